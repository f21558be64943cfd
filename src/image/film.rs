//! The film: per-pixel mean and variance over iterations, in f64.
//!
//! Pixels of one iteration share a light-vertex pool and are correlated, but whole iterations are uncorrelated
//! (where samples follow the error, later ones depend on earlier ones by their counts alone). So the variance comes from iterations
//! as batches, never from the samples of a pixel.

use rayon::prelude::*;

use crate::image::batches::CellBatches;

/// Accumulated images of width x height pixels with R, G, B interleaved, row 0 at the top.
#[derive(Debug, Clone)]
pub struct Film {
    width: u32,
    height: u32,
    /// Moments of every channel over the iterations.
    moments: Vec<Moments>,
    /// The same of the image's mean over all pixels and channels.
    image: Moments,
    cells: CellBatches,
    samples: u64,
    iterations: u32,
}

/// Mean of x and sum of w (x - mean)^2 over the iterations, where iteration i has mean x_i over w_i samples: a sum of squares
/// would lose the variance of channels that hardly vary.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Moments {
    mean: f64,
    spread: f64,
}

impl Moments {
    /// Welford 1962, weighted (West 1979); `share` is `weight` over all weights so far, this one included.
    fn add(&mut self, x: f64, weight: f64, share: f64) {
        let from_old = x - self.mean;
        self.mean += share * from_old;
        self.spread += weight * from_old * (x - self.mean);
    }
}

impl Film {
    pub fn new(width: u32, height: u32) -> Film {
        let channels = 3 * width as usize * height as usize;
        Film {
            width,
            height,
            moments: vec![Moments::default(); channels],
            image: Moments::default(),
            cells: CellBatches::new(width, height),
            samples: 0,
            iterations: 0,
        }
    }

    pub fn width(&self) -> u32 {
        self.width
    }

    pub fn height(&self) -> u32 {
        self.height
    }

    /// Iterations added so far: the batches behind [`Film::variance_of_mean`].
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Samples a pixel in all.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Adds one iteration's image of 3 * width * height channels, each the mean over that iteration's `samples` >= 1
    /// samples a pixel. Values must be finite.
    pub fn add(&mut self, rgb: &[f32], samples: u32) {
        assert_eq!(rgb.len(), self.moments.len(), "the image does not have the film's size");
        assert!(samples > 0, "an iteration has at least one sample");
        let mean = rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / rgb.len().max(1) as f64;
        self.cells.add(rgb, samples);
        self.samples += u64::from(samples);
        let weight = f64::from(samples);
        let share = weight / self.samples as f64;
        let add = |moments: &mut Moments, x: f64| moments.add(x, weight, share);
        self.moments.par_iter_mut().zip(rgb).with_min_len(1 << 14).for_each(|(moments, &x)| add(moments, x.into()));
        add(&mut self.image, mean);
        self.iterations += 1;
    }

    /// The mean over all samples; 0 before the first iteration.
    pub fn mean(&self) -> Vec<f32> {
        self.moments.par_iter().map(|m| m.mean as f32).collect()
    }

    /// Means over cells of pixels in independent batches.
    pub fn cells(&self) -> &CellBatches {
        &self.cells
    }

    /// Takes over how these cells vary; their means become those of the film. A film that joins renders has coarser batches than
    /// the renders had.
    pub fn set_cells(&mut self, cells: CellBatches) {
        assert_eq!(cells.grid(), self.cells.grid(), "the cells are of an image of another size");
        self.cells = cells.moved_to(&self.mean());
    }

    /// The mean over all pixels and channels, and its standard error from the means of whole iterations: pixels of one are
    /// correlated. No error with fewer than two iterations.
    pub fn image_mean(&self) -> (f64, Option<f64>) {
        let weight = f64::from(self.iterations.max(2) - 1) * self.samples as f64;
        let error = (self.iterations > 1).then(|| (self.image.spread / weight).sqrt());
        (self.image.mean, error)
    }

