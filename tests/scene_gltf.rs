//! The glTF reader: what good files become, and that bad ones are refused by name and never panic.

#[path = "common/glb.rs"]
mod glb;

use std::path::{Path, PathBuf};

use base64::Engine;
use glam::{DVec3, Vec3};
use glb::{Glb, complete};
use serde_json::{Value, json};
use taugate::Error;
use taugate::scene::gltf::{load, load_slice};
use taugate::scene::{AlphaMode, Instance, LightKind, Scene, Wrap};

fn read(glb: &Glb) -> Scene {
    load_slice(&glb.build(), Path::new("test.glb")).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    match load_slice(bytes, Path::new("test.glb")) {
        Ok(_) => panic!("was accepted"),
        Err(Error::Scene { message, .. }) => message,
        Err(other) => panic!("wrong kind of error: {other}"),
    }
}

/// A file with one mesh of one primitive, `extra` merged into the primitive.
fn single(positions: &[[f32; 3]], extra: Value) -> Glb {
    let mut glb = Glb::new();
    let position = glb.floats(positions);
    let mut primitive = json!({ "attributes": { "POSITION": position } });
    primitive.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    glb.push("meshes", json!({ "primitives": [primitive] }));
    glb.push("nodes", json!({ "mesh": 0 }));
    glb
}

