//! Means over square cells of an image in a few independent batches of iterations. A comparison uses them to tell noise from
//! error. The pixels of an iteration share a light pool, so the variance of a cell is not the sum of its pixels' variances. Here
//! any union of cells has one value per batch, and the spread of these values gives its variance correctly.

use rayon::prelude::*;

use crate::error::{Error, Result};

/// Side of a cell in pixels.
pub const CELL: usize = 16;
/// Maximum number of batches. When another batch would exceed it, neighbours are merged in pairs.
pub const MAX_BATCHES: usize = 32;
/// Tolerance for the relative difference between a cell's mean and the mean of its pixels, which are rounded to f32.
const ROUNDING: f64 = 1e-5;

/// Independent batches. Each batch is a pair: its number of samples per pixel, and one value per cell and channel. The value is
/// the sum over the pixels of the cell, times the number of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct CellBatches {
    width: usize,
    height: usize,
    batches: Vec<(f64, Vec<f64>)>,
    /// Number of iterations in a full batch, and in the last batch.
    each: u32,
    last: u32,
}

impl CellBatches {
    pub fn new(width: u32, height: u32) -> CellBatches {
        CellBatches { width: width as usize, height: height as usize, batches: vec![], each: 1, last: 1 }
    }

    /// Number of cells across and down. Cells at the right and lower edge may be smaller.
    pub fn grid(&self) -> [usize; 2] {
        [self.width.div_ceil(CELL), self.height.div_ceil(CELL)]
    }

    /// Number of pixels of a cell; cells are counted row by row.
    pub fn pixels(&self, cell: usize) -> usize {
        let columns = self.grid()[0];
        let side = |at: usize, size: usize| CELL.min(size - at * CELL);
        side(cell % columns, self.width) * side(cell / columns, self.height)
    }

    /// Number of batches.
    pub fn len(&self) -> usize {
        self.batches.len()
    }

    pub fn is_empty(&self) -> bool {
        self.batches.is_empty()
    }

    /// Adds an iteration: the means over `samples` samples per pixel, R, G, B interleaved.
    pub fn add(&mut self, rgb: &[f32], samples: u32) {
        let [columns, rows] = self.grid();
        if self.last >= self.each {
            if self.batches.len() == MAX_BATCHES {
                self.merge_neighbours();
            }
            self.batches.push((0.0, vec![0.0; 3 * columns * rows]));
            self.last = 0;
        }
        self.last += 1;
        let (weight, sums) = self.batches.last_mut().expect("one was just pushed, or is not full");
        let samples = f64::from(samples);
        *weight += samples;
        let strips = sums.par_chunks_mut(3 * columns).zip(rgb.par_chunks(3 * self.width * CELL));
        strips.for_each(|(sums, rows)| {
            for row in rows.chunks_exact(3 * self.width) {
                for (cell, sums) in row.chunks(3 * CELL).zip(sums.chunks_exact_mut(3)) {
                    for pixel in cell.chunks_exact(3) {
                        (0..3).for_each(|k| sums[k] += samples * f64::from(pixel[k]));
                    }
                }
            }
        });
    }

    fn merge_neighbours(&mut self) {
        let pairs = std::mem::take(&mut self.batches);
        self.batches = pairs
            .chunks(2)
            .map(|pair| {
                let sums = (0..pair[0].1.len()).map(|i| pair.iter().map(|b| b.1[i]).sum()).collect();
                (pair.iter().map(|b| b.0).sum(), sums)
            })
            .collect();
        self.each *= 2;
        self.last = self.each;
    }

    /// Adds the batches of an independent part of the same render, and merges neighbours if there are too many. The next
    /// iteration begins a new batch.
    pub fn merge(&mut self, other: &CellBatches) {
        assert_eq!(self.grid(), other.grid(), "images of different sizes have different cells");
        self.batches.extend(other.batches.iter().cloned());
        self.each = self.each.max(other.each);
        while self.batches.len() > MAX_BATCHES {
            self.merge_neighbours();
        }
        self.last = self.each;
    }

    /// Each batch: its samples per pixel, and its sums. See [`CellBatches`].
    pub(super) fn batches(&self) -> &[(f64, Vec<f64>)] {
        &self.batches
    }

    /// Number of iterations in a full batch, and in the last batch.
    pub(super) fn lengths(&self) -> [u32; 2] {
        [self.each, self.last]
    }

