//! Phase functions on the device (`shared/phase.wgsl`).

use std::f64::consts::TAU;

use crate::scene::PhaseFunction;
use crate::wgsl::layout::Medium;
use crate::wgsl::layout::constants::{PHASE_DRAINE, PHASE_LOBES, PHASE_RAYLEIGH, PHASE_TABLE};

/// A node of a table: cosine, density per steradian, share of the light that is scattered to smaller cosines, and padding.
pub type Node = [f32; 4];

/// Sets the fields of `medium` that describe its phase function. The nodes of a table are appended to `tables`.
pub fn set(phase: &PhaseFunction, medium: &mut Medium, tables: &mut Vec<Node>) {
    let (kind, [g, g2], share, alpha) = match *phase {
        PhaseFunction::Isotropic => (PHASE_LOBES, [0.0; 2], 0.0, 0.0),
        PhaseFunction::HenyeyGreenstein { g } => (PHASE_LOBES, [g, g], 0.0, 0.0),
        PhaseFunction::DoubleHenyeyGreenstein { g, weight } => (PHASE_LOBES, g, 1.0 - weight, 0.0),
        PhaseFunction::Rayleigh => (PHASE_RAYLEIGH, [0.0; 2], 0.0, 0.0),
        PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine } => {
            (PHASE_DRAINE, [g, g_draine], weight_draine, alpha)
        }
        PhaseFunction::Table { .. } => (PHASE_TABLE, [0.0; 2], 0.0, 0.0),
    };
    medium.phase = kind;
    (medium.g, medium.g2) = (g as f32, g2 as f32);
    (medium.share, medium.alpha) = (share as f32, alpha as f32);
    medium.mean_cosine = mean_cosine(phase) as f32;
    if let PhaseFunction::Table { cosines, values } = phase {
        (medium.table, medium.table_size) = (tables.len() as u32, cosines.len() as u32);
        tables.extend(nodes(cosines, values));
    }
}

/// The nodes of a table. The integral of the density over the sphere is 1.
pub fn nodes(cosines: &[f64], values: &[f64]) -> Vec<Node> {
    // Integrals over the intervals, for the cosines rounded to f32 as on the device.
    let cosines: Vec<f64> = cosines.iter().map(|&cosine| f64::from(cosine as f32)).collect();
    let greatest = values.iter().copied().fold(0.0, f64::max);
    let values: Vec<f64> = values.iter().map(|value| value / greatest).collect();
    let areas = cosines.windows(2).zip(values.windows(2)).map(|(c, v)| (c[1] - c[0]) * (v[0] + v[1]) / 2.0);
    let shares = areas.scan(0.0, |sum, area| {
        *sum += area;
        Some(*sum)
    });
    let shares: Vec<f64> = [0.0].into_iter().chain(shares).collect();
    let total = shares[shares.len() - 1];
    let node = |((cosine, value), share): ((f64, f64), f64)| {
        [cosine as f32, (value / (TAU * total)) as f32, (share / total) as f32, 0.0]
    };
    cosines.into_iter().zip(values).zip(shares).map(node).collect()
}

/// Mean cosine of the scattering angle.
pub fn mean_cosine(phase: &PhaseFunction) -> f64 {
    match phase {
        PhaseFunction::Isotropic | PhaseFunction::Rayleigh => 0.0,
        PhaseFunction::HenyeyGreenstein { g } => *g,
        PhaseFunction::DoubleHenyeyGreenstein { g, weight } => weight * g[0] + (1.0 - weight) * g[1],
        PhaseFunction::HenyeyGreensteinDraine { g, g_draine: d, alpha, weight_draine } => {
            // Jendersie and d'Eon 2023, equation 8.
            let draine = d * (1.0 + alpha * (3.0 + 2.0 * d * d) / 5.0) / (1.0 + alpha * (1.0 + 2.0 * d * d) / 3.0);
            (1.0 - weight_draine) * g + weight_draine * draine
        }
        PhaseFunction::Table { cosines, values } => {
            // The integral of cosine times value, divided by the integral of the value; both are linear in each interval.
            let greatest = values.iter().copied().fold(0.0, f64::max);
            let integral = |product: fn([f64; 2], [f64; 2]) -> f64| -> f64 {
                let intervals = cosines.windows(2).zip(values.windows(2));
                intervals.map(|(c, v)| (c[1] - c[0]) * product([c[0], c[1]], [v[0] / greatest, v[1] / greatest])).sum()
            };
            integral(|c, v| (2.0 * c[0] * v[0] + 2.0 * c[1] * v[1] + c[0] * v[1] + c[1] * v[0]) / 6.0)
                / integral(|_, v| (v[0] + v[1]) / 2.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shares_of_a_table_end_at_one() {
        let found = nodes(&[-1.0, 0.0, 1.0], &[1e300, 0.0, 1e300]);
        assert_eq!(found.iter().map(|node| node[2]).collect::<Vec<_>>(), [0.0, 0.5, 1.0]);
        assert!((f64::from(found[0][1]) * TAU - 1.0).abs() < 1e-6);
    }
}
