//! Number of samples per pixel in an iteration: the same in every pixel, or more where earlier iterations found a larger error.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::Renderer;
use super::emitters::luminance;
use crate::image::accumulation::AdaptiveState;
#[cfg(doc)]
use crate::image::film::Film;

/// Maximum number of samples per pixel in one iteration, averaged over the pixels.
pub const MAX_AVERAGE_SAMPLES: u32 = 16;
/// Maximum number of samples per pixel in one iteration for a camera with aimed rays, which has few pixels.
pub const MAX_AIMED_SAMPLES: u32 = 1024;
/// Maximum samples of one pixel, relative to the average.
pub const MAX_SHARE: u32 = 4;
/// Minimum samples of one pixel, relative to the average; never less than one sample. A pixel that has seen no light so far may
/// still receive some.
const MIN_SHARE: f64 = 0.25;
/// Maximum number of samples in one pixel and iteration.
pub const MAX_SAMPLES_PER_PIXEL: u32 = MAX_AVERAGE_SAMPLES * MAX_SHARE;
/// Fraction of the image's mean luminance that regularises the relative error of dark pixels, as in relMSE.
const DARK_FRACTION: f64 = 0.01;
/// Minimum error of a pixel, relative to the maximum error.
const MIN_RELATIVE_ERROR: f64 = 1e-6;
/// From this iteration on, counted from 0, the samples follow all earlier iterations except the last one. Before it, the last one is too
/// large a part of all.
const FIRST_WITHOUT_LAST: u32 = 3;
/// Maximum number of passes of [`factor`] over all pixels.
const MAX_PASSES: u32 = 64;

/// Samples per pixel of the crop in one iteration.
#[derive(Debug, Clone, PartialEq)]
pub enum SampleCounts {
    /// The same number in every pixel.
    Uniform(u32),
    /// Row-major over the crop; each from 1 to [`MAX_SAMPLES_PER_PIXEL`].
    PerPixel(Vec<u8>),
}

impl SampleCounts {
    /// Samples of `pixel`, a row-major index in the crop.
    pub fn of(&self, pixel: u32) -> u32 {
        match self {
            SampleCounts::Uniform(samples) => *samples,
            SampleCounts::PerPixel(counts) => counts[pixel as usize].into(),
        }
    }

    /// Maximum over all pixels.
    pub fn max(&self) -> u32 {
        match self {
            SampleCounts::Uniform(samples) => *samples,
            SampleCounts::PerPixel(counts) => counts.iter().copied().max().unwrap_or(0).into(),
        }
    }
}

/// Sums over all samples of a pixel so far.
#[derive(Debug, Clone, Copy, Default)]
struct PixelStats {
    samples: f64,
    /// Sum of the samples' luminances.
    sum: f64,
    /// Sum of the samples' squared luminances.
    squares: f64,
    /// Sum over iterations: luminance of the pixel, splats (t = 1) included, times the average samples per pixel.
    light: f64,
}

/// Distributes the samples of an iteration over the pixels according to the error that earlier iterations found. The image
/// stays unbiased for three reasons: the counts are fixed before the iteration begins, every pixel has at least one sample,
/// and the weight of an iteration is its average number of samples per pixel, never the count of one pixel.
///
/// The counts do not depend on the iteration just before. So the host can choose them while the device traces that iteration. The first
/// iterations are exceptions.
#[derive(Clone)]
pub struct Allocation {
    width: usize,
    pixels: Vec<PixelStats>,
    /// Samples per pixel so far, averaged over the pixels.
    samples: f64,
    iterations: u32,
    /// The errors after all iterations, once they are known; and after all except the last one.
    errors: OnceLock<Vec<f64>>,
    without_last: Vec<f64>,
}

impl Allocation {
    /// An allocation without samples, for a crop with `width` columns and `pixels` pixels.
    pub fn new(width: u32, pixels: u64) -> Allocation {
        Allocation {
            width: width as usize,
            pixels: vec![PixelStats::default(); pixels as usize],
            samples: 0.0,
            iterations: 0,
            errors: OnceLock::new(),
            without_last: vec![0.0; pixels as usize],
        }
    }

    pub fn restart(&mut self) {
        self.pixels.fill(PixelStats::default());
        (self.samples, self.iterations) = (0.0, 0);
        self.errors.take();
        self.without_last.fill(0.0);
    }

