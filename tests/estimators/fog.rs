//! Participating media: the estimators against a closed form and the oracle.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::light;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{Camera, LightKind, Medium, PhaseFunction, Projection, Scene};
use taugate::internals::self_check::fog::{Coefficients, gated_single_scattering};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;
use taugate_oracle::phase::Phase;

use super::agreement::{
    against, assert_none, feature_against_oracle, oracle, oracle_samples, unlike_estimators, whole_images,
};
use super::cells::{Cells, renderer, settings, threshold};

pub const SIGMA_S: f64 = 0.1;
const SIGMA_T: f64 = 0.12;
const G: f64 = 0.6;
pub const INTENSITY: f32 = 5.0;
const GATES: [[f64; 2]; 6] = [[1.2, 1.4], [1.5, 2.5], [3.0, 4.0], [6.0, 6.5], [12.0, 12.05], [0.5, 60.0]];

/// As [`fog_with`], with a Henyey-Greenstein lobe.
pub fn fog(lamp: DVec3) -> Scene {
    fog_with(lamp, PhaseFunction::HenyeyGreenstein { g: G })
}

/// A pinhole at the origin that looks along -Z through a field of view of 0.02 degrees, and a point light, in fog. There are no
/// surfaces.
fn fog_with(lamp: DVec3, phase: PhaseFunction) -> Scene {
    let mut scene = Scene::default();
    light(&mut scene, "lamp", lamp, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY; 3] });
    scene.add_camera(Camera {
        name: "pinhole".into(),
        transform: DAffine3::IDENTITY,
        projection: Projection::Perspective { yfov: 0.02f64.to_radians() },
        aspect: None,
        resolution: None,
        principal_point: Camera::CENTRED,
        lens: taugate::Lens::PINHOLE,
    });
    scene.media = vec![Medium { sigma_s: [SIGMA_S; 3], sigma_a: [SIGMA_T - SIGMA_S; 3], phase, ..Medium::default() }];
    scene
}

fn henyey_greenstein(cosine: f64) -> f64 {
    (1.0 - G * G) / (4.0 * PI * (1.0 + G * G - 2.0 * G * cosine).powf(1.5))
}

/// Radiance after one scattering, by the closed form with a scattering coefficient `sigma_s`.
pub fn truth(lamp: DVec3, sigma_s: f64, gate: [f64; 2]) -> f64 {
    let medium = Coefficients { sigma_s, sigma_t: SIGMA_T };
    gated_single_scattering(medium, henyey_greenstein, INTENSITY.into(), lamp, DVec3::NEG_Z, gate)
}

/// Mean of the image through a gate, and its standard error.
pub fn mean(scene: &Scene, estimator: Estimator, [lo, hi]: [f64; 2]) -> (f64, f64) {
    let s = settings(estimator, [8, 8]).max_depth(2).build().unwrap();
    Cells::measure(&mut renderer(scene, &s), Gate { lo, hi }, 8, 4, 16, 100).whole()
}

#[test]
fn light_that_scatters_once_has_the_radiance_of_the_closed_form() {
    let lamp = DVec3::new(0.7, 0.2, -1.0);
    let scene = fog(lamp);
    for estimator in unlike_estimators(&scene) {
        for gate in GATES {
            let (found, error) = mean(&scene, estimator, gate);
            let expected = truth(lamp, SIGMA_S, gate);
            eprintln!("{estimator} {gate:?}: {found:.6e} +- {error:.1e}, expected {expected:.6e}");
            assert!(
                (found - expected).abs() < threshold(GATES.len()) * error + 1e-4 * expected,
                "{estimator} {gate:?}"
            );
        }
    }
}

/// `lcs` draws the scattering in the gate. With as many samples as above, its standard error is below 0.2 %, and a coefficient that is
/// wrong by 3 % is rejected.
#[test]
fn light_that_scatters_once_in_the_gate_is_nearly_free_of_noise() {
    // The second lamp is beside the pinhole; its light returns from the fog in front of the camera.
    for lamp in [DVec3::new(0.7, 0.2, -1.0), DVec3::new(1e-3, 0.0, 0.0)] {
        let scene = fog(lamp);
        for &gate in &GATES[..5] {
            let (found, error) = mean(&scene, Estimator::Lcs, gate);
            let (expected, wrong) = (truth(lamp, SIGMA_S, gate), truth(lamp, 1.03 * SIGMA_S, gate));
            eprintln!(
                "{lamp} {gate:?}: {:+.3} % +- {:.3} %",
                100.0 * (found / expected - 1.0),
                100.0 * error / expected
            );
            let differs = |from: f64| (found - from).abs() > threshold(GATES.len()) * error + 1e-4 * from;
            assert!(error < 2e-3 * expected && !differs(expected), "{lamp} {gate:?}: {found} +- {error}, {expected}");
            assert!(differs(wrong), "{lamp} {gate:?}");
        }
    }
}

