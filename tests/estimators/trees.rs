//! The expected image depends neither on the trees (one or two, leaf size) nor on the importance by which queries sample.

use super::cells::{Cells, disagreements, is_long, renderer, settings, threshold};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::Scene;
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Importance, Settings};

const ALBEDO: f64 = 0.5;

/// The gated sphere without its point light; the wall emits radiance 1 instead. Emitter points and scattered light vertices lie
/// on the same wall, so a single tree mixes both in every node.
fn glowing_sphere() -> Scene {
    let mut scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: ALBEDO as f32 });
    scene.lights.clear();
    for wall in &mut scene.materials {
        (wall.emission, wall.double_sided) = ([1.0; 3], false);
    }
    scene
}

/// Radiance at the centre in [1 + a, 1 + b): the sum over n >= 0 of rho^n F_n. For the point light it is the sum over n >= 1 of
/// rho^n F_(n - 1), one radius later.
fn truth(a: f64, b: f64) -> f64 {
    gated_radiance(1.0, ALBEDO, 2.0 + a, 2.0 + b) / ALBEDO
}

/// z-score of the mean image in the gate [1 + a, 1 + b), against the closed form of this gate with its ends times `stretch`.
fn z(scene: &Scene, settings: &Settings, [a, b]: [f64; 2], stretch: f64) -> f64 {
    let gate = Gate { lo: 1.0 + a, hi: 1.0 + b };
    let (mean, error) = Cells::measure(&mut renderer(scene, settings), gate, 12, 1, 8, 300).whole();
    let expected = truth(gate.lo * stretch - 1.0, gate.hi * stretch - 1.0);
    eprintln!("{} [{a}, {b}): {mean:.6} +- {error:.6}, closed form {expected:.6}", settings.estimator());
    (mean - expected) / error
}

fn single(estimator: Estimator, resolution: [u32; 2]) -> Settings {
    settings(estimator, resolution).single_tree(true).build().unwrap()
}

const TREES: [Estimator; 2] = [Estimator::LcsPaper, Estimator::Lcs];
/// Before the first scattered light arrives, while emitter points and scattered vertices both contribute, and long after.
const GATES: [[f64; 2]; 3] = [[0.5, 1.0], [1.5, 1.7], [3.0, 4.0]];

#[test]
fn a_single_tree_agrees_with_the_closed_form() {
    let scene = glowing_sphere();
    for estimator in TREES {
        for gate in GATES {
            let z = z(&scene, &single(estimator, [12, 12]), gate, 1.0);
            assert!(z.abs() < threshold(2 * GATES.len()), "{estimator} {gate:?}: z = {z:.2}");
        }
    }
}

/// Negative control: a gate that is off by 2 %.
#[test]
#[ignore = "takes ten seconds; the negative controls of two trees are tested always"]
fn a_gate_off_by_two_percent_is_rejected_with_a_single_tree() {
    let scene = glowing_sphere();
    for estimator in TREES {
        let z = z(&scene, &single(estimator, [12, 12]), GATES[1], 1.02);
        assert!(z.abs() > threshold(1), "{estimator}: z = {z:.2} against a wrong truth");
    }
}

#[test]
fn leaves_and_frontiers_of_any_size_agree_with_the_closed_form() {
    let scene = glowing_sphere();
    let sizes =
        [(Estimator::LcsPaper, 16, 32), (Estimator::Lcs, 1, 32), (Estimator::Lcs, 8, 5), (Estimator::Lcs, 16, 1)];
    for (estimator, leaf_size, frontier) in sizes {
        let z = z(
            &scene,
            &settings(estimator, [12, 12]).leaf_size(leaf_size).frontier(frontier).build().unwrap(),
            GATES[1],
            1.0,
        );
        assert!(
            z.abs() < threshold(sizes.len()),
            "{estimator}, leaves of {leaf_size}, frontiers of {frontier}: z = {z:.2}"
        );
    }
}

/// `cargo test --release --test estimators -- --ignored a_single_tree`
#[test]
#[ignore = "takes ten seconds; the closed form is tested always"]
fn a_single_tree_agrees_with_two() {
    let scene = build(Kind::CornellBox);
    let measure = |settings: Settings, lo: f64| {
        let s = settings.change().max_depth(10).build().unwrap();
        Cells::measure(
            &mut renderer(&scene, &s),
            Gate { lo, hi: lo + 0.3 },
            8,
            1,
            8,
            if s.single_tree() { 40 } else { 80 },
        )
    };
    for estimator in TREES {
        let two = measure(settings(estimator, [24, 24]).build().unwrap(), 8.0);
        let wrong = disagreements(&two, &measure(single(estimator, [24, 24]), 8.0));
        assert!(wrong.is_empty(), "{estimator}:\n{}", wrong.join("\n"));
        let shifted = measure(single(estimator, [24, 24]), 8.3);
        assert!(!disagreements(&two, &shifted).is_empty(), "{estimator}: another gate looks the same");
    }
}

/// All combinations of `centre`, `cosine` and `overlap`, except all three together: the other tests use all factors. `gloss` is
/// off, because the sphere has no glossy surface.
fn combinations() -> Vec<Importance> {
    let bit = |n: u32, k: u32| n >> k & 1 == 1;
    (0..7).map(|n| Importance { centre: bit(n, 0), cosine: bit(n, 1), overlap: bit(n, 2), gloss: false }).collect()
}

fn settings_with(importance: Importance, resolution: [u32; 2]) -> Settings {
    settings(Estimator::Lcs, resolution).importance(importance).build().unwrap()
}

#[test]
#[ignore = "takes ten seconds; leaves and frontiers of any size are tested always"]
fn any_importance_agrees_with_the_closed_form() {
    let scene = glowing_sphere();
    let all = combinations();
    for &importance in if is_long() { &all[..] } else { &all[..2] } {
        let z = z(&scene, &settings_with(importance, [12, 12]), GATES[1], 1.0);
        assert!(z.abs() < threshold(all.len()), "{importance}: z = {z:.2}");
    }
    let late = z(&scene, &settings_with(Importance::NONE, [12, 12]), GATES[1], 1.02);
    assert!(late.abs() > threshold(1), "a gate that is off by 2 % passes with z = {late:.2}");
}

/// `cargo test --release --test estimators -- --ignored any_importance`
#[test]
#[ignore = "takes ten seconds; leaves and frontiers of any size are tested always"]
fn any_importance_agrees_with_all_factors() {
    let scene = build(Kind::CornellBox);
    let measure = |importance: Importance, lo: f64, seed: u32| {
        let s = settings_with(importance, [24, 24]).change().max_depth(10).build().unwrap();
        Cells::measure(&mut renderer(&scene, &s), Gate { lo, hi: lo + 0.3 }, 8, 1, 8, seed)
    };
    let all = measure(Importance::ALL, 8.0, 40);
    // First no switch, then only gloss. Long runs also test each of the other switches alone.
    let gloss = Importance { gloss: true, ..Importance::NONE };
    let variants = [combinations()[0], gloss, combinations()[1], combinations()[2], combinations()[4]];
    for &importance in if is_long() { &variants[..] } else { &variants[..2] } {
        let wrong = disagreements(&all, &measure(importance, 8.0, 80));
        assert!(wrong.is_empty(), "{importance}:\n{}", wrong.join("\n"));
    }
    assert!(!disagreements(&all, &measure(Importance::NONE, 8.3, 80)).is_empty(), "another gate looks the same");
}
