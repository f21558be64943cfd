//! Quantized attributes, copies of nodes, morph targets and skins.

use glam::{DAffine3, DVec3};

use super::*;

const TRIANGLE: [[f32; 3]; 3] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// World-space corners of the only triangle of instance `index`.
fn corners(scene: &Scene, index: usize) -> [DVec3; 3] {
    let instance = &scene.instances[index];
    let mesh = &scene.meshes[instance.mesh as usize];
    mesh.triangles[0]
        .map(|corner| instance.transform.transform_point3(Vec3::from(mesh.positions[corner as usize]).as_dvec3()))
}

fn assert_near(corners: [DVec3; 3], want: [[f64; 3]; 3]) {
    let is_near = |(corner, want): (DVec3, [f64; 3])| (corner - DVec3::from(want)).length() < 1e-5;
    assert!(corners.into_iter().zip(want).all(is_near), "{corners:?} is not {want:?}");
}

#[test]
fn integers_of_all_kinds_are_read() {
    // Component type, whether it is normalized, the bytes of `zero`, `one` and `end`, and their values.
    type Case = (u32, bool, [&'static [u8]; 3], [f32; 3]);
    let cases: [Case; 8] = [
        (5120, false, [&[0], &[127], &[0x80]], [0.0, 127.0, -128.0]),
        (5120, true, [&[0], &[127], &[0x80]], [0.0, 1.0, -1.0]),
        (5121, false, [&[0], &[1], &[255]], [0.0, 1.0, 255.0]),
        (5121, true, [&[0], &[51], &[255]], [0.0, 0.2, 1.0]),
        (5122, false, [&[0, 0], &[1, 0], &[0, 0x80]], [0.0, 1.0, -32768.0]),
        (5122, true, [&[0, 0], &[0xff, 0x7f], &[0, 0x80]], [0.0, 1.0, -1.0]),
        (5123, false, [&[0, 0], &[1, 0], &[0xff, 0xff]], [0.0, 1.0, 65535.0]),
        (5123, true, [&[0, 0], &[0x33, 0x33], &[0xff, 0xff]], [0.0, 0.2, 1.0]),
    ];
    for (component, normalized, [zero, one, end], values) in cases {
        let mut glb = single(&TRIANGLE, json!({}));
        // Elements are aligned to 4 bytes.
        let pad = |element: Vec<u8>| {
            let size = element.len().next_multiple_of(4);
            [element, vec![0; 4]].concat()[..size].to_vec()
        };
        let positions = [[zero, zero, zero], [one, zero, zero], [zero, end, zero]].map(|p| pad(p.concat()));
        let accessor = glb.accessor(&positions.concat(), component, "VEC3", 3);
        glb.json["bufferViews"][accessor]["byteStride"] = json!(positions[0].len());
        glb.json["accessors"][accessor]["normalized"] = json!(normalized);
        let uvs = [[zero, one], [end, zero], [one, end]].map(|uv| pad(uv.concat()));
        let uv = glb.accessor(&uvs.concat(), component, "VEC2", 3);
        glb.json["bufferViews"][uv]["byteStride"] = json!(uvs[0].len());
        glb.json["accessors"][uv]["normalized"] = json!(normalized);
        glb.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": accessor, "TEXCOORD_0": uv });
        glb.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        let scene = read(&glb);
        assert_eq!(scene.warnings, Vec::<String>::new());
        let [zero, one, end] = values;
        assert_eq!(scene.meshes[0].positions, [[zero; 3], [one, zero, zero], [zero, end, zero]], "{component}");
        assert_eq!(scene.meshes[0].uvs, [[zero, one], [end, zero], [one, end]], "{component}");
    }
}

#[test]
fn normals_of_two_bytes_are_normalized() {
    let mut glb = complete();
    let normals: Vec<u8> = [[0i16, 0, 16384, 0]; 3].iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let accessor = glb.accessor(&normals, 5122, "VEC3", 3);
    let view = glb.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
    glb.json["bufferViews"][view]["byteStride"] = json!(8);
    glb.json["accessors"][accessor]["normalized"] = json!(true);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(accessor);
    assert_eq!(read(&glb).meshes[0].normals, [[0.0, 0.0, 1.0]; 3]);
}

#[test]
fn every_copy_of_a_node_is_an_instance_with_its_name() {
    let mut glb = single(&TRIANGLE, json!({}));
    let translation = glb.floats(&[[0.0; 3], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0], [5.0; 3]]);
    let quarter = [0i16, 0, 23170, 23170];
    let rotations = [[0, 0, 0, 32767], quarter, [0, 0, 0, 32767], quarter];
    let bytes: Vec<u8> = rotations.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let rotation = glb.accessor(&bytes, 5122, "VEC4", 4);
    glb.json["accessors"][rotation]["normalized"] = json!(true);
    let scale = glb.floats(&[[1.0; 3], [1.0; 3], [2.0, 3.0, 4.0], [0.0; 3]]);
    let attributes = json!({ "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale });
    glb.json["nodes"] = json!([{
        "name": "grass", "mesh": 0, "scale": [2.0, 2.0, 2.0],
        "extensions": { "EXT_mesh_gpu_instancing": { "attributes": attributes } },
    }]);
    let scene = read(&glb);
    check_invariants(&scene);
    // The fourth copy has no size.
    assert_eq!(scene.warnings, ["node `grass` is scaled to nothing, so its mesh is left out"]);
    assert!(scene.instances.len() == 3 && scene.instances.iter().all(|instance| instance.node == "grass"));
    assert_near(corners(&scene, 0), [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]);
    assert_near(corners(&scene, 1), [[20.0, 0.0, 0.0], [20.0, 2.0, 0.0], [18.0, 0.0, 0.0]]);
    assert_near(corners(&scene, 2), [[0.0, 40.0, 0.0], [4.0, 40.0, 0.0], [0.0, 46.0, 0.0]]);

    // If all attributes are custom, no copy is moved.
    glb.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({ "_ID": translation });
    assert_eq!(read(&glb).instances.len(), 4);
}

#[test]
fn morph_targets_have_the_weights_of_the_node_or_of_the_mesh() {
    let mut glb = complete();
    let up = glb.floats(&[[0.0, 0.0, 1.0]; 3]);
    let right = glb.floats(&[[4.0, 0.0, 0.0]; 3]);
    let tilt = glb.floats(&[[2.0, 0.0, 0.0]; 3]);
    glb.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up }, { "POSITION": right, "NORMAL": tilt }, { "POSITION": 99 }]);
    // The third target has no weight, so it is not read.
    glb.json["meshes"][0]["weights"] = json!([2.0]);
    glb.json["nodes"][1]["weights"] = json!([0.0, 0.5, 0.0]);
    glb.json["nodes"].as_array_mut().unwrap().push(json!({ "name": "copy", "mesh": 0 }));
    glb.json["scenes"][0]["nodes"] = json!([0, 5]);
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert_near(corners(&scene, 0), [[2.0, 0.0, 10.0], [3.0, 0.0, 10.0], [2.0, 1.0, 10.0]]);
    assert_near(corners(&scene, 1), [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]]);
    // The mesh's normal has length 2 along Z; the second target adds half of 2 along X.
    let normal = Vec3::from(scene.meshes[scene.instances[0].mesh as usize].normals[0]);
    assert!((normal - Vec3::new(1.0, 0.0, 2.0).normalize()).length() < 1e-6);
}