/// Absorption multiplies the light of a path by exp(-sigma_a tau). `pt` draws flights from sigma_s alone, so with the same random
/// numbers this factor is the ratio of two images through a thin gate, pixel by pixel. Paths of three segments make no choice that
/// depends on absorption. In the other estimators, absorption also ends light subpaths.
#[test]
#[ignore = "takes ten seconds; closed forms and a room with absorption are tested always"]
fn absorption_is_a_factor_that_falls_with_travel_time() {
    let (sigma_a, [lo, hi]) = (0.3, [6.5, 6.5006]);
    let image = |sigma_a: f64| {
        let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
        let medium = Medium { sigma_s: [0.2; 3], sigma_a: [sigma_a; 3], phase, ..Medium::default() };
        let s = settings(Estimator::Pt, [128, 128]).max_depth(3).build().unwrap();
        let mut renderer = renderer(&Scene { media: vec![medium], ..build(Kind::CornellBox) }, &s);
        renderer.restart(1, Gate { lo, hi }).unwrap();
        (0..4).for_each(|_| renderer.iterate(1).unwrap());
        renderer.film().mean()
    };
    let (dim, bright) = (image(sigma_a), image(0.0));
    let lit = || dim.iter().zip(&bright).filter(|(dim, bright)| dim.max(**bright) > 0.0);
    assert!(lit().count() > 30, "{} values", lit().count());
    let expected = (-0.5 * sigma_a * (lo + hi)).exp();
    let error =
        |expected: f64| lit().map(move |(&dim, &bright)| (f64::from(dim) / f64::from(bright) / expected - 1.0).abs());
    let worst = error(expected).fold(0.0, f64::max);
    eprintln!("{} values, largest error {worst:.1e}", lit().count());
    assert!(worst < 1e-4, "{worst}");
    // A travel time that is wrong by 0.1 % is rejected in every pixel.
    assert!(error(expected.powf(1.001)).all(|error| error > 1e-4));
}

/// The phase function of fog droplets, and a table with a narrow forward peak and a peak backwards.
#[test]
#[ignore = "takes ten seconds; `parity` tests the phase functions always"]
fn light_that_returns_from_droplets_and_tables_has_the_radiance_of_the_closed_form() {
    let lamp = DVec3::new(0.05, 0.0, 0.0);
    let droplets =
        PhaseFunction::HenyeyGreensteinDraine { g: 0.9926, g_draine: 0.58, alpha: 25.0, weight_draine: 0.493 };
    let cosines = vec![-1.0, -0.98, -0.9, 0.0, 0.9, 0.99, 1.0];
    let table = PhaseFunction::Table { cosines, values: vec![0.9, 0.3, 0.1, 0.05, 1.0, 10.0, 300.0] };
    for function in [droplets, table] {
        let scene = fog_with(lamp, function.clone());
        let phase = Phase::new(&function);
        for gate in [[1.5, 2.5], [3.0, 3.1]] {
            let (found, error) = mean(&scene, Estimator::Lcs, gate);
            let medium = Coefficients { sigma_s: SIGMA_S, sigma_t: SIGMA_T };
            let single = |factor: f64| {
                let density = |c| factor * phase.density(c);
                gated_single_scattering(medium, density, INTENSITY.into(), lamp, DVec3::NEG_Z, gate)
            };
            let (expected, wrong) = (single(1.0), single(1.02));
            eprintln!(
                "{function:?} {gate:?}: {:+.3} % +- {:.3} %",
                100.0 * (found / expected - 1.0),
                100.0 * error / expected
            );
            let differs = |from: f64| (found - from).abs() > threshold(4) * error + 1e-4 * from;
            assert!(error < 1e-3 * expected && !differs(expected), "{gate:?}: {found} +- {error}, {expected}");
            assert!(differs(wrong), "{gate:?}");
        }
    }
}

/// A room with an area light. Droplets surround a box of fog whose phase function is a table.
/// `cargo test --release --test estimators -- --ignored --nocapture rooms`
#[test]
#[ignore = "takes half a minute; `parity` tests the phase functions always"]
fn rooms_with_droplets_and_tables_agree_with_the_oracle() {
    let mut scene = foggy(Light::Area);
    scene.media[0].phase =
        PhaseFunction::HenyeyGreensteinDraine { g: 0.9, g_draine: 0.5, alpha: 20.0, weight_draine: 0.5 };
    scene.media[1].phase =
        PhaseFunction::Table { cosines: vec![-1.0, -0.8, 0.5, 1.0], values: vec![2.0, 0.1, 0.3, 3.0] };
    let gates = [(5.0, 6.0), (0.0, f64::INFINITY)];
    assert_none(feature_against_oracle("droplets", &scene, &gates, [16, 8]));
}

/// A room in coloured fog, with a denser box of other fog around its middle. The denser box counts where the two overlap.
fn foggy(lamps: Light) -> Scene {
    let mut scene = zoo(lamps);
    let lobes = PhaseFunction::DoubleHenyeyGreenstein { g: [0.7, -0.3], weight: 0.8 };
    let thin = Medium { sigma_s: [0.1, 0.15, 0.2], sigma_a: [0.05, 0.0, 0.02], phase: lobes, ..Medium::default() };
    let bounds = Some([DVec3::new(-0.8, 0.3, -0.9), DVec3::new(0.9, 2.0, 0.7)]);
    let dense =
        Medium { sigma_s: [0.6, 0.5, 0.4], sigma_a: [0.1; 3], phase: PhaseFunction::Rayleigh, bounds, ..thin.clone() };
    scene.media = vec![thin, dense];
    scene
}

#[test]
fn a_foggy_room_agrees_with_the_oracle() {
    let gates = [(5.0, 6.0), (0.0, f64::INFINITY)];
    let scene = foggy(Light::Punctual);
    let truth = oracle(&scene, &gates, [24, 16], oracle_samples());
    assert_none(against("punctual", &unlike_estimators(&scene), &scene, &gates, &truth));
}

/// The long version, with all lamps and smaller errors:
/// `cargo test --release --test estimators -- --ignored --nocapture foggy_rooms`
#[test]
#[ignore = "takes minutes"]
fn whole_images_of_foggy_rooms_agree_with_the_oracle() {
    for (name, lamps, lo) in
        [("lamp", Light::Area, 5.0), ("punctual", Light::Punctual, 5.0), ("beam", Light::Beam, 6.5)]
    {
        whole_images(name, &foggy(lamps), lo);
    }
}