/// The promises of `scene/mod.rs` that every accepted file must keep.
fn check_promises(scene: &Scene) {
    assert!(!scene.materials.is_empty() && !scene.instances.is_empty());
    for mesh in &scene.meshes {
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < mesh.positions.len()));
        assert!(mesh.positions.iter().flatten().chain(mesh.uvs.iter().flatten()).all(|value| value.is_finite()));
        assert!(mesh.normals.iter().all(|&normal| (Vec3::from(normal).length() - 1.0).abs() < 1e-5));
        assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
        assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.positions.len());
        assert!((mesh.material as usize) < scene.materials.len());
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len());
        assert!(instance.transform.is_finite() && instance.transform.matrix3.determinant() != 0.0);
    }
    for material in &scene.materials {
        let unit = [material.metallic, material.roughness, material.specular, material.transmission];
        assert!(material.base_color.iter().chain(&unit).all(|value| (0.0..=1.0).contains(value)));
        assert!(material.emission.iter().all(|value| value.is_finite() && *value >= 0.0) && material.ior >= 1.0);
        let textures = [material.base_color_texture, material.emission_texture];
        assert!(textures.into_iter().flatten().all(|texture| (texture as usize) < scene.textures.len()));
    }
    assert!(scene.textures.iter().all(|texture| (texture.image as usize) < scene.images.len()));
    assert!(scene.images.iter().all(|image| image.rgba.len() == image.width as usize * image.height as usize));
    for light in &scene.lights {
        assert!(light.position.is_finite() && (light.direction.length() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_complete_file_is_read() {
    let scene = read(&complete());
    check_promises(&scene);
    assert_eq!(scene.warnings, Vec::<String>::new());

    let mesh = &scene.meshes[0];
    assert_eq!(mesh.name, "Tri[0]");
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.normals[1], [0.0, 0.0, 1.0]);
    assert_eq!(mesh.uvs[2], [0.0, 1.0]);
    assert_eq!((scene.instances[0].node.as_str(), scene.instances[0].transform.translation), ("tri", DVec3::Z * 10.0));

    let material = &scene.materials[0];
    assert_eq!((material.base_color, material.metallic, material.roughness), ([0.5, 0.25, 1.0, 1.0], 0.0, 0.75));
    assert_eq!((material.emission, material.specular, material.ior), ([4.0, 2.0, 0.0], 0.5, 1.25));
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
    assert_eq!((camera.name.as_str(), camera.yfov, camera.aspect), ("eye", 0.5, Some(2.0)));
    assert_eq!(camera.resolution, Some([64, 32]));
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
    check_promises(&scene);
    assert_eq!(scene.meshes.len(), 1);
    let [plain, mirror] = &scene.instances[..] else { panic!("{:?}", scene.instances) };
    assert_eq!(plain.node, "node 1");
    assert_eq!(plain.transform.transform_point3(DVec3::ONE), DVec3::new(3.0, 8.0, 2.0));
    assert_eq!(mirror.transform.transform_point3(DVec3::ONE), DVec3::new(-1.0, 2.0, 10.0));
    assert!(scene.warnings[0].contains("`node 3` is scaled to nothing"), "{:?}", scene.warnings);
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
    assert!(refusal(&glb.build()).contains("only 1 of zero area"));
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
fn texture_transforms_are_baked_into_the_coordinates() {
    let mut glb = complete();
    let quarter = std::f32::consts::FRAC_PI_2;
    let transform = json!({ "offset": [10.0, 20.0], "rotation": quarter, "scale": [2.0, 3.0] });
    let info = &mut glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    info["extensions"] = json!({ "KHR_texture_transform": transform });
    let uvs = read(&glb).meshes[0].uvs.clone();
    // Scaled, then turned counter-clockwise on a v axis that points down, then moved.
    for (uv, want) in uvs.iter().zip([[10.0, 20.0], [10.0, 18.0], [13.0, 20.0]]) {
        assert!((uv[0] - want[0]).abs() < 1e-5 && (uv[1] - want[1]).abs() < 1e-5, "{uvs:?}");
    }
    glb.json["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
    let scene = read(&glb);
    assert_eq!(scene.meshes[0].uvs[1], [1.0, 0.0]);
    assert!(scene.warnings[0].contains("texture transforms"), "{:?}", scene.warnings);
}

#[test]
fn what_is_not_read_is_warned_about_once() {
    let mut glb = complete();
    glb.json["extensionsUsed"] = json!(["KHR_materials_clearcoat"]);
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    let copy = glb.json["materials"][0].clone();
    glb.push("materials", copy);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(2);
    let primitive = json!({ "attributes": { "POSITION": 0 }, "mode": 1 });
    glb.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    glb.json["cameras"][0] = json!({
        "type": "orthographic", "orthographic": { "xmag": 1.0, "ymag": 1.0, "zfar": 1.0, "znear": 0.0 },
    });
    let scene = read(&glb);
    assert!(scene.cameras.is_empty());
    let words = ["clearcoat", "normal textures", "vertex colours", "points or lines", "orthographic"];
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
        check_promises(&scene);
        assert!(scene.warnings.len() == 1 && scene.warnings[0].ends_with(word), "{pointer}: {:?}", scene.warnings);
    }
    // Many of them: one sentence.
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

/// The complete scene as `.gltf`, its buffer behind `uri`.
fn text(uri: &str) -> Vec<u8> {
    let mut glb = complete();
    glb.json["buffers"][0]["uri"] = json!(uri);
    serde_json::to_vec_pretty(&glb.json).unwrap()
}

#[test]
fn buffers_come_from_data_uris_and_files() {
    let data = base64::engine::general_purpose::STANDARD.encode(complete().bin);
    let scene = load_slice(&text(&format!("data:application/octet-stream;base64,{data}")), Path::new("a.gltf"));
    check_promises(&scene.unwrap());

    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    std::fs::write(folder.path().join("data/a b.bin"), complete().bin).unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, text("data/a%20b.bin")).unwrap();
    check_promises(&load(&path).unwrap());

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
    let deep = image::DynamicImage::ImageLuma16(image::ImageBuffer::from_pixel(2, 1, image::Luma([0x8000])));
    deep.save(folder.path().join("deep.png")).unwrap();
    let grey = image::DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(8, 8, image::Rgb([128; 3])));
    grey.save(folder.path().join("grey.jpg")).unwrap();
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

#[test]
fn files_outside_the_folder_of_the_scene_are_refused() {
    let outside = tempfile::tempdir().unwrap();
    let folder = tempfile::tempdir_in(outside.path()).unwrap();
    let secret = outside.path().join("secret.bin");
    std::fs::write(&secret, complete().bin).unwrap();
    let path = folder.path().join("scene.gltf");
    let absolute = secret.to_str().unwrap();
    let file_uri = format!("file://{absolute}");
    let uris = [
        absolute,
        file_uri.as_str(),
        "../secret.bin",
        "%2e%2e/secret.bin",
        "x/../../secret.bin",
        "a%FFb",
        "a%00",
        "C:/secret.bin",
        "\\\\host\\secret.bin",
        "http://host/secret.bin",
        "",
    ];
    for uri in uris {
        std::fs::write(&path, text(uri)).unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains("buffer 0 refers to"), "{uri}: {message}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, folder.path().join("link.bin")).unwrap();
        std::fs::write(&path, text("link.bin")).unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains("outside the folder"), "{message}");
    }
}

/// A change to the complete scene and the words its refusal must contain.
type Case = (&'static str, fn(&mut Glb), &'static [&'static str]);

const HUGE: u64 = u64::MAX - 8;

#[rustfmt::skip]
const HOSTILE: &[Case] = &[
    ("accessor beyond its view", |g| g.json["accessors"][0]["count"] = json!(4), &["accessor 0", "POSITION of Tri[0]", "beyond"]),
    ("view beyond its buffer", |g| g.json["bufferViews"][0]["byteLength"] = json!(100_000), &["bufferView 0", "beyond"]),
    ("stride below element", |g| g.json["bufferViews"][0]["byteStride"] = json!(4), &["accessor 0", "byteStride"]),
    ("stride zero", |g| g.json["bufferViews"][0]["byteStride"] = json!(0), &["accessor 0", "byteStride"]),
    ("stride near 2^64", |g| g.json["bufferViews"][0]["byteStride"] = json!(HUGE), &["accessor 0", "beyond"]),
    ("count zero", |g| g.json["accessors"][0]["count"] = json!(0), &["accessor 0", "no elements"]),
    ("count near 2^64", |g| g.json["accessors"][0]["count"] = json!(HUGE), &["accessor 0", "elements"]),
    ("accessor offset near 2^64", |g| g.json["accessors"][0]["byteOffset"] = json!(HUGE), &["accessor 0", "beyond"]),
    ("view offset near 2^64", |g| g.json["bufferViews"][0]["byteOffset"] = json!(HUGE), &["bufferView 0", "beyond"]),
    ("view length near 2^64", |g| g.json["bufferViews"][0]["byteLength"] = json!(HUGE), &["bufferView 0", "beyond"]),
    ("buffer length near 2^64", |g| g.json["buffers"][0]["byteLength"] = json!(HUGE), &["buffer 0", "1 GiB"]),
    ("buffer longer than its data", |g| g.json["buffers"][0]["byteLength"] = json!(100_000), &["buffer 0", "shorter"]),
    ("buffer without data", |g| { g.push("buffers", json!({ "byteLength": 4 })); }, &["buffer 1", "no data"]),
    ("view of an absent buffer", |g| g.json["bufferViews"][0]["buffer"] = json!(7), &["bufferView 0", "buffer 7"]),
    ("sparse count zero", |g| sparse(g, 0, 0), &["accessor 0", "sparse count"]),
    ("sparse count above count", |g| sparse(g, 4, 0), &["accessor 0", "sparse count"]),
    ("sparse index out of range", |g| sparse(g, 1, 3), &["accessor 0", "sparse index 3"]),
    ("positions as u8", |g| g.json["accessors"][0]["componentType"] = json!(5121), &["accessor 0", "component type"]),
    ("positions as vec2", |g| g.json["accessors"][0]["type"] = json!("VEC2"), &["accessor 0", "VEC3"]),
    ("component type unknown", |g| g.json["accessors"][0]["componentType"] = json!(1), &["accessor 0", "component type"]),
    ("indices as floats", |g| g.json["accessors"][1]["componentType"] = json!(5126), &["accessor 1", "indices of Tri[0]"]),
    ("index out of range", |g| g.bin[36] = 3, &["accessor 1", "index 3"]),
    ("two corners", |g| g.json["accessors"][1]["count"] = json!(2), &["Tri[0]", "2 corners"]),
    ("uv integers not normalized", |g| g.json["accessors"][3]["componentType"] = json!(5123), &["accessor 3", "normalized"]),
    ("fewer normals", |g| g.json["accessors"][2]["count"] = json!(2), &["accessor 2", "NORMAL of Tri[0]"]),
    ("position not a number", |g| g.bin[0..4].copy_from_slice(&f32::NAN.to_le_bytes()), &["POSITION of Tri[0]", "not finite"]),
    ("position infinite", |g| g.bin[0..4].copy_from_slice(&f32::INFINITY.to_le_bytes()), &["POSITION of Tri[0]", "not finite"]),
    ("normal not a number", |g| g.bin[44..48].copy_from_slice(&f32::NAN.to_le_bytes()), &["NORMAL of Tri[0]", "not finite"]),
    ("uv not a number", |g| g.bin[80..84].copy_from_slice(&f32::NAN.to_le_bytes()), &["TEXCOORD_0 of Tri[0]", "not finite"]),
    ("no positions", |g| g.json["meshes"][0]["primitives"][0]["attributes"] = json!({}), &["Tri[0]", "POSITION"]),
    ("absent accessor", |g| g.json["meshes"][0]["primitives"][0]["indices"] = json!(99), &["Tri[0]", "accessor 99"]),
    ("absent material", |g| g.json["meshes"][0]["primitives"][0]["material"] = json!(9), &["Tri[0]", "material 9"]),
    ("absent mesh", |g| g.json["nodes"][1]["mesh"] = json!(9), &["`tri`", "mesh 9"]),
    ("unknown mode", |g| g.json["meshes"][0]["primitives"][0]["mode"] = json!(9), &["Tri[0]", "mode"]),
    ("points only", |g| g.json["meshes"][0]["primitives"][0]["mode"] = json!(0), &["no triangles", "points"]),
    ("all of zero area", |g| g.bin[36..42].fill(0), &["no triangles", "zero area"]),
    ("no mesh at all", |g| { g.json["nodes"][1].as_object_mut().unwrap().remove("mesh"); }, &["no triangles"]),
    ("image view out of range", |g| g.json["images"][0]["bufferView"] = json!(99), &["image `Wood`", "bufferView 99"]),
    ("image without data", |g| { g.json["images"][0].as_object_mut().unwrap().remove("bufferView"); }, &["image `Wood`", "no data"]),
    ("image of garbage", |g| g.json["images"][0]["bufferView"] = json!(0), &["image `Wood`", "decoded"]),
    ("image uri outside", |g| g.json["images"][0] = json!({ "name": "Wood", "uri": "../a.png" }), &["image `Wood`", "leaves"]),
    ("absent texture", |g| g.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(5), &["`Paint`", "texture 5"]),
    ("absent image", |g| g.json["textures"][0]["source"] = json!(5), &["texture 0", "image"]),
    ("absent sampler", |g| g.json["textures"][0]["sampler"] = json!(5), &["texture 0", "sampler 5"]),
    ("unknown wrap mode", |g| g.json["samplers"][0]["wrapS"] = json!(5), &["texture 0", "wrap"]),
    ("roughness infinite", |g| g.json["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = json!(1e39), &["`Paint`", "roughnessFactor"]),
    ("negative emission", |g| g.json["materials"][0]["emissiveFactor"][0] = json!(-1.0), &["`Paint`", "emission"]),
    ("ior zero", |g| g.json["materials"][0]["extensions"]["KHR_materials_ior"]["ior"] = json!(0.0), &["`Paint`", "ior"]),
    ("ior below one", |g| g.json["materials"][0]["extensions"]["KHR_materials_ior"]["ior"] = json!(0.9), &["`Paint`", "ior"]),
    ("unknown alpha mode", |g| g.json["materials"][0]["alphaMode"] = json!("X"), &["`Paint`", "alphaMode"]),
    ("node cycle", |g| g.json["nodes"][3]["children"] = json!([0]), &["`root`", "ancestor"]),
    ("node cycle without scene", |g| { g.json.as_object_mut().unwrap().remove("scene"); g.json["scenes"] = json!([]); g.json["nodes"][3]["children"] = json!([0]); }, &["`root`", "ancestor"]),
    ("node with two parents", |g| g.json["nodes"][3]["children"] = json!([1]), &["`tri`", "two parents"]),
    ("absent child", |g| g.json["nodes"][3]["children"] = json!([77]), &["node 77"]),
    ("absent scene", |g| g.json["scene"] = json!(3), &["scene 3"]),
    ("absent root", |g| g.json["scenes"][0]["nodes"] = json!([9]), &["node 9"]),
    ("translation infinite", |g| g.json["nodes"][1]["translation"] = json!([1e39, 0, 0]), &["`tri`", "not finite"]),
    ("rotation zero", |g| g.json["nodes"][1]["rotation"] = json!([0, 0, 0, 0]), &["`tri`", "rotation"]),
    ("matrix with perspective", |g| g.json["nodes"][1]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), &["`tri`", "affine"]),
    ("scale out of all measure", |g| g.json["nodes"][1]["scale"] = json!([1e30, 1e30, 1e30]), &["`tri`", "farther"]),
    ("absent camera", |g| g.json["nodes"][2]["camera"] = json!(4), &["`eye`", "camera 4"]),
    ("yfov zero", |g| g.json["cameras"][0]["perspective"]["yfov"] = json!(0.0), &["`eye`", "yfov"]),
    ("yfov above pi", |g| g.json["cameras"][0]["perspective"]["yfov"] = json!(3.2), &["`eye`", "yfov"]),
    ("aspect negative", |g| g.json["cameras"][0]["perspective"]["aspectRatio"] = json!(-1.0), &["`eye`", "aspectRatio"]),
    ("flat camera", |g| g.json["nodes"][2]["scale"] = json!([1, 0, 1]), &["`eye`", "scale"]),
    ("absent light", |g| g.json["nodes"][3]["extensions"]["KHR_lights_punctual"]["light"] = json!(4), &["`lamp`", "light 4"]),
    ("negative light", |g| light(g)["intensity"] = json!(-1.0), &["`lamp`", "intensity"]),
    ("infinite light", |g| light(g)["intensity"] = json!(1e39), &["`lamp`", "intensity"]),
    ("spot without cone", |g| { light(g).as_object_mut().unwrap().remove("spot"); }, &["`lamp`", "cone"]),
    ("spot inside out", |g| light(g)["spot"]["innerConeAngle"] = json!(0.6), &["`lamp`", "innerConeAngle"]),
    ("unknown light", |g| light(g)["type"] = json!("area"), &["`lamp`", "type"]),
    ("emitter is a string", |g| g.json["nodes"][4]["extras"]["emitter"] = json!("beam"), &["`laser`", "extras.emitter"]),
    ("emitter of unknown type", |g| g.json["nodes"][4]["extras"]["emitter"]["type"] = json!("x"), &["`laser`", "type"]),
    ("emitter of negative radius", |g| g.json["nodes"][4]["extras"]["emitter"]["radius"] = json!(-1), &["`laser`", "radius"]),
    ("emitter without power", |g| { g.json["nodes"][4]["extras"]["emitter"].as_object_mut().unwrap().remove("power"); }, &["`laser`", "power"]),
    ("emitter of two powers", |g| g.json["nodes"][4]["extras"]["emitter"]["power"] = json!([1, 2]), &["`laser`", "power"]),
    ("glTF 1", |g| g.json["asset"]["version"] = json!("1.0"), &["version 1.0"]),
    ("no asset", |g| { g.json.as_object_mut().unwrap().remove("asset"); }, &["not valid glTF", "asset"]),
    ("Draco", |g| g.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]), &["without Draco"]),
    ("meshopt", |g| g.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]), &["without meshopt"]),
    ("quantization", |g| g.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]), &["without quantization"]),
    ("unknown extension", |g| g.json["extensionsRequired"] = json!(["X_y"]), &["X_y"]),
    ("bad percent escape", |g| g.json["buffers"][0]["uri"] = json!("a%FFb"), &["buffer 0", "% escape"]),
    ("bad base64", |g| g.json["buffers"][0]["uri"] = json!("data:;base64,*"), &["buffer 0", "base64"]),
    ("data URI without base64", |g| g.json["buffers"][0]["uri"] = json!("data:,abc"), &["buffer 0", "base64"]),
];