    /// The batches of [`CellBatches::batches`] with the lengths of [`CellBatches::lengths`]. `None` if they are too many or do not fit
    /// the image.
    pub(super) fn from_batches(
        [width, height]: [u32; 2],
        batches: Vec<(f64, Vec<f64>)>,
        [each, last]: [u32; 2],
    ) -> Option<CellBatches> {
        let empty = CellBatches::new(width, height);
        let [columns, rows] = empty.grid();
        let fits = batches.len() <= MAX_BATCHES && batches.iter().all(|(_, sums)| sums.len() == 3 * columns * rows);
        let counts = each >= 1 && (1..=each).contains(&last);
        (fits && counts).then_some(CellBatches { batches, each, last, ..empty })
    }

    /// Mean over the pixels of `cells` in one channel, and the variance of that mean. Needs at least two batches.
    ///
    /// The mean is m = sum_i p_i x_i, where x_i is the mean of batch i, and p_i its share of all samples. The variance is
    /// sum_i p_i^2 (x_i - m)^2 / (1 - p_i): the estimate HC2 of MacKinnon and White 1985. Let v_i be the variance of x_i. The true
    /// variance is then V = sum_i p_i^2 v_i, and the estimate has the expectation
    /// sum_i p_i^2 ((1 - 2 p_i) v_i + V) / (1 - p_i). This is V
    ///
    /// * if v_i is inversely proportional to p_i, as the noise of samples is: V / v_i is p_i,
    /// * if all p_i are equal, whatever the v_i are.
    ///
    /// The noise of light subpaths is the third case: all v_i are equal, because an iteration has the same number of light subpaths
    /// whether it has 2 samples or 8. With the lengths of [`crate::render::schedule`] and at least 8 iterations, the estimate is then at
    /// most 2 % too small. The estimate sum_i p_i (x_i - m)^2 / (n - 1), which assumes the noise of samples, would be up to 23 % too small.
    pub fn pooled(&self, cells: &[usize], channel: usize) -> (f64, f64) {
        let pixels: f64 = cells.iter().map(|&c| self.pixels(c) as f64).sum();
        let sum_of = |sums: &[f64]| cells.iter().map(|&c| sums[3 * c + channel]).sum::<f64>() / pixels;
        let (mean, [_, variance]) = self.estimates(sum_of);
        (mean, variance)
    }

    /// Two estimates of the variance of the mean over all pixels and channels: the one in [`CellBatches::pooled`], divided by the one
    /// that assumes the noise of samples. 1 if there is no noise.
    pub(super) fn correction(&self) -> f64 {
        if self.batches.len() < 2 {
            return 1.0;
        }
        let (_, [of_samples, variance]) = self.estimates(|sums| sums.iter().sum());
        if of_samples > 0.0 { variance / of_samples } else { 1.0 }
    }

    /// The mean of a quantity with these sums in each batch, and two estimates of its variance. The first is for the noise of samples,
    /// the second is that of [`CellBatches::pooled`].
    fn estimates(&self, sum_of: impl Fn(&[f64]) -> f64) -> (f64, [f64; 2]) {
        let samples: f64 = self.batches.iter().map(|b| b.0).sum();
        let mean = self.batches.iter().map(|(_, sums)| sum_of(sums)).sum::<f64>() / samples;
        let mut estimates = [0.0; 2];
        for (weight, sums) in &self.batches {
            let (part, square) = (weight / samples, (sum_of(sums) / weight - mean).powi(2));
            estimates[0] += part * square / (self.batches.len() as f64 - 1.0);
            estimates[1] += part * part * square / (1.0 - part);
        }
        (mean, estimates)
    }

    /// Skewness of the means of the batches, whose spread is the variance in [`CellBatches::pooled`]: 0 on average for noise that is
    /// symmetric about its mean, whatever the numbers of samples. [`CellBatches::max_skewness`] if one batch has all the noise.
    pub fn skewness(&self, cells: &[usize], channel: usize) -> f64 {
        let sum_of = |sums: &[f64]| cells.iter().map(|&c| sums[3 * c + channel]).sum::<f64>();
        let samples: f64 = self.batches.iter().map(|b| b.0).sum();
        let mean = self.batches.iter().map(|(_, sums)| sum_of(sums)).sum::<f64>() / samples;
        // The noise of samples has the same variance in each term.
        let terms = self.batches.iter().map(|(weight, sums)| (sum_of(sums) / weight - mean) * weight.sqrt());
        let (squares, cubes) = terms.fold((0.0, 0.0), |(squares, cubes), x| (squares + x * x, cubes + x * x * x));
        match squares > 0.0 {
            true => cubes * (self.batches.len() as f64).sqrt() / squares.powf(1.5),
            false => 0.0,
        }
    }

    /// The greatest skewness that this number of equal batches can have.
    pub fn max_skewness(&self) -> f64 {
        let n = self.batches.len() as f64;
        (n - 2.0) / (n - 1.0).sqrt()
    }

