//! Parts of a file that are foreign to taugate, or that the image does not need: they are left out, with a warning that names them.
//! Also spellings of JSON and of the container that exporters use although the specification does not have them.

use taugate::internals::scene::LightKind;
use taugate::internals::scene::gltf::load;

use super::*;

/// The only warning of a scene.
fn warning(glb: &Glb) -> String {
    let scene = read(glb);
    check_invariants(&scene);
    let [warning] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
    warning.clone()
}

/// The parser reads a list as a struct: the elements are its members in the order of the declaration.
#[test]
fn extras_that_are_lists_are_ignored() {
    let mut glb = complete();
    glb.json["cameras"][0]["extras"] = json!([32, 16]);
    glb.json["nodes"][1]["extras"] = json!(["array"]);
    glb.json["nodes"][4]["extras"] = json!([{ "type": "collimated_beam", "radius": 0.5, "power": 1 }]);
    glb.json["materials"][0]["extras"] = json!([{ "share": 0.3, "angle": 0.5 }]);
    glb.json["scenes"][0]["extras"] = json!([{ "sigma_s": 1 }]);
    let scene = read(&glb);
    assert_eq!((scene.cameras[0].resolution, scene.cameras[0].aspect), (None, Some(2.0)));
    assert_eq!((scene.lights.len(), &scene.materials[0].retroreflector, scene.media.len()), (1, &None, 0));
    assert_eq!(scene.warnings, Vec::<String>::new());
}

#[test]
fn foreign_values_of_a_key_are_ignored_with_a_warning() {
    let cases = [
        ("/nodes/1", "emitter", "node `tri`", vec![json!("fire"), json!(3), json!({ "type": "fire" }), json!([1])]),
        (
            "/materials/0",
            "retroreflector",
            "material `Paint`",
            vec![json!(true), json!({ "colour": "red" }), json!([0.3, 0.5])],
        ),
        ("/materials/0", "medium", "material `Paint`", vec![json!("air"), json!({ "name": "air" }), json!([1])]),
        ("/scenes/0", "medium", "the scene", vec![json!("fog"), json!({})]),
        ("/cameras/0", "principal_point", "camera `eye`", vec![json!([1, 2, 3]), json!({})]),
        ("/cameras/0", "width", "camera `eye`", vec![json!("32 px"), json!(-4), json!(0), json!(1.5), json!(32)]),
    ];
    for (place, key, of, values) in cases {
        for value in values {
            let mut glb = complete();
            glb.json.pointer_mut(place).unwrap()["extras"] = json!({ key: value });
            let warning = warning(&glb);
            assert!(warning.starts_with(&format!("extras.{key} is ignored where it is not ")), "{warning}");
            assert!(warning.ends_with(&format!("(first: {of})")), "{warning}");
        }
    }
    // Null is no value.
    let mut glb = complete();
    glb.json["nodes"][1]["extras"] = json!({ "emitter": null });
    assert_eq!(read(&glb).warnings, Vec::<String>::new());
}

