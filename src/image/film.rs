//! The film: mean and variance per pixel over iterations, as sums that can be merged with those of another render.
//!
//! The pixels of one iteration share a light-vertex pool, so they are correlated. Whole iterations are uncorrelated: with
//! adaptive sampling, later iterations depend on earlier ones only by their sample counts. So the variance comes from iterations
//! as batches, never from the samples of a pixel.

#![warn(missing_docs)]

use rayon::prelude::*;

use crate::image::batches::CellBatches;
use crate::image::brightness_layers::BrightnessLayers;
use crate::image::moments::Moments;

/// Accumulated image of width x height pixels, with R, G, B interleaved and row 0 at the top.
#[derive(Debug, Clone)]
pub struct Film {
    width: u32,
    height: u32,
    /// Moments over the iterations of every channel of every pixel.
    moments: Vec<Moments>,
    /// Moments over the iterations of the image's mean over all pixels and channels.
    image: Moments,
    cells: CellBatches,
    samples: u64,
    iterations: u32,
    /// `None` if fireflies are kept.
    layers: Option<BrightnessLayers>,
}

/// An image whose fireflies are damped, see [`BrightnessLayers`].
pub struct Damped {
    /// R, G, B interleaved, row 0 at the top.
    pub rgb: Vec<f32>,
    /// Share of the light of the image that damping took away, 0 to 1.
    pub share: f64,
}

