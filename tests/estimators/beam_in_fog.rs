//! A beam in fog, seen from the side: light that scatters once on the line of the beam.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::light;
use taugate::internals::scene::{Camera, DensityGrid, GridFilter, LightKind, Medium, PhaseFunction, Projection, Scene};
use taugate::internals::self_check::fog::{Coefficients, gated_single_scattering};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;
use taugate_oracle::phase::Phase;

use super::cells::{renderer, settings, threshold};

const SIGMA_S: f64 = 0.04;
const SIGMA_T: f64 = 0.05;
const PHASE: PhaseFunction = PhaseFunction::HenyeyGreenstein { g: 0.6 };
const POWER: f32 = 2.0;
/// The beam crosses the view about 6 m from the pinhole.
const SOURCE: DVec3 = DVec3::new(-2.0, -1.0, -6.0);
const SIDE: usize = 128;
const HALF_FIELD: f64 = 0.95;
const SEEDS: u32 = 8;

fn direction() -> DVec3 {
    DVec3::new(1.0, 0.4, 0.3).normalize()
}

/// A pinhole at the origin that looks along -Z, and a beam of no width in fog. There are no surfaces.
fn scene() -> Scene {
    let mut scene = Scene::default();
    light(&mut scene, "beam", SOURCE, direction(), LightKind::Beam { power: [POWER; 3], radius: 0.0 });
    scene.add_camera(Camera {
        name: "pinhole".into(),
        transform: DAffine3::IDENTITY,
        projection: Projection::Perspective { yfov: 2.0 * HALF_FIELD },
        aspect: None,
        resolution: None,
        principal_point: Camera::CENTRED,
        lens: taugate::Lens::PINHOLE,
    });
    let sigma_a = [SIGMA_T - SIGMA_S; 3];
    scene.media = vec![Medium { sigma_s: [SIGMA_S; 3], sigma_a, phase: PHASE, ..Medium::default() }];
    scene
}

/// Fluence at the pinhole through a gate, in W per square metre, and its standard error. Each pixel has the solid angle of its centre.
/// If only a few pixels see the gate, the fluence is wrong by up to 0.2 %.
fn fluence(scene: &Scene, estimator: Estimator, gate: Gate) -> (f64, f64) {
    let s = settings(estimator, [SIDE as u32; 2]).max_depth(2).build().unwrap();
    let mut renderer = renderer(scene, &s);
    let half = HALF_FIELD.tan();
    let solid_angle = |pixel: usize| {
        let on_plane = |k: usize| ((k as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0) * half;
        let (x, y) = (on_plane(pixel % SIDE), on_plane(pixel / SIDE));
        (2.0 * half / SIDE as f64).powi(2) / (1.0 + x * x + y * y).powf(1.5)
    };
    let found: Vec<f64> = (0..SEEDS)
        .map(|seed| {
            renderer.restart(seed, gate).unwrap();
            renderer.iterate(1).unwrap();
            let mean = renderer.film().mean();
            mean.chunks(3).enumerate().map(|(pixel, rgb)| f64::from(rgb[0]) * solid_angle(pixel)).sum()
        })
        .collect();
    let n = f64::from(SEEDS);
    let mean = found.iter().sum::<f64>() / n;
    (mean, (found.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
}

/// The fluence by the closed form. By reciprocity, it equals the radiance along the beam of a point light at the pinhole.
fn truth(sigma_s: f64, [lo, hi]: [f64; 2]) -> f64 {
    let phase = Phase::new(&PHASE);
    let fog = Coefficients { sigma_s, sigma_t: SIGMA_T };
    gated_single_scattering(fog, |cos| phase.density(cos), POWER.into(), -SOURCE, direction(), [lo, hi])
}

/// `lcs` also draws events in the gate. Its standard error is below 0.3 %, and a coefficient that is wrong by 3 % is rejected. `bdpt`
/// leaves the events to chance. `whole_images_of_foggy_rooms_agree_with_the_oracle` has a beam with walls, mirrors and glass.
#[test]
fn light_that_scatters_once_on_a_beam_is_nearly_free_of_noise() {
    let gates = [[7.5, 7.51], [7.5, 8.0], [9.0, 12.0]];
    let scene = scene();
    for estimator in [Estimator::Lcs, Estimator::Bdpt] {
        for gate in gates {
            let (found, error) = fluence(&scene, estimator, Gate { lo: gate[0], hi: gate[1] });
            let (expected, wrong) = (truth(SIGMA_S, gate), truth(1.03 * SIGMA_S, gate));
            let percent = |x: f64| 100.0 * x / expected;
            eprintln!("{estimator} {gate:?}: {:+.3} % +- {:.3} %", percent(found - expected), percent(error));
            let differs = |from: f64| (found - from).abs() > threshold(gates.len()) * error + 2e-3 * from;
            assert!(!differs(expected), "{estimator} {gate:?}: {found} +- {error}, expected {expected}");
            if estimator == Estimator::Lcs {
                assert!(error < 3e-3 * expected && differs(wrong), "{gate:?}: {found} +- {error}");
            }
        }
    }
}

/// A small cloud in a large grid. `bdpt` has only flights along the beam, and they follow the density of the grid. The events that `lcs`
/// also draws in the gate change no mean, and add no noise without a gate.
#[test]
fn a_beam_on_a_grid_has_the_light_of_flights() {
    let mut density = vec![0.0; 12];
    density[4] = 1.0;
    let bounds = [DVec3::new(-3.0, -3.0, -8.0), DVec3::new(9.0, 5.0, -1.0)];
    let resolution = [12, 1, 1];
    let grid = DensityGrid { resolution, density, bounds, transform: DAffine3::IDENTITY, filter: GridFilter::Nearest };
    let mut scene = scene();
    scene.media = vec![Medium { sigma_s: [0.5, 1.0, 2.0], phase: PHASE, grid: Some(grid), ..Medium::default() }];
    for gate in [Gate { lo: 9.0, hi: 9.2 }, Gate::OPEN] {
        let [(found, error), (expected, expected_error)] =
            [Estimator::Lcs, Estimator::Bdpt].map(|estimator| fluence(&scene, estimator, gate));
        eprintln!("{gate:?}: {found:.4e} +- {error:.1e}, bdpt {expected:.4e} +- {expected_error:.1e}");
        assert!((found - expected).abs() < threshold(2) * error.hypot(expected_error), "{gate:?}: {found}, {expected}");
        assert!(error < 1.5 * expected_error && expected_error < 0.1 * expected, "{gate:?}: {error}, {expected_error}");
    }
}
