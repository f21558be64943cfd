//! Media in the extras of the scene and of materials.

use glam::DVec3;
use taugate::internals::scene::{Medium, PhaseFunction};

use super::*;

fn with_medium(medium: Value) -> Glb {
    let mut glb = complete();
    glb.json["scenes"][0]["extras"] = json!({ "medium": medium });
    glb
}

#[test]
fn the_medium_of_the_scene_is_read() {
    let scene = read(&with_medium(json!({
        "type": "homogeneous", "sigma_s": [0.012, 0.012, 0.011], "sigma_a": [0.00012, 0.00012, 0.0001],
        "phase": { "type": "hg", "g": 0.8 }, "note": "per metre",
    })));
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.8 };
    let (sigma_s, sigma_a) = ([0.012, 0.012, 0.011], [0.00012, 0.00012, 0.0001]);
    assert_eq!(scene.media, [Medium { sigma_s, sigma_a, phase, ..Medium::default() }]);
    assert!(scene.warnings.is_empty());

    let scene = read(&with_medium(json!({ "sigma-s": 0.5, "bounds": [[0, 0, 0], [1, 2, 3]] })));
    let bounds = Some([DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)]);
    assert_eq!(scene.media, [Medium { sigma_s: [0.5; 3], bounds, ..Medium::default() }]);
    // Without a group index, water has that of its phase.
    let water = read(&with_medium(json!({ "sigma_a": 0.1, "ior": 1.33 }))).media.remove(0);
    assert_eq!((water.ior, water.group_ior, water.sigma_a), (1.33, 1.33, [0.1; 3]));
}

#[test]
fn every_phase_function_is_read() {
    let cases = [
        (json!({ "type": "isotropic" }), PhaseFunction::Isotropic),
        (json!({ "type": "rayleigh" }), PhaseFunction::Rayleigh),
        (
            json!({ "type": "double-hg", "g": [0.9, -0.4], "weight": 0.8 }),
            PhaseFunction::DoubleHenyeyGreenstein { g: [0.9, -0.4], weight: 0.8 },
        ),
        (
            json!({ "type": "draine", "g": 0.9, "g_draine": 0.5, "alpha": 20, "weight_draine": 0.3 }),
            PhaseFunction::HenyeyGreensteinDraine { g: 0.9, g_draine: 0.5, alpha: 20.0, weight_draine: 0.3 },
        ),
        (
            json!({ "type": "table", "cosines": [-1, 0, 1], "values": [1, 2, 3] }),
            PhaseFunction::Table { cosines: vec![-1.0, 0.0, 1.0], values: vec![1.0, 2.0, 3.0] },
        ),
    ];
    for (phase, expected) in cases {
        let scene = read(&with_medium(json!({ "sigma_s": 1, "phase": phase })));
        assert_eq!(scene.media[0].phase, expected);
    }
}

#[test]
fn extras_of_other_programs_are_no_media() {
    for (medium, warnings) in
        [(json!("oil on canvas"), 1), (json!(3), 1), (json!({}), 1), (json!([]), 1), (json!(null), 0)]
    {
        let scene = read(&with_medium(medium));
        assert!(scene.media.is_empty() && scene.warnings.len() == warnings, "{:?}", scene.warnings);
    }
}

#[test]
fn the_medium_inside_a_material_is_read() {
    let mut glb = complete();
    glb.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = json!(1.0);
    glb.json["materials"][0]["extras"] = json!({ "medium": { "sigma_a": [1, 2, 3] } });
    let scene = read(&glb);
    assert_eq!(scene.materials[0].interior, Some(Medium { sigma_a: [1.0, 2.0, 3.0], ..Medium::default() }));
    assert!(scene.warnings.is_empty());
    glb.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = json!(0.0);
    assert!(refusal(&glb.build()).contains("material 'Paint' has a medium inside, but a transmission of 0"));
}

fn with_volume(volume: Value) -> Glb {
    let mut glb = complete();
    glb.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = json!(1.0);
    glb.json["materials"][0]["extensions"]["KHR_materials_volume"] = volume;
    glb
}

