//! A medium with an index of refraction fills all space. Outside of glass, travel times use the group index of the medium, and
//! glass refracts light less.

use glam::DVec3;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{assert_none, feature_against_oracle, feature_estimators};
use super::cells::{Cells, renderer, settings, threshold};
use super::fog;

const IOR: f32 = 1.33;
const GROUP_IOR: f32 = 1.36;

fn water() -> Medium {
    Medium { ior: IOR, group_ior: GROUP_IOR, ..Medium::default() }
}

/// The gate with both ends multiplied by `factor`.
fn stretched([lo, hi]: [f64; 2], factor: f32) -> Gate {
    Gate { lo: lo * f64::from(factor), hi: hi * f64::from(factor) }
}

/// Mean of the image through a gate.
fn mean(scene: &Scene, estimator: Estimator, gate: Gate) -> f64 {
    let s = settings(estimator, [16, 16]).build().unwrap();
    Cells::measure(&mut renderer(scene, &s), gate, 8, 2, 4, 100).whole().0
}

#[test]
#[ignore = "takes ten seconds; light that scatters in water is tested always"]
fn light_in_clear_water_arrives_later_by_the_group_index() {
    // Where the first light arrives, the image changes fast with time.
    let gate = [4.5, 4.9];
    let mut air = build(Kind::CornellBox);
    air.media = vec![Medium::default()];
    let mut wet = build(Kind::CornellBox);
    wet.media = vec![water()];
    for estimator in feature_estimators(&wet) {
        let [in_air, in_water, wrong] = [
            mean(&air, estimator, stretched(gate, 1.0)),
            mean(&wet, estimator, stretched(gate, GROUP_IOR)),
            mean(&wet, estimator, stretched(gate, IOR)),
        ];
        eprintln!("{estimator}: air {in_air}, water {in_water}, wrong {wrong}");
        // The random numbers are the same, so the images differ by rounding alone.
        assert!((in_water / in_air - 1.0).abs() < 0.01, "{estimator}");
        assert!((wrong / in_air - 1.0).abs() > 0.05, "{estimator}");
    }
}

#[test]
fn light_that_scatters_once_in_water_has_the_radiance_of_the_closed_form() {
    let lamp = DVec3::new(0.7, 0.2, -1.0);
    let mut scene = fog::fog(lamp);
    scene.media[0] = Medium { ior: IOR, group_ior: GROUP_IOR, ..scene.media[0].clone() };
    for gate in [[1.2, 1.4], [6.0, 6.5]] {
        let stretched = stretched(gate, GROUP_IOR);
        let (found, error) = fog::mean(&scene, Estimator::Lcs, [stretched.lo, stretched.hi]);
        let expected = fog::truth(lamp, fog::SIGMA_S, gate);
        eprintln!("{gate:?}: {:+.3} % +- {:.3} %", 100.0 * (found / expected - 1.0), 100.0 * error / expected);
        let differs = |from: f64| (found - from).abs() > threshold(2) * error + 1e-4 * from;
        assert!(!differs(expected) && differs(fog::truth(lamp, 1.02 * fog::SIGMA_S, gate)), "{gate:?}");
    }
}

/// The room has glass, plastics and metals. `cargo test --release --test estimators -- --ignored --nocapture room`
#[test]
#[ignore = "takes half a minute; light that scatters in water is tested always"]
fn a_room_under_water_agrees_with_the_oracle() {
    let mut scene = zoo(Light::Area);
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.7 };
    scene.media = vec![Medium { sigma_s: [0.1; 3], sigma_a: [0.05, 0.02, 0.01], phase, ..water() }];
    let gates = [(7.0, 8.5), (0.0, f64::INFINITY)];
    assert_none(feature_against_oracle("water", &scene, &gates, [24, 16]));
}
