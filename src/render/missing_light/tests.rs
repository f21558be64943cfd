use glam::DVec3;

use super::*;
use crate::generate::parts::{add, camera, diffuse, glass, material, metal};
use crate::generate::shapes::{cuboid, icosphere, quad};
use crate::scene::{LightKind, Material, Medium};
use crate::settings::gates::Gates;
use crate::settings::{Estimator, SettingsBuilder};

/// A wall 4 m before a camera that looks along -Z, and a lamp at the camera.
fn wall() -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-9.0, -9.0, -4.0), 18.0 * DVec3::X, 18.0 * DVec3::Y, [1.0; 2]));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.2, [16, 16]);
    scene.add_light("headlamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    scene
}

/// Adds a pane of glass 2 cm thick, 1 m before the camera, from `left` to 3 m on the right.
fn add_pane(scene: &mut Scene, left: f64, kind: Material) {
    let pane = material(scene, kind);
    add(scene, "pane", pane, cuboid(DVec3::new(left, -3.0, -1.01), DVec3::new(3.0, 3.0, -0.99)));
}

/// The light that a render without merging misses.
fn found_with(scene: &Scene, change: impl Fn(SettingsBuilder) -> SettingsBuilder) -> Option<MissingLight> {
    let settings = change(Settings::builder().resolution([16, 16]).merge(Merge::Off)).build().unwrap();
    missing_light(scene, &settings, &PreparedScene::new(scene, &settings).unwrap())
}

fn found(scene: &Scene) -> Option<MissingLight> {
    found_with(scene, |settings| settings)
}

#[test]
fn a_wall_behind_a_pane_misses_the_light_of_a_headlamp() {
    assert_eq!(found(&wall()), None);
    let mut scene = wall();
    add_pane(&mut scene, -3.0, glass("glass"));
    let missing = found(&scene).unwrap();
    assert_eq!((missing.share, missing.lamp.as_str(), missing.object.as_str()), (1.0, "headlamp", "pane"));
    assert!(
        missing.describe().starts_with("100 % of the pixels miss light of 'headlamp', because it passes smooth glass")
    );
    assert_eq!(found_with(&scene, |settings| settings.merge(Merge::Auto)), None);
    let gates = Gates::new(Gate { lo: 7.0, hi: 9.0 }, 2).unwrap();
    assert_eq!(found_with(&scene, |settings| settings.merge(Merge::Auto).responses(gates)), None);
    let paper = found_with(&scene, |settings| settings.merge(Merge::Auto).strategies(Strategies::Paper)).unwrap();
    assert!(paper.describe().starts_with(
        "100 % of the pixels miss light of 'headlamp' (about 100 % of the direct light there), which has no surface"
    ));
    // The path has 6 segments and takes 8.02 m.
    let with_depth = |depth| found_with(&scene, |settings| settings.max_depth(depth)).unwrap();
    assert!(with_depth(5).too_long && !with_depth(6).too_long);
    let text = with_depth(2).describe();
    assert!(text.contains("--max-depth leaves out paths") && text.contains("100 % of the pixels"), "{text}");
    let gate = |lo, hi| found_with(&scene, |settings| settings.gate(Gate { lo, hi }));
    assert!(gate(8.0, 8.1).is_some() && gate(9.0, 10.0).is_none() && gate(7.0, 8.01).is_none());
}

#[test]
fn the_share_of_the_pixels_behind_half_a_pane_is_told() {
    let mut scene = wall();
    add_pane(&mut scene, 0.0, glass("glass"));
    assert_eq!(found(&scene).unwrap().share, 0.5);
}

#[test]
fn light_that_strategies_form_is_not_missing() {
    // Rough glass can be connected.
    let mut scene = wall();
    add_pane(&mut scene, -3.0, Material { roughness: 0.2, ..glass("rough") });
    assert_eq!(found(&scene), None);
    // A lamp with a surface can be hit.
    let mut scene = wall();
    add_pane(&mut scene, -3.0, glass("glass"));
    scene.lights.clear();
    let shine = material(&mut scene, Material::emitter("shine", [1.0; 3]));
    add(&mut scene, "lamp", shine, icosphere(0.1, 1));
    assert_eq!(found(&scene), None);
    // A ball of glass beside the view.
    let mut scene = wall();
    let ball = material(&mut scene, glass("glass"));
    add(&mut scene, "ball", ball, {
        let mut ball = icosphere(0.3, 2);
        ball.positions.iter_mut().for_each(|p| (p[0], p[2]) = (p[0] + 2.0, p[2] - 2.0));
        ball
    });
    assert_eq!(found(&scene), None);
}

/// A lamp between pane and wall lights the wall straight. The pane reflects 7.7 % of the light, over a longer way.
#[test]
fn the_missing_part_of_the_light_is_told() {
    let mut scene = wall();
    add_pane(&mut scene, -3.0, glass("glass"));
    // 5 m instead of 1 m: 0.3 %, too little to tell.
    scene.lights[0].position = DVec3::NEG_Z * 3.0;
    assert_eq!(found(&scene), None);
    scene.lights[0].position = DVec3::NEG_Z * 1.5;
    // 3.5 m instead of 2.5 m.
    let reflected = 0.077 * (2.5f64 / 3.5).powi(2);
    let MissingLight { share, loss, .. } = found(&scene).unwrap();
    assert!(share > 0.95 && (loss / (reflected / (1.0 + reflected)) - 1.0).abs() < 0.2, "{share} {loss} {reflected}");
}

