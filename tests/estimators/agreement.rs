//! The estimators agree with each other and with the oracle, a path tracer in f64 with another algorithm.

use std::sync::OnceLock;

use super::cells::{Cells, disagreements, exceeds, is_long, renderer, settings, threshold, z_score};
use super::rough_glass;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{LightKind, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Emitters, Estimator, SettingsBuilder, Strategies};
use taugate_oracle::path_tracer::{self, Film};

const CELL: usize = 8;
const MAX_DEPTH: u32 = 10;

fn gate(lo: f64, hi: f64) -> Gate {
    Gate { lo, hi }
}

/// Mean and variance of each cell of one bin of the oracle's image: of the average over the channels, and of each channel
/// (`[3 * cell + channel]`).
fn oracle_cells(film: &Film, bin: usize) -> [Vec<(f64, f64)>; 2] {
    let width = film.resolution[0] as usize;
    let columns = width.div_ceil(CELL);
    let mut sums = vec![([(0.0, 0.0); 4], 0usize); columns * (film.resolution[1] as usize).div_ceil(CELL)];
    for (i, p) in film.bins[bin].iter().enumerate() {
        let (values, n) = &mut sums[i / width / CELL * columns + i % width / CELL];
        values[0].0 += p.mean.iter().sum::<f64>() / 3.0;
        // Upper bound: the channels of a pixel may be fully correlated.
        values[0].1 += p.variance.iter().map(|v| v.sqrt() / 3.0).sum::<f64>().powi(2);
        for (value, (mean, variance)) in values[1..].iter_mut().zip(p.mean.into_iter().zip(p.variance)) {
            *value = (value.0 + mean, value.1 + variance);
        }
        *n += 1;
    }
    let means = sums.into_iter().map(|(values, n)| values.map(|(m, v)| (m / n as f64, v / (n * n) as f64)));
    let means: Vec<[(f64, f64); 4]> = means.collect();
    [means.iter().map(|m| m[0]).collect(), means.iter().flat_map(|m| &m[1..]).copied().collect()]
}

/// Describes the values that differ significantly from `factor` times the expected ones. `whole` is the mean of the oracle's image.
/// The variance of a value that is dark in the oracle's image is too uncertain for a test. Such a value must be dark too.
fn differences(found: &[(f64, f64)], expected: &[(f64, f64)], factor: f64, whole: f64, limit: f64) -> Vec<String> {
    let mut wrong = vec![];
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let (mean, variance) = (factor * expected.0, found.1 + factor * factor * expected.1);
        let z = z_score(found.0 - mean, variance);
        let differs = match 100.0 * expected.0 < whole {
            true => found.0.is_nan() || found.0 > 0.02 * whole + limit * variance.sqrt(),
            false => exceeds(z, limit),
        };
        if differs {
            wrong.push(format!("{i}: {:.6}, oracle {mean:.6}, z = {z:.2}", found.0));
        }
    }
    wrong
}

/// The estimators that can render the scene's emitters: `pt` cannot render beams.
fn estimators(scene: &Scene) -> Vec<Estimator> {
    let mut estimators = vec![Estimator::Bdpt, Estimator::Epc, Estimator::LcsPaper, Estimator::Lcs];
    if !has_only_beams(scene) {
        estimators.push(Estimator::Pt);
    }
    estimators
}

fn has_only_beams(scene: &Scene) -> bool {
    !scene.lights.is_empty() && scene.lights.iter().all(|l| matches!(l.kind, LightKind::Beam { .. }))
}

/// Compares the estimators that check a feature with the oracle over several gates.
pub fn feature_against_oracle(name: &str, scene: &Scene, gates: &[(f64, f64)], resolution: [u32; 2]) -> Vec<String> {
    against(name, &feature_estimators(scene), scene, gates, &oracle(scene, gates, resolution, oracle_samples()))
}

/// All estimators evaluate materials, media and cameras with the same functions, so only `lcs` checks such a feature: it has the
/// strategies of all others. Long runs ([`is_long`]) use all estimators that can render the scene.
pub fn feature_estimators(scene: &Scene) -> Vec<Estimator> {
    if is_long() { estimators(scene) } else { vec![Estimator::Lcs] }
}

