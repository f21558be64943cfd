//! The distribution for drawing deterministic vertices in estimators without trees. If there are too many vertices to connect
//! each shade point to all of them, each shade point draws some.

use crate::wgsl::layout::PathVertex;

/// Fraction of the probability that is uniform, without regard to power: a weak lamp may be the only one that lights a shade
/// point.
const UNIFORM_FRACTION: f64 = 0.5;

/// Sets `selection_cdf` of every vertex to the start of its interval in the cumulative distribution, scaled by 2^32, that
/// `slots.wgsl: draw_deterministic` samples. Every interval has a probability of at least 2^-32.
pub fn set_selection_cdf(vertices: &mut [PathVertex]) {
    let shared = 2f64.powi(32) - vertices.len() as f64;
    let power = |v: &PathVertex| f64::from(v.throughput.iter().fold(0.0f32, |a, &x| a.max(x)));
    let total: f64 = vertices.iter().map(power).sum();
    let even = UNIFORM_FRACTION / vertices.len() as f64;
    let mut before = 0.0;
    for (i, v) in vertices.iter_mut().enumerate() {
        v.selection_cdf = (shared * before) as u32 + i as u32;
        before += even + (1.0 - UNIFORM_FRACTION) * power(v) / total;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cdf_is_half_uniform_and_half_by_power() {
        let powers = [1.0f32, 0.0, 3.0, 1e-9, 4.0];
        let vertex = |&p: &f32| PathVertex { throughput: [0.5 * p, p, 0.0], ..bytemuck::Zeroable::zeroed() };
        let mut vertices: Vec<PathVertex> = powers.iter().map(vertex).collect();
        set_selection_cdf(&mut vertices);
        assert_eq!(vertices[0].selection_cdf, 0);
        let next = |i: usize| vertices.get(i + 1).map_or(2f64.powi(32), |v| f64::from(v.selection_cdf));
        for (i, power) in powers.iter().enumerate() {
            let share = (next(i) - f64::from(vertices[i].selection_cdf)) / 2f64.powi(32);
            assert!((share - (0.1 + 0.5 * f64::from(*power) / 8.0)).abs() < 1e-8, "vertex {i}: {share}");
        }
    }

    #[test]
    fn the_weakest_of_a_million_is_drawn() {
        let mut vertices = vec![PathVertex { throughput: [1e-30; 3], ..bytemuck::Zeroable::zeroed() }; 1 << 20];
        vertices[0].throughput = [1e30; 3];
        set_selection_cdf(&mut vertices);
        assert!(vertices.windows(2).all(|pair| pair[0].selection_cdf < pair[1].selection_cdf));
    }
}