/// A mirror at 45 degrees before the camera shows a wall aside, which the lamp lights over the same mirror.
#[test]
fn a_wall_lit_and_seen_over_a_mirror_misses_light() {
    let scene = |lamp: DVec3| {
        let mut scene = Scene::default();
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        add(&mut scene, "wall", grey, quad(DVec3::new(4.0, -9.0, 8.0), -18.0 * DVec3::Z, 18.0 * DVec3::Y, [1.0; 2]));
        let silver = material(&mut scene, metal("silver", [0.9; 3], 0.0));
        let along = DVec3::new(1.0, 0.0, -1.0);
        add(&mut scene, "mirror", silver, quad(DVec3::new(-0.5, -1.0, -0.5), along, 2.0 * DVec3::Y, [1.0; 2]));
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.2, [16, 16]);
        scene.add_light("lamp", lamp, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
        scene
    };
    let missing = found(&scene(DVec3::new(0.1, 0.1, 0.0))).unwrap();
    assert_eq!((missing.object.as_str(), missing.only_before), ("mirror", false));
    assert!(missing.share > 0.9, "{}", missing.share);
    let mut matt = scene(DVec3::new(0.1, 0.1, 0.0));
    matt.materials[1].roughness = 0.3;
    assert_eq!(found(&matt), None);
}

/// A sheet of thin glass at 45 degrees before the camera and a lamp reflects a wall aside, which the lamp lights straight and over the
/// sheet.
#[test]
fn a_wall_lit_and_seen_over_thin_glass_misses_light() {
    let scene = |kind: Material| {
        let mut scene = Scene::default();
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        add(&mut scene, "wall", grey, quad(DVec3::new(4.0, -9.0, 8.0), -18.0 * DVec3::Z, 18.0 * DVec3::Y, [1.0; 2]));
        let pane = material(&mut scene, kind);
        let along = DVec3::new(1.0, 0.0, -1.0);
        add(&mut scene, "pane", pane, quad(DVec3::new(-0.5, -1.0, -0.5), along, 2.0 * DVec3::Y, [1.0; 2]));
        camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.05, [16, 16]);
        scene.add_light("lamp", DVec3::new(0.0, 0.0, 0.0), DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
        scene
    };
    let missing = found_with(&scene(glass("glass")), |settings| settings.merge(Merge::Auto)).unwrap();
    assert_eq!((missing.object.as_str(), missing.by_sheets, missing.only_before), ("pane", true, false));
    let (face, cosine) = (0.5 * (0.0920f64 + 0.0920 * 0.0920), 4.0 / 17f64.sqrt());
    let sheet = 2.0 * face / (1.0 + face);
    // Over the sheet 5 m, straight the root of 17 m.
    let ratio = sheet / 25.0 / (cosine / 17.0);
    let wanted = ratio / (1.0 + ratio);
    assert!(missing.share == 1.0 && (missing.loss / wanted - 1.0).abs() < 0.1, "{missing:?}, not {wanted}");
    assert!(missing.describe().contains("thin glass, such as 'pane', reflects it before it is scattered"));
    // Rough glass can be connected, and glass of the index of air reflects nothing.
    assert_eq!(found(&scene(Material { roughness: 0.3, ..glass("rough") })), None);
    assert_eq!(found(&scene(Material { ior: 1.0, ..glass("clear") })), None);
}

/// A window before a wall reflects nothing that matters, even if there is a wall behind the lamp.
#[test]
fn a_window_misses_no_light_that_matters() {
    let mut scene = wall();
    let pane = material(&mut scene, glass("glass"));
    add(&mut scene, "pane", pane, quad(DVec3::new(-3.0, -3.0, -1.0), 6.0 * DVec3::X, 6.0 * DVec3::Y, [1.0; 2]));
    assert_eq!(found(&scene), None);
    add(&mut scene, "behind", 0, quad(DVec3::new(-9.0, -9.0, 4.0), 18.0 * DVec3::Y, 18.0 * DVec3::X, [1.0; 2]));
    assert_eq!(found(&scene), None);
    // But in a gate that holds this light alone.
    let gate = Gate { lo: 11.9, hi: 12.5 };
    assert!(found_with(&scene, |settings| settings.gate(gate)).unwrap().by_sheets);
    assert!(!found_with(&scene, |settings| settings.estimator(Estimator::Pt)).is_some_and(|missing| missing.by_sheets));
}

/// Turbid water behind a smooth surface.
#[test]
fn light_in_milk_is_missing_unless_its_surface_does_not_bend_light() {
    let scene = |ior: f32| {
        let mut scene = wall();
        let interior = Some(Medium { sigma_s: [1.0; 3], ..Medium::default() });
        let milk = material(&mut scene, Material { ior, interior, ..glass("milk") });
        add(&mut scene, "milk", milk, cuboid(DVec3::new(-0.5, -0.5, -3.5), DVec3::new(0.5, 0.5, -2.5)));
        scene
    };
    assert_eq!(found(&scene(1.33)).unwrap().object, "milk");
    assert_eq!(found_with(&scene(1.33), |settings| settings.merge(Merge::Auto)), None);
    assert_eq!(found(&scene(1.0)), None);
}

/// A caustic on the wall, seen without glass: only estimators with light subpaths form it.
#[test]
fn path_tracing_forms_no_caustics_of_point_lamps() {
    let mut scene = wall();
    let ball = material(&mut scene, glass("glass"));
    add(&mut scene, "ball", ball, {
        let mut ball = icosphere(0.3, 3);
        ball.positions.iter_mut().for_each(|p| (p[0], p[2]) = (p[0] + 1.0, p[2] - 3.0));
        ball
    });
    scene.lights[0].position = DVec3::new(2.0, 0.0, -2.0);
    let with = |estimator| found_with(&scene, |settings| settings.estimator(estimator));
    assert!(with(Estimator::Pt).unwrap().only_before);
    assert_eq!(with(Estimator::Bdpt), None);
}