impl Film {
    /// A film without samples.
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
            layers: None,
        }
    }

    /// Also keeps the sums that [`Film::damped`] needs, 112 bytes per pixel.
    ///
    /// # Panics
    /// If there was an iteration.
    pub fn damp_fireflies(&mut self) {
        assert_eq!(self.iterations, 0, "the layers of brightness must have all iterations");
        self.layers = Some(BrightnessLayers::new(self.width, self.height));
    }

    /// Whether fireflies are damped.
    pub fn damps_fireflies(&self) -> bool {
        self.layers.is_some()
    }

    /// A film of this kind and size without samples.
    pub fn cleared(&self) -> Film {
        let mut film = Film::new(self.width, self.height);
        if self.damps_fireflies() {
            film.damp_fireflies();
        }
        film
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Number of iterations so far: the batches of [`Film::variance_of_mean`].
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Average number of samples per pixel so far.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Adds the image of one iteration: 3 * width * height finite values. Each is a mean over the iteration's samples of that
    /// pixel; `samples` >= 1 is their average number per pixel.
    ///
    /// # Panics
    /// If `rgb` does not have the film's size, or `samples` is 0.
    pub fn add(&mut self, rgb: &[f32], samples: u32) {
        assert_eq!(rgb.len(), self.moments.len(), "the image does not have the film's size");
        assert!(samples > 0, "an iteration has at least one sample");
        let sums: Vec<f64> = rgb.par_chunks(1 << 14).map(|part| part.iter().map(|&x| f64::from(x)).sum()).collect();
        let mean = sums.iter().sum::<f64>() / rgb.len().max(1) as f64;
        self.cells.add(rgb, samples);
        self.samples += u64::from(samples);
        let weight = f64::from(samples);
        let add = |(moments, &x): (&mut Moments, &f32)| moments.add(x.into(), weight);
        self.moments.par_iter_mut().zip(rgb).with_min_len(1 << 14).for_each(add);
        self.image.add(mean, weight);
        if let Some(layers) = &mut self.layers {
            layers.add(rgb, samples);
        }
        self.iterations += 1;
    }

    /// Adds the iterations of `other`, an independent part of the same render. Mean and variance become equal,
    /// to an ulp, to those of one film with all iterations, whatever the order of the parts. The batches of cells may become
    /// coarser than in one film.
    ///
    /// # Panics
    /// If the films have different sizes, or if only one damps fireflies.
    pub fn merge(&mut self, other: &Film) {
        assert_eq!((self.width, self.height), (other.width, other.height), "the films have different sizes");
        assert_eq!(self.damps_fireflies(), other.damps_fireflies(), "only one of the films damps fireflies");
        let merge = |(moments, other): (&mut Moments, &Moments)| moments.merge(other);
        self.moments.par_iter_mut().zip(&other.moments).with_min_len(1 << 14).for_each(merge);
        self.image.merge(&other.image);
        self.cells.merge(&other.cells);
        if let (Some(layers), Some(other)) = (&mut self.layers, &other.layers) {
            layers.merge(other);
        }
        self.samples += other.samples;
        self.iterations += other.iterations;
    }

    /// The moments of every channel of every pixel, and those of the mean over all of them.
    pub(super) fn moments(&self) -> (&[Moments], Moments) {
        (&self.moments, self.image)
    }

    pub(super) fn layers(&self) -> Option<&BrightnessLayers> {
        self.layers.as_ref()
    }

    /// A film with these moments, see [`Film::moments`], of `iterations` iterations with `samples` samples per pixel together.
    pub(super) fn from_moments(
        moments: Vec<Moments>,
        image: Moments,
        cells: CellBatches,
        [width, height]: [u32; 2],
        samples: u64,
        iterations: u32,
        layers: Option<BrightnessLayers>,
    ) -> Film {
        Film { width, height, moments, image, cells, samples, iterations, layers }
    }

    /// The image to show: damped if this film damps fireflies, else the mean.
    pub fn shown(&self) -> Vec<f32> {
        self.damped().map_or_else(|| self.mean(), |damped| damped.rgb)
    }

    /// The mean with damped fireflies. It is too dark where light is rare, and this bias vanishes with the number of iterations.
    /// `None` if fireflies are kept.
    pub fn damped(&self) -> Option<Damped> {
        let excess = self.layers.as_ref()?.excess(self.samples.max(1), self.iterations);
        let mut rgb = self.mean();
        let light = |rgb: &[f32]| rgb.iter().map(|&x| f64::from(x)).sum::<f64>();
        let (all, taken) = (light(&rgb), light(&excess));
        rgb.par_iter_mut().zip(&excess).with_min_len(1 << 14).for_each(|(x, excess)| *x = (*x - excess).max(0.0));
        Some(Damped { rgb, share: if taken > 0.0 { (taken / all).min(1.0) } else { 0.0 } })
    }

    /// The mean over all samples; 0 before the first iteration.
    pub fn mean(&self) -> Vec<f32> {
        let weights = self.samples.max(1) as f64;
        self.moments.par_iter().map(|m| m.mean(weights) as f32).collect()
    }

    /// Means over cells of pixels, in independent batches.
    #[doc(hidden)]
    pub fn cells(&self) -> &CellBatches {
        &self.cells
    }

    /// Replaces the cells by `cells`, shifted so that their means are those of this film. A film that joins renders has coarser
    /// batches than the renders had.
    #[doc(hidden)]
    pub fn set_cells(&mut self, cells: CellBatches) {
        assert_eq!(cells.grid(), self.cells.grid(), "the cells are of an image of another size");
        self.cells = cells.moved_to(&self.mean());
    }

    /// The mean over all pixels and channels, and its standard error. The error comes from the means of whole iterations, because
    /// the pixels of one iteration are correlated. The error is `None` with fewer than two iterations.
    ///
    /// The noise of light subpaths dominates here, because that of samples averages out over the pixels. The sums assume the noise of
    /// samples, so the error is corrected by the batches of cells, see [`CellBatches::pooled`]. These are too few to give the error
    /// itself as precisely as all iterations do. The expected variance is then 2 % too small to 5 % too large.
    pub fn image_mean(&self) -> (f64, Option<f64>) {
        let weights = self.samples.max(1) as f64;
        let variance = self.image.spread(weights) * self.per_spread() * self.cells.correction();
        (self.image.mean(weights), (self.iterations > 1).then(|| variance.sqrt()))
    }

    /// Estimated variance of [`Film::mean`]: sum_i w_i (x_i - mean)^2 / ((n - 1) sum_i w_i) for n iterations with w_i samples. It
    /// is unbiased for iterations of equal length, and for unequal ones if the variance of an iteration is inversely proportional to
    /// its samples. Adaptive samples break that rule: a pixel with 4 times the average samples has them only from the second
    /// iteration on. With the lengths of [`crate::render::schedule`] the estimate is then at most 7 % too large. In a film that joins
    /// N adaptive shards, the first N iterations have the average samples in every pixel. For 8 to 16 shards of 64 to 512 samples per
    /// pixel: with 4 times the average samples, the estimate is up to 36 % too large. With a quarter of the average, it is up to 21 %
    /// too small. Always finite; 0 with fewer than two iterations.
    ///
    /// The noise of light subpaths breaks the rule too: it is the same in iterations of 2, 4 and 8 samples. In a pixel with no other
    /// noise, the estimate is right up to 16 samples per pixel. It is 12 % too small with 32 samples, 21 % with 128 and 10 % with 512;
    /// the maximum is 23 %. The sums of a pixel do not tell the two kinds of noise apart; the batches of [`Film::cells`] do.
    pub fn variance_of_mean(&self) -> Vec<f32> {
        if self.iterations < 2 {
            return vec![0.0; self.moments.len()];
        }
        let (weights, per_spread) = (self.samples as f64, self.per_spread());
        let variance = |m: &Moments| (m.spread(weights) * per_spread).min(f64::from(f32::MAX)) as f32;
        self.moments.par_iter().map(variance).collect()
    }

    /// Factor from the spread of a channel to the variance of its mean.
    fn per_spread(&self) -> f64 {
        1.0 / (f64::from(self.iterations.max(2) - 1) * self.samples.max(1) as f64)
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
        // Batches of 4, 4 and 2 samples with means 1, 3 and 6: mean (4 + 12 + 12) / 10 = 2.8, spread
        // 4 * 1.8^2 + 4 * 0.2^2 + 2 * 3.2^2 = 33.6, variance of the mean 33.6 / (2 * 10) = 1.68.
        let mut film = Film::new(1, 1);
        for (x, samples) in [(1.0, 4), (3.0, 4), (6.0, 2)] {
            film.add(&[x, 0.1, 1e18], samples);
        }
        assert_eq!(film.mean(), [2.8, 0.1, 1e18]);
        let variance = film.variance_of_mean();
        assert!((variance[0] - 1.68).abs() < 1e-6, "{variance:?}");
        assert!(variance[1] < 1e-16 && variance[2].is_finite(), "{variance:?}");
    }

    /// Iterations of noise in six channels, from nearly constant to mostly black.
    fn noise(count: u32) -> Vec<([f32; 6], u32)> {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let mut values = || {
            let [a, b, c, d] = [uniform(), uniform(), uniform(), uniform()];
            [a, 1.0 + 1e-6 * b, 1e18 * c, 1e-12 + 1e-13 * a, if d > 0.99 { 1e4 * d } else { 0.0 }, 0.1]
        };
        (0..count).map(|i| (values(), 1 + i % 8)).collect()
    }

    fn film_of(iterations: &[([f32; 6], u32)]) -> Film {
        let mut film = Film::new(2, 1);
        iterations.iter().for_each(|(image, samples)| film.add(image, *samples));
        film
    }

    #[test]
    fn parts_merge_in_any_order_to_the_whole() {
        let iterations = noise(1000);
        let whole = film_of(&iterations);
        let parts: Vec<Film> = [0..1, 1..300, 300..301, 301..640, 640..1000].map(|r| film_of(&iterations[r])).into();
        for order in [[0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [2, 4, 0, 3, 1]] {
            let mut film = Film::new(2, 1);
            order.iter().for_each(|&i| film.merge(&parts[i]));
            same(&film, &whole);
        }
        // In pairs, as a tree of machines would merge them.
        let [mut a, b, mut c, d, e] = parts.try_into().unwrap();
        a.merge(&b);
        c.merge(&d);
        c.merge(&e);
        a.merge(&c);
        same(&a, &whole);
        // A film with one iteration less must differ.
        let less = film_of(&iterations[..999]);
        assert!(less.mean()[0] != whole.mean()[0]);
    }

    /// Checks that the films are equal to an ulp of f32, and in f64 to 1e-12.
    fn same(a: &Film, b: &Film) {
        assert_eq!((a.iterations(), a.samples()), (b.iterations(), b.samples()));
        for (a, b) in [(a.mean(), b.mean()), (a.variance_of_mean(), b.variance_of_mean())] {
            assert!(a.iter().zip(&b).all(|(a, b)| a.to_bits().abs_diff(b.to_bits()) <= 1), "{a:?} {b:?}");
        }
        let weights = a.samples() as f64;
        for (a, b) in a.moments.iter().zip(&b.moments) {
            let [mean, spread] = [[a.mean(weights), b.mean(weights)], [a.spread(weights), b.spread(weights)]];
            assert!((mean[0] - mean[1]).abs() <= 1e-12 * mean[1], "{mean:?}");
            assert!((spread[0] - spread[1]).abs() <= 1e-12 * spread[1], "{spread:?}");
        }
        let (cells, others) = (a.cells().pooled(&[0], 0), b.cells().pooled(&[0], 0));
        assert!((cells.0 / others.0 - 1.0).abs() < 1e-12, "{cells:?} {others:?}");
    }

    #[test]
    fn a_merged_film_goes_on() {
        let iterations = noise(50);
        let mut film = film_of(&iterations[..20]);
        film.merge(&film_of(&iterations[20..30]));
        iterations[30..].iter().for_each(|(image, samples)| film.add(image, *samples));
        same(&film, &film_of(&iterations));
    }

    #[test]
    fn the_error_of_the_image_mean_counts_correlated_pixels() {
        // Batches of 4, 4 and 2 samples as above, equal in every pixel: the mean of all pixels has the error of one pixel.
        let mut film = Film::new(5, 2);
        assert_eq!(film.image_mean(), (0.0, None));
        for (x, samples) in [(1.0, 4), (3.0, 4), (6.0, 2)] {
            film.add(&[x; 30], samples);
        }
        let (mean, error) = film.image_mean();
        // 0.4^2 1.8^2 / 0.6 + 0.4^2 0.2^2 / 0.6 + 0.2^2 3.2^2 / 0.8 = 1.3867.
        assert!((mean - 2.8).abs() < 1e-12 && (error.unwrap().powi(2) - 1.386_667).abs() < 1e-6, "{mean} {error:?}");
        // Treating the thirty values as independent must give too small an error.
        let naive = (f64::from(film.variance_of_mean()[0]) / 30.0).sqrt();
        assert!(naive < 0.25 * error.unwrap());
    }

    #[test]
    fn the_variance_estimate_is_unbiased_with_a_short_last_batch() {
        // Samples are 0 or 1 with probability 1/2, so the variance is 1/4 per sample and 1/40 for the mean of ten.
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
        // Unweighted batches would give 0.25 * (1/4 + 1/4 + 1/2) / 9 = 0.0278, which the test must reject.
        assert!((mean / 0.0278 - 1.0).abs() > 0.05, "{mean}");
    }
}
