//! Whether two estimators agree: pooled cells of the image, with the variance of independent batches of iterations.

use crate::film::Film;

/// Cells across and down the image.
const SIDE: usize = 8;
/// Batches behind every variance, at least: fewer and the limit below would not hold.
pub const LEAST_BATCHES: usize = 32;
/// Student's t of 31 degrees of freedom is beyond this once in 48,000 times: over 65 cells, a false alarm in 700 checks.
const LIMIT: f64 = 5.0;
/// A cell counts for itself if light arrived there in this part of the batches; the others are taken together, since too few
/// hits are not normally distributed.
const LIT: f64 = 0.9;

/// Means of cells in batches of iterations.
pub struct Cells {
    /// Weight (samples) and mean of each cell.
    batches: Vec<(f64, Vec<f64>)>,
    samples: f64,
    sums: Vec<f64>,
}

/// How far two renders are apart.
#[derive(Debug, Clone, Copy)]
pub struct Agreement {
    pub cells: usize,
    /// The greatest |z|.
    pub worst: f64,
}

impl Agreement {
    pub fn holds(&self) -> bool {
        self.worst <= LIMIT
    }
}

impl Cells {
    pub fn new() -> Cells {
        Cells { batches: vec![], samples: 0.0, sums: vec![0.0; SIDE * SIDE] }
    }

    /// Takes what was added to `film` since the last call as one batch.
    pub fn note(&mut self, film: &Film) {
        let samples = film.samples() as f64;
        let weight = samples - self.samples;
        if weight <= 0.0 {
            return;
        }
        let sums: Vec<f64> = pool(&film.mean(), film.width() as usize).iter().map(|mean| mean * samples).collect();
        let batch = sums.iter().zip(&self.sums).map(|(now, before)| (now - before) / weight).collect();
        self.batches.push((weight, batch));
        (self.samples, self.sums) = (samples, sums);
    }

    pub fn batches(&self) -> usize {
        self.batches.len()
    }

    /// Joins two independent halves.
    pub fn and(mut self, other: Cells) -> Cells {
        self.batches.extend(other.batches);
        self
    }

    /// Mean of a sum of cells and the variance of that mean.
    fn estimate(&self, cells: &[usize]) -> (f64, f64) {
        let value = |batch: &[f64]| cells.iter().map(|&c| batch[c]).sum::<f64>();
        let whole: f64 = self.batches.iter().map(|(weight, _)| weight).sum();
        let mean = self.batches.iter().map(|(weight, batch)| weight * value(batch)).sum::<f64>() / whole;
        let spread: f64 = self.batches.iter().map(|(weight, batch)| weight * (value(batch) - mean).powi(2)).sum();
        (mean, spread / ((self.batches.len() as f64 - 1.0) * whole))
    }

    fn is_lit(&self, cell: usize) -> bool {
        let lit = self.batches.iter().filter(|(_, batch)| batch[cell] > 0.0).count();
        lit as f64 >= LIT * self.batches.len() as f64
    }
}

/// Compares two independent renders of at least [`LEAST_BATCHES`] batches.
pub fn compare(a: &Cells, b: &Cells) -> Agreement {
    let (lit, dim): (Vec<usize>, Vec<usize>) = (0..SIDE * SIDE).partition(|&c| a.is_lit(c) && b.is_lit(c));
    let mut groups: Vec<Vec<usize>> = lit.into_iter().map(|c| vec![c]).collect();
    groups.extend((!dim.is_empty()).then_some(dim));
    let z = |group: &Vec<usize>| {
        let ((mean_a, variance_a), (mean_b, variance_b)) = (a.estimate(group), b.estimate(group));
        let difference = (mean_a - mean_b).abs();
        if difference == 0.0 { 0.0 } else { difference / (variance_a + variance_b).sqrt() }
    };
    Agreement { cells: groups.len(), worst: groups.iter().map(z).fold(0.0, f64::max) }
}

/// Mean over the channels and pixels of each cell; cells without a pixel are 0.
fn pool(rgb: &[f32], width: usize) -> Vec<f64> {
    let height = rgb.len() / 3 / width;
    let mut sums = vec![(0.0, 0u32); SIDE * SIDE];
    for (i, p) in rgb.chunks_exact(3).enumerate() {
        let (sum, count) = &mut sums[i / width * SIDE / height * SIDE + i % width * SIDE / width];
        *sum += p.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
        *count += 1;
    }
    sums.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 batches of noise around 1 with a fifth of the pixels at `bright`.
    fn cells(seed: u64, bright: f32) -> Cells {
        let mut state = seed;
        let mut cells = Cells::new();
        let mut film = Film::new(20, 12);
        for i in 0..40 {
            let mut image = vec![0.0f32; 3 * 240];
            for (i, v) in image.iter_mut().enumerate() {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let uniform = (state >> 40) as f32 / (1u64 << 24) as f32;
                *v = 2.0 * uniform * if i < 144 { bright } else { 1.0 };
            }
            film.add(&image, 1 + i % 3);
            cells.note(&film);
        }
        cells
    }

    #[test]
    fn equals_agree_and_others_do_not() {
        let same = compare(&cells(1, 1.0), &cells(2, 1.0));
        assert!(same.holds() && same.cells == 64 && same.worst > 0.5, "{same:?}");
        let other = compare(&cells(1, 1.0), &cells(2, 1.3));
        assert!(!other.holds(), "{other:?}");
    }

    #[test]
    fn light_that_one_misses_is_found() {
        let dark = compare(&cells(1, 0.0), &cells(2, 1.0));
        assert!(!dark.holds() && dark.cells < 64, "{dark:?}");
        assert_eq!(compare(&cells(1, 0.0), &cells(1, 0.0)).worst, 0.0);
    }
}
