//! Materials: their extensions, and the textures of one material with their coordinates and transforms.

use glam::{DAffine2, DVec2};
use taugate::internals::scene::Retroreflector;

use super::*;

/// The extensions of the only material of [`complete`].
fn extensions(glb: &mut Glb) -> &mut Value {
    &mut glb.json["materials"][0]["extensions"]
}

#[test]
fn texture_transforms_are_baked_into_the_coordinates() {
    let mut glb = complete();
    let quarter = std::f32::consts::FRAC_PI_2;
    let transform = json!({ "offset": [10.0, 20.0], "rotation": quarter, "scale": [2.0, 3.0] });
    let info = &mut glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    info["extensions"] = json!({ "KHR_texture_transform": transform });
    let uvs = read(&glb).meshes[0].uvs.clone();
    // Coordinates are scaled, then rotated counter-clockwise (the v axis points down), then translated.
    for (uv, want) in uvs.iter().zip([[10.0, 20.0], [10.0, 18.0], [13.0, 20.0]]) {
        assert!((uv[0] - want[0]).abs() < 1e-5 && (uv[1] - want[1]).abs() < 1e-5, "{uvs:?}");
    }
    glb.json["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
    // The second texture undoes the transform of the first.
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!((&scene.meshes[0].uvs, &scene.warnings), (&uvs, &vec![]));
    let m = &scene.materials[0];
    let of = |texture: Option<u32>| scene.textures[texture.unwrap() as usize].transform;
    assert_eq!(of(m.base_color_texture), DAffine2::IDENTITY);
    for (uv, plain) in uvs.iter().zip(read(&complete()).meshes[0].uvs.iter()) {
        let [own, plain] = [uv, plain].map(|uv| DVec2::from(uv.map(f64::from)));
        assert!((of(m.emission_texture).transform_point2(own) - plain).length() < 1e-5);
    }
    // Tangents belong to the coordinates of the normal map.
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    let scene = read(&glb);
    assert_eq!(scene.meshes[0].uvs, read(&complete()).meshes[0].uvs);
    let m = &scene.materials[0];
    assert_eq!((m.emission_texture, m.normal_texture), (Some(1), Some(1)));
    let translation = scene.textures[m.base_color_texture.unwrap() as usize].transform.translation;
    assert_eq!(translation, DVec2::new(10.0, 20.0));
}

#[test]
fn a_material_may_use_another_set_of_texture_coordinates() {
    let mut glb = complete();
    let other = glb.floats(&[[0.5, 0.0], [0.5, 1.0], [0.0, 0.5]]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(other);
    let paint = &mut glb.json["materials"][0];
    paint["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(1);
    paint["emissiveTexture"] = json!({ "index": 0, "texCoord": 1 });
    let scene = read(&glb);
    assert_eq!(scene.meshes[0].uvs, [[0.5, 0.0], [0.5, 1.0], [0.0, 0.5]]);
    assert_eq!((scene.materials[0].emission_texture, scene.warnings), (Some(0), vec![]));

    // A second set in one material is not read.
    glb.json["materials"][0]["emissiveTexture"]["texCoord"] = json!(0);
    let scene = read(&glb);
    assert_eq!((scene.materials[0].base_color_texture, scene.materials[0].emission_texture), (Some(0), None));
    assert!(scene.warnings[0].contains("texture coordinate set"), "{:?}", scene.warnings);
}

#[test]
fn clear_coats_and_specular_colours_are_read() {
    let mut glb = complete();
    glb.json["extensionsUsed"] = json!(["KHR_materials_clearcoat"]);
    let paint = &mut glb.json["materials"][0];
    paint["emissiveFactor"] = json!([0, 0, 0]);
    let extensions = &mut paint["extensions"];
    extensions["KHR_materials_transmission"] = json!({});
    extensions["KHR_materials_specular"] = json!({ "specularFactor": 0.5, "specularColorFactor": [0.5, 8.0, 0.0] });
    extensions["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25 });
    let scene = read(&glb);
    check_invariants(&scene);
    let m = &scene.materials[0];
    assert_eq!((m.specular, m.specular_color), (0.5, [0.5, 8.0, 0.0]));
    assert_eq!((m.clearcoat, m.clearcoat_roughness), (0.5, 0.25));
    assert_eq!(scene.warnings, Vec::<String>::new());
    // The coat always has the normals of the surface under it. If its own normal map differs, a warning says so.
    let mut bumped = glb.clone();
    let map = json!({ "index": 0, "scale": 0.5 });
    bumped.json["materials"][0]["extensions"]["KHR_materials_clearcoat"]["clearcoatNormalTexture"] = map.clone();
    let warnings = read(&bumped).warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("normals of the surface under them"), "{warnings:?}");
    bumped.json["materials"][0]["normalTexture"] = map;
    assert_eq!(read(&bumped).warnings, Vec::<String>::new());
    // Factors out of range.
    glb.json["materials"][0]["extensions"]["KHR_materials_clearcoat"]["clearcoatFactor"] = json!(7);
    assert_eq!(read(&glb).materials[0].clearcoat, 1.0);
    assert!(read(&glb).warnings[0].contains("clearcoatFactor of material `Paint` (7)"));
}

#[test]
fn a_lamp_under_a_clear_coat_gives_a_warning() {
    let mut glb = complete();
    extensions(&mut glb)["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 0.5 });
    let warnings = read(&glb).warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("lower the emission"), "{warnings:?}");
    glb.json["materials"][0]["emissiveFactor"] = json!([0, 0, 0]);
    assert_eq!(read(&glb).warnings, Vec::<String>::new());
}

#[test]
fn glass_with_specular_factors_gives_a_warning() {
    for specular in [
        json!({ "specularFactor": 0.5 }),
        json!({ "specularColorFactor": [1.0, 0.5, 1.0] }),
        json!({ "specularTexture": { "index": 0 } }),
    ] {
        let mut glb = complete();
        extensions(&mut glb)["KHR_materials_specular"] = specular;
        let warnings = read(&glb).warnings;
        assert!(warnings.len() == 1 && warnings[0].contains("set the ior"), "{warnings:?}");
        // Metals let no light through, so they are no glass.
        glb.json["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = json!(1);
        assert_eq!(read(&glb).warnings, Vec::<String>::new());
    }
}

/// The extension gives an index of 0 the meaning of a Fresnel reflectance of 1.
#[test]
fn an_index_of_0_reflects_everything() {
    let mut glb = complete();
    extensions(&mut glb)["KHR_materials_ior"]["ior"] = json!(0);
    let ior = read(&glb).materials[0].ior;
    assert!(((ior - 1.0) / (ior + 1.0)).powi(2) > 0.99, "{ior}");
    extensions(&mut glb)["KHR_materials_ior"]["ior"] = json!(0.5);
    assert!(refusal(&glb.build()).contains("is 0.5, but must be at least 1"));
}

#[test]
fn textures_of_transmission_are_read() {
    let mut glb = complete();
    let plain = read(&glb).materials[0].clone();
    extensions(&mut glb)["KHR_materials_transmission"]["transmissionTexture"] = json!({ "index": 0 });
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!((plain.transmission_texture, &scene.warnings), (None, &vec![]));
    assert!(scene.materials[0].transmission_texture.is_some());
    extensions(&mut glb)["KHR_materials_transmission"]["transmissionFactor"] = json!(0);
    assert_eq!(read(&glb).materials[0].transmission_texture, None);
}

#[test]
fn textures_of_coats_are_read() {
    let mut glb = complete();
    let texture = |number: u32| json!({ "index": number });
    for _ in 1..4 {
        glb.push("textures", json!({ "source": 0 }));
    }
    glb.json["materials"][0]["emissiveFactor"] = json!([0, 0, 0]);
    extensions(&mut glb)["KHR_materials_transmission"] = json!({});
    extensions(&mut glb)["KHR_materials_specular"] =
        json!({ "specularTexture": texture(0), "specularColorTexture": texture(1) });
    extensions(&mut glb)["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 0.5, "clearcoatTexture": texture(2),
        "clearcoatRoughnessFactor": 0.25, "clearcoatRoughnessTexture": texture(3) });
    let scene = read(&glb);
    check_invariants(&scene);
    let m = &scene.materials[0];
    let of_coat = [m.specular_texture, m.specular_color_texture];
    let all = of_coat.into_iter().chain([m.clearcoat_texture, m.clearcoat_roughness_texture]);
    let mut all: Vec<u32> = all.flatten().collect();
    all.sort();
    all.dedup();
    assert_eq!((all.len(), scene.images.len(), &scene.warnings), (4, 1, &vec![]));

    // A factor of 0 makes its textures useless.
    extensions(&mut glb)["KHR_materials_specular"]["specularFactor"] = json!(0);
    extensions(&mut glb)["KHR_materials_clearcoat"]["clearcoatFactor"] = json!(0);
    let m = read(&glb).materials[0].clone();
    assert_eq!((m.specular_texture, m.specular_color_texture, m.clearcoat_texture), (None, None, None));
}

#[test]
fn specular_glossiness_becomes_a_coat_over_a_diffuse_base() {
    let mut glb = complete();
    glb.json["extensionsUsed"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    glb.json["extensionsRequired"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    extensions(&mut glb)["KHR_materials_pbrSpecularGlossiness"] = json!({ "diffuseFactor": [0.5, 0.25, 0.125, 1.0],
        "specularFactor": [0.04, 0.5, 1.0], "glossinessFactor": 0.75 });
    let scene = read(&glb);
    check_invariants(&scene);
    let m = &scene.materials[0];
    assert_eq!((m.base_color, m.base_color_texture), ([0.5, 0.25, 0.125, 1.0], None));
    assert_eq!((m.metallic, m.roughness, m.specular, m.surface_texture), (0.0, 0.25, 1.0, None));
    let white = ((m.ior - 1.0) / (m.ior + 1.0)).powi(2);
    for (color, expected) in m.specular_color.iter().zip([0.04, 0.5, 1.0]) {
        assert!((color * white - expected).abs() < 1e-6, "{:?}", m.specular_color);
    }
    assert_eq!(scene.warnings, Vec::<String>::new());
    let broken = |value: Value| {
        let mut glb = glb.clone();
        extensions(&mut glb)["KHR_materials_pbrSpecularGlossiness"]["specularFactor"] = value;
        glb
    };
    assert!(read(&broken(json!([0, 7, 0]))).warnings[0].contains("specularFactor of material `Paint` (7)"));
    assert!(refusal(&broken(json!([0, -1, 0])).build()).contains("specularFactor of material `Paint`"));
    // By default, the material is white, and reflects like a perfect mirror.
    extensions(&mut glb)["KHR_materials_pbrSpecularGlossiness"] = json!({});
    let m = read(&glb).materials[0].clone();
    assert_eq!((m.base_color, m.roughness, m.transmission), ([1.0; 4], 0.0, 0.0));
}

#[test]
fn a_glossiness_texture_becomes_a_roughness_texture() {
    let mut glb = complete();
    let view = glb.view(&glb::png(3, &[0, 102, 255].map(|glossiness| [188, 99, 0, glossiness])));
    let image = glb.push("images", json!({ "bufferView": view }));
    let texture = json!({ "index": glb.push("textures", json!({ "source": image })) });
    extensions(&mut glb)["KHR_materials_pbrSpecularGlossiness"] =
        json!({ "diffuseTexture": { "index": 0 }, "specularGlossinessTexture": texture, "glossinessFactor": 0.5 });
    let scene = read(&glb);
    check_invariants(&scene);
    let m = &scene.materials[0];
    let of = |texture: Option<u32>| &scene.images[scene.textures[texture.unwrap() as usize].image as usize].rgba;
    let green: Vec<u8> = of(m.surface_texture).iter().map(|texel| texel[1]).collect();
    assert_eq!((m.roughness, green), (1.0, vec![255, 204, 128]));
    assert_eq!(of(m.specular_color_texture)[0], [188, 99, 0, 0]);
    assert!(m.base_color_texture.is_some() && scene.images.len() == 3);

    // If the texture has other coordinates than the first texture, it is not read. The factor alone gives the roughness.
    let glossy = &mut extensions(&mut glb)["KHR_materials_pbrSpecularGlossiness"];
    glossy["specularGlossinessTexture"]["texCoord"] = json!(1);
    glossy["glossinessFactor"] = json!(0.9);
    let scene = read(&glb);
    let m = &scene.materials[0];
    assert!(m.surface_texture.is_none() && scene.warnings[0].contains("specularGlossinessTexture"));
    assert!((m.roughness - 0.1).abs() < 1e-6, "{}", m.roughness);
}

#[test]
fn a_broken_transform_of_a_normal_map_is_named() {
    let mut glb = complete();
    let transform = json!({ "KHR_texture_transform": { "offset": "left" } });
    glb.json["materials"][0]["normalTexture"] = json!({ "index": 0, "extensions": transform });
    let message = refusal(&glb.build());
    assert!(message.contains("KHR_texture_transform of the normalTexture of material `Paint`"), "{message}");
}

/// Every texture of an extension is checked, and errors name it.
#[test]
fn broken_textures_of_extensions_are_named() {
    let slots = [
        ("KHR_materials_specular", "specularTexture"),
        ("KHR_materials_specular", "specularColorTexture"),
        ("KHR_materials_clearcoat", "clearcoatTexture"),
        ("KHR_materials_clearcoat", "clearcoatRoughnessTexture"),
        ("KHR_materials_pbrSpecularGlossiness", "diffuseTexture"),
        ("KHR_materials_pbrSpecularGlossiness", "specularGlossinessTexture"),
    ];
    for (extension, slot) in slots {
        let with = |texture: Value, change: &dyn Fn(&mut Glb)| {
            let mut glb = complete();
            glb.json["materials"][0]["pbrMetallicRoughness"].as_object_mut().unwrap().remove("baseColorTexture");
            extensions(&mut glb)[extension] =
                json!({ "clearcoatFactor": 1, "clearcoatRoughnessFactor": 1, slot: texture });
            change(&mut glb);
            refusal(&glb.build())
        };
        let user = format!("{slot} of material `Paint`");
        let expect = |message: String, part: &str| {
            assert!(message.contains(&user) && message.contains(part), "{slot}: {message}");
        };
        expect(with(json!({ "index": 77 }), &|_| ()), "texture 77, which does not exist");
        expect(with(json!({ "index": 0 }), &|glb| glb.json["textures"][0]["source"] = json!(9)), "has no PNG");
        let no_data = |glb: &mut Glb| glb.json["images"][0] = json!({ "name": "Wood", "uri": "absent.png" });
        expect(with(json!({ "index": 0 }), &no_data), "`absent.png`, which cannot be opened");
        let far = json!({ "index": 0, "extensions": { "KHR_texture_transform": { "offset": [1e39, 0] } } });
        expect(with(far, &|_| ()), "not finite");
        let wrong = with(json!({ "index": "x" }), &|_| ());
        assert!(wrong.contains("invalid") || wrong.contains("not valid"), "{slot}: {wrong}");
    }
}

#[test]
fn transforms_that_cannot_be_undone_are_left_to_the_textures() {
    let mut glb = complete();
    let transform =
        |scale: f64| json!({ "index": 0, "extensions": { "KHR_texture_transform": { "scale": [scale, 1] } } });
    glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = transform(0.0);
    glb.json["materials"][0]["emissiveTexture"] = transform(3.0);
    let scene = read(&glb);
    check_invariants(&scene);
    assert_eq!(scene.meshes[0].uvs, read(&complete()).meshes[0].uvs);
    let scales: Vec<f64> = scene.textures.iter().map(|texture| texture.transform.matrix2.x_axis.x).collect();
    assert_eq!(scales, [0.0, 3.0]);
    glb.json["materials"][0]["emissiveTexture"] = transform(1e8);
    assert!(refusal(&glb.build()).contains("texture transforms of material `Paint` differ"));
}

#[test]
fn retroreflectors_are_read() {
    let with = |value: Value| {
        let mut glb = complete();
        extensions(&mut glb)["KHR_materials_transmission"]["transmissionFactor"] = json!(0.0);
        glb.json["materials"][0]["extras"] = json!({ "retroreflector": value });
        glb
    };
    let scene = read(&with(json!({ "share": 0.3, "angle": 0.5 })));
    assert_eq!(scene.materials[0].retroreflector, Some(Retroreflector { share: 0.3, angle: 0.5 }));
    assert!(scene.warnings.is_empty());
    assert_eq!(read(&with(json!(null))).materials[0].retroreflector, None);
    let mut glb = complete();
    glb.json["materials"][0]["extras"] = json!("made of glass beads");
    assert_eq!(read(&glb).materials[0].retroreflector, None);

    for (value, part) in [
        (json!({ "share": -0.1, "angle": 0.5 }), "a share of -0.1; it must be from 0 to 1"),
        (json!({ "share": 1.5, "angle": 0.5 }), "a share of 1.5; it must be from 0 to 1"),
        (json!({ "share": 0.3, "angle": 0.01 }), "an angle of 0.01 degrees; it must be from 0.1 to 60"),
        (json!({ "share": 0.3, "angle": 1e30 }), "it must be from 0.1 to 60"),
        (json!({ "share": 0.3, "angle": -1 }), "it must be from 0.1 to 60"),
        (json!({ "share": "a lot", "angle": 0.5 }), "write {\"share\": 0.3, \"angle\": 0.5}"),
        (json!({ "share": 0.3 }), "missing field `angle`"),
        (json!({ "share": 0.3, "angle": 0.5, "width": 2 }), "unknown field `width`"),
    ] {
        let message = refusal(&with(value.clone()).build());
        assert!(message.contains(part) && message.contains("Paint"), "{value}: {message}");
    }
    let mut glass = with(json!({ "share": 0.3, "angle": 0.5 }));
    extensions(&mut glass)["KHR_materials_transmission"]["transmissionFactor"] = json!(1.0);
    let message = refusal(&glass.build());
    assert!(message.contains("has a retroreflector and a transmission of 1; set the transmission to 0"), "{message}");
}
