//! Good files: the scenes that the reader makes of them.

use std::path::PathBuf;

use base64::Engine;
use glam::DVec3;
use taugate::internals::scene::gltf::load;
use taugate::internals::scene::{AlphaMode, Instance, LightKind, Projection, Wrap};

use super::*;

#[test]
fn a_complete_file_is_read() {
    let scene = read(&complete());
    check_invariants(&scene);
    assert_eq!(scene.warnings, Vec::<String>::new());

    let mesh = &scene.meshes[0];
    assert_eq!(mesh.name, "Tri[0]");
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.normals[1], [0.0, 0.0, 1.0]);
    assert_eq!(mesh.uvs[2], [0.0, 1.0]);
    assert_eq!((scene.instances[0].node.as_str(), scene.instances[0].transform.translation), ("tri", DVec3::Z * 10.0));

    let material = &scene.materials[0];
    assert_eq!((material.base_color, material.metallic, material.roughness), ([0.5, 0.25, 1.0, 1.0], 0.0, 0.75));
    assert_eq!((material.emission, material.specular, material.ior), ([4.0, 2.0, 0.0], 1.0, 1.25));
    assert_eq!((material.transmission, material.alpha_mode), (0.125, AlphaMode::Mask(0.25)));
    assert!(material.double_sided);
    assert_eq!((material.base_color_texture, material.emission_texture), (Some(0), None));
    assert_eq!((scene.textures[0].wrap, scene.textures[0].linear), ([Wrap::Clamp, Wrap::Mirror], false));
    let image = &scene.images[0];
    assert_eq!(
        (image.width, image.height, image.rgba[1], image.rgba[3]),
        (2, 2, [0, 255, 0, 255], [255, 255, 255, 128])
    );

    let camera = &scene.cameras[0];
    let projection = Projection::Perspective { yfov: 0.5 };
    assert_eq!((camera.name.as_str(), &camera.projection, camera.aspect), ("eye", &projection, Some(2.0)));
    assert_eq!((camera.resolution, camera.principal_point), (Some([64, 32]), [0.5, 0.5]));
    assert!(camera.transform.abs_diff_eq(glam::DAffine3::from_translation(DVec3::Z * 10.0), 1e-12));

    let [lamp, laser] = &scene.lights[..] else { panic!() };
    assert_eq!((lamp.node.as_str(), lamp.direction), ("lamp", DVec3::NEG_Z));
    assert_eq!(lamp.kind, LightKind::Spot { intensity: [8.0, 4.0, 2.0], inner: 0.25, outer: 0.5 });
    assert!(laser.direction.abs_diff_eq(DVec3::Z, 1e-12));
    assert_eq!(laser.kind, LightKind::Beam { power: [1.0, 2.0, 3.0], radius: 0.5 });
}

