//! Scenes with more lamps than the estimators connect one by one. Queries or random draws then choose among the lamps, and the
//! image must stay the sum over all lamps.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material, metal, plastic};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{LightKind, Scene};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Emitters, Estimator, Settings};

use super::agreement::{NOTICED, assert_none, feature_estimators, oracle, oracle_samples, settings_against};
use super::cells::{Cells, exceeds, is_long, renderer, settings, threshold};

const ALBEDO: f32 = 0.5;

/// The gated sphere with its point light replaced by `count` point lights at the same position, of unequal power and the same
/// total.
pub fn sphere_of(count: usize, subdivisions: u32) -> Scene {
    let mut scene = build(Kind::GatedSphere { radius: 1.0, subdivisions, albedo: ALBEDO });
    let whole = scene.lights.remove(0);
    let LightKind::Point { intensity } = whole.kind else { panic!("the sphere's light is a point") };
    let mut pcg = Pcg::new(5);
    let shares: Vec<f64> = (0..count).map(|_| pcg.uniform().powi(4) + 1e-3).collect();
    let sum: f64 = shares.iter().sum();
    for (n, share) in shares.iter().enumerate() {
        let kind = LightKind::Point { intensity: intensity.map(|i| (f64::from(i) * share / sum) as f32) };
        light(&mut scene, &format!("point {n}"), whole.position, whole.direction, kind);
    }
    scene
}

/// z-scores of the mean images with `count` point lights in the gates [2 + a, 2 + b), against `times` the closed form.
fn z_of_sphere(count: usize, estimator: Estimator, gates: &[[f64; 2]], times: f64) -> Vec<f64> {
    // `epc` searches all triangles for each connection, so its sphere has fewer.
    let subdivisions = if estimator == Estimator::Epc { 4 } else { 6 };
    let scene = sphere_of(count, subdivisions);
    let mut renderer = renderer(&scene, &settings(estimator, [12, 12]).build().unwrap());
    let mut z = |&[a, b]: &[f64; 2]| {
        let gate = Gate { lo: 2.0 + a, hi: 2.0 + b };
        let truth = times * gated_radiance(1.0, f64::from(ALBEDO), gate.lo, gate.hi);
        let (mean, error) = Cells::measure(&mut renderer, gate, 12, 1, 8, 100).whole();
        eprintln!("{count} lamps, {estimator} [{a}, {b}): {mean:.6} +- {error:.6}, closed form {truth:.6}");
        (mean - truth) / error
    };
    gates.iter().map(&mut z).collect()
}

const COUNTS: [usize; 2] = [9, 100];
/// Gates around the direct return, the next bounce, and later bounces.
const GATES: [[f64; 2]; 3] = [[-0.05, 0.25], [0.5, 1.0], [2.0, 3.0]];

#[test]
fn many_points_in_one_place_agree_with_the_closed_form() {
    let cases = COUNTS.len() * Estimator::ALL.len() * GATES.len();
    // Estimators draw 9 lamps in the same way as 100, and `pt` and `epc` in the same way as `bdpt`. Long runs test all of them.
    let counts = if is_long() { &COUNTS[..] } else { &COUNTS[1..] };
    let drawn_alike = |estimator| [Estimator::Pt, Estimator::Epc].contains(&estimator);
    for (&count, estimator) in counts.iter().flat_map(|n| Estimator::ALL.map(|e| (n, e))) {
        if drawn_alike(estimator) && !is_long() {
            continue;
        }
        for (gate, z) in GATES.iter().zip(z_of_sphere(count, estimator, &GATES, 1.0)) {
            assert!(z.abs() < threshold(cases), "{count} lamps, {estimator}, gate {gate:?}: z = {z:.2}");
        }
    }
}

/// Negative control: a truth that is off by 3 %, as if the probabilities of the lamps were wrong.
#[test]
#[ignore = "takes five seconds; the tests whose sensitivity it shows run always"]
fn probabilities_off_by_three_percent_are_rejected() {
    for &estimator in if is_long() { &Estimator::ALL[..] } else { &[Estimator::Bdpt, Estimator::Lcs] } {
        let z = z_of_sphere(20, estimator, &GATES[1..2], 1.03)[0];
        assert!(z.abs() > threshold(1), "{estimator}: z = {z:.2} against a wrong truth");
    }
}