    /// The statistics of earlier iterations.
    pub fn state(&self) -> AdaptiveState {
        let pixels = self.pixels.iter().map(|p| [p.samples, p.sum, p.squares, p.light]).collect();
        let errors = Some(self.without_last.clone());
        AdaptiveState { pixels, samples: self.samples, iterations: self.iterations, errors }
    }

    /// Goes on from `state`, which has the same number of pixels. If it lacks errors, those after all its iterations serve.
    pub fn resume(&mut self, state: &AdaptiveState) {
        let stats = |&[samples, sum, squares, light]: &[f64; 4]| PixelStats { samples, sum, squares, light };
        self.pixels = state.pixels.iter().map(stats).collect();
        (self.samples, self.iterations) = (state.samples, state.iterations);
        self.errors.take();
        self.without_last = state.errors.clone().unwrap_or_else(|| self.errors().to_vec());
    }

    /// Adds an iteration with `samples` samples per pixel on average, distributed as in `counts`. `film` has one entry per
    /// pixel: the mean RGB of its camera samples, and in w the sum of their squared luminances. `image`: mean RGB per pixel
    /// with all other light (t = 1) included.
    pub fn add(&mut self, film: &[[f32; 4]], image: &[f32], counts: &SampleCounts, samples: u32) {
        self.errors();
        self.without_last = self.errors.take().expect("they are known now");
        let samples = f64::from(samples);
        let parts = self.pixels.par_chunks_mut(CHUNK).zip(film.par_chunks(CHUNK)).zip(image.par_chunks(3 * CHUNK));
        parts.enumerate().for_each(|(part, ((pixels, film), image))| {
            let pixels = pixels.iter_mut().zip(film).zip(image.chunks_exact(3));
            for (i, ((pixel, &[r, g, b, squares]), all)) in pixels.enumerate() {
                let count = f64::from(counts.of((part * CHUNK + i) as u32));
                pixel.samples += count;
                pixel.sum += count * luminance([r, g, b]);
                pixel.squares += f64::from(squares);
                pixel.light += samples * luminance([all[0], all[1], all[2]]);
            }
        });
        self.samples += samples;
        self.iterations += 1;
    }

    /// Counts for the next iteration, with `samples` samples per pixel on average. Their sum differs from `samples` times the number
    /// of pixels by at most two. Each count is a lower bound plus a multiple of the square root of variance / luminance^2, up to an
    /// upper bound. Both values are estimated over 3 x 3 pixels. This minimises the mean relative error: the sum of variance / (count
    /// luminance^2) (Neyman 1934, "On the Two Different Aspects of the Representative Method", optimum allocation). All
    /// counts are equal until each pixel has two samples.
    pub fn counts(&self, samples: u32) -> SampleCounts {
        let errors = if self.iterations < FIRST_WITHOUT_LAST { self.errors() } else { &self.without_last };
        counts_by(errors, samples, self.iterations)
    }

    /// As [`Allocation::counts`] for the iteration after the next one; `None` if they depend on the next one.
    pub fn counts_after_next(&self, samples: u32) -> Option<SampleCounts> {
        let next = self.iterations + 1;
        (next >= FIRST_WITHOUT_LAST).then(|| counts_by(self.errors(), samples, next))
    }

    /// The error of each pixel: the square root of variance / luminance^2, without infinities, and 0 only if all are 0 or unknown.
    fn errors(&self) -> &[f64] {
        self.errors.get_or_init(|| {
            if self.samples < 2.0 {
                return vec![0.0; self.pixels.len()];
            }
            let mut errors = self.relative_errors();
            let finite = errors.par_iter().with_min_len(CHUNK).copied().filter(|error| error.is_finite());
            let max_error = finite.reduce(|| 0.0, f64::max);
            // Infinite errors are reduced to the maximum finite one. Errors of 0 are raised to a small fraction of it.
            let clamp = |error: &mut f64| *error = error.clamp(MIN_RELATIVE_ERROR * max_error, max_error);
            errors.par_iter_mut().with_min_len(CHUNK).for_each(clamp);
            errors
        })
    }