fn light(glb: &mut Glb) -> &mut Value {
    &mut glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]
}

/// Replaces `count` positions, all of them at index `at`.
fn sparse(glb: &mut Glb, count: usize, at: u8) {
    let indices = glb.view(&[at; 4]);
    let values = glb.view(&[0; 48]);
    glb.json["accessors"][0]["sparse"] = json!({
        "count": count,
        "indices": { "bufferView": indices, "componentType": 5121 },
        "values": { "bufferView": values },
    });
}

#[test]
fn hostile_files_are_refused_by_name() {
    for (name, change, words) in HOSTILE {
        let mut glb = complete();
        change(&mut glb);
        let message = refusal(&glb.build());
        for word in *words {
            assert!(message.contains(word), "{name}: `{word}` is not in: {message}");
        }
        assert!(!message.contains("reader failed"), "{name}: panicked");
        assert!(message.contains("; ") && !message.ends_with('.'), "{name}: no remedy in: {message}");
    }
}

#[test]
fn instances_that_multiply_beyond_the_limit_are_refused() {
    let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    let indices = glb.indices(&[0, 1, 2].repeat(1000));
    glb.json["meshes"][0]["primitives"] =
        json!(vec![json!({ "attributes": { "POSITION": 0 }, "indices": indices }); 100]);
    glb.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 700]);
    assert!(refusal(&glb.build()).contains("64 million triangles"));
}