/// `lcs`, and the estimator that has the least in common with it. All estimators in long runs.
pub fn unlike_estimators(scene: &Scene) -> Vec<Estimator> {
    let least_like_lcs = if has_only_beams(scene) { Estimator::Bdpt } else { Estimator::Pt };
    if is_long() { estimators(scene) } else { vec![least_like_lcs, Estimator::Lcs] }
}

/// The oracle's samples per pixel in most tests.
pub fn oracle_samples() -> u32 {
    if is_long() { 800 } else { 500 }
}

/// The oracle's image through each gate, with `spp` samples per pixel.
pub fn oracle(scene: &Scene, gates: &[(f64, f64)], resolution: [u32; 2], spp: u32) -> Film {
    let (camera, emitters, bins) = (0, Emitters::Scene, gates.to_vec());
    let s = path_tracer::Settings { camera, resolution, spp, seed: 7, max_depth: MAX_DEPTH, bins, emitters };
    path_tracer::render(scene, &s)
}

/// The part of `film` that belongs to one gate.
pub fn bin(film: &Film, bin: usize) -> Film {
    Film { resolution: film.resolution, bins: vec![film.bins[bin].clone()] }
}

/// A factor between two images that the comparisons notice, unless a test says otherwise.
pub const NOTICED: f64 = 1.2;

/// Compares images of `scene` with `truth` and describes each cell, and each channel of a cell, in which they differ significantly.
/// If none does, this panics unless an image that is [`NOTICED`] times as bright would differ through at least one of the gates.
pub fn against(name: &str, estimators: &[Estimator], scene: &Scene, gates: &[(f64, f64)], truth: &Film) -> Vec<String> {
    let of_estimator = |&estimator: &Estimator| {
        let settings = settings(estimator, truth.resolution);
        settings_against(name, settings, scene, gates, truth, NOTICED)
    };
    estimators.iter().flat_map(of_estimator).collect()
}

/// As [`against`], for an estimator with these settings, and with a factor other than [`NOTICED`].
pub fn settings_against(
    name: &str,
    settings: SettingsBuilder,
    scene: &Scene,
    gates: &[(f64, f64)],
    truth: &Film,
    noticed: f64,
) -> Vec<String> {
    let settings = settings.max_depth(MAX_DEPTH).build().unwrap();
    let (estimator, mut renderer) = (settings.estimator(), renderer(scene, &settings));
    // Few paths of pt fall into a gate. With 4 samples per pixel, a cell has about a hundred paths in the last gate of the
    // Cornell box. Their weights vary so much that the mean is not yet normally distributed.
    let samples = if estimator == Estimator::Pt { 16 } else { 4 };
    let (mut wrong, mut rejected) = (vec![], 0);
    for (bin, &(lo, hi)) in gates.iter().enumerate() {
        let cells = Cells::measure(&mut renderer, gate(lo, hi), CELL, 1, samples, 500);
        let [averages, channels] = oracle_cells(truth, bin);
        let whole = averages.iter().map(|e| e.0).sum::<f64>() / averages.len() as f64;
        let title = format!("{name} {estimator} [{lo}, {hi})");
        eprintln!("{title}: {:.6}, oracle {whole:.6}", cells.whole().0);
        for (kind, found, expected) in [("cell", cells.averages(), averages), ("channel", cells.channels(), channels)] {
            let limit = threshold(expected.len() * gates.len());
            let differences = |factor: f64| differences(&found, &expected, factor, whole, limit);
            wrong.extend(differences(1.0).into_iter().map(|line| format!("{title} {kind} {line}")));
            rejected += differences(noticed).len();
        }
    }
    // A wrong truth may be `noticed` times too dark.
    assert!(rejected > 0 || !wrong.is_empty(), "{name} {estimator}: {noticed} times the light is not rejected");
    wrong
}

pub fn assert_none(wrong: Vec<String>) {
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

const CORNELL_GATES: [(f64, f64); 4] = [(6.5, 7.0), (8.0, 8.3), (14.0, 16.0), (0.0, f64::INFINITY)];

/// The oracle's images of the box through its gates. One more bin is the first gate, shifted by a fifth of its width.
fn cornell_truth() -> &'static Film {
    static TRUTH: OnceLock<Film> = OnceLock::new();
    TRUTH.get_or_init(|| {
        let gates = [&CORNELL_GATES[..], &[(6.6, 7.1)]].concat();
        oracle(&build(Kind::CornellBox), &gates, [32, 32], oracle_samples())
    })
}

