//! Retroreflectors: a plate in the light of a headlamp has the radiance of a closed form, and rooms agree with the oracle.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{LightKind, Material, Retroreflector, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;
use taugate_oracle::ggx;

use super::agreement::{against, assert_none, feature_estimators, oracle, whole_images};
use super::cells::{is_long, renderer, settings};

const INTENSITY: f32 = 3.0;
const BASE: f32 = 0.6;
const DISTANCE: f64 = 20.0;
const SHARE: f32 = 0.3;
/// Angle of the retroreflector, in degrees.
const ANGLE: f32 = 0.5;

/// A plate at [`DISTANCE`] on the axis of a camera whose view is half a degree wide. The normal is turned away from the camera by
/// `tilt` degrees. The lamp is `offset` metres beside the pinhole.
fn plate(retroreflector: Retroreflector, tilt: f64, offset: f64) -> Scene {
    let mut scene = Scene::default();
    let sheet = Material { retroreflector: Some(retroreflector), ..diffuse("sheet", [BASE; 3]) };
    let sheet = material(&mut scene, sheet);
    let (sine, cosine) = tilt.to_radians().sin_cos();
    let (across, up) = (DVec3::new(cosine, 0.0, -sine), DVec3::Y);
    add(&mut scene, "plate", sheet, quad(DVec3::NEG_Z * DISTANCE - 0.5 * (across + up), across, up, [1.0; 2]));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.5f64.to_radians(), [8, 8]);
    let kind = LightKind::Point { intensity: [INTENSITY; 3] };
    light(&mut scene, "headlamp", DVec3::Y * offset, DVec3::NEG_Z, kind);
    scene
}

/// Radiance in the centre of the image. The lobe of a collocated lamp is at its maximum, `1 / (4 pi alpha^2)` for a plate seen
/// head-on.
fn closed_form(share: f64, tilt: f64, offset: f64) -> f64 {
    let alpha = (f64::from(ANGLE).to_radians() / 2.0).tan() / (2f64.sqrt() - 1.0).sqrt();
    let (sine, cosine) = tilt.to_radians().sin_cos();
    let wc = DVec3::new(sine, 0.0, cosine);
    let wl = (DVec3::new(sine, 0.0, cosine) * DISTANCE + DVec3::Y * offset) / DISTANCE.hypot(offset);
    let lobe = if offset == 0.0 {
        1.0 / (4.0 * PI * (alpha * cosine).powi(2) * (1.0 + 2.0 * ggx::lambda(alpha, wc)))
    } else {
        ggx::lobe(alpha, DVec3::new(-wl.x, -wl.y, wl.z), wc)
    };
    let f = f64::from(BASE) * (share * lobe + (1.0 - share) / PI);
    f * wl.z * f64::from(INTENSITY) / (DISTANCE.powi(2) + offset * offset)
}

/// Mean of the image through the gate. The lamp is a single point, which all estimators connect to each sample, so the mean has no noise.
fn mean(renderer: &mut Renderer, gate: Gate) -> f64 {
    renderer.restart(1, gate).unwrap();
    renderer.iterate(16).unwrap();
    let image = renderer.film().mean();
    image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64
}

#[test]
fn a_plate_in_the_light_of_a_headlamp_has_the_radiance_of_the_closed_form() {
    let sheet = Retroreflector { share: SHARE, angle: ANGLE };
    let share = f64::from(SHARE);
    // All estimators connect the lamp by the same function.
    for &estimator in if is_long() { &Estimator::ALL[..] } else { &[Estimator::Lcs] } {
        for (tilt, offset) in [(0.0, 0.0), (30.0, 0.0), (0.0, 0.1)] {
            let settings = settings(estimator, [8, 8]).max_depth(2).light_paths(100).build().unwrap();
            let mut renderer = renderer(&plate(sheet, tilt, offset), &settings);
            let truth = closed_form(share, tilt, offset);
            for (lo, hi, part) in [(39.8, 40.2, 1.0), (0.0, f64::INFINITY, 1.0), (0.0, 39.8, 0.0)] {
                let mean = mean(&mut renderer, Gate { lo, hi });
                // At the border of the image, the cosine of the angle is 0.99999, and a tilted plate is 0.3 % nearer or farther.
                let fits = |truth: f64| (mean - part * truth).abs() <= 1e-3 * part * truth;
                assert!(fits(truth), "{estimator} {tilt} {offset} [{lo}, {hi}): {mean}, closed form {truth}");
                // Negative control: a share that is 1 % larger.
                let wrong = closed_form(1.01 * share, tilt, offset);
                assert!(part == 0.0 || !fits(wrong), "{estimator} {tilt} {offset}: {mean} fits {wrong}");
            }
        }
    }
}

/// At this angle the lobe falls to half its maximum. Without a diffuse part, the radiance also falls to half.
#[test]
fn the_radiance_falls_to_half_at_the_angle() {
    let sheet = Retroreflector { share: 1.0, angle: ANGLE };
    let settings = settings(Estimator::Lcs, [8, 8]).max_depth(2).light_paths(100).build().unwrap();
    let at = |degrees: f64| {
        let plate = plate(sheet, 0.0, DISTANCE * degrees.to_radians().tan());
        mean(&mut renderer(&plate, &settings), Gate { lo: 0.0, hi: f64::INFINITY })
    };
    let [peak, half, beyond] = [0.0, f64::from(ANGLE), 1.1 * f64::from(ANGLE)].map(at);
    assert!((half / peak - 0.5).abs() < 2e-3, "{}", half / peak);
    assert!((beyond / peak - 0.5).abs() > 0.05, "{}", beyond / peak);
}

/// The room with every feature, whose floor, walls and ring retroreflect.
fn room(share: f32, angle: f32) -> Scene {
    let mut scene = zoo(Light::Area);
    for material in &mut scene.materials {
        if ["floor", "wall", "brass"].contains(&material.name.as_str()) {
            material.retroreflector = Some(Retroreflector { share, angle });
        }
    }
    scene
}

/// `cargo test --release --test estimators -- --ignored retroreflectors_agree`
#[test]
#[ignore = "takes ten seconds; plates with a closed form are tested always"]
fn retroreflectors_agree_with_the_oracle() {
    const GATES: [(f64, f64); 2] = [(5.0, 6.0), (0.0, f64::INFINITY)];
    let scene = room(0.6, 20.0);
    let truth = oracle(&scene, &GATES, [24, 16], 800);
    assert_none(against("retroreflectors", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative control: a lobe of another width.
    assert!(!against("wider", &[Estimator::Lcs], &room(0.6, 40.0), &GATES[..1], &truth).is_empty());
}

/// The long version. `cargo test --release --test estimators -- --ignored --nocapture whole_images`
#[test]
#[ignore = "takes minutes"]
fn whole_images_of_retroreflectors_agree_with_the_oracle() {
    whole_images("retroreflectors", &room(0.6, 20.0), 5.0);
}