#[test]
fn zeros_without_a_view_are_counted_before_they_are_made() {
    let mut glb = complete();
    for count in [1_000_000_000_000u64, 100_000_000] {
        glb.json["accessors"][0] = json!({ "componentType": 5126, "type": "VEC3", "count": count });
        assert!(refusal(&glb.build()).contains("accessor 0"));
    }
}

#[test]
fn deep_chains_are_walked_without_recursion() {
    let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
    let mut nodes: Vec<Value> = (1..200_000).map(|child| json!({ "children": [child] })).collect();
    nodes.push(json!({ "mesh": 0 }));
    glb.json["nodes"] = json!(nodes);
    assert_eq!(read(&glb).instances[0].node, "node 199999");

    let nested = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
    let chain = serde_json::to_string(&complete().json).unwrap();
    let data = base64::engine::general_purpose::STANDARD.encode(complete().bin);
    let chain = chain.replacen("\"buffers\":[{", &format!("\"buffers\":[{{\"uri\":\"data:;base64,{data}\","), 1);
    let plain = chain.replacen("\"name\":\"tri\"", &format!("\"name\":\"tri\",\"extras\":{{\"a\":{nested}}}"), 1);
    check_promises(&load_slice(plain.as_bytes(), Path::new("a.gltf")).unwrap());
    let emitter =
        chain.replacen("\"name\":\"tri\"", &format!("\"name\":\"tri\",\"extras\":{{\"emitter\":{nested}}}"), 1);
    assert!(refusal(emitter.as_bytes()).contains("`tri`"));
}

