//! Gates whose ends equal the length of a path, and gates outside the travel times of the scene.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, emitter, glass, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::Scene;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Responses};

use super::cells::{renderer, settings};
use super::wall::{ALBEDO, wall};
use super::{image, sum};

/// A field of view so narrow that all its rays have the same length in f32.
const NARROW: f64 = 1e-5;

/// The f32 number `n` steps above `x` (below, if `n` is negative).
fn step(x: f64, n: i32) -> f64 {
    let moved = |bits: u32| f64::from(f32::from_bits((bits as i32 + n) as u32));
    moved((x as f32).to_bits())
}

/// All light of the scene has the travel time `tau`. Checks gates with an end at `tau`: the light counts if `tau` is `lo`, and
/// does not if `tau` is `hi`.
fn edges_are_half_open(scene: &Scene, estimator: Estimator, tau: f64, radiance: f64) {
    let s = settings(estimator, [2, 2]).max_depth(6).light_paths(100).build().unwrap();
    let mut renderer = renderer(scene, &s);
    let mut through = |lo: f64, hi: f64| sum(&image(&mut renderer, 1, Gate { lo, hi }, 1, 16)) / 12.0;
    for (lo, hi) in [
        (tau, f64::INFINITY),
        (tau, tau + 1.0),
        (tau, step(tau, 16)),
        (tau, step(tau, 1)),
        (step(tau, -16), step(tau, 1)),
        (0.0, step(tau, 1)),
    ] {
        let got = through(lo, hi);
        assert!((got / radiance - 1.0).abs() < 1e-4, "{estimator:?}, {tau} m in [{lo}, {hi}): {got}, not {radiance}");
    }
    for (lo, hi) in [(0.0, tau), (step(tau, -16), tau), (step(tau, 1), tau + 1.0), (step(tau, 1), step(tau, 17))] {
        assert_eq!(through(lo, hi), 0.0, "{estimator:?}, {tau} m in [{lo}, {hi})");
    }
}

/// The test also shows that a travel time is measured between points on surfaces, although rays start at offset points.
#[test]
fn a_path_exactly_at_an_edge_counts_at_the_beginning_only() {
    for distance in [2.0, 3.0, 1000.0] {
        let radiance = f64::from(ALBEDO) / (std::f64::consts::PI * distance * distance);
        let scene = wall(distance, NARROW, [2, 2]);
        for estimator in Estimator::ALL {
            edges_are_half_open(&scene, estimator, 2.0 * distance, radiance);
        }
    }
}

#[test]
fn a_pane_of_glass_delays_light_by_its_index() {
    let mut scene = Scene::default();
    let lamp = material(&mut scene, emitter("lamp", [3.0; 3]));
    add(&mut scene, "lamp", lamp, quad(DVec3::new(-1.0, -1.0, -4.0), DVec3::X * 2.0, DVec3::Y * 2.0, [1.0; 2]));
    let clear = material(&mut scene, glass("pane"));
    add(&mut scene, "pane", clear, cuboid(DVec3::new(-1.0, -1.0, -2.0), DVec3::new(1.0, 1.0, -1.0)));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, NARROW, [2, 2]);
    // 1 m of air, 1 m of glass, 2 m of air.
    let tau = 1.0 + 1.5 + 2.0;
    let s = settings(Estimator::Pt, [2, 2]).max_depth(3).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    let mut through = |lo: f64, hi: f64| sum(&image(&mut renderer, 1, Gate { lo, hi }, 1, 16));
    assert!(through(tau, step(tau, 1)) > 0.0);
    assert_eq!((through(0.0, tau), through(step(tau, 1), 100.0)), (0.0, 0.0));
}

#[test]
fn a_gate_before_or_after_all_light_is_black() {
    let scene = build(Kind::CornellBox);
    for estimator in Estimator::ALL {
        let s = settings(estimator, [8, 8]).max_depth(4).light_paths(200).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        for (lo, hi) in [(0.0, 1e-30), (0.0, 2.0), (1.9, 2.0), (1e3, f64::INFINITY), (1e3, 2e3), (5e29, 1e30)] {
            assert_eq!(sum(&image(&mut renderer, 1, Gate { lo, hi }, 1, 4)), 0.0, "{estimator:?}: [{lo}, {hi})");
        }
        assert!(sum(&image(&mut renderer, 1, Gate::OPEN, 1, 4)) > 0.0);
        for (lo, hi) in [
            (2.0, 1.0),
            (1.0, 1.0),
            (f64::NAN, 1.0),
            (1.0, f64::NAN),
            (f64::NEG_INFINITY, 1.0),
            (-5.0, -1.0),
            (1e30, 2e30),
        ] {
            assert!(renderer.restart(1, Gate { lo, hi }).is_err(), "[{lo}, {hi})");
        }
        let too_often = renderer.restart(1, Responses::from(Gate { lo: 1.0, hi: 2.0 }).repeated(1e-9)).unwrap_err();
        assert!(too_often.to_string().contains("too short for the gate"), "{too_often}");
        assert!(renderer.film().samples() > 0, "a gate that is refused changes nothing");
        assert_eq!(renderer.stats().dropped, 0);
    }
}
