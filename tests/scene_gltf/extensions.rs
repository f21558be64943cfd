//! Extensions and parts of files that do not matter for the image, and scenes without surfaces.

use super::*;

#[test]
fn extensions_without_effect_are_accepted_even_if_required() {
    let mut glb = complete();
    glb.json["extensionsRequired"] = json!([
        "KHR_materials_variants",
        "KHR_xmp_json_ld",
        "KHR_animation_pointer",
        "MSFT_lod",
        "EXT_structural_metadata",
        "KHR_node_selectability",
    ]);
    assert_eq!(read(&glb).warnings, Vec::<String>::new());
}

#[test]
fn an_extension_that_is_left_out_says_what_is_shown_instead() {
    let mut glb = complete();
    glb.json["extensionsRequired"] = json!(["EXT_lights_image_based"]);
    glb.json["extensionsUsed"] = json!(["EXT_lights_image_based", "X_y"]);
    let warnings = read(&glb).warnings;
    let shown = "the extension EXT_lights_image_based is not read: the environment map does not light the scene";
    assert_eq!(warnings, [shown, "the extension X_y is not read"]);
}

#[test]
fn the_range_of_a_lamp_is_warned_about() {
    let mut glb = complete();
    glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]["range"] = json!(5.0);
    glb.json["nodes"][4]["extensions"] = glb.json["nodes"][3]["extensions"].clone();
    let warnings = read(&glb).warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("range (first: node `lamp`)"), "{warnings:?}");
}

#[test]
fn hidden_nodes_have_no_meshes_and_no_lights() {
    let mut glb = complete();
    glb.json["nodes"][0]["extensions"] = json!({ "KHR_node_visibility": { "visible": false } });
    glb.json["nodes"][1]["extensions"] = json!({ "KHR_node_visibility": { "visible": true } });
    let scene = read(&glb);
    assert_eq!((scene.instances.len(), scene.lights.len(), scene.cameras.len()), (0, 0, 1));
    glb.json["nodes"][0]["extensions"] = json!({ "KHR_node_visibility": {} });
    assert_eq!(read(&glb).instances.len(), 1);
}

#[test]
fn scenes_without_surfaces_load() {
    let empty = json!({ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "name": "Scene" }] });
    let scene = load_slice(&serde_json::to_vec(&empty).unwrap(), Path::new("a.gltf")).unwrap();
    check_invariants(&scene);
    assert_eq!(scene.warnings, ["the scene has no triangles; export a scene with visible meshes"]);

    let mut glb = complete();
    glb.json["meshes"][0]["primitives"][0]["mode"] = json!(0);
    assert!(read(&glb).warnings.iter().any(|warning| warning.contains("no triangles, only points or lines")));
    glb.json["meshes"][0]["primitives"][0]["mode"] = json!(4);
    glb.bin[36..42].fill(0);
    assert!(read(&glb).warnings.iter().any(|warning| warning.contains("no triangles, only 1 of zero area")));
}

#[test]
fn what_is_not_read_need_not_be_readable() {
    let mut glb = complete();
    let channel = json!({ "sampler": 0, "target": {
        "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": "/materials/0/alphaCutoff" } } } });
    glb.json["animations"] = json!([{ "channels": [channel], "samplers": [{ "input": 0, "output": 0 }] }, 5]);
    let scene = read(&glb);
    assert_eq!(
        scene.warnings,
        ["animations are only played with --at or --frames; nodes keep the transforms in the file"]
    );
    // A buffer and a compressed view that nothing refers to.
    glb.push("buffers", json!({ "byteLength": 1000 }));
    let source = json!({ "buffer": 1, "byteLength": 5, "byteStride": 4, "count": 2, "mode": "ATTRIBUTES" });
    let extensions = json!({ "EXT_meshopt_compression": source });
    glb.push("bufferViews", json!({ "buffer": 1, "byteLength": 8, "extensions": extensions }));
    assert_eq!(read(&glb).warnings.len(), 1);
}

#[test]
fn strips_and_fans_may_have_triangles_without_area() {
    let corners = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [5.0, 0.0, 0.0],
        [6.0, 0.0, 0.0],
        [5.0, 1.0, 0.0],
    ];
    // Two strips that are joined by repeated corners: the second begins at an even place, so it keeps its winding.
    let mut strip = single(&corners, json!({ "mode": 5 }));
    let indices = strip.indices(&[0, 1, 2, 3, 3, 4, 4, 5, 6]);
    strip.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let scene = read(&strip);
    assert_eq!(scene.meshes[0].triangles, [[0, 1, 2], [1, 3, 2], [4, 5, 6]]);
    assert_eq!(scene.warnings, ["4 triangles of zero area are left out"]);
    let mut fan = single(&corners, json!({ "mode": 6 }));
    let indices = fan.indices(&[0, 1, 1, 3, 2]);
    fan.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert_eq!(read(&fan).meshes[0].triangles, [[1, 3, 0], [3, 2, 0]]);
}