/// Neither a panic nor a scene that breaks a promise.
fn survive(bytes: &[u8], what: impl Fn() -> String) {
    match load_slice(bytes, Path::new("test.glb")) {
        Ok(scene) => check_promises(&scene),
        Err(error) => assert!(!error.to_string().contains("reader failed"), "{}", what()),
    }
}

#[test]
fn truncation_at_every_length_is_survived() {
    let bytes = complete().build();
    for length in 0..bytes.len() {
        assert!(refusal(&bytes[..length]).len() > 10);
        // The same with the header telling the truth, so that the cut reaches the chunks.
        let mut cut = bytes[..length].to_vec();
        if length >= 12 {
            cut[8..12].copy_from_slice(&(length as u32).to_le_bytes());
        }
        survive(&cut, || format!("cut at {length}"));
    }
}

#[test]
fn random_bytes_are_survived() {
    let bytes = complete().build();
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for round in 0..2000 {
        let mut flipped = bytes.clone();
        for _ in 0..1 + random(3) {
            let at = random(flipped.len());
            // Digits for digits keep the JSON whole and reach further in.
            flipped[at] = if flipped[at].is_ascii_digit() { b'0' + random(10) as u8 } else { random(256) as u8 };
        }
        survive(&flipped, || format!("round {round}"));
    }
}

/// Shared scenes beside the repository, if any; `TAUGATE_SHARED_SCENES` names another folder.
#[test]
fn shared_scenes_are_read() {
    let folder = std::env::var_os("TAUGATE_SHARED_SCENES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: there are no shared scenes");
        return;
    }
    // Name, cameras, lights and beams.
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
        check_promises(&scene);
        let facts = std::fs::read(folder.join(name).join("scene.json")).unwrap();
        let facts: Value = serde_json::from_slice(&facts).unwrap();
        let of = |instance: &Instance| scene.meshes[instance.mesh as usize].triangles.len() as u64;
        let triangles: u64 = scene.instances.iter().map(of).sum();
        let degenerate = facts["degenerate_triangles"].as_u64().unwrap();
        assert_eq!(triangles, facts["triangles"].as_u64().unwrap() - degenerate, "{name}");
        assert_eq!((scene.cameras.len(), scene.lights.len()), (cameras, lights), "{name}");
    }
}