#[test]
fn nested_nodes_compose_and_share_their_mesh() {
    let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    glb.json["nodes"] = json!([
        { "translation": [1.0, 0.0, 0.0], "scale": [2.0, 2.0, 2.0], "children": [1, 2] },
        { "mesh": 0, "translation": [0.0, 3.0, 0.0] },
        { "mesh": 0, "name": "mirror", "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 4, 1] },
        { "mesh": 0, "scale": [1.0, 0.0, 1.0] },
    ]);
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!(scene.meshes.len(), 1);
    let [plain, mirror] = &scene.instances[..] else { panic!("{:?}", scene.instances) };
    assert_eq!(plain.node, "node 1");
    assert_eq!(plain.transform.transform_point3(DVec3::ONE), DVec3::new(3.0, 8.0, 2.0));
    assert_eq!(mirror.transform.transform_point3(DVec3::ONE), DVec3::new(-1.0, 2.0, 10.0));
    assert!(scene.warnings[0].contains("`node 3` is scaled to nothing"), "{:?}", scene.warnings);
}

/// Some exporters round the last row of a matrix.
#[test]
fn a_matrix_may_have_a_rounded_last_row() {
    let mut glb = complete();
    glb.json["nodes"][1]["matrix"] = json!([1, 0, 0, 1e-7, 0, 1, 0, -1e-7, 0, 0, 1, 0, 2, 0, 0, 0.9999999]);
    assert_eq!(read(&glb).instances[0].transform.translation, DVec3::new(2.0, 0.0, 10.0));
    glb.json["nodes"][1]["matrix"][15] = json!(0.999);
    assert!(refusal(&glb.build()).contains("is not affine"));
}

/// Exporters flatten planes with a scale of 0 along their normal.
#[test]
fn a_flat_mesh_may_have_a_scale_of_0_along_its_normal() {
    let local = [DVec3::new(0.0, 0.0, 5.0), DVec3::new(1.0, 0.0, 5.0), DVec3::new(0.0, 1.0, 5.0)];
    let mut glb = single(&local.map(|p| p.as_vec3().to_array()), json!({}));
    let quarter = std::f64::consts::FRAC_1_SQRT_2;
    for x in [2.0, -2.0] {
        glb.json["nodes"] = json!([{
            "mesh": 0, "translation": [7, 0, 0], "rotation": [quarter, 0, 0, quarter], "scale": [x, 3.0, 0.0]
        }]);
        let scene = read(&glb);
        check_invariants(&scene);
        assert_eq!(scene.warnings, Vec::<String>::new());
        let transform = scene.instances[0].transform;
        // The rotation turns y to z.
        for (p, expected) in local.into_iter().zip([[7.0, 0.0, 0.0], [7.0 + x, 0.0, 0.0], [7.0, 0.0, 3.0]]) {
            let place = transform.transform_point3(p);
            assert!(place.abs_diff_eq(DVec3::from(expected), 1e-6), "{place} {expected:?}");
        }
        assert!(transform.matrix3.determinant() > 0.0, "the mesh is not mirrored");
    }
}

#[test]
fn strips_and_fans_keep_their_winding() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let strip = read(&single(&corners, json!({ "mode": 5 })));
    assert_eq!(strip.meshes[0].triangles, [[0, 1, 2], [1, 3, 2]]);
    let around = [corners[0], corners[1], corners[3], corners[2]];
    let mut fan = single(&around, json!({ "mode": 6 }));
    let indices = fan.indices(&[0, 1, 2, 3]);
    fan.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert_eq!(read(&fan).meshes[0].triangles, [[1, 2, 0], [2, 3, 0]]);
}