    /// Square root of variance / luminance^2 per pixel, both estimated over 3 x 3 pixels. Infinite if the sum of squares
    /// overflows.
    fn relative_errors(&self) -> Vec<f64> {
        let (width, height) = (self.width, self.pixels.len() / self.width);
        let light = sum_of_chunks(&self.pixels, |pixels| [pixels.iter().map(|p| p.light).sum()])[0];
        let light = light / self.pixels.len() as f64;
        let dark = (DARK_FRACTION * light / self.samples).powi(2);
        let error = |i: usize| {
            let (x, y) = (i % width, i / width);
            let (mut spread, mut freedom, mut light, mut pixels) = (0.0, 0.0, 0.0, 0.0);
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for pixel in &self.pixels[row * width..][x.saturating_sub(1)..(x + 2).min(width)] {
                    spread += (pixel.squares - pixel.sum * pixel.sum / pixel.samples).max(0.0);
                    freedom += pixel.samples - 1.0;
                    light += pixel.light;
                    pixels += 1.0;
                }
            }
            let mean = light / (pixels * self.samples);
            let relative = spread / freedom / (mean * mean + dark);
            if relative.is_nan() { 0.0 } else { relative.sqrt() }
        };
        (0..self.pixels.len()).into_par_iter().with_min_len(CHUNK).map(error).collect()
    }
}

#[warn(missing_docs)]
impl Renderer {
    /// Minimum and maximum number of samples of a pixel of the crop so far. Both equal [`Film::samples`] if the sampling is
    /// uniform.
    pub fn samples_in_pixels(&self) -> [u64; 2] {
        let samples = self.samples_of_pixels();
        let average = self.rendered().samples;
        [samples.iter().min().map_or(average, |&n| n.into()), samples.iter().max().map_or(average, |&n| n.into())]
    }

    /// Number of samples of each pixel of the crop so far, row-major; empty if each has [`Film::samples`].
    #[doc(hidden)]
    pub fn samples_of_pixels(&self) -> Vec<u32> {
        match &self.sums.get().allocation {
            Some(allocation) if !self.plan.dark => allocation.pixels.iter().map(|pixel| pixel.samples as u32).collect(),
            _ => vec![],
        }
    }
}

/// Number of pixels that a thread takes at a time. Sums do not depend on the number of threads.
const CHUNK: usize = 1 << 12;

/// Sums over all chunks of `items`, added in the order of the chunks. `of_chunk` gives those of a chunk.
fn sum_of_chunks<T: Sync, const N: usize>(items: &[T], of_chunk: impl Fn(&[T]) -> [f64; N] + Send + Sync) -> [f64; N] {
    let sums: Vec<[f64; N]> = items.par_chunks(CHUNK).map(of_chunk).collect();
    sums.into_iter().fold([0.0; N], |sum, of_chunk| std::array::from_fn(|k| sum[k] + of_chunk[k]))
}

/// The factor f for which min(f error, `max`) has the average `wanted` < `max`; errors are positive. Pixels at the upper
/// bound return their excess, and the next pass shares it among the others in proportion. So f only grows, and the search
/// ends when no further pixel reaches the bound.
fn factor(errors: &[f64], wanted: f64, max: f64) -> f64 {
    let mut factor = 0.0;
    for _ in 0..MAX_PASSES {
        // The number of pixels at the bound, and the sum of the errors of all others.
        let [full, free] = sum_of_chunks(errors, |errors| {
            let add = |[full, free]: [f64; 2], &error: &f64| match factor * error >= max {
                true => [full + 1.0, free],
                false => [full, free + error],
            };
            errors.iter().fold([0.0; 2], add)
        });
        let next = (wanted * errors.len() as f64 - full * max) / free;
        if next.is_nan() || next <= factor * (1.0 + 1e-9) {
            break;
        }
        factor = next;
    }
    factor
}

/// Counts for iteration `iteration` in proportion to `errors`, see [`Allocation::counts`].
fn counts_by(errors: &[f64], samples: u32, iteration: u32) -> SampleCounts {
    if samples == 1 || errors.iter().all(|&error| error == 0.0) {
        return SampleCounts::Uniform(samples);
    }
    let wanted = f64::from(samples);
    let (min, max) = ((MIN_SHARE * wanted).max(1.0), f64::from(MAX_SHARE * samples));
    let factor = factor(errors, wanted - min, max - min);
    round_shares(errors.iter().map(|&error| (min + factor * error).min(max)), iteration)
}

