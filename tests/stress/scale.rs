//! The same scene a thousand times larger, smaller, or far from the origin of its world is the same image.

use glam::{DAffine3, DVec3};
use taugate::generate::shapes::cuboid;
use taugate::generate::stage::{add, glass, light, material, metal};
use taugate::generate::{Kind, build};
use taugate::render::Renderer;
use taugate::scene::{LightKind, Scene};
use taugate::settings::Estimator;
use taugate::units::Gate;

use super::cells::{device, settings};
use super::zoo::{Light, zoo};
use super::{image, sum};

const SIZE: [u32; 2] = [24, 16];
const GATE: Gate = Gate { lo: 8.0, hi: 9.0 };
/// Greatest part of the light that may move when all coordinates round differently: a ray or a choice at an edge falls to the
/// other side, and one path of 1,536 is another one.
const ROUNDING: f64 = 2e-3;

/// The scene `scale` times as large, then moved: radiance of surfaces stays, intensity and power grow with the area.
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
    let area = |rgb: [f32; 3]| rgb.map(|x| (f64::from(x) * scale * scale) as f32);
    for light in &mut out.lights {
        light.position = move_to(light.position);
        light.kind = match light.kind {
            LightKind::Point { intensity } => LightKind::Point { intensity: area(intensity) },
            LightKind::Spot { intensity, inner, outer } => LightKind::Spot { intensity: area(intensity), inner, outer },
            LightKind::Beam { power, radius } => {
                LightKind::Beam { power: area(power), radius: (f64::from(radius) * scale) as f32 }
            }
            directional => directional,
        };
    }
    out
}

/// Cornell box with its lamp, a point, a beam, a mirror and a block of glass.
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

fn render(scene: &Scene, estimator: Estimator, scale: f64) -> Vec<f32> {
    let mut s = settings(estimator, SIZE);
    (s.max_depth, s.light_paths) = (8, 500);
    let mut renderer = Renderer::new(&device(), scene, &s).unwrap_or_else(|e| panic!("{e}"));
    let gate = Gate { lo: GATE.lo * scale, hi: GATE.hi * scale };
    let out = image(&mut renderer, 3, gate, 1, 4);
    assert!(sum(&out) > 0.0, "a black image proves nothing");
    assert_eq!(renderer.stats().dropped, 0, "{estimator:?} at scale {scale:e}: contributions that are not finite");
    out
}

/// Part of the light of `a` that is elsewhere in `b`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / sum(a)
}

fn near(scene: &Scene, name: &str, estimator: Estimator, places: &[(f64, f64)]) {
    let usual = render(scene, estimator, 1.0);
    for &(scale, distance) in places {
        let shift = DVec3::new(0.6, -0.3, 0.74).normalize() * distance;
        let there = render(&placed(scene, scale, shift), estimator, scale);
        let (moved, gain) = (difference(&usual, &there), sum(&there) / sum(&usual) - 1.0);
        println!("{name}, {estimator:?}: scale {scale:e}, at {distance:e} m: {moved:.1e} moved, {gain:+.1e} in all");
        assert!(
            moved < ROUNDING,
            "{name}, {estimator:?}: scale {scale:e}, at {distance} m: {moved:e} of the light moved"
        );
    }
}

const PLACES: [(f64, f64); 7] = [(1e-3, 0.0), (1e3, 0.0), (1e6, 0.0), (1e9, 0.0), (1.0, 1e3), (1.0, 1e5), (1e-3, 1e5)];

#[test]
fn a_scene_far_away_or_vast_is_the_same_image() {
    near(&mixed(), "mixed", Estimator::LcsPaper, &[(1e9, 0.0), (1.0, 1e5)]);
}

/// 11 contributions were dropped as non-finite at 1e9: the fourth power of a distance overflowed in the MIS sums.
#[test]
fn powers_of_two_change_no_bit() {
    let scene = zoo(Light::Area);
    let usual = render(&scene, Estimator::Bdpt, 1.0);
    let far = render(&placed(&scene, 30f64.exp2(), DVec3::ZERO), Estimator::Bdpt, 30f64.exp2());
    assert!(usual.iter().zip(&far).all(|(a, b)| a.to_bits() == b.to_bits()), "{:e}", difference(&usual, &far));
}

/// The sibling that must fail: a gate that is off by a thousandth.
#[test]
fn a_gate_that_is_scaled_wrongly_is_noticed() {
    let scene = mixed();
    let usual = render(&scene, Estimator::Pt, 1.0);
    let off = render(&scene, Estimator::Pt, 1.001);
    assert!(difference(&usual, &off) > 2.0 * ROUNDING, "{:e}", difference(&usual, &off));
}

#[test]
#[ignore = "takes minutes"]
fn every_estimator_and_emitter_at_every_scale_and_place() {
    for estimator in Estimator::ALL {
        near(&mixed(), "mixed", estimator, &PLACES);
        near(&zoo(Light::Area), "area light", estimator, &PLACES);
        near(&zoo(Light::Punctual), "point and spot", estimator, &PLACES);
        if estimator != Estimator::Pt {
            near(&zoo(Light::Beam), "beam", estimator, &PLACES);
        }
    }
}