#[test]
fn colours_and_coordinates_of_morph_targets_are_warned_about() {
    let warnings = |targets: Value| {
        let mut glb = complete();
        glb.json["meshes"][0]["primitives"][0]["targets"] = targets;
        read(&glb).warnings
    };
    assert_eq!(warnings(json!([{ "POSITION": 0, "NORMAL": 0, "TANGENT": 0 }, {}])), Vec::<String>::new());
    for target in [json!({ "COLOR_0": 0 }), json!({ "POSITION": 0, "TEXCOORD_1": 3 })] {
        let warnings = warnings(json!([{ "POSITION": 0 }, target]));
        assert!(warnings.len() == 1 && warnings[0].contains("morph targets move no colours"), "{warnings:?}");
    }
}

/// The complete scene, but with a skin with two joints. Node 5 is at (100, 0, 0); node 6 makes a quarter turn about Z.
fn skinned(weights: [[f32; 4]; 3]) -> Glb {
    let mut glb = complete();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    glb.push("nodes", json!({ "name": "still", "translation": [100.0, 0.0, 0.0] }));
    glb.push("nodes", json!({ "name": "turned", "rotation": [0.0, 0.0, half, half] }));
    glb.json["scenes"][0]["nodes"] = json!([0, 5, 6]);
    let lower = glam::Mat4::from_translation(Vec3::new(0.0, 0.0, -1.0)).to_cols_array();
    let matrices = glb.floats(&[lower, glam::Mat4::IDENTITY.to_cols_array()]);
    glb.push("skins", json!({ "joints": [5, 6], "inverseBindMatrices": matrices }));
    glb.json["nodes"][1]["skin"] = json!(0);
    glb.json["nodes"][1]["translation"] = json!([7.0, 7.0, 7.0]);
    let joints = glb.accessor(&[0, 1, 0, 0].repeat(3), 5121, "VEC4", 3);
    let weights = glb.floats(&weights);
    let attributes = &mut glb.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    glb
}

