//! Bad files: the reader refuses them with a message that names the bad part and the remedy, and never panics.

use base64::Engine;
use taugate::internals::scene::gltf::{Playback, load, load_with};

use super::*;

/// Name of a case, a change to the complete scene, and the words that the reader's message must contain.
pub type Case = (&'static str, fn(&mut Glb), &'static [&'static str]);

const HUGE: u64 = u64::MAX - 8;

#[rustfmt::skip]
const HOSTILE: &[Case] = &[
    ("clear coat as text", |g| g.json["materials"][0]["extensions"]["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": "much" }), &["KHR_materials_clearcoat of material `Paint`", "re-export"]),
    ("clear coat that is no object", |g| g.json["materials"][0]["extensions"]["KHR_materials_clearcoat"] = json!("shiny"), &["KHR_materials_clearcoat of material `Paint`", "re-export"]),
    ("specular colour below 0", |g| g.json["materials"][0]["extensions"]["KHR_materials_specular"]["specularColorFactor"] = json!([1, -1, 1]), &["specularColorFactor of material `Paint`", "re-export"]),
    ("clear coat too large for f32", |g| g.json["materials"][0]["extensions"]["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 1e300 }), &["clearcoatFactor of material `Paint`", "not a finite"]),
    ("accessor beyond its view", |g| g.json["accessors"][0]["count"] = json!(4), &["accessor 0", "POSITION of Tri[0]", "beyond"]),
    ("view beyond its buffer", |g| g.json["bufferViews"][0]["byteLength"] = json!(100_000), &["bufferView 0", "beyond"]),
    ("stride below element", |g| g.json["bufferViews"][0]["byteStride"] = json!(4), &["accessor 0", "byteStride"]),
    ("stride zero", |g| g.json["bufferViews"][0]["byteStride"] = json!(0), &["accessor 0", "byteStride"]),
    ("stride near 2^64", |g| g.json["bufferViews"][0]["byteStride"] = json!(HUGE), &["accessor 0", "beyond"]),
    ("count zero", |g| g.json["accessors"][0]["count"] = json!(0), &["accessor 0", "no elements"]),
    ("count near 2^64", |g| g.json["accessors"][0]["count"] = json!(HUGE), &["accessor 0", "elements"]),
    ("a million positions without bytes", |g| { g.json["accessors"][0]["count"] = json!(1_000_000); g.json["accessors"][0].as_object_mut().unwrap().remove("bufferView"); }, &["accessor 0", "no bufferView", "1000000 elements"]),
    ("accessor offset near 2^64", |g| g.json["accessors"][0]["byteOffset"] = json!(HUGE), &["accessor 0", "beyond"]),
    ("view offset near 2^64", |g| g.json["bufferViews"][0]["byteOffset"] = json!(HUGE), &["bufferView 0", "beyond"]),
    ("view length near 2^64", |g| g.json["bufferViews"][0]["byteLength"] = json!(HUGE), &["bufferView 0", "beyond"]),
    ("buffer length near 2^64", |g| g.json["buffers"][0]["byteLength"] = json!(HUGE), &["buffer 0", "1 GiB"]),
    ("buffer longer than its data", |g| g.json["buffers"][0]["byteLength"] = json!(100_000), &["buffer 0", "shorter"]),
    ("buffer without data", |g| g.json["bufferViews"][0]["buffer"] = json!(g.push("buffers", json!({ "byteLength": 4 }))), &["buffer 1", "no data"]),
    ("view of an absent buffer", |g| g.json["bufferViews"][0]["buffer"] = json!(7), &["bufferView 0", "buffer 7"]),
    ("sparse count zero", |g| sparse(g, 0, 0), &["accessor 0", "sparse count"]),
    ("sparse count above count", |g| sparse(g, 4, 0), &["accessor 0", "sparse count"]),
    ("sparse index out of range", |g| sparse(g, 1, 3), &["accessor 0", "sparse index 3"]),
    ("positions as u32", |g| g.json["accessors"][0]["componentType"] = json!(5125), &["accessor 0", "component type"]),
    ("positions as vec2", |g| g.json["accessors"][0]["type"] = json!("VEC2"), &["accessor 0", "VEC3"]),
    ("component type unknown", |g| g.json["accessors"][0]["componentType"] = json!(1), &["accessor 0", "component type"]),
    ("indices as floats", |g| g.json["accessors"][1]["componentType"] = json!(5126), &["accessor 1", "indices of Tri[0]"]),
    ("index out of range", |g| g.bin[36] = 3, &["accessor 1", "index 3"]),
    ("two corners", |g| g.json["accessors"][1]["count"] = json!(2), &["Tri[0]", "2 corners"]),
    ("normals not normalized", |g| g.json["accessors"][2]["componentType"] = json!(5122), &["accessor 2", "normalized"]),
    ("fewer normals", |g| g.json["accessors"][2]["count"] = json!(2), &["accessor 2", "NORMAL of Tri[0]"]),
    ("position not a number", |g| g.bin[0..4].copy_from_slice(&f32::NAN.to_le_bytes()), &["POSITION of Tri[0]", "not finite"]),
    ("position infinite", |g| g.bin[0..4].copy_from_slice(&f32::INFINITY.to_le_bytes()), &["POSITION of Tri[0]", "not finite"]),
    ("normal not a number", |g| g.bin[44..48].copy_from_slice(&f32::NAN.to_le_bytes()), &["NORMAL of Tri[0]", "not finite"]),
    ("uv not a number", |g| g.bin[80..84].copy_from_slice(&f32::NAN.to_le_bytes()), &["TEXCOORD_0 of Tri[0]", "not finite"]),
    ("fewer colours", |g| color(g, 2, "VEC4", 1.0), &["COLOR_0 of Tri[0]", "2 elements"]),
    ("colours of two channels", |g| color(g, 3, "VEC2", 1.0), &["COLOR_0 of Tri[0]", "VEC3"]),
    ("colour not a number", |g| color(g, 3, "VEC4", f32::NAN), &["COLOR_0 of Tri[0]", "not finite"]),
    ("tangent infinite", |g| { color(g, 3, "VEC4", f32::INFINITY); bumped(g) }, &["TANGENT of Tri[0]", "not finite"]),
    ("tangents of three numbers", |g| { color(g, 3, "VEC3", 1.0); bumped(g) }, &["TANGENT of Tri[0]", "VEC4"]),
    ("normal map absent", |g| g.json["materials"][0]["normalTexture"] = json!({ "index": 5 }), &["`Paint`", "texture 5"]),
    ("scale of normals infinite", |g| g.json["materials"][0]["normalTexture"] = json!({ "index": 0, "scale": 1e39 }), &["`Paint`", "scale"]),
    ("no positions", |g| g.json["meshes"][0]["primitives"][0]["attributes"] = json!({}), &["Tri[0]", "POSITION"]),
    ("absent accessor", |g| g.json["meshes"][0]["primitives"][0]["indices"] = json!(99), &["Tri[0]", "accessor 99"]),
    ("absent material", |g| g.json["meshes"][0]["primitives"][0]["material"] = json!(9), &["Tri[0]", "material 9"]),
    ("absent mesh", |g| g.json["nodes"][1]["mesh"] = json!(9), &["`tri`", "mesh 9"]),
    ("unknown mode", |g| g.json["meshes"][0]["primitives"][0]["mode"] = json!(9), &["Tri[0]", "mode"]),
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
    ("ior below zero", |g| g.json["materials"][0]["extensions"]["KHR_materials_ior"]["ior"] = json!(-1.0), &["`Paint`", "ior"]),
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
    ("ymag not a number", |g| orthographic(g, json!({ "xmag": 1, "ymag": null, "znear": 0, "zfar": 1 })), &["not valid glTF"]),
    ("absent light", |g| g.json["nodes"][3]["extensions"]["KHR_lights_punctual"]["light"] = json!(4), &["`lamp`", "light 4"]),
    ("negative light", |g| light(g)["intensity"] = json!(-1.0), &["`lamp`", "intensity"]),
    ("infinite light", |g| light(g)["intensity"] = json!(1e39), &["`lamp`", "intensity"]),
    ("spot without cone", |g| { light(g).as_object_mut().unwrap().remove("spot"); }, &["`lamp`", "cone"]),
    ("spot inside out", |g| light(g)["spot"]["innerConeAngle"] = json!(0.6), &["`lamp`", "innerConeAngle"]),
    ("unknown light", |g| light(g)["type"] = json!("area"), &["`lamp`", "type"]),
    ("emitter of negative radius", |g| g.json["nodes"][4]["extras"]["emitter"]["radius"] = json!(-1), &["`laser`", "radius"]),
    ("emitter without power", |g| { g.json["nodes"][4]["extras"]["emitter"].as_object_mut().unwrap().remove("power"); }, &["`laser`", "power"]),
    ("emitter of two powers", |g| g.json["nodes"][4]["extras"]["emitter"]["power"] = json!([1, 2]), &["`laser`", "power"]),
    ("glTF 1", |g| g.json["asset"]["version"] = json!("1.0"), &["version 1.0"]),
    ("structure of glTF 1", |g| { g.json["asset"]["version"] = json!("1.0"); g.json["nodes"] = json!({ "root": {} }); }, &["version 1.0"]),
    ("glTF 1 as a number", |g| g.json["asset"]["version"] = json!(1), &["version 1.0"]),
    ("no asset", |g| { g.json.as_object_mut().unwrap().remove("asset"); }, &["not valid glTF", "asset"]),
    ("texture format", |g| g.json["extensionsRequired"] = json!(["KHR_texture_basisu"]), &["KHR_texture_basisu", "ktxdecompress"]),
    ("unknown extension", |g| g.json["extensionsRequired"] = json!(["X_y"]), &["X_y"]),
    ("instances without a list", |g| instances(g, json!(5)), &["`tri`", "instances"]),
    ("instances of an absent accessor", |g| instances(g, json!({ "TRANSLATION": 99 })), &["`tri`", "accessor 99"]),
    ("instances of two lengths", |g| { let short = g.floats(&[[0.0; 3]; 2]); instances(g, json!({ "SCALE": 0, "TRANSLATION": short })); }, &["`tri`", "length"]),
    ("instances as vec2", |g| instances(g, json!({ "TRANSLATION": 3 })), &["TRANSLATION", "`tri`", "VEC3"]),
    ("instances turned by nothing", |g| { let zero = g.floats(&[[0.0; 4]]); instances(g, json!({ "ROTATION": zero })); }, &["instance 0 of node `tri`"]),
    ("instances beyond the limit", |g| { let many = g.accessor(&vec![0; 5_000_000], 5121, "SCALAR", 5_000_000); instances(g, json!({ "_ID": many })); }, &["4 million instances"]),
    ("absent skin", |g| g.json["nodes"][1]["skin"] = json!(3), &["skin 3"]),
    ("few bind matrices", |g| { skin(g, [0; 4], [1.0; 4]); g.json["skins"][0]["joints"] = json!([1, 2]); }, &["skin `bones`", "1 inverse bind matrices"]),
    ("joint of another skin", |g| skin(g, [0, 0, 7, 0], [1.0; 4]), &["JOINTS_0 of Tri[0]", "joint 7", "skin `bones`"]),
    ("weight not a number", |g| skin(g, [0; 4], [f32::NAN; 4]), &["WEIGHTS_0 of Tri[0]", "not finite"]),
    ("few weights", |g| { skin(g, [0; 4], [1.0; 4]); let last = g.json["accessors"].as_array().unwrap().len() - 1; g.json["accessors"][last]["count"] = json!(2); }, &["WEIGHTS_0 of Tri[0]", "3 elements"]),
    ("joints as floats", |g| { skin(g, [0; 4], [1.0; 4]); let weights = g.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"].clone(); g.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = weights; }, &["JOINTS_0 of Tri[0]", "component type"]),
    ("bind matrix not a number", |g| { skin(g, [0; 4], [1.0; 4]); let matrix = g.floats(&[[f32::NAN; 16]]); g.json["skins"][0]["inverseBindMatrices"] = json!(matrix); }, &["joint 0 of skin `bones`", "finite"]),
    ("absent morph target", |g| morph(g, 99, 1.0), &["accessor 99", "morph target 0 of Tri[0]"]),
    ("short morph target", |g| { let short = g.floats(&[[0.0; 3]; 2]); morph(g, short, 1.0); }, &["morph target 0 of Tri[0]", "2 elements"]),
    ("morph weight beyond all measure", |g| { let far = g.floats(&[[4.0; 3]; 3]); morph(g, far, f32::MAX); }, &["Tri[0]", "not finite"]),
    ("compressed by an unknown mode", |g| meshopt(g, json!({ "mode": "X" })), &["bufferView 0", "cannot be read"]),
    ("compressed with an odd stride", |g| meshopt(g, json!({ "byteStride": 6, "count": 6 })), &["bufferView 0", "6 bytes"]),
    ("compressed to another length", |g| meshopt(g, json!({ "count": 4 })), &["bufferView 0", "4 elements"]),
    ("compressed beyond the limit", |g| { meshopt(g, json!({ "count": 1_000_000_000u64 })); g.json["bufferViews"][0]["byteLength"] = json!(12_000_000_000u64); }, &["bufferView 0", "too much data"]),
    ("compressed beyond 2^64", |g| meshopt(g, json!({ "count": HUGE })), &["bufferView 0", "elements"]),
    ("compressed far too well", |g| { g.bin[0] = 0xa1; meshopt(g, json!({ "count": 50_000_000 })); g.json["bufferViews"][0]["byteLength"] = json!(600_000_000); }, &["bufferView 0", "damaged"]),
    ("compressed in an absent buffer", |g| meshopt(g, json!({ "buffer": 4 })), &["bufferView 0", "buffer 4"]),
    ("compressed beyond the buffer", |g| meshopt(g, json!({ "byteOffset": HUGE })), &["bufferView 0", "beyond"]),
    ("Draco without a view", |g| draco(g, json!({ "bufferView": 99, "attributes": { "POSITION": 0 } })), &["POSITION of Tri[0]", "bufferView 99"]),
    ("Draco of garbage", |g| draco(g, json!({ "bufferView": 1, "attributes": { "POSITION": 0 } })), &["Draco data of POSITION of Tri[0]", "decoded"]),
    ("Draco without attributes", |g| draco(g, json!({ "bufferView": 1 })), &["Draco data of primitive 0 of mesh 0", "attributes"]),
    ("extension as a list", |g| g.json["materials"][0]["extensions"]["KHR_materials_ior"] = json!([1.25]), &["KHR_materials_ior", "list instead of an object"]),
    ("phase function as a list", |g| g.json["scenes"][0]["extras"] = json!({ "medium": { "sigma_s": 1, "phase": ["hg", 0.5] } }), &["extras.medium of the scene", "phase"]),
    ("bad base64", |g| g.json["buffers"][0]["uri"] = json!("data:;base64,*"), &["buffer 0", "base64"]),
    ("data URI without base64", |g| g.json["buffers"][0]["uri"] = json!("data:,abc"), &["buffer 0", "base64"]),
];

pub fn orthographic(glb: &mut Glb, view: Value) {
    glb.json["cameras"][0] = json!({ "type": "orthographic", "orthographic": view });
}

fn light(glb: &mut Glb) -> &mut Value {
    &mut glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]
}

/// Gives the triangle's node EXT_mesh_gpu_instancing with these attributes.
fn instances(glb: &mut Glb, attributes: Value) {
    glb.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
}

/// Gives the triangle a skin with one joint. All vertices have the same joints and weights.
fn skin(glb: &mut Glb, joints: [u8; 4], weights: [f32; 4]) {
    let matrix = glb.floats(&[glam::Mat4::IDENTITY.to_cols_array()]);
    glb.push("skins", json!({ "name": "bones", "joints": [2], "inverseBindMatrices": matrix }));
    glb.json["nodes"][1]["skin"] = json!(0);
    let joints = glb.accessor(&[joints; 3].concat(), 5121, "VEC4", 3);
    let weights = glb.floats(&[weights; 3]);
    let attributes = &mut glb.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
}

/// Gives the triangle one morph target.
fn morph(glb: &mut Glb, positions: usize, weight: f32) {
    glb.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": positions }]);
    glb.json["meshes"][0]["weights"] = json!([weight]);
}

/// Says that the positions, 3 elements of 12 bytes, are compressed; `change` replaces members of the extension.
fn meshopt(glb: &mut Glb, change: Value) {
    let mut source = json!({
        "buffer": 0, "byteOffset": 0, "byteLength": 36, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES",
    });
    source.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
    glb.json["bufferViews"][0]["extensions"] = json!({ "EXT_meshopt_compression": source });
}

/// Says that the positions are in Draco data.
fn draco(glb: &mut Glb, source: Value) {
    glb.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    glb.json["meshes"][0]["primitives"][0]["extensions"] = json!({ "KHR_draco_mesh_compression": source });
}

/// Adds a vertex colour to `count` vertices, each channel of which is `value`.
fn color(glb: &mut Glb, count: usize, shape: &str, value: f32) {
    let bytes: Vec<u8> = [value; 12].iter().flat_map(|value| value.to_le_bytes()).collect();
    let accessor = glb.accessor(&bytes, 5126, shape, count);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(accessor);
}

/// Turns the vertex colour into a tangent, and adds a normal map, which needs the tangent.
fn bumped(glb: &mut Glb) {
    let attributes = glb.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
    let accessor = attributes.remove("COLOR_0").unwrap();
    attributes.insert("TANGENT".into(), accessor);
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
}

/// Makes the positions sparse: `count` replaced elements, all with the index `at`.
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
        assert!(!message.contains("reader failed"), "{name}: the reader panicked");
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
fn accessors_without_a_view_are_checked_before_memory_is_allocated() {
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
    check_invariants(&load_slice(plain.as_bytes(), Path::new("a.gltf")).unwrap());
    let emitter =
        chain.replacen("\"name\":\"tri\"", &format!("\"name\":\"tri\",\"extras\":{{\"emitter\":{nested}}}"), 1);
    let warnings = load_slice(emitter.as_bytes(), Path::new("a.gltf")).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("extras.emitter is ignored") && warnings[0].contains("`tri`"));
}

/// Reads any bytes. The reader must not panic, and a scene that the reader accepts must be valid. `name` is for the message.
pub fn survive(bytes: &[u8], name: impl Fn() -> String) {
    match load_slice(bytes, Path::new("test.glb")) {
        Ok(scene) => check_invariants(&scene),
        Err(error) => assert!(!error.to_string().contains("reader failed"), "{}: the reader panicked", name()),
    }
}

#[test]
fn truncation_at_every_length_is_survived() {
    let bytes = complete().build();
    for length in 0..bytes.len() {
        assert!(refusal(&bytes[..length]).len() > 10);
        // With the right length in the header, the reader goes on and meets the cut in a chunk.
        let mut cut = bytes[..length].to_vec();
        if length >= 12 {
            cut[8..12].copy_from_slice(&(length as u32).to_le_bytes());
        }
        survive(&cut, || format!("cut at {length}"));
    }
}

/// Random numbers below the argument.
pub fn random() -> impl FnMut(usize) -> usize {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    move |below| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    }
}

#[test]
fn random_bytes_are_survived() {
    let bytes = complete().build();
    let mut random = random();
    for round in 0..2000 {
        let mut flipped = bytes.clone();
        for _ in 0..1 + random(3) {
            let at = random(flipped.len());
            // Replacing a digit by a digit keeps the JSON valid, so that the reader gets further.
            flipped[at] = if flipped[at].is_ascii_digit() { b'0' + random(10) as u8 } else { random(256) as u8 };
        }
        survive(&flipped, || format!("round {round}"));
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

#[test]
fn files_of_an_allowed_folder_are_read_and_links_do_not_leave_it() {
    let outside = tempfile::tempdir().unwrap();
    let [folder, textures] = ["scenes", "textures"].map(|name| outside.path().join(name));
    for folder in [&folder, &textures] {
        std::fs::create_dir(folder).unwrap();
    }
    std::fs::write(textures.join("good.bin"), complete().bin).unwrap();
    std::fs::write(outside.path().join("secret.bin"), complete().bin).unwrap();
    let path = folder.join("scene.gltf");
    let load_uri = |uri: &str, allowed: &[std::path::PathBuf]| {
        std::fs::write(&path, text(uri)).unwrap();
        load_with(&path, allowed, Playback::default()).map(drop).map_err(|error| error.to_string())
    };
    let allowed = [textures.clone()];
    let refused = load_uri("../textures/good.bin", &[]).unwrap_err();
    assert!(refused.contains("--allow-path"), "{refused}");
    load_uri("../textures/good.bin", &allowed).unwrap();
    load_uri("../scenes/../textures/./good.bin", &allowed).unwrap();
    let mut uris =
        vec!["../secret.bin", "../textures/../secret.bin", "../textures/../../etc/passwd", "file:///etc/passwd"];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(outside.path().join("secret.bin"), textures.join("link.bin")).unwrap();
        std::os::unix::fs::symlink(outside.path(), textures.join("up")).unwrap();
        uris.extend(["../textures/link.bin", "../textures/up/secret.bin"]);
    }
    for uri in uris {
        let message = load_uri(uri, &allowed).unwrap_err();
        assert!(message.contains("buffer 0 refers to"), "{uri}: {message}");
    }
    let message = load_uri("../textures/good.bin", &[outside.path().join("missing")]).unwrap_err();
    assert!(message.contains("is not a folder; check --allow-path"), "{message}");
}

/// Blender writes candela and lux by default. taugate reads W/sr and W/m^2.
#[test]
fn lights_that_blender_wrote_in_candela_are_named() {
    let warnings = |generator: &str, kind: &str, intensity: f64| {
        let mut glb = single(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], json!({}));
        glb.json["asset"]["generator"] = generator.into();
        let lights = json!([{"type": kind, "intensity": intensity}]);
        glb.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
        glb.push("nodes", json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
        load_slice(&glb.build(), Path::new("a.glb")).unwrap().warnings.join("; ")
    };
    let blender = "Khronos glTF Blender I/O v4.2.57";
    for (kind, bright, usual, part) in [
        (
            "point",
            543.5,
            79.6,
            "544 W/sr; Blender writes candela, 683 times as much, unless Data > Lighting is set to Unitless",
        ),
        ("directional", 2049.0, 1361.0, "2049 W/m^2; Blender writes lux, 683 times as much"),
    ] {
        let warning = warnings(blender, kind, bright);
        assert!(warning.contains(part), "{kind}: {warning}");
        assert!(!warnings(blender, kind, usual).contains("Unitless"), "{kind}");
        assert!(!warnings("Other", kind, 1e6).contains("Unitless"), "{kind}");
    }
}
