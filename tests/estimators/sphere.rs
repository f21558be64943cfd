//! The gated integrating sphere, whose radiance in any gate is known in closed form (`oracle::sphere`).

use super::cells::{Cells, is_long, renderer, settings, threshold};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

const ALBEDO: f32 = 0.5;
/// Gates relative to the direct return at 2 R, in units of R. The first gate holds the direct return.
const GATES: [(f64, f64); 9] =
    [(-0.05, 0.25), (0.25, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 6.0), (6.0, 8.0)];
const CONTROL: (f64, f64) = GATES[3];
/// The gates of tests that would take long with all of them.
const CHOSEN: [(f64, f64); 4] = [GATES[0], GATES[1], CONTROL, GATES[6]];

fn sphere(radius: f32, estimator: Estimator) -> Renderer {
    let scene = build(Kind::GatedSphere { radius, subdivisions: 6, albedo: ALBEDO });
    renderer(&scene, &settings(estimator, [16, 16]).build().unwrap())
}

/// z-scores of the mean image in a gate against the closed form of this gate, and of the gate times 1.02.
fn z_scores(renderer: &mut Renderer, radius: f32, (a, b): (f64, f64)) -> [f64; 2] {
    let r = f64::from(radius);
    let (lo, hi) = (2.0 * r + a * r, 2.0 * r + b * r);
    let (mean, error) = Cells::measure(renderer, Gate { lo, hi }, 16, 1, 8, 100).whole();
    [1.0, 1.02].map(|stretch| {
        let truth = gated_radiance(r, f64::from(ALBEDO), lo * stretch, hi * stretch);
        eprintln!("R {r}: [{a}, {b}) {mean:.6} +- {error:.6}, closed form {truth:.6}");
        (mean - truth) / error
    })
}

/// Compares each gate with the closed form. Negative control: a truth that is off by 2 % is rejected in the gate [`CONTROL`].
fn agrees(radius: f32, estimator: Estimator, gates: &[(f64, f64)]) {
    let mut renderer = sphere(radius, estimator);
    for &gate in gates {
        let [z, wrong] = z_scores(&mut renderer, radius, gate);
        assert!(z.abs() < threshold(GATES.len()), "{estimator:?}, R {radius}, gate {gate:?}: z = {z:.2}");
        assert!(gate != CONTROL || wrong.abs() > threshold(1), "{estimator:?}: z = {wrong:.2} against a wrong truth");
    }
}

#[test]
fn path_tracing_agrees_with_the_closed_form() {
    agrees(1.0, Estimator::Pt, &GATES);
}

#[test]
fn bidirectional_path_tracing_agrees_with_the_closed_form() {
    agrees(1.0, Estimator::Bdpt, &GATES);
}

#[test]
fn light_cone_shell_queries_agree_with_the_closed_form() {
    agrees(1.0, Estimator::LcsPaper, if is_long() { &GATES } else { &CHOSEN });
}

#[test]
fn resampled_queries_agree_with_the_closed_form() {
    agrees(1.0, Estimator::Lcs, if is_long() { &GATES } else { &CHOSEN });
}

#[test]
#[ignore = "takes five seconds; `stress` tests large scenes with two other estimators always"]
fn a_sphere_of_a_hundred_metres_agrees_with_the_closed_form() {
    // `ellipsoids` has a sphere with fewer triangles for `epc`.
    let all = [Estimator::Lcs, Estimator::Bdpt, Estimator::LcsPaper, Estimator::Pt];
    for &estimator in if is_long() { &all[..] } else { &all[..1] } {
        agrees(100.0, estimator, &[GATES[0], GATES[3], GATES[6]]);
    }
}

/// The long version: bias below 0.5 % in every gate. `cargo test --release --test estimators -- --ignored --nocapture bias`
fn bias_is_small(estimator: Estimator) {
    let scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 6, albedo: ALBEDO });
    let s = settings(estimator, [64, 64]).light_paths(20_000).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    for (a, b) in GATES {
        let gate = Gate { lo: 2.0 + a, hi: 2.0 + b };
        let truth = gated_radiance(1.0, f64::from(ALBEDO), gate.lo, gate.hi);
        let (mean, error) = Cells::measure(&mut renderer, gate, 64, 2, 16, 100).whole();
        let bias = mean / truth - 1.0;
        println!(
            "{estimator:?} [{a}, {b}): {mean:.6} +- {error:.6}, closed form {truth:.6}, bias {:+.3} %",
            100.0 * bias
        );
        assert!(bias.abs() < 0.005, "{estimator:?}, gate [{a}, {b}): {mean} against {truth}");
    }
}

#[test]
#[ignore = "takes minutes"]
fn bias_of_path_tracing_is_small() {
    bias_is_small(Estimator::Pt);
}

#[test]
#[ignore = "takes minutes"]
fn bias_of_bidirectional_path_tracing_is_small() {
    bias_is_small(Estimator::Bdpt);
}

#[test]
#[ignore = "takes minutes"]
fn bias_of_light_cone_shell_queries_is_small() {
    bias_is_small(Estimator::LcsPaper);
}

#[test]
#[ignore = "takes minutes"]
fn bias_of_resampled_queries_is_small() {
    bias_is_small(Estimator::Lcs);
}