/// Rounds `shares` to whole numbers, at least 1. Each pixel passes its rounding error on to the next pixel. So every
/// count differs from the exact value by at most one, and so does the sum over every row-major range of pixels. The first
/// carried error changes with the `iteration`, so that no pixel is always rounded down.
fn round_shares(shares: impl Iterator<Item = f64>, iteration: u32) -> SampleCounts {
    let golden = 0.618_033_988_749_895;
    let mut carried = (golden * f64::from(iteration)).fract() - 0.5;
    let round = |share: f64| {
        let count = (share + carried).round().max(1.0);
        carried += share - count;
        count as u8
    };
    SampleCounts::PerPixel(shares.map(round).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 x 10 pixels after an iteration with four samples each. The mean luminance of each pixel is 1; `squares` gives the
    /// sum of its squared luminances.
    fn after(squares: impl Fn(usize) -> f32) -> Allocation {
        let mut allocation = Allocation::new(20, 200);
        let film: Vec<[f32; 4]> = (0..200).map(|i| [1.0, 1.0, 1.0, squares(i)]).collect();
        allocation.add(&film, &[1.0; 600], &SampleCounts::Uniform(4), 4);
        allocation
    }

    fn counts(allocation: &Allocation, samples: u32) -> Vec<u32> {
        let counts = allocation.counts(samples);
        (0..200).map(|pixel| counts.of(pixel)).collect()
    }

    #[test]
    fn samples_are_even_until_errors_are_known() {
        let fresh = Allocation::new(20, 200);
        assert_eq!(fresh.counts(4), SampleCounts::Uniform(4));
        assert_eq!(after(|_| 4.0).counts(4), SampleCounts::Uniform(4), "all samples are equal");
        assert_eq!(after(|_| 9.0).counts(1), SampleCounts::Uniform(1));
        assert!(counts(&after(|_| 9.0), 4).iter().all(|&n| n == 4), "all pixels have the same error");
    }

    #[test]
    fn samples_go_where_the_error_is() {
        // The variance is (40 - 4) / 3 in the left half and (13 - 4) / 3 in the right half: the ratio of the roots is 2.
        let allocation = after(|i| if i % 20 < 10 { 40.0 } else { 13.0 });
        let pixel = counts(&allocation, 8);
        let sum = |columns: std::ops::Range<usize>| -> u32 {
            (0..200).filter(|i| columns.contains(&(i % 20))).map(|i| pixel[i]).sum()
        };
        assert!(sum(0..20).abs_diff(8 * 200) <= 1, "{}", sum(0..20));
        // Nine columns per half, away from the border between the halves: 2 + 2 f and 2 + f have the mean 8, so f = 4.
        assert!(sum(0..9).abs_diff(10 * 90) <= 2 && sum(11..20).abs_diff(6 * 90) <= 2, "{} {}", sum(0..9), sum(11..20));
    }

    /// The image has several parts, and the last one is not full.
    #[test]
    fn every_pixel_learns_from_its_own_samples() {
        let pixels = 2 * CHUNK + 77;
        let counts = SampleCounts::PerPixel((0..pixels).map(|i| 1 + (i % 9) as u8).collect());
        let film: Vec<[f32; 4]> = (0..pixels).map(|i| [i as f32, 0.5, 2.0, 3.0 + i as f32]).collect();
        let image: Vec<f32> = (0..3 * pixels).map(|i| i as f32).collect();
        let mut allocation = Allocation::new(pixels as u32, pixels as u64);
        allocation.add(&film, &image, &counts, 5);
        for (i, pixel) in allocation.pixels.iter().enumerate() {
            let count = 1.0 + (i % 9) as f64;
            let light = 5.0 * luminance([0, 1, 2].map(|k| image[3 * i + k]));
            let wanted = [count, count * luminance([i as f32, 0.5, 2.0]), 3.0 + i as f64, light];
            assert_eq!([pixel.samples, pixel.sum, pixel.squares, pixel.light], wanted, "pixel {i}");
        }
        let parts = sum_of_chunks(&allocation.pixels, |part| [part.len() as f64, part.iter().map(|p| p.samples).sum()]);
        assert_eq!(parts, [pixels as f64, (0..pixels).map(|i| 1.0 + (i % 9) as f64).sum()]);
    }

    #[test]
    fn no_pixel_has_none_and_none_has_all() {
        for samples in [2, 3, 4, 16] {
            let pixel = counts(&after(|i| if i == 105 { 1e9 } else { 4.0 }), samples);
            let [min, max] = [pixel.iter().min().unwrap(), pixel.iter().max().unwrap()];
            assert!(*min >= (samples / 4).max(1) && *max == 4 * samples, "{samples}: {min} to {max}");
            assert!(*max <= MAX_SAMPLES_PER_PIXEL);
            // Nine pixels have the maximum; all others share the rest evenly.
            let rest = f64::from(200 * samples - 9 * max) / 191.0;
            assert!(pixel.iter().all(|&n| n == *max || (f64::from(n) - rest).abs() < 1.0));
            assert!(pixel.iter().sum::<u32>().abs_diff(200 * samples) <= 1);
        }
    }

    #[test]
    fn squares_beyond_all_floats_are_the_greatest_error() {
        let pixel = counts(&after(|i| if i == 105 { f32::INFINITY } else { 5.0 + (i % 7) as f32 }), 4);
        assert!(pixel[105] > 4 && pixel.iter().sum::<u32>().abs_diff(800) <= 1, "{}", pixel[105]);
    }

    #[test]
    fn what_is_cut_off_changes_place() {
        let mut allocation = after(|i| 5.0 + i as f32);
        let first = counts(&allocation, 2);
        allocation.iterations += 1;
        let second = counts(&allocation, 2);
        assert_ne!(first, second);
        assert!(first.iter().zip(&second).all(|(a, b)| a.abs_diff(*b) <= 1));
    }

    /// The image has an even error, and `right` finds another in the last of `iterations`.
    fn with_another_last(iterations: u32, right: f32) -> Allocation {
        let mut allocation = after(|_| 20.0);
        for iteration in 1..iterations {
            let right = if iteration == iterations - 1 { right } else { 20.0 };
            let film: Vec<[f32; 4]> =
                (0..200).map(|i| [1.0, 1.0, 1.0, if i % 20 < 10 { 20.0 } else { right }]).collect();
            allocation.add(&film, &[1.0; 600], &SampleCounts::Uniform(4), 4);
        }
        allocation
    }

    #[test]
    fn samples_follow_the_last_iteration_only_in_the_first_ones() {
        for iterations in [2, 3, 4, 9] {
            let [even, uneven] = [20.0, 900.0].map(|right| counts(&with_another_last(iterations, right), 8));
            assert!(even.iter().all(|&n| n == 8));
            assert_eq!(even != uneven, iterations < FIRST_WITHOUT_LAST, "after {iterations} iterations");
        }
        // The iteration after the next one follows it.
        let mut allocation = with_another_last(4, 900.0);
        let early = allocation.counts_after_next(8);
        allocation.add(&[[1.0, 1.0, 1.0, 20.0]; 200], &[1.0; 600], &SampleCounts::Uniform(4), 4);
        assert!(counts(&allocation, 8)[19] > counts(&allocation, 8)[0]);
        assert_eq!(early, Some(allocation.counts(8)));
        assert_eq!(after(|_| 20.0).counts_after_next(8), None, "they depend on the next iteration");
    }

    #[test]
    fn a_render_that_goes_on_has_the_same_counts() {
        for iterations in [1, 2, 3, 4, 9] {
            let [mut whole, mut resumed] = [(); 2].map(|()| with_another_last(iterations, 900.0));
            let state = resumed.state();
            resumed = Allocation::new(20, 200);
            resumed.resume(&state);
            for _ in 0..3 {
                assert_eq!(whole.counts(5), resumed.counts(5), "after {iterations} iterations");
                for allocation in [&mut whole, &mut resumed] {
                    let counts = allocation.counts(5);
                    let film: Vec<[f32; 4]> = (0..200).map(|i| [1.0, 1.0, 1.0, 9.0 + i as f32]).collect();
                    allocation.add(&film, &[1.0; 600], &counts, 5);
                }
            }
            // Merged sums lack the errors.
            resumed.resume(&AdaptiveState { errors: None, ..whole.state() });
            assert_eq!(resumed.without_last, whole.errors());
        }
    }

    #[test]
    fn a_restart_clears_the_film() {
        let mut allocation = with_another_last(5, 900.0);
        allocation.counts(4);
        allocation.restart();
        assert_eq!(allocation.counts(4), SampleCounts::Uniform(4));
        assert!(allocation.state() == Allocation::new(20, 200).state());
    }
}
