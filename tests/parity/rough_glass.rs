//! Rough glass: the oracle samples facets, and the device evaluates the lobe of Walter et al. 2007. The test compares both in
//! f64.

use std::f64::consts::TAU;

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;

use crate::materials::{Reference, set};
use crate::values::polar;

/// Integrates the lobe over a grid of directions. Returns the reflected power, the reflected power weighted with (1 + x) / 2,
/// and the same two for the transmitted power. x is the first coordinate of the direction.
fn by_lobe(reference: &Reference, wo: DVec3, front: bool) -> [f64; 4] {
    const STEPS: [usize; 2] = [800, 400];
    let mut sums = [0.0; 4];
    for i in 0..STEPS[0] * STEPS[1] {
        let (row, column) = (i / STEPS[1], i % STEPS[1]);
        let cos = 2.0 * (row as f64 + 0.5) / STEPS[0] as f64 - 1.0;
        let w = polar(cos.abs(), TAU * (column as f64 + 0.5) / STEPS[1] as f64);
        let wi = DVec3::new(w.x, w.y, cos);
        // f is for radiance. Without the squared ratio of the indices it is for power.
        let squeeze = (reference.index(wi, front) / reference.index(wo, front)).powi(2);
        let power = reference.f(wi, wo, front)[0] * cos.abs() * squeeze * 2.0 * TAU / (STEPS[0] * STEPS[1]) as f64;
        let side = if cos > 0.0 { 0 } else { 2 };
        sums[side] += power;
        sums[side + 1] += power * (1.0 + wi.x) / 2.0;
    }
    sums
}

#[test]
fn facets_and_lobe_send_the_same_light_to_the_same_sides() {
    let mut pcg = Pcg::new(5);
    for alpha in [0.3, 1.0] {
        let material = set().named("rough glass", alpha);
        for (cos, front) in [(0.95, true), (0.95, false), (0.5, true), (0.5, false), (0.2, true)] {
            let wo = polar(cos, 0.0);
            let bsdf = set().prepared[material].at([1.0; 3]);
            let n = 400_000;
            let (mut sums, mut squares) = ([0.0; 4], [0.0; 4]);
            for _ in 0..n {
                let u = [pcg.uniform(), pcg.uniform(), pcg.uniform()];
                let Some(sample) = bsdf.sample(wo, !front, u) else { continue };
                let side = if sample.refracted { 2 } else { 0 };
                for (k, value) in [(0, 1.0), (1, (1.0 + sample.wi.x) / 2.0)] {
                    sums[side + k] += sample.weight[0] * value / f64::from(n);
                    squares[side + k] += (sample.weight[0] * value).powi(2) / f64::from(n);
                }
            }
            let expected = by_lobe(&set().at(material, [1.0; 3]), wo, front);
            for k in 0..4 {
                let error = ((squares[k] - sums[k] * sums[k]) / f64::from(n)).sqrt();
                let off = (sums[k] - expected[k]).abs();
                let case = format!("alpha {alpha}, cos {cos}, front {front}, {k}: {}, lobe {}", sums[k], expected[k]);
                assert!(off < 4.5 * error + 2e-3 * expected[k], "{case} +- {error}");
                // An error of 10 % must fail.
                let wrong = (sums[k] - 1.1 * expected[k]).abs();
                assert!(wrong > 4.5 * error + 2e-3 * expected[k], "{case}: too noisy to detect an error of 10 %");
            }
        }
    }
}