#[test]
fn cornell_box_agrees_with_the_oracle() {
    let scene = build(Kind::CornellBox);
    // The door ajar and the sphere test `epc` and `lcs-paper`. Rooms with every feature test `lcs`.
    let tested = if is_long() { estimators(&scene) } else { vec![Estimator::Bdpt, Estimator::Pt] };
    assert_none(against("cornell", &tested, &scene, &CORNELL_GATES, cornell_truth()));
}

/// Negative control: two channels of the oracle's image are swapped.
#[test]
fn swapped_channels_are_rejected() {
    let mut swapped = bin(cornell_truth(), 0);
    swapped.bins[0].iter_mut().for_each(|pixel| (pixel.mean.swap(1, 2), pixel.variance.swap(1, 2)).0);
    let scene = build(Kind::CornellBox);
    assert!(!against("cornell, swapped", &[Estimator::Bdpt], &scene, &CORNELL_GATES[..1], &swapped).is_empty());
}

#[test]
fn bright_cells_in_the_dark_and_undefined_values_are_found() {
    let differs =
        |found: f64, expected: f64| !differences(&[(found, 1e-6)], &[(expected, 1e-6)], 1.0, 1.0, 4.0).is_empty();
    assert!(!differs(0.5, 0.5) && differs(0.5, 0.51) && differs(f64::NAN, 0.5));
    assert!(!differs(0.0, 0.0) && !differs(0.02, 0.009) && differs(0.03, 0.0) && differs(f64::NAN, 0.0));
}

/// Negative control: the oracle's bin is shifted by a fifth of its width.
#[test]
fn shifted_bins_are_rejected() {
    let scene = build(Kind::CornellBox);
    let shifted = bin(cornell_truth(), CORNELL_GATES.len());
    for estimator in [Estimator::Pt, Estimator::Lcs] {
        assert!(!against("cornell, shifted", &[estimator], &scene, &CORNELL_GATES[..1], &shifted).is_empty());
    }
}

#[test]
fn door_ajar_with_its_beam_agrees_with_the_oracle() {
    let scene = build(Kind::DoorAjar);
    let gates = [(14.0, 15.0), (0.0, f64::INFINITY)];
    // Rooms with every feature test `bdpt` and `lcs` with beams.
    let tested = if is_long() { estimators(&scene) } else { vec![Estimator::Epc, Estimator::LcsPaper] };
    assert_none(against("door", &tested, &scene, &gates, &oracle(&scene, &gates, [32, 16], oracle_samples())));
}

#[test]
#[ignore = "takes ten seconds; a room with every feature is tested always"]
fn clutter_with_mirror_and_glass_agrees_with_the_oracle() {
    let scene = build(Kind::ClutteredRoom { triangles: 20_000 });
    assert_none(feature_against_oracle("clutter", &scene, &[(8.0, 9.0), (0.0, f64::INFINITY)], [32, 16]));
}

/// `devices --check` compares all estimators with stored means of these rooms.
#[test]
fn a_room_with_every_feature_agrees_with_the_oracle() {
    for (name, light, lo) in
        [("lamp", Light::Area, 5.0), ("punctual", Light::Punctual, 5.0), ("beam", Light::Beam, 6.5)]
    {
        let gates = [(lo, lo + 1.0), (0.0, f64::INFINITY)];
        let scene = zoo(light);
        let truth = oracle(&scene, &gates, [24, 16], oracle_samples());
        assert_none(against(name, &unlike_estimators(&scene), &scene, &gates, &truth));
    }
}

/// Compares means of whole images with the oracle, through the gate [`lo`, `lo` + 1 m) and without a gate.
pub fn whole_images(name: &str, scene: &Scene, lo: f64) {
    let gates = [(lo, lo + 1.0), (0.0, f64::INFINITY)];
    let truth = oracle(scene, &gates, [24, 16], 2_500);
    for (bin, &(lo, hi)) in gates.iter().enumerate() {
        let pixels = &truth.bins[bin];
        let error =
            pixels.iter().map(|p| p.variance.iter().sum::<f64>() / 3.0).sum::<f64>().sqrt() / pixels.len() as f64;
        let expected = truth.average(bin);
        for estimator in [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
            let s = settings(estimator, truth.resolution).max_depth(MAX_DEPTH).light_paths(20_000).build().unwrap();
            let (mean, spread) = Cells::measure(&mut renderer(scene, &s), gate(lo, hi), 24, 4, 16, 900).whole();
            let z = (mean - expected) / spread.hypot(error);
            println!(
                "{name} {estimator:?} [{lo}, {hi}): {mean:.6} +- {spread:.6}, oracle {expected:.6} +- {error:.6}, {:+.2} %, z = {z:.2}",
                100.0 * (mean / expected - 1.0)
            );
            assert!(z.abs() < threshold(24), "{name} {estimator:?} [{lo}, {hi}): z = {z:.2}");
            let wrong = (mean - 1.2 * expected) / spread.hypot(1.2 * error);
            assert!(wrong.abs() > threshold(24), "{name} {estimator:?} [{lo}, {hi}): 20 % more light is not rejected");
        }
    }
}