#[test]
fn triangles_of_zero_area_and_unused_vertices_are_dropped() {
    let corners = [[9.0; 3], [0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut glb = single(&corners, json!({}));
    let indices = glb.indices(&[1, 1, 2, 1, 2, 3, 1, 2, 4]);
    glb.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let scene = read(&glb);
    assert_eq!(scene.meshes[0].triangles, [[0, 1, 2]]);
    assert_eq!(scene.meshes[0].positions, [corners[1], corners[2], corners[4]]);
    assert_eq!(scene.warnings, ["2 triangles of zero area are left out"]);
}

#[test]
fn normals_of_zero_length_make_the_mesh_flat() {
    let mut glb = complete();
    glb.bin[44..56].fill(0);
    let scene = read(&glb);
    assert!(scene.meshes[0].normals.is_empty());
    assert!(scene.warnings[0].contains("Tri[0]"), "{:?}", scene.warnings);
}

#[test]
fn sparse_accessors_patch_zeros_or_a_view() {
    let mut glb = complete();
    let at = glb.view(&[2]);
    let values = glb.view(&[5.0f32, 6.0, 7.0].map(f32::to_le_bytes).concat());
    let indices = json!({ "bufferView": at, "componentType": 5121 });
    glb.json["accessors"][0]["sparse"] = json!({ "count": 1, "indices": indices, "values": { "bufferView": values } });
    assert_eq!(read(&glb).meshes[0].positions, [[0.0; 3], [1.0, 0.0, 0.0], [5.0, 6.0, 7.0]]);
    glb.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(read(&glb).warnings.last().unwrap().contains("only 1 of zero area"));
}

#[test]
fn interleaved_vertices_and_normalized_coordinates_are_read() {
    let mut glb = single(&[[0.0; 3], [0.0; 3], [1.0, 0.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0], [0.0; 3]], json!({}));
    glb.json["bufferViews"][0]["byteStride"] = json!(24);
    glb.json["accessors"][0]["count"] = json!(3);
    let uv = glb.accessor(&[0, 0, 255, 0, 0, 255], 5121, "VEC2", 3);
    glb.json["accessors"][uv]["normalized"] = json!(true);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uv);
    let mesh = &read(&glb).meshes[0];
    assert_eq!(mesh.positions[2], [0.0, 1.0, 0.0]);
    assert_eq!(mesh.uvs, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
}

#[test]
fn metallic_roughness_textures_are_read() {
    let mut glb = complete();
    glb.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": 0 });
    let scene = read(&glb);
    assert_eq!((scene.materials[0].surface_texture, scene.warnings), (Some(0), vec![]));
    // The texture does not replace the factors.
    assert_eq!((scene.materials[0].metallic, scene.materials[0].roughness), (0.0, 0.75));
}

#[test]
fn vertex_colours_are_read() {
    // Bytes, words and floats. The floats have no alpha, and some of them are outside [0, 1].
    let bytes = [255, 0, 51, 102, 0, 255, 0, 255, 0, 0, 0, 0];
    let words: Vec<u8> = bytes.iter().flat_map(|&b| (u16::from(b) * 257).to_le_bytes()).collect();
    let mut glb = complete();
    let (bytes, words) = (glb.accessor(&bytes, 5121, "VEC4", 3), glb.accessor(&words, 5123, "VEC4", 3));
    for integers in [bytes, words] {
        glb.json["accessors"][integers]["normalized"] = json!(true);
        glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(integers);
        let scene = read(&glb);
        assert_eq!(scene.meshes[0].colors, [[1.0, 0.0, 0.2, 0.4], [0.0, 1.0, 0.0, 1.0], [0.0; 4]]);
        assert_eq!(scene.warnings, Vec::<String>::new());
    }
    let floats = glb.floats(&[[1.5, 0.25, -1.0], [0.0, 0.5, 1.0], [1.0; 3]]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(floats);
    assert_eq!(read(&glb).meshes[0].colors, [[1.0, 0.25, 0.0, 1.0], [0.0, 0.5, 1.0, 1.0], [1.0; 4]]);
}

#[test]
fn normal_maps_get_tangents() {
    let mut glb = complete();
    assert!(read(&glb).meshes[0].tangents.is_empty());
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0, "scale": 0.5 });
    let scene = read(&glb);
    assert_eq!((scene.materials[0].normal_texture, scene.materials[0].normal_scale), (Some(0), 0.5));
    // u runs along x and v along y, so green, which points up in the image, points along -y.
    assert_eq!(scene.meshes[0].tangents, [[1.0, 0.0, 0.0, -1.0]; 3]);
    check_invariants(&scene);

    let tangents = glb.floats(&[[0.0, 2.0, 0.0, 1.0]; 3]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(tangents);
    assert_eq!(read(&glb).meshes[0].tangents, [[0.0, 1.0, 0.0, 1.0]; 3]);
    // The tangents of a mesh without texture coordinates are ignored, because its normal map cannot be looked up. For a mesh without
    // normals, the tangents of the file are replaced by computed ones.
    let without = |names: &[&str]| {
        let mut glb = glb.clone();
        let attributes = glb.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
        names.iter().for_each(|name| drop(attributes.remove(*name)));
        read(&glb).meshes[0].tangents.clone()
    };
    assert_eq!(without(&["NORMAL"]), [[1.0, 0.0, 0.0, -1.0]; 3]);
    assert!(without(&["TEXCOORD_0"]).is_empty() && without(&["NORMAL", "TEXCOORD_0"]).is_empty());
}

#[test]
fn what_is_not_read_is_warned_about_once() {
    let mut glb = complete();
    glb.json["extensionsUsed"] = json!(["KHR_materials_sheen"]);
    let copy = glb.json["materials"][0].clone();
    glb.push("materials", copy);
    let primitive = json!({ "attributes": { "POSITION": 0 }, "mode": 1 });
    glb.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    let scene = read(&glb);
    let words = ["sheen", "points or lines"];
    assert_eq!(scene.warnings.len(), words.len(), "{:?}", scene.warnings);
    for (warning, word) in scene.warnings.iter().zip(words) {
        assert!(warning.contains(word), "{warning}");
    }
}

#[test]
fn factors_out_of_range_are_moved_to_its_edge_with_a_warning() {
    let mut glb = complete();
    glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5, 2.0, 0.0, 1.0]);
    assert_eq!(read(&glb).materials[0].base_color, [0.5, 1.0, 0.0, 1.0]);
    glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5, 1.0, 0.0, 1.0]);
    assert_eq!(read(&glb).warnings, Vec::<String>::new());
    for (pointer, value, word) in [
        (
            "/pbrMetallicRoughness/baseColorFactor",
            json!([0.5, 1.25, 0.5, 1.0]),
            "baseColorFactor of material `Paint` (1.25)",
        ),
        ("/pbrMetallicRoughness/metallicFactor", json!(-0.5), "metallicFactor of material `Paint` (-0.5)"),
        ("/pbrMetallicRoughness/roughnessFactor", json!(3), "roughnessFactor of material `Paint` (3)"),
        ("/extensions/KHR_materials_specular/specularFactor", json!(1.5), "specularFactor of material `Paint` (1.5)"),
        (
            "/extensions/KHR_materials_transmission/transmissionFactor",
            json!(2),
            "transmissionFactor of material `Paint` (2)",
        ),
    ] {
        let mut wrong = glb.clone();
        *wrong.json["materials"][0].pointer_mut(pointer).unwrap() = value;
        let scene = read(&wrong);
        check_invariants(&scene);
        assert!(scene.warnings.len() == 1 && scene.warnings[0].ends_with(word), "{pointer}: {:?}", scene.warnings);
    }
    // Many such factors give one warning together.
    for _ in 0..20 {
        glb.push("materials", json!({ "name": "Neon", "pbrMetallicRoughness": { "baseColorFactor": [2, 0, 0, 1] } }));
    }
    let warnings = read(&glb).warnings;
    assert!(warnings.len() == 1 && warnings[0].ends_with("material `Neon` (2), and 12 more"), "{warnings:?}");
}

