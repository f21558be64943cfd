//! Media inside of glass: the estimators against a closed form and the oracle.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, glass, light, material, mesh, place};
use taugate::internals::generate::shapes::{cuboid, icosphere, quad};
use taugate::internals::scene::{LightKind, Material, Medium, PhaseFunction, Scene};
use taugate::internals::self_check::fog::{Coefficients, gated_single_scattering};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, bin, oracle, whole_images};
use super::cells::{Cells, renderer, settings, threshold};

const SIZE: [u32; 2] = [16, 8];
const SIGMA_S: f64 = 1.0;
const SIGMA_T: f64 = 1.5;
const G: f64 = 0.5;
const HG: PhaseFunction = PhaseFunction::HenyeyGreenstein { g: G };
const INTENSITY: f32 = 5.0;

/// A shining wall, seen through a slab of glass that is half a metre thick and absorbs `sigma_a` per metre.
fn window(sigma_a: [f64; 3]) -> Scene {
    let mut scene = Scene::default();
    let shine = material(&mut scene, emitter("shine", [1.0; 3]));
    let corner = DVec3::new(-5.0, -5.0, -3.0);
    add(&mut scene, "wall", shine, quad(corner, DVec3::X * 10.0, DVec3::Y * 10.0, [1.0; 2]));
    let interior = Some(Medium { sigma_a, ..Medium::default() });
    let pane = material(&mut scene, Material { interior, ..glass("pane") });
    add(&mut scene, "pane", pane, cuboid(DVec3::new(-4.0, -4.0, -1.5), DVec3::new(4.0, 4.0, -1.0)));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.01, [4, 4]);
    scene
}

/// The gate contains only light that crosses the slab directly, without reflections between its two faces.
#[test]
fn coloured_glass_absorbs_as_the_closed_form_says() {
    let sigma_a = [2.0, 1.0, 0.1];
    let scene = window(sigma_a);
    let truth =
        |thickness: f64| 0.96f64.powi(2) * sigma_a.map(|sigma| (-thickness * sigma).exp()).iter().sum::<f64>() / 3.0;
    for estimator in [Estimator::Pt, Estimator::Lcs] {
        // Sensor subpaths that end on the wall find this light, so a few light subpaths are enough.
        let s = settings(estimator, [8, 8]).max_depth(6).light_paths(200).splat_paths(50).build().unwrap();
        let gate = Gate { lo: 3.2499, hi: 3.251 };
        let (found, error) = Cells::measure(&mut renderer(&scene, &s), gate, 8, 2, 16, 300).whole();
        let off = |thickness: f64| (found - truth(thickness)).abs() / error;
        eprintln!("{estimator}: {found:.5} +- {error:.1e}, expected {:.5}", truth(0.5));
        // A slab that is 2 cm thicker is rejected.
        assert!(off(0.5) < threshold(2) && off(0.52) > threshold(2), "{estimator}");
    }
}

/// A slab of glass that scatters, half a metre thick and one metre in front of the camera, with a point light inside. `bulb` is the
/// position of the light relative to the point where the camera's axis enters the slab.
fn milky_window(bulb: DVec3) -> Scene {
    let mut scene = Scene::default();
    let interior = Medium { sigma_s: [SIGMA_S; 3], sigma_a: [SIGMA_T - SIGMA_S; 3], phase: HG, ..Medium::default() };
    let pane = material(&mut scene, Material { interior: Some(interior), ..glass("pane") });
    add(&mut scene, "pane", pane, cuboid(DVec3::new(-4.0, -4.0, -1.5), DVec3::new(4.0, 4.0, -1.0)));
    let kind = LightKind::Point { intensity: [INTENSITY; 3] };
    light(&mut scene, "bulb", bulb - DVec3::Z, DVec3::NEG_Y, kind);
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [8, 8]);
    scene
}

