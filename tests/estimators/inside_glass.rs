//! The camera and lamps inside of glass, together with opaque objects: the estimators against closed forms and the oracle.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material, mesh, place};
use taugate::internals::generate::shapes::{cuboid, icosphere, quad};
use taugate::internals::scene::{LightKind, Material, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, bin, oracle, oracle_samples, unlike_estimators};
use super::cells::{Cells, renderer, settings, threshold};

const SIZE: [u32; 2] = [16, 8];
/// Index of refraction of `parts::glass`.
const INDEX: f64 = 1.5;

/// A grey plate inside of a block of glass, lit by a bulb. Camera and bulb are in the glass too, one metre above the plate.
fn plate_in_glass(bulb: DVec3) -> Scene {
    let mut scene = Scene::default();
    let block = material(&mut scene, glass("block"));
    add(&mut scene, "block", block, cuboid(DVec3::splat(-2.0), DVec3::splat(2.0)));
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "plate", grey, quad(DVec3::new(-1.0, -1.0, -1.0), DVec3::X * 2.0, DVec3::Y * 2.0, [1.0; 2]));
    light(&mut scene, "bulb", bulb, DVec3::NEG_Z, LightKind::Point { intensity: [3.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [4, 4]);
    scene
}

/// Light that the plate reflects once. Its travel time counts the glass on both segments.
#[test]
fn a_bulb_in_the_glass_around_the_camera_lights_a_plate_as_the_closed_form_says() {
    let bulb = DVec3::new(0.6, 0.0, 0.0);
    let scene = plate_in_glass(bulb);
    let distance = (bulb + DVec3::Z).length();
    let truth = 0.5 / PI * 3.0 / distance.powi(3);
    let tau = INDEX * (1.0 + distance);
    for estimator in [Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs, Estimator::Epc] {
        let s = settings(estimator, [4, 4]).max_depth(2).light_paths(200).splat_paths(50).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        let mut mean = |lo: f64, hi: f64| Cells::measure(&mut renderer, Gate { lo, hi }, 4, 2, 4, 100).whole();
        let (found, error) = mean(tau - 0.01, tau + 0.01);
        eprintln!("{estimator}: {found:.5} +- {error:.1e}, expected {truth:.5}");
        let off = |truth: f64| ((found - truth).abs() - 1e-3 * truth).max(0.0) / error.max(1e-9);
        assert!(off(truth) < threshold(1) && off(1.05 * truth) > threshold(1), "{estimator}");
        // No light arrives as if one of the segments were in air.
        assert_eq!(mean(0.0, tau - 0.02).0, 0.0, "{estimator}");
    }
}

/// A room with a block of glass, which the camera is inside of. With it in the glass are a white cube and a small lamp. A larger lamp
/// shines from outside. `milk`: the medium in the glass. `fog`: the medium around the glass.
fn block(milk: Option<Medium>, fog: Option<Medium>) -> Scene {
    let mut scene = Scene::default();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let grey = material(&mut scene, diffuse("grey", [0.6, 0.5, 0.4]));
    let shine = material(&mut scene, emitter("lamp", [4.0; 3]));
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    let clear = material(&mut scene, Material { interior: milk, ..glass("block") });
    add(&mut scene, "floor", grey, quad(DVec3::new(-2.0, -1.0, -2.0), z * 4.0, x * 4.0, [1.0; 2]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-2.0, -1.0, -2.0), x * 4.0, y * 3.0, [1.0; 2]));
    add(&mut scene, "lamp", shine, quad(DVec3::new(-0.5, 2.0, -1.8), x, z, [1.0; 2]));
    add(&mut scene, "block", clear, cuboid(DVec3::new(-1.0, -0.9, -1.2), DVec3::new(1.0, 0.9, 1.2)));
    let cube = DVec3::new(-0.35, -0.1, -0.3);
    add(&mut scene, "cube", white, cuboid(cube - DVec3::splat(0.25), cube + DVec3::splat(0.25)));
    let ball = icosphere(0.1, 1);
    let bright = material(&mut scene, emitter("core", [30.0; 3]));
    let core = mesh(&mut scene, "core", bright, ball);
    place(&mut scene, "core", core, DAffine3::from_translation(DVec3::new(0.45, 0.2, 0.1)));
    camera(&mut scene, DVec3::new(0.1, 0.1, 1.0), DVec3::new(0.0, -0.1, -0.3), 0.9, SIZE);
    scene.media.extend(fog);
    scene
}

fn medium(sigma_s: f64, sigma_a: [f64; 3]) -> Medium {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.4 };
    Medium { sigma_s: [sigma_s; 3], sigma_a, phase, ..Medium::default() }
}

#[test]
fn a_camera_in_clear_glass_agrees_with_the_oracle() {
    let gates = [(2.4, 3.0), (0.0, f64::INFINITY)];
    let scene = block(None, None);
    let truth = oracle(&scene, &gates, SIZE, oracle_samples());
    assert_none(against("clear block", &unlike_estimators(&scene), &scene, &gates, &truth));
    // Negative control: in glass of another index, light has other travel times.
    let mut denser = block(None, None);
    denser.materials.iter_mut().filter(|m| m.transmission > 0.0).for_each(|m| m.ior = 1.7);
    assert!(!against("denser block", &[Estimator::Lcs], &denser, &gates[..1], &bin(&truth, 0)).is_empty());
}

/// A beam starts in the glass, too. Glass and air are filled with different media.
#[test]
fn a_beam_in_milky_glass_around_the_camera_agrees_with_the_oracle() {
    let gates = [(1.5, 3.0), (0.0, f64::INFINITY)];
    let mut scene = block(Some(medium(0.4, [0.1, 0.3, 0.6])), Some(medium(0.2, [0.05; 3])));
    scene.materials.iter_mut().for_each(|m| m.emission = [0.0; 3]);
    let from = DVec3::new(0.5, 0.4, 0.9);
    let onwards = (DVec3::new(-0.3, -0.1, -0.05) - from).normalize();
    light(&mut scene, "beam", from, onwards, LightKind::Beam { power: [5.0; 3], radius: 0.05 });
    let truth = oracle(&scene, &gates, SIZE, 4 * oracle_samples());
    assert_none(against("beam in milk", &[Estimator::Bdpt, Estimator::Lcs], &scene, &gates, &truth));
}