#[test]
fn attributes_that_the_material_does_not_need_do_not_refuse_a_file() {
    let mut glb = complete();
    glb.json["accessors"][3]["count"] = json!(0);
    assert!(refusal(&glb.build()).contains("TEXCOORD_0 of Tri[0]"));
    glb.json["materials"][0]["pbrMetallicRoughness"].as_object_mut().unwrap().remove("baseColorTexture");
    let text = "vertex attributes that the material does not need are left out: accessor 3 (TEXCOORD_0 of Tri[0]) has no elements";
    assert_eq!(warning(&glb), text);

    let mut glb = complete();
    let tangents = glb.floats(&[[0.0; 4]; 2]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(tangents);
    assert!(warning(&glb).contains("TANGENT of Tri[0]) has 2 elements for 3 positions"));
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    assert!(refusal(&glb.build()).contains("TANGENT of Tri[0]"));
}

#[test]
fn materials_that_no_mesh_has_do_not_refuse_a_file_and_load_no_textures() {
    let spoilt = [
        json!({ "name": "Other", "extensions": { "KHR_materials_ior": { "ior": 0.5 } } }),
        json!({ "name": "Other", "emissiveFactor": [-1, 0, 0] }),
        json!({ "name": "Other", "extensions": { "KHR_materials_clearcoat": "shiny" } }),
    ];
    for material in spoilt {
        let mut glb = complete();
        glb.push("materials", material);
        let warning = warning(&glb);
        assert!(warning.starts_with("a material that no mesh has is left out: "), "{warning}");
        assert!(warning.contains("material `Other`"), "{warning}");
        // A mesh that only a hidden node has does not count.
        glb.json["nodes"][1]["extensions"] = json!({ "KHR_node_visibility": { "visible": false } });
        glb.json["meshes"][0]["primitives"][0]["material"] = json!(1);
        read(&glb);
        glb.json["nodes"][1].as_object_mut().unwrap().remove("extensions");
        assert!(refusal(&glb.build()).contains("material `Other`"));
    }
    let mut glb = complete();
    let missing = glb.push("textures", json!({ "source": 7 }));
    let texture = json!({ "baseColorTexture": { "index": missing } });
    let extras = json!({ "retroreflector": { "share": 7, "angle": -1 }, "medium": { "sigma_s": "much" } });
    let other = glb.push("materials", json!({ "pbrMetallicRoughness": texture, "extras": extras }));
    let scene = read(&glb);
    assert_eq!((scene.warnings.len(), scene.textures.len(), scene.materials.len()), (0, 1, 2));
    glb.json["meshes"][0]["primitives"][0]["material"] = json!(other);
    assert!(refusal(&glb.build()).contains("texture 1"));
}

#[test]
fn a_light_whose_node_is_scaled_to_nothing_is_off() {
    for (node, name) in [(3, "lamp"), (4, "laser")] {
        let mut glb = complete();
        glb.json["nodes"][node]["scale"] = json!([0, 0, 0]);
        let scene = read(&glb);
        check_invariants(&scene);
        let light = scene.lights.iter().find(|light| light.node == name).unwrap();
        assert_eq!((light.kind.strength(), &scene.lights_off[..]), ([0.0; 3], &[name.to_string()][..]));
        assert!(warning(&glb).ends_with(&format!("and are off (first: node `{name}`)")));
        // One axis is enough for a direction.
        glb.json["nodes"][node]["scale"] = json!([0, 0, 1]);
        let scene = read(&glb);
        assert!(scene.lights_off.is_empty() && scene.lights.iter().all(|light| light.kind.strength() != [0.0; 3]));
    }
    // A point light shines in all directions, whatever its scale.
    let mut glb = complete();
    glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]["type"] = json!("point");
    glb.json["nodes"][3]["scale"] = json!([0, 0, 0]);
    let scene = read(&glb);
    assert!(scene.lights_off.is_empty() && scene.lights[0].kind.strength() == [8.0, 4.0, 2.0]);
}

#[test]
fn a_light_that_is_off_needs_no_cone() {
    for spot in [json!({ "innerConeAngle": 2.0, "outerConeAngle": 0.5 }), json!(null)] {
        let mut glb = complete();
        let light = &mut glb.json["extensions"]["KHR_lights_punctual"]["lights"][0];
        light["spot"] = spot;
        light["intensity"] = json!(0);
        let scene = read(&glb);
        assert_eq!((scene.lights[0].kind, scene.warnings.len()), (LightKind::Point { intensity: [0.0; 3] }, 0));
    }
}

/// The text of the JSON, with a fraction behind every integer outside of strings.
fn with_fractions(json: &Value) -> String {
    let text = serde_json::to_string(json).unwrap();
    let (mut out, mut inside, mut last) = (String::new(), false, ' ');
    for c in text.chars().chain([' ']) {
        let ends_integer = last.is_ascii_digit() && !inside && !(c.is_ascii_digit() || matches!(c, '.' | 'e' | '-'));
        let is_whole = || {
            let number =
                out.rsplit(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | 'e' | '-' | '+'))).next().unwrap();
            !number.contains(['.', 'e'])
        };
        if ends_integer && is_whole() {
            out += ".0";
        }
        inside ^= c == '"';
        out.push(c);
        last = c;
    }
    out
}

#[test]
fn whole_numbers_may_have_a_fraction() {
    let glb = complete();
    let text = with_fractions(&glb.json);
    assert!(text.contains(r#""count":3.0"#) && text.contains(r#""version":"2.0""#), "{text}");
    let json = serde_json::from_str::<Value>(&text).unwrap();
    let (plain, other) = (read(&glb), read(&Glb { json, bin: glb.bin.clone() }));
    assert!(plain.has_same_objects(&other) && plain.has_same_places(&other) && plain.cameras == other.cameras);
    let mut glb = complete();
    glb.json["accessors"][0]["count"] = json!(3.5);
    assert!(refusal(&glb.build()).contains("not valid glTF 2.0"));
}

#[test]
fn a_chunk_may_be_padded_with_nul() {
    let text = serde_json::to_vec(&complete().json).unwrap();
    for padding in 1..9 {
        let json = [&text[..], &vec![0; padding]].concat();
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &complete().bin)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        let length = bytes.len() as u32;
        bytes[8..12].copy_from_slice(&length.to_le_bytes());
        check_invariants(&load_slice(&bytes, Path::new("a.glb")).unwrap());
    }
}

#[test]
fn a_percent_sign_that_begins_no_escape_stands_for_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    for (name, uri) in [("50%.bin", "50%.bin"), ("50%_grey x.bin", "50%_grey%20x.bin"), ("a%FFb.bin", "a%FFb.bin")] {
        std::fs::write(folder.path().join(name), complete().bin).unwrap();
        std::fs::write(&path, text(uri)).unwrap();
        check_invariants(&load(&path).unwrap());
    }
}