/// Light that scatters once inside the glass. The gates hold events inside the slab only.
#[test]
fn light_of_a_bulb_in_glass_scatters_as_the_closed_form_says() {
    let bulb = DVec3::new(0.2, 0.0, -0.25);
    let scene = milky_window(bulb);
    let phase = |cosine: f64| (1.0 - G * G) / (4.0 * PI * (1.0 + G * G - 2.0 * G * cosine).powf(1.5));
    let truth = |sigma_s: f64, gate: [f64; 2]| {
        // One metre of air, then glass of index 1.5. The face passes 96 % of the light, and radiance falls with the index squared.
        let medium = Coefficients { sigma_s, sigma_t: SIGMA_T };
        let lengths = gate.map(|tau| (tau - 1.0) / 1.5);
        0.96 / 2.25 * gated_single_scattering(medium, phase, INTENSITY.into(), bulb, DVec3::NEG_Z, lengths)
    };
    for gate in [[1.6, 1.65], [1.7, 2.05]] {
        for estimator in [Estimator::Pt, Estimator::Lcs] {
            let s = settings(estimator, [8, 8]).max_depth(3).build().unwrap();
            let (lo, hi) = (gate[0], gate[1]);
            let (found, error) = Cells::measure(&mut renderer(&scene, &s), Gate { lo, hi }, 8, 4, 16, 100).whole();
            let expected = truth(SIGMA_S, gate);
            eprintln!("{estimator} {gate:?}: {found:.5e} +- {error:.1e}, expected {expected:.5e}");
            let off = |truth: f64| ((found - truth).abs() - 1e-4 * truth).max(0.0) / error;
            assert!(off(expected) < threshold(8), "{estimator} {gate:?}");
            // A coefficient that is wrong by 10 % is rejected.
            assert!(off(truth(1.1 * SIGMA_S, gate)) > threshold(8), "{estimator} {gate:?}");
        }
    }
}

/// Two balls of scattering glass: a rough one with an opaque cube inside, and a smooth one with a lamp inside. `density`
/// multiplies the coefficients.
fn balls(density: f64) -> Scene {
    let mut scene = Scene::default();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let grey = material(&mut scene, diffuse("grey", [0.6, 0.5, 0.4]));
    let shine = material(&mut scene, emitter("lamp", [4.0; 3]));
    add(&mut scene, "floor", grey, quad(DVec3::new(-2.0, 0.0, -1.5), z * 3.0, x * 4.0, [1.0; 2]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-2.0, 0.0, -1.0), x * 4.0, y * 2.5, [1.0; 2]));
    add(&mut scene, "lamp", shine, quad(DVec3::new(-0.9, 2.0, -0.6), x * 1.0, z * 1.0, [1.0; 2]));
    let milk = |sigma_a: [f64; 3]| Medium {
        sigma_s: [2.0, 2.4, 2.8].map(|sigma| density * sigma),
        sigma_a: sigma_a.map(|sigma| density * sigma),
        phase: HG,
        ..Medium::default()
    };
    let mut ball = |name: &str, roughness: f32, sigma_a: [f64; 3], at: DVec3| {
        let milky = Material { roughness, interior: Some(milk(sigma_a)), ..glass(name) };
        let milky = material(&mut scene, milky);
        let round = mesh(&mut scene, name, milky, icosphere(0.5, 2));
        place(&mut scene, name, round, DAffine3::from_translation(at));
    };
    let (left, right) = (DVec3::new(-0.55, 0.55, 0.0), DVec3::new(0.55, 0.55, 0.0));
    ball("rough", 0.5, [0.2, 0.1, 0.4], left);
    ball("smooth", 0.0, [0.1, 0.5, 0.9], right);
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    add(&mut scene, "cube", white, cuboid(left - DVec3::splat(0.15), left + DVec3::splat(0.15)));
    let core = mesh(&mut scene, "core", shine, icosphere(0.2, 1));
    place(&mut scene, "core", core, DAffine3::from_translation(right));
    camera(&mut scene, DVec3::new(0.0, 0.9, 2.2), DVec3::new(0.0, 0.5, 0.0), 0.6, SIZE);
    scene
}

#[test]
fn glass_with_media_inside_agrees_with_the_oracle() {
    let gates = [(2.4, 3.0), (0.0, f64::INFINITY)];
    let truth = oracle(&balls(1.0), &gates, SIZE, 1000);
    assert_none(against("balls", &[Estimator::Bdpt, Estimator::Lcs], &balls(1.0), &gates, &truth));
    // Negative control: the media are 1.5 times as dense.
    assert!(!against("denser balls", &[Estimator::Lcs], &balls(1.5), &gates[1..], &bin(&truth, 1)).is_empty());
}

/// The long version, with smaller errors: `cargo test --release --test estimators -- --ignored --nocapture interiors`
#[test]
#[ignore = "takes minutes"]
fn whole_images_of_glass_with_media_inside_agree_with_the_oracle() {
    whole_images("balls", &balls(1.0), 2.4);
}
