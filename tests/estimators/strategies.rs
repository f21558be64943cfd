//! One image per strategy. The MIS-weighted images add up to the rendered image. Without MIS weights, all strategies that can
//! find all paths with k segments have the same expected image.

use super::cells::{device, is_long, renderer, settings};
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::{PreparedScene, StrategyImage, StrategyImages, strategies};
use taugate::internals::scene::{Medium, PhaseFunction, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Settings, Strategies};

const SAMPLES: [u32; 2] = [2, 3];
/// Allowed relative error of the sum over all strategies. Every strategy with any light contributes more than this.
const TOLERANCE: f64 = 2e-6;

/// Renders the image, and the images of its strategies with the same seed.
fn both(scene: &Scene, settings: &Settings) -> (Vec<f32>, StrategyImages) {
    let mut whole = renderer(scene, settings);
    let prepared = PreparedScene::new(scene, settings).unwrap();
    let mut parts = StrategyImages::new(&device(), scene, settings, &prepared).unwrap();
    for samples in SAMPLES {
        whole.iterate(samples).unwrap();
        parts.iterate(samples).unwrap();
    }
    assert_eq!(whole.stats().dropped, 0);
    (whole.film().mean(), parts)
}

/// Largest difference between the image and the sum of `parts`, relative to the pixel's value plus the image's mean.
fn difference<'a>(image: &[f32], parts: impl Iterator<Item = &'a StrategyImage>) -> f64 {
    let mut sum = vec![0.0f64; image.len()];
    for part in parts {
        for (to, from) in sum.iter_mut().zip(part.weighted.mean()) {
            *to += f64::from(from);
        }
    }
    let mean = image.iter().map(|&x| f64::from(x)).sum::<f64>() / image.len() as f64;
    let relative = |(&x, s): (&f32, &f64)| (f64::from(x) - s).abs() / (f64::from(x).abs() + mean);
    image.iter().zip(&sum).map(relative).fold(0.0, f64::max)
}

/// The scene in thin fog that scatters forwards.
fn foggy(scene: Scene) -> Scene {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    Scene { media: vec![Medium { sigma_s: [0.15, 0.1, 0.2], sigma_a: [0.02; 3], phase, ..Medium::default() }], ..scene }
}

/// Small settings with one query per shade point: with more queries, MIS gives the other strategies of `lcs` hardly any weight.
fn small(estimator: Estimator, strategies: Strategies, gate: Gate) -> Settings {
    settings(estimator, [24, 20])
        .strategies(strategies)
        .gate(gate)
        .max_depth(6)
        .light_paths(500)
        .queries(1)
        .build()
        .unwrap()
}

#[test]
fn weighted_strategies_sum_to_the_image() {
    let gate = Gate { lo: 4.0, hi: 9.0 };
    let mut cases = vec![
        ("lamp", zoo(Light::Area), Estimator::Lcs, Strategies::All, gate),
        ("foggy punctual", foggy(zoo(Light::Punctual)), Estimator::Lcs, Strategies::All, gate),
    ];
    // `lcs-paper` gives paths the same weights as `lcs` does. `lcs` has the strategies of `bdpt`, and in fog more.
    if is_long() {
        cases.push(("thin beam", build(Kind::DoorAjar), Estimator::Bdpt, Strategies::All, Gate::OPEN));
        cases.push(("punctual", zoo(Light::Punctual), Estimator::Lcs, Strategies::All, gate));
        cases.push(("lamp", zoo(Light::Area), Estimator::Bdpt, Strategies::All, gate));
        cases.push(("lamp", zoo(Light::Area), Estimator::Pt, Strategies::All, gate));
        cases.push(("lamp", zoo(Light::Area), Estimator::Lcs, Strategies::Paper, Gate::OPEN));
        cases.push(("lamp", zoo(Light::Area), Estimator::Epc, Strategies::All, gate));
        cases.push(("lamp", zoo(Light::Area), Estimator::LcsPaper, Strategies::All, Gate::OPEN));
        cases.push(("lamp", zoo(Light::Area), Estimator::LcsPaper, Strategies::Paper, gate));
        cases.push(("foggy punctual", foggy(zoo(Light::Punctual)), Estimator::Epc, Strategies::All, gate));
        cases.push(("foggy lamp", foggy(zoo(Light::Area)), Estimator::Lcs, Strategies::All, gate));
        cases.push(("foggy lamp", foggy(zoo(Light::Area)), Estimator::Bdpt, Strategies::All, gate));
        cases.push(("punctual", zoo(Light::Punctual), Estimator::LcsPaper, Strategies::All, gate));
        cases.push(("foggy lamp", foggy(zoo(Light::Area)), Estimator::LcsPaper, Strategies::All, gate));
    }
    for (name, scene, estimator, kept, gate) in cases {
        let (image, parts) = both(&scene, &small(estimator, kept, gate));
        let all = difference(&image, parts.images().iter());
        eprintln!("{name} {estimator:?} {kept:?}: {all:.1e}");
        assert!(all < TOLERANCE, "{name} {estimator:?} {kept:?}: {all:.1e} off");
        // Negative control: the sum without any one strategy that has light must differ.
        let mut lit = 0;
        for left_out in parts.images() {
            let light: f64 = left_out.weighted.mean().iter().map(|&x| f64::from(x)).sum();
            let unweighted: f64 = left_out.unweighted.mean().iter().map(|&x| f64::from(x)).sum();
            assert!(light <= unweighted * (1.0 + 1e-6), "a weight is above 1");
            if light > 0.0 {
                lit += 1;
                let rest = parts.images().iter().filter(|&i| !std::ptr::eq(i, left_out));
                let off = difference(&image, rest);
                assert!(off > TOLERANCE, "{name} {estimator:?} without ({}, {}): {off:.1e}", left_out.s, left_out.t);
            }
        }
        assert!(lit >= 4, "{name} {estimator:?}: only {lit} strategies find light");
    }
}

