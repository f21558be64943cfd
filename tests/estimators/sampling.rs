//! Adaptive sampling does not change the expected image, and the error that a render states is right.

use super::cells::{Cells, device, disagreements, is_long, renderer, settings, threshold};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::{PreparedScene, StrategyImages};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Sampling, Settings};

/// Through this gate the generated Cornell box is dark in some parts, bright in others, and seen in its mirror.
const GATE: Gate = Gate { lo: 8.0, hi: 8.3 };

fn spread(estimator: Estimator, sampling: Sampling) -> Settings {
    settings(estimator, [24, 24]).sampling(sampling).max_depth(10).build().unwrap()
}

/// `cargo test --release --test estimators -- --ignored adaptive_samples`
#[test]
#[ignore = "takes ten seconds; the closed form is tested always"]
fn adaptive_samples_agree_with_uniform_ones() {
    let scene = build(Kind::CornellBox);
    let all = [Estimator::Lcs, Estimator::Bdpt];
    for &estimator in if is_long() { &all[..] } else { &all[..1] } {
        let uniform = Cells::measure(&mut renderer(&scene, &spread(estimator, Sampling::Uniform)), GATE, 8, 3, 4, 500);
        let mut adaptive = renderer(&scene, &spread(estimator, Sampling::Adaptive));
        let wrong = disagreements(&uniform, &Cells::measure(&mut adaptive, GATE, 8, 3, 4, 600));
        assert!(wrong.is_empty(), "{estimator}:\n{}", wrong.join("\n"));
        let later = Gate { lo: 8.3, hi: 8.6 };
        let shifted = Cells::measure(&mut adaptive, later, 8, 3, 4, 600);
        assert!(!disagreements(&uniform, &shifted).is_empty(), "{estimator}: another gate looks the same");
    }
}

#[test]
fn adaptive_samples_agree_with_the_closed_form() {
    let scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: 0.5 });
    let settings = settings(Estimator::Lcs, [12, 12]).sampling(Sampling::Adaptive).build().unwrap();
    let mut renderer = renderer(&scene, &settings);
    for (lo, hi) in [(2.5, 3.0), (4.0, 5.0)] {
        let (mean, error) = Cells::measure(&mut renderer, Gate { lo, hi }, 12, 4, 4, 700).whole();
        let [z, off] = [1.0, 1.02].map(|stretch| (mean - gated_radiance(1.0, 0.5, lo * stretch, hi * stretch)) / error);
        assert!(z.abs() < threshold(2), "[{lo}, {hi}): z = {z:.2}");
        assert!(off.abs() > threshold(1), "[{lo}, {hi}): a gate off by 2 % passes with z = {off:.2}");
    }
}

/// The standard error that a render states for the mean of its image agrees with the spread of the means of different seeds.
#[test]
#[ignore = "takes five seconds; the unit tests of the schedule test the stated variance always"]
fn the_stated_error_of_adaptive_renders_is_that_of_seeds() {
    let scene = build(Kind::CornellBox);
    let settings = spread(Estimator::Lcs, Sampling::Adaptive).change().resolution([12, 12]).build().unwrap();
    let mut renderer = renderer(&scene, &settings);
    const SEEDS: u32 = 32;
    let (mut means, mut stated) = (vec![], 0.0);
    for seed in 0..SEEDS {
        renderer.restart(800 + seed, GATE).unwrap();
        (0..8).for_each(|_| renderer.iterate(4).unwrap_or_else(|e| panic!("{e}")));
        let (mean, error) = renderer.film().image_mean();
        means.push(mean);
        stated += error.expect("eight iterations").powi(2) / f64::from(SEEDS);
    }
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let found = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (means.len() - 1) as f64;
    // A variance that is estimated from 32 values has a relative standard deviation of 25 %. The mean of the 32 stated variances
    // has less than half that deviation.
    let ratio = stated / found;
    assert!((0.45..2.2).contains(&ratio), "stated variance / variance between seeds = {ratio:.2}");
}

#[test]
fn adaptive_renders_take_the_samples_they_say() {
    let scene = build(Kind::CornellBox);
    let mut renderer = renderer(&scene, &spread(Estimator::Lcs, Sampling::Adaptive));
    renderer.restart(1, GATE).unwrap();
    for samples in [1, 1, 2, 4, 16] {
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    assert_eq!(renderer.film().samples(), 24);
    let traced = renderer.stats().samples;
    assert!(traced.abs_diff(24 * 24 * 24) <= 5, "{traced} samples");
    let [min, max] = renderer.samples_in_pixels();
    assert!((8..16).contains(&min) && (41..=96).contains(&max), "{min} to {max} samples per pixel");
}

#[test]
fn images_of_strategies_are_refused() {
    let scene = build(Kind::CornellBox);
    let settings = spread(Estimator::Lcs, Sampling::Adaptive);
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let error = StrategyImages::new(&device(), &scene, &settings, &prepared).err().expect("refused").to_string();
    assert!(error.contains("--sampling uniform"), "{error}");
}
