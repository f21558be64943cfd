//! Thin gates have the right energy. They show rings on a plane almost a kilometre away, where f32 travel times are coarse.

use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{renderer, settings, threshold};
use super::wall::{gated_pixels, wall};
use super::{image, sum};

/// Distance of the plane in metres. It is no power of two, and all travel times in view (about twice the distance) have the same
/// f32 exponent.
const DISTANCE: f64 = 870.0;
/// Field of view in radians. The rings that are completely in view span about 700 f32 steps of 2^-13 m.
const YFOV: f64 = 0.0195;
/// Distance of neighbouring f32 numbers between 1024 m and 2048 m, in metres.
const STEP: f64 = 1.0 / 8192.0;

/// Relative bias of the mean over `gates` gates, and its standard error. Gates are `width` f32 steps wide and begin the fraction
/// `phase` of a step above an f32 number.
fn bias(estimator: Estimator, width: f64, phase: f64, gates: u32, seeds: u32, iterations: u32) -> (f64, f64) {
    let s = settings(estimator, [32, 32]).max_depth(2).light_paths(16).build().unwrap();
    let mut renderer = renderer(&wall(DISTANCE, YFOV, [32, 32]), &s);
    let mut ratios = vec![0.0; seeds as usize];
    for i in 0..gates {
        // The gates are spread over the rings that are completely in view.
        let lo = 2.0 * DISTANCE + STEP * (8.0 + f64::from(i) * 300.0 / f64::from(gates) + phase).floor() + STEP * phase;
        let gate = Gate { lo, hi: lo + width * STEP };
        let truth: f64 = 3072.0 * gated_pixels(DISTANCE, YFOV, 1, gate.lo, gate.hi)[0];
        for (seed, ratio) in ratios.iter_mut().enumerate() {
            let got = sum(&image(&mut renderer, 1 + i * seeds + seed as u32, gate, iterations, 16));
            *ratio += got / truth / f64::from(gates);
        }
    }
    let n = f64::from(seeds);
    let mean = ratios.iter().sum::<f64>() / n;
    let error = (ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    println!(
        "{estimator:?}, {width} steps, phase {phase}: bias {:+.3} % +- {:.3} %",
        100.0 * (mean - 1.0),
        100.0 * error
    );
    (mean - 1.0, error)
}

#[test]
fn a_gate_of_256_steps_has_its_energy() {
    for estimator in [Estimator::Pt, Estimator::Lcs] {
        let (bias, error) = bias(estimator, 256.0, 0.0, 2, 32, 1);
        assert!(error < 0.0015 && bias.abs() < 0.005, "{estimator:?}: {bias} +- {error}");
    }
}

/// A single gate may be off by a rounding step of the squared distance, which is a quarter of a step of time, so the test
/// averages over many gates. Ends of gates between two f32 numbers are rounded to one of them.
#[test]
#[ignore = "takes a minute"]
fn energy_of_gates_down_to_16_steps() {
    for estimator in [Estimator::Pt, Estimator::LcsPaper, Estimator::Lcs, Estimator::Epc] {
        for (width, gates, iterations) in [(256.0, 4, 2), (64.0, 16, 1), (16.0, 64, 1)] {
            let (bias, error) = bias(estimator, width, 0.0, gates, 32, iterations);
            assert!(
                bias.abs() < 0.005_f64.max(threshold(9) * error),
                "{estimator:?}, {width} steps: {bias} +- {error}"
            );
        }
    }
    for phase in [0.25, 0.5, 0.75] {
        let (bias, _) = bias(Estimator::Pt, 256.0, phase, 4, 32, 2);
        assert!(bias.abs() < 0.005, "phase {phase}: {bias}");
    }
    // Negative control: a gate that is closed at both ends is one step wider, 6 % of 16 steps.
    let (bias, error) = bias(Estimator::Pt, 17.0, 0.0, 64, 32, 1);
    assert!((bias + 1.0) * 17.0 / 16.0 - 1.0 > threshold(1) * error + 0.005);
}