/// The long version, with smaller errors. `cargo test --release --test estimators -- --ignored --nocapture whole_images`
#[test]
#[ignore = "takes minutes"]
fn whole_images_agree_with_the_oracle() {
    for (name, light, lo) in
        [("lamp", Light::Area, 5.0), ("punctual", Light::Punctual, 5.0), ("beam", Light::Beam, 6.5)]
    {
        whole_images(name, &zoo(light), lo);
    }
}

#[test]
#[ignore = "takes a minute"]
fn whole_images_of_rough_glass_agree_with_the_oracle() {
    whole_images("rough glass", &rough_glass::scene(1.0), rough_glass::GATES[1].0);
}

/// Compares each set of strategies with all strategies of `bdpt`, in the Cornell box.
fn strategies_agree(sets: &[(Estimator, Strategies)]) {
    let scene = build(Kind::CornellBox);
    let cells = |estimator, strategies, seed| {
        let s = settings(estimator, [32, 32]).strategies(strategies).build().unwrap();
        Cells::measure(&mut renderer(&scene, &s), gate(9.0, 9.4), CELL, 1, 8, seed)
    };
    let all = cells(Estimator::Bdpt, Strategies::All, 1000);
    for &(estimator, strategies) in sets {
        let found = cells(estimator, strategies, 900);
        assert_none(disagreements(&all, &found));
        assert!(
            !disagreements(&all, &found.times(NOTICED)).is_empty(),
            "{estimator}: a brighter image is not rejected"
        );
    }
}

/// The paper's strategies (s >= 1, t >= 2) find all light of these images: no emitter is seen directly through this gate.
#[test]
#[ignore = "takes ten seconds; sums of strategies are tested always"]
fn the_papers_strategies_agree_with_all_strategies() {
    let all = [Estimator::LcsPaper, Estimator::Lcs, Estimator::Bdpt].map(|e| (e, Strategies::Paper));
    strategies_agree(if is_long() { &all } else { &all[..2] });
}

/// Compares `lcs-paper` and `lcs` with `bdpt`, all with all strategies.
/// `cargo test --release --test estimators -- --ignored --nocapture all_strategies_agree`
#[test]
#[ignore = "the oracle covers it"]
fn all_strategies_agree() {
    strategies_agree(&[Estimator::LcsPaper, Estimator::Lcs].map(|e| (e, Strategies::All)));
}

/// The images of abutting gates add up to the ungated image: with the same seed every path falls into exactly one gate.
#[test]
fn abutting_gates_partition_the_steady_image() {
    let scene = build(Kind::CornellBox);
    let edges = [0.0, 5.0, 6.0, 6.7, 7.4, 9.0, 12.0, f64::INFINITY];
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        let mut r = renderer(&scene, &settings(estimator, [32, 32]).build().unwrap());
        let mut image = |gate: Gate| {
            r.restart(3, gate).unwrap();
            r.iterate(4).unwrap_or_else(|e| panic!("{e}"));
            r.film().mean()
        };
        let steady = image(Gate::OPEN);
        let mut sum = vec![0.0f64; steady.len()];
        for pair in edges.windows(2) {
            for (s, x) in sum.iter_mut().zip(image(gate(pair[0], pair[1]))) {
                *s += f64::from(x);
            }
        }
        for (i, (s, x)) in sum.iter().zip(&steady).enumerate() {
            assert!(
                (s - f64::from(*x)).abs() <= 1e-5 * f64::from(*x).abs().max(1e-3),
                "{estimator:?}, channel {i}: {s} against {x}"
            );
        }
    }
}