#[test]
fn the_absorption_of_a_volume_is_read() {
    let volume = json!({ "thicknessFactor": 0.1, "attenuationDistance": 0.5, "attenuationColor": [1.0, 0.5, 0.0] });
    let mut glb = with_volume(volume.clone());
    let absorption = [0.0, 2f64.ln() / 0.5, 1e15];
    let sigma_a = |glb: &Glb| read(glb).materials[0].interior.as_ref().map(|medium| medium.sigma_a);
    assert_eq!(sigma_a(&glb), Some(absorption));
    // With a medium in the extras, the volume adds its absorption.
    glb.json["materials"][0]["extras"] = json!({ "medium": { "sigma_s": 3, "sigma_a": [1, 0, 0] } });
    let expected = Medium { sigma_s: [3.0; 3], sigma_a: [1.0, absorption[1], 1e15], ..Medium::default() };
    assert_eq!(read(&glb).materials[0].interior, Some(expected));
    // Without transmission, light does not get inside.
    let mut opaque = with_volume(volume.clone());
    opaque.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = json!(0.0);
    assert_eq!(sigma_a(&opaque), None);
    // White, and no distance.
    for (key, value) in [("attenuationColor", json!([1, 1, 1])), ("attenuationDistance", json!(null))] {
        let mut clear = volume.clone();
        clear[key] = value;
        assert_eq!(sigma_a(&with_volume(clear)), None, "{key}");
    }
    let mut thin = volume;
    thin["thicknessFactor"] = json!(0.0);
    let thin = read(&with_volume(thin));
    assert!(thin.materials[0].interior.is_none());
    assert!(thin.warnings[0].contains("a thicknessFactor of 0 absorb nothing"), "{:?}", thin.warnings);
}

#[test]
fn bad_volumes_are_refused() {
    let cases = [
        (json!({ "attenuationDistance": 0 }), "the attenuationDistance of material `Paint` is 0; it must be above 0"),
        (json!({ "attenuationDistance": -1.5 }), "is -1.5; it must be above 0"),
        (json!({ "attenuationColor": [0, 1, 1.5] }), "the attenuationColor of material `Paint` is not from 0 to 1"),
        (json!({ "attenuationColor": [0, -1, 0] }), "is not from 0 to 1"),
        (json!({ "attenuationColor": "red" }), "the KHR_materials_volume of material `Paint` is invalid"),
    ];
    for (volume, part) in cases {
        let message = refusal(&with_volume(volume).build());
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn bad_media_are_refused() {
    let cases = [
        (json!({ "sigma_s": -1 }), "medium 0 has a sigma_s of -1"),
        (json!({ "sigma_a": [0, 1e300, 0] }), "medium 0 has a sigma_a of 1000"),
        (json!({ "sigma_s": 1, "phase": { "type": "hg", "g": 1 } }), "a g of 1"),
        (json!({ "sigma_s": 1, "bounds": [[1, 0, 0], [0, 1, 1]] }), "first corner is not below the second"),
        (json!({ "sigma_s": 1, "bounds": [[0, 0, 0], [1, 1, 1]], "ior": 1.33 }), "remove its bounds"),
        (json!({ "sigma_s": [1, 2] }), "extras.medium of the scene has a sigma_s or sigma_a that is neither"),
        (json!({ "sigma_s": "much" }), "extras.medium of the scene has a sigma_s or sigma_a that is neither"),
        (json!({ "sigma_s": 1, "type": "grid" }), "has the type `grid` instead of `homogeneous`"),
        (json!({ "sigma_s": 1, "albedo": 1 }), "unknown field `albedo`"),
        (json!({ "sigma_s": 1, "phase": { "type": "mie" } }), "unknown variant `mie`"),
        (json!({ "sigma_s": 1, "phase": { "type": "hg" } }), "missing field `g`"),
    ];
    for (medium, part) in cases {
        let message = refusal(&with_medium(medium).build());
        assert!(message.contains(part), "{part}: {message}");
    }
}