    /// Degrees of freedom of the variance in [`CellBatches::pooled`] if all batches have equal variances (Bell and McCaffrey 2002). With
    /// equal numbers of samples, it is the number of batches less 1, otherwise less. The noise of samples gives more.
    pub fn freedom(&self) -> f64 {
        let samples: f64 = self.batches.iter().map(|b| b.0).sum();
        let parts: Vec<f64> = self.batches.iter().map(|b| b.0 / samples).collect();
        let of_mean: f64 = parts.iter().map(|p| p * p).sum();
        // The variance is the sum of the squares of normal numbers d_i = p_i (x_i - m) / sqrt(1 - p_i). These are their covariances.
        let factor = |p: f64| p / (1.0 - p).sqrt();
        let covariance = |i: usize, j: usize| {
            let (a, b) = (parts[i], parts[j]);
            factor(a) * factor(b) * (if i == j { 1.0 } else { 0.0 } - a - b + of_mean)
        };
        let all = 0..parts.len();
        let trace: f64 = all.clone().map(|i| covariance(i, i)).sum();
        let squares: f64 =
            all.clone().flat_map(|i| all.clone().map(move |j| (i, j))).map(|(i, j)| covariance(i, j).powi(2)).sum();
        trace * trace / squares
    }

    /// Whether the cells were computed from the pixels `rgb`: the mean of every cell is that of its pixels, up to rounding.
    pub fn are_of(&self, rgb: &[f32]) -> bool {
        let mut pixels = CellBatches::new(self.width as u32, self.height as u32);
        pixels.add(rgb, 1);
        let cells = self.grid()[0] * self.grid()[1];
        (0..3 * cells).all(|i| {
            let [found, kept] = [&pixels, self].map(|batches| batches.pooled(&[i / 3], i % 3).0);
            (found - kept).abs() <= ROUNDING * found.abs().max(kept.abs()) + f64::from(f32::MIN_POSITIVE)
        })
    }

    /// The same batches, shifted by a constant per cell and channel, so that their means are those of the pixels `rgb`.
    pub fn moved_to(mut self, rgb: &[f32]) -> CellBatches {
        let mut pixels = CellBatches::new(self.width as u32, self.height as u32);
        pixels.add(rgb, 1);
        let moves: Vec<f64> = (0..3 * self.grid()[0] * self.grid()[1])
            .map(|i| {
                let [wanted, mean] = [&pixels, &self].map(|batches| batches.pooled(&[i / 3], i % 3).0);
                (wanted - mean) * self.pixels(i / 3) as f64
            })
            .collect();
        for (weight, sums) in &mut self.batches {
            sums.iter_mut().zip(&moves).for_each(|(sum, step)| *sum += *weight * step);
        }
        self
    }

    /// The batches as numbers for a file: side of a cell, number of batches, then the samples and means of each batch (cells row
    /// by row, R, G, B).
    pub fn to_floats(&self) -> Vec<f32> {
        let mut floats = vec![CELL as f32, self.batches.len() as f32];
        for (weight, sums) in &self.batches {
            floats.push(*weight as f32);
            let mean = |(i, sum): (usize, &f64)| (sum / (weight * self.pixels(i / 3) as f64)) as f32;
            floats.extend(sums.iter().enumerate().map(mean));
        }
        floats
    }

    /// Reads the numbers of [`CellBatches::to_floats`] for an image of this size. The numbers come from a file, so all of them
    /// are checked.
    pub fn from_floats(width: u32, height: u32, floats: &[f32]) -> Result<CellBatches> {
        let wrong = |what: &str| Error::settings(format!("the batches of cells (tof:cellBatches) {what}"));
        let mut all = CellBatches::new(width, height);
        let [columns, rows] = all.grid();
        let size = 1 + 3 * columns * rows;
        let [cell, count, data @ ..] = floats else { return Err(wrong("are missing")) };
        if *cell != CELL as f32 || !(0.0..=MAX_BATCHES as f32).contains(count) || data.len() != *count as usize * size {
            return Err(wrong("do not fit the image; use the file as rendered, not cropped or scaled"));
        }
        if data.iter().any(|x| !x.is_finite()) || data.chunks_exact(size).any(|batch| batch[0] <= 0.0) {
            return Err(wrong("hold values that are not finite, or a batch without samples"));
        }
        for batch in data.chunks_exact(size) {
            let weight = f64::from(batch[0]);
            let sum = |(i, &mean): (usize, &f32)| f64::from(mean) * weight * all.pixels(i / 3) as f64;
            let sums = batch[1..].iter().enumerate().map(sum).collect();
            all.batches.push((weight, sums));
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests;
