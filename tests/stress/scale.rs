//! A scene gives the same image when it is scaled up or down, or moved far from the origin of world space.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, glass, light, material, metal};
use taugate::internals::generate::shapes::cuboid;
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{LightKind, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{device, settings, threshold};
use super::{image, sum};
use taugate::internals::generate::zoo::{Light, zoo};

const SIZE: [u32; 2] = [24, 16];
const GATE: Gate = Gate { lo: 8.0, hi: 9.0 };
/// Largest fraction of the light that may change when all coordinates round differently. A ray or a random choice at an edge may
/// fall to the other side, and each of the 1,536 paths of an image is a visible part of it. The limit holds for estimators
/// without trees: if rounding swaps two light vertices, nodes of the tree change, and with them the results of many queries.
const ROUNDING: f64 = 2e-3;
/// Number of independent iterations from which the change of the mean is estimated.
const ITERATIONS: u32 = 64;
/// Maximum of the standard error of the relative change of the mean. With a larger error, the test would notice little.
const MAX_STANDARD_ERROR: f64 = 0.02;

/// The scene scaled by `scale`, then moved by `shift`. Intensity and power are multiplied by `scale` squared and coefficients of
/// media divided by `scale`, so that radiance stays the same.
fn placed(scene: &Scene, scale: f64, shift: DVec3) -> Scene {
    let mut out = scene.clone();
    let move_to = |p: DVec3| p * scale + shift;
    for instance in &mut out.instances {
        let t = instance.transform;
        instance.transform = DAffine3 { matrix3: t.matrix3 * scale, translation: move_to(t.translation) };
    }
    for camera in &mut out.cameras {
        camera.transform.translation = move_to(camera.transform.translation);
    }
    for medium in &mut out.media {
        medium.sigma_s = medium.sigma_s.map(|sigma| sigma / scale);
        medium.sigma_a = medium.sigma_a.map(|sigma| sigma / scale);
        medium.bounds = medium.bounds.map(|bounds| bounds.map(move_to));
    }
    let times_scale_squared = |rgb: [f32; 3]| rgb.map(|x| (f64::from(x) * scale * scale) as f32);
    for light in &mut out.lights {
        light.position = move_to(light.position);
        light.kind = match light.kind {
            LightKind::Point { intensity } => LightKind::Point { intensity: times_scale_squared(intensity) },
            LightKind::Spot { intensity, inner, outer } => {
                LightKind::Spot { intensity: times_scale_squared(intensity), inner, outer }
            }
            LightKind::Beam { power, radius } => {
                LightKind::Beam { power: times_scale_squared(power), radius: (f64::from(radius) * scale) as f32 }
            }
            directional => directional,
        };
    }
    out
}

/// The Cornell box with its area light, a point light, a beam, a mirror and a glass block.
fn mixed() -> Scene {
    let mut scene = build(Kind::CornellBox);
    let mirror = material(&mut scene, metal("mirror", [0.9; 3], 0.0));
    add(&mut scene, "mirror", mirror, cuboid(DVec3::new(-0.95, 0.4, -0.6), DVec3::new(-0.9, 1.4, 0.4)));
    let clear = material(&mut scene, glass("glass"));
    add(&mut scene, "block", clear, cuboid(DVec3::new(0.1, 0.62, 0.1), DVec3::new(0.5, 0.9, 0.5)));
    light(
        &mut scene,
        "point",
        DVec3::new(0.7, 1.6, 0.5),
        DVec3::NEG_Y,
        LightKind::Point { intensity: [0.3, 0.5, 0.9] },
    );
    let beam = LightKind::Beam { power: [2.0, 1.0, 1.0], radius: 0.02 };
    light(&mut scene, "beam", DVec3::new(0.2, 1.2, 0.9), DVec3::new(-0.2, -0.3, -1.0), beam);
    scene
}

/// [`mixed`] with fog in the back half of the box.
fn mixed_in_fog() -> Scene {
    let bounds = Some([DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 0.0)]);
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    let fog = Medium { sigma_s: [0.3, 0.4, 0.5], sigma_a: [0.1, 0.05, 0.02], phase, bounds, ..Medium::default() };
    Scene { media: vec![fog], ..mixed() }
}

/// Images of independent iterations, through the gate scaled by `scale`.
fn render(scene: &Scene, estimator: Estimator, scale: f64) -> Vec<Vec<f32>> {
    let s = settings(estimator, SIZE).max_depth(8).light_paths(500).build().unwrap();
    let mut renderer = Renderer::new(&device(), scene, &s).unwrap_or_else(|e| panic!("{e}"));
    let gate = Gate { lo: GATE.lo * scale, hi: GATE.hi * scale };
    let out: Vec<Vec<f32>> = (0..ITERATIONS).map(|i| image(&mut renderer, 3 + i, gate, 1, 4)).collect();
    assert!(sum(&out[0]) > 0.0, "a black image proves nothing");
    assert_eq!(renderer.stats().dropped, 0, "{estimator:?} at scale {scale:e}: contributions that are not finite");
    out
}

