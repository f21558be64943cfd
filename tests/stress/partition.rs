//! The images of a thousand abutting gates add up to the ungated image.

use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Medium, PhaseFunction, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Strategies};

use super::cells::{renderer, settings, threshold};
use super::{image, sum};

/// `n` gates that together cover every travel time. The edges between neighbours lie from 3 m to 18 m, where most light of the box
/// arrives.
fn abutting(n: u32) -> Vec<Gate> {
    let edge = |i: u32| match i {
        0 => 0.0,
        i if i == n => f64::INFINITY,
        i => 3.0 + 15.0 * f64::from(i) / f64::from(n),
    };
    (0..n).map(|i| Gate { lo: edge(i), hi: edge(i + 1) }).collect()
}

fn cornell(estimator: Estimator, media: Vec<Medium>) -> Renderer {
    let s = settings(estimator, [8, 8]).max_depth(6).light_paths(100).build().unwrap();
    renderer(&Scene { media, ..build(Kind::CornellBox) }, &s)
}

/// Compares the sum of the gated images with the ungated image, with the same seed for all images. Returns the largest difference
/// in a pixel channel, relative to the mean of the ungated image.
fn worst(estimator: Estimator, media: Vec<Medium>, gates: &[Gate]) -> f64 {
    let mut renderer = cornell(estimator, media);
    let whole = image(&mut renderer, 7, Gate::OPEN, 1, 2);
    let mut total = vec![0.0; whole.len()];
    for &gate in gates {
        for (t, x) in total.iter_mut().zip(image(&mut renderer, 7, gate, 1, 2)) {
            *t += f64::from(x);
        }
    }
    let mean = sum(&whole) / whole.len() as f64;
    let worst = total.iter().zip(&whole).map(|(t, &w)| (t - f64::from(w)).abs() / mean).fold(0.0, f64::max);
    println!("{estimator:?}, {} gates: {worst:.1e} of the mean at worst", gates.len());
    worst
}

#[test]
fn a_hundred_gates_add_up() {
    assert!(worst(Estimator::Bdpt, vec![], &abutting(100)) < 1e-5);
    // Negative control: forty gates are missing.
    assert!(worst(Estimator::Bdpt, vec![], &abutting(100)[..60]) > 1e-5);
}

/// Fog fills the box, and the air around the camera.
#[test]
fn gates_add_up_in_fog() {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    let fog =
        || vec![Medium { sigma_s: [0.3, 0.2, 0.1], sigma_a: [0.05; 3], phase: phase.clone(), ..Medium::default() }];
    assert!(worst(Estimator::Pt, fog(), &abutting(15)) < 1e-5);
    assert!(worst(Estimator::Bdpt, fog(), &abutting(15)) < 1e-5);
    // Negative control: the light that arrives after 10 m is missing.
    assert!(worst(Estimator::Bdpt, fog(), &abutting(15)[..7]) > 1e-5);
}

#[test]
#[ignore = "takes a minute"]
fn a_thousand_gates_add_up_with_the_same_seed() {
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        assert!(worst(estimator, vec![], &abutting(1000)) < 1e-5);
    }
}

/// Returns the light in the image of each of `n` gates, the light of the ungated image, and the standard error of the difference:
/// the sum of the gates minus the ungated light. Each gate is rendered with `seeds` seeds that no other gate has, so that the
/// variances of the gates add up. The error is small only without t = 1, because rare bright pixels of this strategy dominate the
/// variance.
fn totals(estimator: Estimator, strategies: Strategies, n: u32, seeds: u32, whole_seeds: u32) -> (Vec<f64>, f64, f64) {
    let s = settings(estimator, [8, 8]).max_depth(4).light_paths(2000).strategies(strategies).build().unwrap();
    let mut renderer = renderer(&build(Kind::CornellBox), &s);
    let mut moments = |gate: Gate, first_seed: u32, seeds: u32| {
        let values: Vec<f64> = (0..seeds).map(|i| sum(&image(&mut renderer, first_seed + i, gate, 1, 16))).collect();
        let n = f64::from(seeds);
        let mean = values.iter().sum::<f64>() / n;
        (mean, values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
    };
    let (whole, mut variance) = moments(Gate::OPEN, 1, whole_seeds);
    let mut parts = vec![];
    for (i, &gate) in abutting(n).iter().enumerate() {
        let (mean, var) = moments(gate, 1000 + seeds * i as u32, seeds);
        parts.push(mean);
        variance += var;
    }
    let total: f64 = parts.iter().sum();
    let error = variance.sqrt();
    println!("{estimator}, {n} gates: {total:.4} against {whole:.4} +- {error:.4}, z = {:.2}", (total - whole) / error);
    (parts, whole, error)
}

#[test]
fn thirty_gates_add_up_with_resampled_queries() {
    let (parts, whole, error) = totals(Estimator::Lcs, Strategies::Paper, 30, 16, 64);
    assert!(error < 0.02 * whole && ((parts.iter().sum::<f64>() - whole) / error).abs() < threshold(1));
    // Negative control: the brightest gate is missing.
    let brightest = parts.iter().copied().fold(0.0, f64::max);
    assert!((parts.iter().sum::<f64>() - brightest - whole) / error < -threshold(1));
}

#[test]
#[ignore = "takes minutes"]
fn a_thousand_gates_add_up_with_light_cone_shell_queries() {
    for (estimator, strategies, noise) in [
        (Estimator::LcsPaper, Strategies::All, 0.1),
        (Estimator::LcsPaper, Strategies::Paper, 0.1),
        (Estimator::Lcs, Strategies::Paper, 0.02),
    ] {
        let (parts, whole, error) = totals(estimator, strategies, 1000, 8, 400);
        let z = (parts.iter().sum::<f64>() - whole) / error;
        assert!(error < noise * whole && z.abs() < 4.0, "{estimator}: z = {z:.2}");
    }
}
