//! Fog that is thin or thick, at any scale, through gates of a few f32 steps: light that scatters once has the radiance of the
//! closed form.

use glam::DVec3;
use taugate::internals::generate::parts::{camera, light};
use taugate::internals::scene::{LightKind, Medium, PhaseFunction, Scene};
use taugate::internals::self_check::fog::{Coefficients, gated_single_scattering};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{Cells, renderer, settings, threshold};

const SIZE: [u32; 2] = [8, 8];
const ISOTROPIC: f64 = 0.25 / std::f64::consts::PI;
/// Share of the extinction that is scattering.
const ALBEDO: f64 = 0.9;
const LAMP: DVec3 = DVec3::new(0.7, 0.2, -1.0);

/// A pinhole and a point light in fog, without surfaces. The pinhole looks along -Z, with a field of view of 0.02 degrees. The light
/// is 1.24 `scale` metres away. `sigma_t`: extinction coefficient of the fog, per metre.
fn scene(scale: f64, sigma_t: f64) -> Scene {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.0 };
    let medium =
        Medium { sigma_s: [ALBEDO * sigma_t; 3], sigma_a: [(1.0 - ALBEDO) * sigma_t; 3], phase, ..Medium::default() };
    let mut scene = Scene { media: vec![medium], ..Scene::default() };
    light(&mut scene, "lamp", LAMP * scale, DVec3::NEG_Z, LightKind::Point { intensity: [intensity(scale) as f32; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.02f64.to_radians(), SIZE);
    scene
}

/// Radiance does not depend on the scale.
fn intensity(scale: f64) -> f64 {
    5.0 * scale * scale
}

/// The relative difference from the closed form, and its standard error.
fn bias(estimator: Estimator, scale: f64, depth: f64, [lo, hi]: [f64; 2]) -> (f64, f64) {
    let sigma_t = depth / scale;
    let gate = [lo * scale, hi * scale];
    let medium = Coefficients { sigma_s: ALBEDO * sigma_t, sigma_t };
    let truth = gated_single_scattering(medium, |_| ISOTROPIC, intensity(scale), LAMP * scale, DVec3::NEG_Z, gate);
    let s = settings(estimator, SIZE).max_depth(2).build().unwrap();
    let mut renderer = renderer(&scene(scale, sigma_t), &s);
    let (found, error) = Cells::measure(&mut renderer, Gate { lo: gate[0], hi: gate[1] }, 8, 1, 16, 100).whole();
    assert_eq!(renderer.stats().dropped, 0, "{estimator} at scale {scale:e}: contributions that are not finite");
    println!(
        "{estimator}, scale {scale:e}, optical depth {depth:e} per metre, gate {lo}..{hi}: {:+.3} % +- {:.3} %",
        100.0 * (found / truth - 1.0),
        100.0 * error / truth
    );
    (found / truth - 1.0, error / truth)
}

#[test]
fn fog_of_any_thickness_and_scale_has_the_radiance_of_the_closed_form() {
    // The thickest fog dims the latest light by exp(-100). The last gate is 64 steps of f32 wide.
    let gates = [[1.5, 2.5], [1.3, 1.35], [1.5, 1.5 + 64.0 * f64::from(f32::EPSILON)]];
    for scale in [1e-3, 1.0, 1e6] {
        for depth in [1e-6, 1.0, 40.0] {
            for gate in gates {
                let (bias, error) = bias(Estimator::Lcs, scale, depth, gate);
                assert!(bias.abs() < threshold(27) * error + 0.005 && error < 0.015, "{bias} +- {error}");
                // A truth that is 10 % larger is rejected.
                assert!(((1.0 + bias) / 1.1 - 1.0).abs() > threshold(27) * error + 0.005, "{bias} +- {error}");
            }
            // Free flights find nothing in the thinnest and in the thickest fog.
            let free = [Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper];
            for estimator in free.into_iter().filter(|_| depth == 1.0) {
                let (bias, error) = bias(estimator, scale, depth, gates[0]);
                assert!(bias.abs() < threshold(27) * error + 0.005 && error < 0.02, "{bias} +- {error}");
            }
        }
    }
}
