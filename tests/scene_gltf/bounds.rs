//! Small files that would take long or fill the memory: accessors that many objects share, and vertices that many triangles share.

use super::*;

/// An accessor of zeros that takes no bytes.
fn zeros(glb: &mut Glb, shape: &str, count: usize) -> usize {
    glb.push("accessors", json!({ "componentType": 5126, "type": shape, "count": count }))
}

fn copied(glb: &mut Glb, node: usize, translations: usize) {
    let attributes = json!({ "TRANSLATION": translations });
    glb.json["nodes"][node]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
}

/// Copies that are left out count, except those of nodes without triangles, which are not even read.
#[test]
fn copies_are_counted_even_if_they_have_no_size() {
    const COPIES: usize = 1 << 18;
    let tetrahedron = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let mut glb = single(&tetrahedron, json!({}));
    let many = zeros(&mut glb, "VEC3", COPIES);
    for node in 0..17 {
        if node > 0 {
            glb.push("nodes", json!({ "mesh": 0 }));
        }
        glb.json["nodes"][node]["scale"] = json!([0, 0, 0]);
        copied(&mut glb, node, many);
    }
    assert!(refusal(&glb.build()).contains("more than 4 million instances"));
    glb.json["nodes"].as_array_mut().unwrap().truncate(2);
    assert!(read(&glb).warnings.iter().any(|warning| warning.contains("scaled to nothing")));

    let wrong = zeros(&mut glb, "VEC4", 3);
    copied(&mut glb, 1, wrong);
    assert!(refusal(&glb.build()).contains("VEC3"));
    let points = glb.json["meshes"][0]["primitives"][0].clone();
    let mesh = glb.push("meshes", json!({ "primitives": [points] }));
    glb.json["meshes"][mesh]["primitives"][0]["mode"] = json!(0);
    glb.json["nodes"][1]["mesh"] = json!(mesh);
    read(&glb);
}

#[test]
fn vertices_of_morph_targets_are_counted() {
    let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    let vertices = zeros(&mut glb, "VEC3", 3 << 16);
    let primitive = &mut glb.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["POSITION"] = json!(vertices);
    primitive["targets"] = json!(vec![json!({ "POSITION": vertices }); 1100]);
    glb.json["meshes"][0]["weights"] = json!(vec![1.0; 1100]);
    assert!(refusal(&glb.build()).contains("morph targets included"));
    glb.json["meshes"][0]["weights"] = json!([0.0, 1.0, 0.0]);
    read(&glb);
}

#[test]
fn matrices_of_skins_are_counted() {
    let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    let matrices = zeros(&mut glb, "MAT4", 1 << 18);
    for skin in 0..17 {
        glb.push("skins", json!({ "joints": [0], "inverseBindMatrices": matrices }));
        glb.push("nodes", json!({ "mesh": 0, "skin": skin }));
    }
    assert!(refusal(&glb.build()).contains("the skins have more than 4194304 matrices"));
}

/// A fan of triangles around one vertex, with a normal map.
fn fan(triangles: usize) -> Glb {
    let angle = |i: usize| i as f32 / (triangles + 1) as f32 * std::f32::consts::TAU;
    let rim = (0..=triangles).map(|i| [angle(i).cos(), angle(i).sin(), 0.0]);
    let positions: Vec<[f32; 3]> = [[0.0; 3]].into_iter().chain(rim).collect();
    let uvs: Vec<[f32; 2]> = positions.iter().map(|&[x, y, _]| [x, y]).collect();
    let mut glb = complete();
    let (position, uv) = (glb.floats(&positions), glb.floats(&uvs));
    let attributes = json!({ "POSITION": position, "TEXCOORD_0": uv });
    glb.json["meshes"][0]["primitives"] = json!([{ "attributes": attributes, "mode": 6, "material": 0 }]);
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    glb
}

/// The time for the tangents of a vertex grows with the square of its triangles, and their recursion needs stack.
#[test]
fn a_vertex_with_too_many_triangles_leaves_the_normal_map_out() {
    let scene = read(&fan(4000));
    assert!(scene.warnings.is_empty() && !scene.meshes[0].tangents.is_empty(), "{:?}", scene.warnings);
    let scene = read(&fan(100_000));
    check_invariants(&scene);
    let material = &scene.materials[scene.meshes[0].material as usize];
    assert_eq!((material.normal_texture, material.base_color_texture), (None, Some(0)));
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("export the tangents too (first: Tri[0])"));
}

/// Three megabytes of empty objects once took a gigabyte.
#[cfg(target_os = "linux")]
#[test]
fn lists_that_are_too_long_are_refused_before_their_elements_take_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    for (list, element, limit) in [
        ("nodes", "{}", 250_000),
        ("nodes", r#"{"translation":[0,0,0]}"#, 1_000_000),
        ("materials", "{}", 250_000),
        ("textures", r#"{"source":0}"#, 250_000),
        ("animations", r#"{"a":0}"#, 250_000),
    ] {
        // A list that is longer by many elements was once accepted.
        for count in [limit + 1, 3 * limit] {
            let elements = vec![element; count].join(",");
            std::fs::write(&path, format!(r#"{{"asset":{{"version":"2.0"}},"{list}":[{elements}]}}"#)).unwrap();
            let (peak, outcome) = crate::peak::peak("textures::helper_peak", &path);
            // Long texts may have more nodes.
            assert!(outcome.contains("has more than ") && outcome.contains(&format!(" {list}; ")), "{outcome}");
            assert!(peak < 64 + (std::fs::metadata(&path).unwrap().len() >> 20), "{list}: {peak} MiB");
        }
    }
    // Animations that are not played take no more memory than their text.
    let nested = vec![r#"{"":0}"#; 500_000].join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"animations":[{{"a":[{nested}]}}]}}"#);
    std::fs::write(&path, text).unwrap();
    let (peak, outcome) = crate::peak::peak("textures::helper_peak", &path);
    assert!(outcome == "0 images" && peak < 64, "{peak} MiB: {outcome}");
}
