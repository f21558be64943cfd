//! The alias table that light subpaths use to choose their emitter (Vose 1991).

use crate::wgsl::layout::Emitter;

/// Sets `keep` and `other` of every entry, so that entry i is chosen with probability `weights[i] / total`. `total` is the
/// sum of the weights.
pub fn fill(table: &mut [Emitter], weights: &[f64], total: f64) {
    let n = table.len() as f64;
    let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..table.len()).partition(|&i| scaled[i] < 1.0);
    for (i, e) in table.iter_mut().enumerate() {
        (e.keep, e.other) = (1.0, i as u32);
    }
    while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
        small.pop();
        table[s].keep = scaled[s] as f32;
        table[s].other = l as u32;
        scaled[l] -= 1.0 - scaled[s];
        if scaled[l] < 1.0 {
            large.pop();
            small.push(l);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alias_table_returns_the_weights() {
        let weights = [1.0, 0.0, 3.0, 0.5, 10.0, 1e-3];
        let total: f64 = weights.iter().sum();
        let mut table: Vec<Emitter> = vec![bytemuck::Zeroable::zeroed(); weights.len()];
        fill(&mut table, &weights, total);
        let mut got = vec![0.0; weights.len()];
        for (i, e) in table.iter().enumerate() {
            got[i] += f64::from(e.keep) / table.len() as f64;
            got[e.other as usize] += f64::from(1.0 - e.keep) / table.len() as f64;
        }
        for (g, w) in got.iter().zip(weights) {
            assert!((g - w / total).abs() < 1e-6, "{got:?}");
        }
    }
}