    /// Estimated variance of [`Film::mean`]: sum_i w_i (x_i - mean)^2 / ((n - 1) sum_i w_i), unbiased for iterations of
    /// as many samples, and for others when an iteration's variance is inverse to its samples. Adaptive samples lower that of a pixel as
    /// they learn: the short iterations at the beginning of a `--time` then count too much in pixels that have many samples, too little in
    /// those that have few (by up to a half of it in renders of 16 samples, less in longer ones). Always finite; 0 with fewer than two iterations.
    pub fn variance_of_mean(&self) -> Vec<f32> {
        if self.iterations < 2 {
            return vec![0.0; self.moments.len()];
        }
        let scale = 1.0 / (f64::from(self.iterations - 1) * self.samples as f64);
        let variance = |m: &Moments| (m.spread * scale).min(f64::from(f32::MAX)) as f32;
        self.moments.par_iter().map(variance).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_film_is_black() {
        let film = Film::new(2, 3);
        assert_eq!(film.mean(), vec![0.0; 18]);
        assert_eq!(film.variance_of_mean(), vec![0.0; 18]);
    }

    #[test]
    fn one_iteration_has_no_variance() {
        let mut film = Film::new(1, 1);
        film.add(&[1.0, 2.0, 3.0], 4);
        assert_eq!((film.mean(), film.variance_of_mean()), (vec![1.0, 2.0, 3.0], vec![0.0; 3]));
        assert_eq!((film.iterations(), film.samples()), (1, 4));
    }

    #[test]
    fn weighted_batches_by_hand() {
        // Batches 1, 3 of 4 samples and 6 of 2: mean (4 + 12 + 12) / 10 = 2.8,
        // spread 4 * 1.8^2 + 4 * 0.2^2 + 2 * 3.2^2 = 33.6, variance of the mean 33.6 / (2 * 10) = 1.68.
        let mut film = Film::new(1, 1);
        for (x, samples) in [(1.0, 4), (3.0, 4), (6.0, 2)] {
            film.add(&[x, 0.1, 1e18], samples);
        }
        assert_eq!(film.mean(), [2.8, 0.1, 1e18]);
        let variance = film.variance_of_mean();
        assert!((variance[0] - 1.68).abs() < 1e-6, "{variance:?}");
        assert!(variance[1] < 1e-16 && variance[2].is_finite(), "{variance:?}");
    }

    #[test]
    fn the_error_of_the_image_mean_counts_correlated_pixels() {
        // Batches of 4, 4 and 2 samples as above, in every pixel alike: the mean is no better known than that of one.
        let mut film = Film::new(5, 2);
        assert_eq!(film.image_mean(), (0.0, None));
        for (x, samples) in [(1.0, 4), (3.0, 4), (6.0, 2)] {
            film.add(&[x; 30], samples);
        }
        let (mean, error) = film.image_mean();
        assert!((mean - 2.8).abs() < 1e-12 && (error.unwrap() - 1.68f64.sqrt()).abs() < 1e-12, "{mean} {error:?}");
        // The sibling that must fail: thirty values taken for independent.
        let naive = (f64::from(film.variance_of_mean()[0]) / 30.0).sqrt();
        assert!(naive < 0.2 * error.unwrap());
    }

    #[test]
    fn the_variance_estimate_is_unbiased_with_a_short_last_batch() {
        // Samples are 0 or 1 with probability 1/2: variance 1/4 a sample, 1/40 for the mean of ten.
        // A linear congruential generator is random enough for 1 % over 100,000 channels.
        let mut state = 1_u64;
        let mut coin = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 63) as f32
        };
        let mut film = Film::new(33_334, 1);
        for samples in [4_u32, 4, 2] {
            let image: Vec<f32> =
                (0..3 * 33_334).map(|_| (0..samples).map(|_| coin()).sum::<f32>() / samples as f32).collect();
            film.add(&image, samples);
        }
        let variance = film.variance_of_mean();
        let mean = variance.iter().map(|&v| f64::from(v)).sum::<f64>() / variance.len() as f64;
        assert!((mean / 0.025 - 1.0).abs() < 0.02, "{mean}");
        // The sibling that must fail: unweighted batches would give 0.25 * (1/4 + 1/4 + 1/2) / 9 = 0.0278.
        assert!((mean / 0.0278 - 1.0).abs() > 0.05, "{mean}");
    }
}