#[test]
fn a_primitive_without_material_gets_the_default() {
    let scene = read(&single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({})));
    assert_eq!(scene.materials.len(), 1);
    assert_eq!((scene.materials[0].metallic, scene.materials[0].ior), (1.0, 1.5));
}

#[test]
fn buffers_come_from_data_uris_and_files() {
    let data = base64::engine::general_purpose::STANDARD.encode(complete().bin);
    let scene = load_slice(&text(&format!("data:application/octet-stream;base64,{data}")), Path::new("a.gltf"));
    check_invariants(&scene.unwrap());

    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    std::fs::write(folder.path().join("data/a b.bin"), complete().bin).unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, text("data/a%20b.bin")).unwrap();
    check_invariants(&load(&path).unwrap());

    std::fs::write(&path, text("absent.bin")).unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("buffer 0") && message.contains("absent.bin"), "{message}");
    let message = load(&folder.path().join("absent.glb")).unwrap_err().to_string();
    assert!(message.contains("absent.glb") && message.contains("cannot be read"), "{message}");
    assert!(load(folder.path()).unwrap_err().to_string().contains("not a regular file"));
}

#[test]
fn deep_pngs_and_jpegs_beside_the_scene_are_read() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("deep.png"), images::png([2, 1, 16, 0, 0], &[], &[0, 0x80, 0, 0x80, 0])).unwrap();
    std::fs::write(folder.path().join("grey.jpg"), images::jpeg(images::YCBCR, &[[128; 3]])).unwrap();
    let path = folder.path().join("scene.glb");
    let mut glb = complete();
    for (file, deep) in [("deep.png", true), ("grey.jpg", false)] {
        glb.json["images"][0] = json!({ "uri": file });
        std::fs::write(&path, glb.build()).unwrap();
        let scene = load(&path).unwrap();
        assert!(scene.images[0].rgba.iter().all(|texel| *texel == [128, 128, 128, 255]), "{:?}", scene.images);
        assert_eq!(scene.warnings.iter().any(|warning| warning.contains("16 bits")), deep);
    }
}

/// Reads the benchmark scenes in `../shared/scenes`, or in the folder that `TAUGATE_SHARED_SCENES` names, if the folder exists.
#[test]
fn shared_scenes_are_read() {
    let folder = std::env::var_os("TAUGATE_SHARED_SCENES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: {} is missing", folder.display());
        return;
    }
    // Name of the scene, number of cameras, number of punctual lights and beams.
    let known = [
        ("bedroom", 1, 1),
        ("city", 2, 1),
        ("cornell-spot", 1, 0),
        ("dining-room", 1, 1),
        ("staircase", 1, 0),
        ("tunnel", 1, 1),
        ("veach-ajar", 1, 1),
    ];
    for (name, cameras, lights) in known {
        let start = std::time::Instant::now();
        let scene = load(&folder.join(name).join("scene.glb")).unwrap();
        println!("{name}: {:?}, {:?}", start.elapsed(), scene.warnings);
        check_invariants(&scene);
        let facts = std::fs::read(folder.join(name).join("scene.json")).unwrap();
        let facts: Value = serde_json::from_slice(&facts).unwrap();
        let count = |instance: &Instance| scene.meshes[instance.mesh as usize].triangles.len() as u64;
        let triangles: u64 = scene.instances.iter().map(count).sum();
        let degenerate = facts["degenerate_triangles"].as_u64().unwrap();
        assert_eq!(triangles, facts["triangles"].as_u64().unwrap() - degenerate, "{name}");
        assert_eq!((scene.cameras.len(), scene.lights.len()), (cameras, lights), "{name}");
    }
}