/// In a diffuse box with a large lamp, every strategy finds all paths of its length. The unweighted images therefore agree on
/// average.
#[test]
fn strategies_of_one_length_agree_unweighted() {
    agree_unweighted("clear", &build(Kind::CornellBox));
}

/// As before, with segments that end in fog and segments that pass through it.
#[test]
fn strategies_of_one_length_agree_unweighted_in_fog() {
    agree_unweighted("foggy", &foggy(build(Kind::CornellBox)));
}

fn agree_unweighted(name: &str, scene: &Scene) {
    let s =
        small(Estimator::Bdpt, Strategies::All, Gate::OPEN).change().max_depth(3).light_paths(2000).build().unwrap();
    let prepared = PreparedScene::new(scene, &s).unwrap();
    let mut parts = StrategyImages::new(&device(), scene, &s, &prepared).unwrap();
    for _ in 0..128 {
        parts.iterate(4).unwrap();
    }
    let mean_of = |s: u32, t: u32| {
        let image = parts.images().iter().find(|i| (i.s, i.t) == (s, t)).unwrap();
        image.unweighted.image_mean()
    };
    for k in [2, 3] {
        let (reference, error) = mean_of(1, k);
        let error = error.unwrap();
        for s in (0..=k).filter(|&s| s != 1) {
            let (mean, own) = mean_of(s, k + 1 - s);
            let z = (mean - reference) / own.unwrap().hypot(error);
            eprintln!("{name} ({s}, {}): {mean:.5} against {reference:.5}, z = {z:.2}", k + 1 - s);
            // Significance 1e-3 for five comparisons, Student's t with over 100 degrees of freedom.
            assert!(z.abs() < 4.1, "({s}, {}): {mean} against {reference}, z = {z:.2}", k + 1 - s);
            // Negative control: 20 % more light. With s = 0, rays hit the lamp by chance and are noisier: 60 % more.
            let more = if s == 0 { 1.6 } else { 1.2 };
            assert!(
                ((more * mean - reference) / (more * own.unwrap()).hypot(error)).abs() > 4.1,
                "({s}, {}): too noisy",
                k + 1 - s
            );
        }
    }
}

#[test]
fn the_strategies_that_are_listed() {
    let count = |estimator, kept| strategies(&small(estimator, kept, Gate::OPEN), estimator == Estimator::Epc).len();
    // bdpt: k + 1 strategies for paths of k = 1 to 6 segments, without (1, 1): 2 + ... + 7 - 1. pt (s <= 1, t >= 2): two for each
    // length, but one for the shortest.
    assert_eq!(count(Estimator::Bdpt, Strategies::All), 26);
    assert_eq!(count(Estimator::Pt, Strategies::All), 11);
    // The paper's strategies (s >= 1, t >= 2): k - 1 for paths of k segments.
    assert_eq!(count(Estimator::LcsPaper, Strategies::Paper), 15);
    assert_eq!(count(Estimator::Lcs, Strategies::Paper), 15);
    let huge = settings(Estimator::Bdpt, [64, 64]).max_depth(254).build().unwrap();
    assert!(StrategyImages::check(&huge).unwrap_err().to_string().contains("--max-depth"));
}