/// Sum of the absolute differences of `a` and `b`, relative to the sum of `a`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / sum(a)
}

/// Relative change of the mean from `usual` to `there`, two sets of images with the same seeds, and its standard error.
fn relative_change(usual: &[Vec<f32>], there: &[Vec<f32>]) -> (f64, f64) {
    let n = usual.len() as f64;
    let mean = usual.iter().map(|image| sum(image)).sum::<f64>() / n;
    let changes: Vec<f64> = usual.iter().zip(there).map(|(a, b)| (sum(b) - sum(a)) / mean).collect();
    let change = changes.iter().sum::<f64>() / n;
    let variance = changes.iter().map(|c| (c - change).powi(2)).sum::<f64>() / (n - 1.0);
    (change, (variance / n).sqrt())
}

/// Fails if `scene` has another image at one of `places` (scale, and distance from the origin of world space in metres).
fn assert_same_image_at(scene: &Scene, name: &str, estimator: Estimator, places: &[(f64, f64)]) {
    let usual = render(scene, estimator, 1.0);
    for &(scale, distance) in places {
        let shift = DVec3::new(0.6, -0.3, 0.74).normalize() * distance;
        let there = render(&placed(scene, scale, shift), estimator, scale);
        let difference = difference(&usual[0], &there[0]);
        let (change, error) = relative_change(&usual, &there);
        let summary = format!(
            "{name}, {estimator:?}: scale {scale:e}, at {distance:e} m: pixels differ by {difference:.1e}, the mean by \
             {change:+.1e} +- {error:.1e}"
        );
        println!("{summary}");
        match estimator {
            Estimator::Pt | Estimator::Bdpt => assert!(difference < ROUNDING, "{summary}"),
            Estimator::Epc | Estimator::LcsPaper | Estimator::Lcs => {
                assert!(error < MAX_STANDARD_ERROR && change.abs() <= 1e-6 + threshold(TESTS) * error, "{summary}")
            }
        }
    }
}

/// Upper bound on the number of comparisons over all estimators and scenes, for the significance threshold.
const TESTS: usize = PLACES.len() * 20;
/// Scale of the scene, and its distance from the origin of world space in metres.
const PLACES: [(f64, f64); 7] = [(1e-3, 0.0), (1e3, 0.0), (1e6, 0.0), (1e9, 0.0), (1.0, 1e3), (1.0, 1e5), (1e-3, 1e5)];

#[test]
fn a_scene_far_away_or_vast_is_the_same_image() {
    assert_same_image_at(&mixed(), "mixed", Estimator::LcsPaper, &[(1e9, 0.0), (1.0, 1e5)]);
}

/// At scale 1e9 the fourth power of a distance overflowed in the MIS sums, and 11 contributions were dropped as non-finite.
/// Scaling by a power of two changes no mantissa, so the image must keep its bits.
#[test]
fn powers_of_two_change_no_bit() {
    let scene = zoo(Light::Area);
    let usual = render(&scene, Estimator::Bdpt, 1.0);
    let far = render(&placed(&scene, 30f64.exp2(), DVec3::ZERO), Estimator::Bdpt, 30f64.exp2());
    let bits = |images: &[Vec<f32>]| images.concat().into_iter().map(f32::to_bits).collect::<Vec<_>>();
    assert!(bits(&usual) == bits(&far), "{:e}", difference(&usual[0], &far[0]));
}

/// Negative control: gates that are off by a thousandth (pt) and by a tenth (lcs).
#[test]
fn a_gate_that_is_scaled_wrongly_is_noticed() {
    let scene = mixed();
    let usual = render(&scene, Estimator::Pt, 1.0);
    let off = render(&scene, Estimator::Pt, 1.001);
    assert!(difference(&usual[0], &off[0]) > 2.0 * ROUNDING, "{:e}", difference(&usual[0], &off[0]));
    let usual = render(&scene, Estimator::Lcs, 1.0);
    let (change, error) = relative_change(&usual, &render(&scene, Estimator::Lcs, 1.1));
    assert!(change.abs() > threshold(TESTS) * error && error < MAX_STANDARD_ERROR, "{change:e} +- {error:e}");
}

#[test]
#[ignore = "takes minutes"]
fn every_estimator_and_emitter_at_every_scale_and_place() {
    for estimator in Estimator::ALL {
        assert_same_image_at(&mixed(), "mixed", estimator, &PLACES);
        assert_same_image_at(&mixed_in_fog(), "mixed, in fog", estimator, &PLACES);
        assert_same_image_at(&zoo(Light::Area), "area light", estimator, &PLACES);
        assert_same_image_at(&zoo(Light::Punctual), "point and spot", estimator, &PLACES);
        if estimator != Estimator::Pt {
            assert_same_image_at(&zoo(Light::Beam), "beam", estimator, &PLACES);
        }
    }
}
