//! `compare --z`: two renders of the same scene agree although the pixels of an iteration are correlated, and small errors are
//! found.

use super::cells::{renderer, settings};
use taugate::internals::compare::agreement::{Agreement, SIGNIFICANCE, agreement};
use taugate::internals::compare::statistics::sidak_threshold;
use taugate::internals::generate::{Kind, build};
use taugate::internals::image::batches::CellBatches;
use taugate::internals::render::Renderer;
use taugate::internals::scene::Scene;
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

const SIZE: [u32; 2] = [48, 48];
const GATE: Gate = Gate { lo: 6.5, hi: 7.5 };

fn prepared(scene: &Scene, estimator: Estimator) -> Renderer {
    // With few light paths, the pixels of an iteration are strongly correlated.
    let s = settings(estimator, SIZE).light_paths(500).max_depth(8).build().unwrap();
    renderer(scene, &s)
}

fn batches(renderer: &mut Renderer, gate: Gate, seed: u32, iterations: u32, samples: u32) -> CellBatches {
    renderer.restart(seed, gate).unwrap();
    (0..iterations).for_each(|_| renderer.iterate(samples).unwrap());
    renderer.film().cells().clone()
}

/// Compares `pairs` pairs of renders per estimator, all with different seeds. Returns how many pairs differ at the stated
/// significance and at 5 %, and the number of pairs.
fn alarms(pairs: u32, estimators: &[Estimator], samples: u32) -> [usize; 3] {
    let scene = build(Kind::CornellBox);
    let mut counts = [0; 3];
    for &estimator in estimators {
        let mut r = prepared(&scene, estimator);
        for pair in 0..pairs {
            let mut one = |seed| batches(&mut r, GATE, seed, 16, samples);
            let (a, b) = (one(2 * pair), one(2 * pair + 1));
            let found = agreement(SIZE, &a, &b).unwrap();
            counts[0] += usize::from(!found.is_within_noise());
            counts[1] += usize::from(found.max_z > sidak_threshold(0.05, found.tests));
            counts[2] += 1;
            eprintln!("{estimator:?}: max |z| {:.2}, {} means of {} pixels", found.max_z, found.tests, found.cell);
        }
    }
    eprintln!("{} alarms at {SIGNIFICANCE}, {} at 5 %, of {} pairs", counts[0], counts[1], counts[2]);
    counts
}

#[test]
#[ignore = "takes five seconds; small errors are found always"]
fn renders_of_the_same_agree() {
    let [significant, at_five_percent, pairs] = alarms(5, &[Estimator::Bdpt, Estimator::LcsPaper], 2);
    // Binomial distribution of 10 pairs: more than one alarm at 1e-3, or more than four at 5 %, have a probability below 1e-4.
    assert!(significant <= 1 && at_five_percent <= 4 && pairs == 10, "{significant} and {at_five_percent} alarms");
}

/// The long version: the rate of false alarms over 120 pairs.
/// `cargo test --release --test estimators -- --ignored --nocapture rate_of_false`
#[test]
#[ignore = "takes minutes"]
fn the_rate_of_false_alarms_is_as_stated() {
    let [significant, at_five_percent, pairs] = alarms(40, &[Estimator::Pt, Estimator::Bdpt, Estimator::LcsPaper], 2);
    assert!(significant <= 2 && at_five_percent <= 15 && pairs == 120, "{significant} and {at_five_percent} alarms");
}

/// Negative controls: a gate that is off by 2 %, and light that is off by 3 %.
#[test]
fn small_errors_are_found() {
    let scene = build(Kind::CornellBox);
    let mut bright = build(Kind::CornellBox);
    bright.materials.iter_mut().for_each(|m| m.emission = m.emission.map(|e| 1.03 * e));
    let mut r = prepared(&scene, Estimator::Bdpt);
    let truth = batches(&mut r, GATE, 1, 24, 16);
    let right = batches(&mut r, GATE, 2, 24, 16);
    let late = batches(&mut r, Gate { lo: GATE.lo * 1.02, hi: GATE.hi * 1.02 }, 3, 24, 16);
    let brighter = batches(&mut prepared(&bright, Estimator::Bdpt), GATE, 4, 24, 16);
    let judge = |name: &str, b: &CellBatches| -> Agreement {
        let found = agreement(SIZE, b, &truth).unwrap();
        eprintln!("{name}: max |z| {:.2} of {} means, threshold {:.2}", found.max_z, found.tests, found.threshold);
        found
    };
    assert!(judge("the same", &right).is_within_noise());
    assert!(!judge("gate off by 2 %", &late).is_within_noise());
    assert!(!judge("light off by 3 %", &brighter).is_within_noise());
}

/// Why cells record their own batches: pixels are correlated, so the variances of pixels add up to less than the variance of
/// their cell.
#[test]
#[ignore = "takes five seconds; it shows why the map needs cells"]
fn the_variances_of_pixels_are_not_enough() {
    let scene = build(Kind::CornellBox);
    let mut r = prepared(&scene, Estimator::LcsPaper);
    // A variance from 32 batches has a relative error of a quarter. Its mean over eight seeds has an error of a tenth.
    let (mut shared, mut added) = (0.0, 0.0);
    for seed in 5..13 {
        let cells = batches(&mut r, GATE, seed, 32, 2);
        let all: Vec<usize> = (0..cells.grid().iter().product()).collect();
        shared += cells.pooled(&all, 1).1;
        let pixels = r.film().variance_of_mean();
        let n = (SIZE[0] * SIZE[1]) as f64;
        added += pixels.iter().skip(1).step_by(3).map(|&v| f64::from(v)).sum::<f64>() / (n * n);
    }
    eprintln!("variance of the mean {shared:.2e}; from pixels {added:.2e}; ratio {:.2}", shared / added);
    assert!(shared > 1.2 * added, "variance of the mean {shared:.2e}; from pixels {added:.2e}");
}