#[test]
fn skinned_meshes_follow_their_joints_at_rest() {
    let weights = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0]];
    let mut glb = skinned(weights);
    glb.json["nodes"].as_array_mut().unwrap().push(json!({ "name": "stiff", "mesh": 0 }));
    glb.json["scenes"][0]["nodes"] = json!([0, 5, 6, 7]);
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!(scene.warnings, Vec::<String>::new());
    // The transform of a skinned mesh's node, here to (7, 7, 17), has no effect. The joints move vertex (0, 1, 0) to (100, 1, -1)
    // and to (-1, 0, 0). With equal weights, the vertex is halfway between.
    let want = [[100.0, 0.0, -1.0], [0.0, 1.0, 0.0], [49.5, 0.5, -0.5]];
    assert_near(corners(&scene, 0), want);
    // A node without the skin shares the glTF mesh, but not its pose.
    assert_near(corners(&scene, 1), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);

    // Weights are divided by their sum; vertices without weights follow the first joint.
    let scene = read(&skinned([[0.0; 4], [0.0, 7.0, 0.0, 0.0], [3.0, 3.0, 0.0, 0.0]]));
    assert_near(corners(&scene, 0), want);
}

/// glTF places a skinned mesh by its joints, so copies would all lie at one place.
#[test]
fn copies_of_a_skinned_node_are_warned_about() {
    let mut glb = skinned([[1.0, 0.0, 0.0, 0.0]; 3]);
    let translation = glb.floats(&[[0.0; 3], [10.0, 0.0, 0.0]]);
    let attributes = json!({ "attributes": { "TRANSLATION": translation } });
    glb.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": attributes });
    let scene = read(&glb);
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("node `tri`"), "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("EXT_mesh_gpu_instancing") && scene.instances.len() == 1);
}

#[test]
fn normals_turn_with_their_joint() {
    let mut glb = skinned([[0.0, 1.0, 0.0, 0.0]; 3]);
    // A normal between X and Y, and a joint that stretches X before it turns X to Y.
    let normals = glb.floats(&[[1.0, 1.0, 0.0]; 3]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    glb.json["nodes"][6]["scale"] = json!([2.0, 1.0, 1.0]);
    let normal = Vec3::from(read(&glb).meshes[0].normals[0]);
    // The normal shrinks along the stretched axis, to (1/2, 1), and then makes a quarter turn.
    assert!((normal - Vec3::new(-1.0, 0.5, 0.0).normalize()).length() < 1e-6, "{normal}");
}

#[test]
fn a_joint_that_mirrors_reverses_the_winding() {
    let mut glb = skinned([[0.0, 1.0, 0.0, 0.0]; 3]);
    glb.json["nodes"][6]["scale"] = json!([1.0, 1.0, -1.0]);
    let scene = read(&glb);
    let [a, b, c] = corners(&scene, 0);
    let front = (b - a).cross(c - a);
    let normal = Vec3::from(scene.meshes[0].normals[0]).as_dvec3();
    // The mirrored triangle lies in the same plane, and its front is on the other side.
    assert!(front.z < 0.0 && normal.z < -0.999, "{front} {normal}");
}

#[test]
fn a_skin_with_joints_outside_the_scene_is_left_out() {
    let mut glb = skinned([[1.0, 0.0, 0.0, 0.0]; 3]);
    glb.json["scenes"][0]["nodes"] = json!([0, 5]);
    let scene = read(&glb);
    assert!(scene.warnings[0].contains("skin `skin 0` has joints outside the scene"), "{:?}", scene.warnings);
    assert!(scene.instances[0].transform.abs_diff_eq(DAffine3::from_translation(DVec3::new(7.0, 7.0, 17.0)), 1e-12));
}