/// A room with `lamps` lamps: spots, thin beams and points in turn. A mirror reflects some of the beams.
fn room(lamps: usize) -> Scene {
    let mut scene = Scene::default();
    let wall = material(&mut scene, diffuse("wall", [0.7, 0.65, 0.6]));
    let floor = material(&mut scene, plastic("floor", [0.4, 0.5, 0.4], 0.5));
    let mirror = material(&mut scene, metal("mirror", [0.9; 3], 0.0));
    let (x, y, z) = (DVec3::X * 4.0, DVec3::Y * 3.0, DVec3::Z * 4.0);
    let corner = DVec3::new(-2.0, 0.0, -2.0);
    add(&mut scene, "floor", floor, quad(corner, z, x, [1.0; 2]));
    add(&mut scene, "ceiling", wall, quad(corner + y, x, z, [1.0; 2]));
    add(&mut scene, "back", wall, quad(corner, x, y, [1.0; 2]));
    add(&mut scene, "front", wall, quad(corner + z, y, x, [1.0; 2]));
    add(&mut scene, "left", wall, quad(corner, y, z, [1.0; 2]));
    add(&mut scene, "right", wall, quad(corner + x, z, y, [1.0; 2]));
    add(&mut scene, "block", wall, cuboid(DVec3::new(-0.9, 0.001, -0.9), DVec3::new(-0.3, 1.1, -0.2)));
    add(&mut scene, "mirror", mirror, quad(DVec3::new(0.2, 0.4, -1.9), DVec3::X * 1.4, DVec3::Y * 1.4, [1.0; 2]));
    let mut pcg = Pcg::new(11);
    for n in 0..lamps {
        let position = DVec3::new(pcg.range(-1.8, 1.8), pcg.range(2.0, 2.9), pcg.range(-1.7, 1.8));
        let direction = DVec3::new(pcg.range(-0.9, 0.9), -1.0, pcg.range(-1.2, 0.6));
        let watts = (0.05 + 4.0 * pcg.uniform().powi(3)) as f32;
        let kind = match n % 3 {
            0 => LightKind::Spot { intensity: [2.0 * watts, watts, watts], inner: 0.2, outer: 0.6 },
            1 => LightKind::Beam { power: [watts, watts, 2.0 * watts], radius: 0.0 },
            _ => LightKind::Point { intensity: [0.2 * watts; 3] },
        };
        light(&mut scene, &format!("lamp {n}"), position, direction, kind);
    }
    camera(&mut scene, DVec3::new(0.4, 1.6, 1.8), DVec3::new(-0.1, 0.9, -0.8), 1.1, [24, 16]);
    scene
}

fn room_settings(estimator: Estimator) -> Settings {
    settings(estimator, [24, 16]).max_depth(6).build().unwrap()
}

/// Mean and variance of the room's cells, as the sum of `bdpt` images of groups of lamps. A group is so small that `bdpt`
/// connects its lamps one by one.
fn sum_over_groups(lamps: usize, gate: Gate) -> Vec<(f64, f64)> {
    let scene = room(lamps);
    let mut sums = vec![];
    for (n, first) in (0..lamps).step_by(6).enumerate() {
        let group = (first..lamps.min(first + 6)).map(|n| format!("lamp {n}")).collect();
        let s = room_settings(Estimator::Bdpt).change().emitters(Emitters::Nodes(group)).build().unwrap();
        // Random numbers do not depend on the lamps, so groups that share seeds would not be independent.
        let cells = Cells::measure(&mut renderer(&scene, &s), gate, 8, 1, 8, 1000 + 100 * n as u32);
        sums.resize(cells.batches.len(), (0.0, 0.0));
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = (sum.0 + cells.mean(i), sum.1 + cells.variance(i));
        }
    }
    sums
}

/// Largest |z| among the cells of a render with all lamps, against `truth`.
fn max_z(lamps: usize, settings: &Settings, gate: Gate, truth: &[(f64, f64)]) -> f64 {
    let cells = Cells::measure(&mut renderer(&room(lamps), settings), gate, 8, 1, 8, 900);
    let z = |i: usize| (cells.mean(i) - truth[i].0) / (cells.variance(i) + truth[i].1).sqrt();
    assert!((0..truth.len()).all(|i| z(i).is_finite()), "{:?} against {truth:?}", cells.averages());
    let greatest = (0..truth.len()).map(|i| z(i).abs()).fold(0.0, f64::max);
    let whole = truth.iter().map(|t| t.0).sum::<f64>() / truth.len() as f64;
    eprintln!(
        "{lamps} lamps, {} in {gate:?}: {:.6}, sum {whole:.6}, |z| <= {greatest:.2}",
        settings.estimator(),
        cells.whole().0
    );
    greatest
}

/// Settings of the estimators that can render beams, except `epc`. `lcs` has one tree, then two.
fn settings_under_test() -> [Settings; 4] {
    let [bdpt, paper, lcs] = [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs].map(room_settings);
    let two = lcs.change().single_tree(false).build().unwrap();
    [bdpt, paper, lcs, two]
}

/// `cargo test --release --test estimators -- --ignored many_lamps`
#[test]
#[ignore = "takes ten seconds; dots of a projector are tested always"]
fn the_image_by_many_lamps_is_the_sum_of_images_by_few() {
    for (lamps, gate) in [(9, Gate::OPEN), (27, Gate { lo: 5.0, hi: 5.6 })] {
        let truth = sum_over_groups(lamps, gate);
        for settings in settings_under_test() {
            let z = max_z(lamps, &settings, gate, &truth);
            assert!(z < threshold(8 * truth.len()), "{lamps} lamps, {}, {gate:?}: |z| = {z:.2}", settings.estimator());
        }
    }
}

