//! A point light exactly at the pinhole, and a camera whose axis is not at the centre of the image.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::generate::{Kind, build};
use taugate::internals::image::depth;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::scenery;
use taugate::internals::scene::{LightKind, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::frequencies::Frequencies;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, oracle, unlike_estimators};
use super::cells::{Cells, renderer, settings};
use super::fog::{self, fog};

const INTENSITY: f32 = 3.0;
const ALBEDO: f32 = 0.6;
const DISTANCE: f64 = 2.0;

/// A diffuse wall at [`DISTANCE`], seen head-on in an angle so small that the light arrives vertically at all pixels.
fn wall() -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [ALBEDO; 3]));
    let corner = DVec3::new(-0.1, -0.1, -DISTANCE);
    add(&mut scene, "wall", grey, quad(corner, DVec3::X * 0.2, DVec3::Y * 0.2, [1.0; 2]));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1f64.to_radians(), [8, 8]);
    light(&mut scene, "headlamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY; 3] });
    scene
}

/// The radiance is albedo / pi times the irradiance I / d^2, and the light travels 2 d.
#[test]
fn a_wall_in_the_light_of_a_headlamp_has_the_radiance_of_the_closed_form() {
    let truth = f64::from(ALBEDO * INTENSITY) / std::f64::consts::PI / (DISTANCE * DISTANCE);
    for estimator in Estimator::ALL {
        let mut renderer = renderer(&wall(), &settings(estimator, [8, 8]).build().unwrap());
        for (lo, hi, part) in [(0.0, f64::INFINITY, 1.0), (3.99, 4.01, 1.0), (0.0, 3.99, 0.0), (4.01, 9.0, 0.0)] {
            let (mean, error) = Cells::measure(&mut renderer, Gate { lo, hi }, 8, 1, 8, 100).whole();
            eprintln!("{estimator} [{lo}, {hi}): {mean:.6} +- {error:.6}, closed form {:.6}", part * truth);
            // At the border of the image, the cosine of the angle is 0.9999.
            let tolerance = 4.0 * error + 4e-4 * truth;
            assert!((mean - part * truth).abs() <= tolerance, "{estimator} [{lo}, {hi}): {mean} +- {error}");
        }
    }
}

/// A continuous-wave sensor measures the distance of the wall: the light of each pixel has one travel time.
#[test]
#[ignore = "takes ten seconds; the error of a continuous wave in a corner is tested always"]
fn a_continuous_wave_sensor_measures_the_distance_of_a_wall() {
    let frequencies = Frequencies::new(vec![80.0, 60.0]).unwrap();
    let scene = wall();
    let settings = settings(Estimator::Pt, [8, 8]).responses(frequencies.clone()).build().unwrap();
    let mut renderer = renderer(&scene, &settings);
    renderer.iterate(4).unwrap();
    let film = renderer.responses().unwrap().unwrap();
    // The pixels see the wall at 2 m to 2.0002 m. At 80 MHz, half a period is 1.874 m, so the wall seems to be 0.126 m away.
    let near = 2.0 - 0.5 * Frequencies::period(80.0);
    for echo in depth::echoes(film, &frequencies, 0) {
        assert!((f64::from(echo.depth) - near).abs() < 5e-4, "{echo:?}");
    }
    let radiance = f64::from(ALBEDO * INTENSITY) / std::f64::consts::PI / (DISTANCE * DISTANCE);
    for echo in depth::echoes(film, &frequencies, 1) {
        assert!((f64::from(echo.amplitude) / radiance - 1.0).abs() < 1e-3, "{echo:?}");
    }
    let (name, unwrapped) = depth::planes(film, settings.responses()).pop().unwrap();
    assert_eq!(name, "cw.depth");
    assert!(unwrapped.iter().all(|&d| (f64::from(d) - 2.0).abs() < 5e-4), "{unwrapped:?}");
}

/// The Cornell box without its camera and light. The experiment `keys` adds a camera at the open side and its headlamp.
fn dark_box(keys: &str) -> Scene {
    let mut scene = build(Kind::CornellBox);
    scene.cameras.clear();
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    let mut experiment = Experiment::parse(keys).unwrap();
    let notes = scenery::apply(&mut experiment, &mut scene).unwrap();
    assert!(scene.lights.len() == 1 && !notes.is_empty(), "{notes:?}");
    scene
}

fn agrees(name: &str, scene: &Scene, gates: &[(f64, f64)]) {
    let truth = oracle(scene, gates, [24, 16], 400);
    assert_none(against(name, &unlike_estimators(scene), scene, gates, &truth));
}

#[test]
#[ignore = "takes five seconds; a wall in the light of a headlamp is tested always"]
fn estimators_agree_on_a_scene_that_has_neither_camera_nor_light() {
    let scene = dark_box("camera = { look-from = [0.1, 1.1, 2.9], resolution = '24x16' }");
    agrees("headlamp", &scene, &[(6.0, 7.0), (8.0, 10.0), (0.0, f64::INFINITY)]);
}

#[test]
#[ignore = "takes ten seconds; `parity` tests cameras with a shifted axis always"]
fn estimators_agree_if_the_principal_point_is_off_the_centre() {
    let keys = "camera = { look-from = [0.1, 1.1, 2.9], resolution = '24x16', principal-point = [0.3, 0.8] }";
    agrees("principal point", &dark_box(keys), &[(8.0, 10.0), (0.0, f64::INFINITY)]);
}

/// The fog directly before a headlamp has no upper limit of brightness. Events may lie so near the lamp that squares of their distance
/// would underflow, but no sample may be lost.
#[test]
fn fog_before_a_headlamp_gives_finite_samples() {
    let mut renderer = renderer(&fog(DVec3::ZERO), &settings(Estimator::Lcs, [32, 32]).build().unwrap());
    renderer.iterate(16).unwrap();
    assert_eq!(renderer.stats().dropped, 0);
}

/// The radiance is sigma_s I / (4 pi) times the integral of exp(-2 sigma_t r) / r^2 over r from 20 m to 25 m.
#[test]
fn fog_returns_the_light_of_a_headlamp_as_the_closed_form_says() {
    let phase = PhaseFunction::Isotropic;
    let medium = Medium { sigma_s: [0.04; 3], sigma_a: [0.01; 3], phase, ..Medium::default() };
    let scene = Scene { media: vec![medium], ..fog(DVec3::ZERO) };
    let (found, error) = fog::mean(&scene, Estimator::Lcs, [40.0, 50.0]);
    let truth = f64::from(fog::INTENSITY) * 3.45304e-6;
    eprintln!("{:+.3} % +- {:.3} %", 100.0 * (found / truth - 1.0), 100.0 * error / truth);
    let is_near = |truth: f64| (found / truth - 1.0).abs() < 5e-3;
    assert!(is_near(truth) && error < 1e-3 * truth, "{found} +- {error}, {truth}");
    // A coefficient that is wrong by 3 % is rejected.
    assert!(!is_near(1.03 * truth) && !is_near(0.97 * truth), "{found}");
}