/// Negative control: the sum lacks one lamp.
#[test]
#[ignore = "the negative control of a long test"]
fn one_lamp_more_is_noticed() {
    let gate = Gate { lo: 5.0, hi: 5.6 };
    let truth = sum_over_groups(26, gate);
    for settings in settings_under_test() {
        let z = max_z(27, &settings, gate, &truth);
        assert!(z > threshold(truth.len()), "{}: |z| = {z:.2} against a wrong truth", settings.estimator());
    }
}

#[test]
fn a_hundred_spot_lights_agree_with_the_oracle() {
    let scene = build(Kind::HundredLamps);
    let gates = [(11.0, 12.0), (0.0, f64::INFINITY)];
    let truth = oracle(&scene, &gates, [24, 16], oracle_samples());
    for estimator in feature_estimators(&scene) {
        let settings = settings(estimator, truth.resolution);
        assert_none(settings_against("hundred lamps", settings, &scene, &gates, &truth, 1.3));
    }
}

/// Relative variance of a cell in a render of the hall with a hundred lamps, averaged over all cells.
fn relative_variance(estimator: Estimator, gate: Gate) -> f64 {
    let mut renderer = renderer(&build(Kind::HundredLamps), &room_settings(estimator));
    let cells = Cells::measure(&mut renderer, gate, 2, 1, 8, 700);
    let count = cells.batches.len();
    let floor = 0.01 * (0..count).map(|i| cells.mean(i)).sum::<f64>() / count as f64;
    (0..count).map(|i| cells.variance(i) / cells.mean(i).hypot(floor).powi(2)).sum::<f64>() / count as f64
}

/// Among a hundred spot lights, queries find those that light a shade point through the gate. With the same number of samples,
/// the variance of `lcs` is at most a fifth of that of `bdpt`.
#[test]
fn queries_find_the_lamps_that_count() {
    for gate in [Gate::OPEN, Gate { lo: 12.0, hi: 12.5 }] {
        let [bdpt, lcs] = [Estimator::Bdpt, Estimator::Lcs].map(|estimator| relative_variance(estimator, gate));
        eprintln!("{gate:?}: bdpt {bdpt:.3e}, lcs {lcs:.3e}, {:.1} times", bdpt / lcs);
        assert!(lcs * 5.0 < bdpt, "{gate:?}: variance {lcs} of lcs, {bdpt} of bdpt");
    }
}

/// A hundred beams of zero radius: each lights one point, and queries find the points near a shade point.
#[test]
fn a_projector_of_dots_agrees_with_the_sum_of_its_parts() {
    let mut scene = room(0);
    for n in 0..100 {
        let (column, row) = (f64::from(n % 10), f64::from(n / 10));
        let direction = DVec3::new(0.12 * column - 0.5, 0.08 * row - 0.6, -1.0);
        let kind = LightKind::Beam { power: [0.02 * f64::from(n + 1) as f32; 3], radius: 0.0 };
        light(&mut scene, &format!("dot {n}"), DVec3::new(0.0, 1.6, 1.9), direction, kind);
    }
    let gate = Gate { lo: 7.0, hi: 7.5 };
    let cells = |settings: &Settings, seed: u32| Cells::measure(&mut renderer(&scene, settings), gate, 8, 1, 8, seed);
    let mut sums = [(0.0, 0.0); 6];
    for (n, first) in (0..100).step_by(5).enumerate() {
        let group = (first..first + 5).map(|n| format!("dot {n}")).collect();
        let settings = room_settings(Estimator::Bdpt).change().emitters(Emitters::Nodes(group)).build().unwrap();
        let part = cells(&settings, 1000 + 100 * n as u32);
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = (sum.0 + part.mean(i), sum.1 + part.variance(i));
        }
    }
    for settings in settings_under_test() {
        let all = cells(&settings, 400);
        let estimator = settings.estimator();
        let lit = || sums.iter().enumerate().filter(|(_, sum)| sum.0 > 0.0);
        let z = |i: usize, factor: f64| {
            (all.mean(i) - factor * sums[i].0) / (all.variance(i) + factor.powi(2) * sums[i].1).sqrt()
        };
        for (i, (mean, _)) in lit() {
            let (found, z) = (all.mean(i), z(i, 1.0));
            assert!(!exceeds(z, threshold(24)), "{estimator}, cell {i}: {found:.6} against {mean:.6}, z = {z:.2}");
        }
        assert!(lit().any(|(i, _)| exceeds(z(i, NOTICED), threshold(24))), "{estimator}: more light is not rejected");
    }
}
