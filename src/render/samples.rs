//! How many samples each pixel gets in an iteration: as many everywhere, or more where earlier iterations found more error.

use rayon::prelude::*;

use super::emitters::luminance;

/// Samples a pixel in one iteration at most, on average over the pixels.
pub const MAX_AVERAGE_SAMPLES: u32 = 16;
/// No pixel has more than so many times the average.
const MAX_SHARE: u32 = 4;
/// And none less than this part of it, nor than one, whatever was found: where no light was seen there may be some.
const MIN_SHARE: f64 = 0.25;
/// Samples in one pixel and iteration at most.
pub const MAX_SAMPLES_PER_PIXEL: u32 = MAX_AVERAGE_SAMPLES * MAX_SHARE;
/// Part of the image's mean below which an error counts as that part of it does: that of relMSE.
const DARK_FRACTION: f64 = 0.01;
/// Part of the greatest error that every pixel is taken to have at least.
const MIN_RELATIVE_ERROR: f64 = 1e-6;
/// Passes over all pixels that look for the factor of their shares; it is found when no more of them have their most.
const MAX_PASSES: u32 = 64;

/// Samples of the pixels of the crop in one iteration.
#[derive(Debug, Clone, PartialEq)]
pub enum SampleCounts {
    /// As many in every pixel.
    Uniform(u32),
    /// Row-major, 1 to [`MAX_SAMPLES_PER_PIXEL`] each.
    PerPixel(Vec<u8>),
}

impl SampleCounts {
    /// Of a pixel of the crop, row-major.
    pub fn of(&self, pixel: u32) -> u32 {
        match self {
            SampleCounts::Uniform(samples) => *samples,
            SampleCounts::PerPixel(counts) => counts[pixel as usize].into(),
        }
    }

    /// The greatest of all.
    pub fn max(&self) -> u32 {
        match self {
            SampleCounts::Uniform(samples) => *samples,
            SampleCounts::PerPixel(counts) => counts.iter().copied().max().unwrap_or(0).into(),
        }
    }
}

/// What a pixel's samples were so far.
#[derive(Debug, Clone, Copy, Default)]
struct PixelStats {
    samples: f64,
    /// Luminances of the samples and their squares, added up.
    sum: f64,
    squares: f64,
    /// The pixel's luminance, that of t = 1 included, times the samples a pixel of its iteration.
    light: f64,
}

/// Gives samples to the pixels by the error that earlier iterations found in them. What an iteration renders stays unbiased:
/// its counts are known before it begins, every pixel has a sample, and iterations are weighed by their average, never by the
/// counts of a pixel.
pub struct Allocation {
    width: usize,
    pixels: Vec<PixelStats>,
    /// Samples a pixel so far, on average.
    samples: f64,
    iterations: u32,
}

impl Allocation {
    /// For a crop of `width` pixels across.
    pub fn new(width: u32, pixels: u64) -> Allocation {
        Allocation {
            width: width as usize,
            pixels: vec![PixelStats::default(); pixels as usize],
            samples: 0.0,
            iterations: 0,
        }
    }

    pub fn restart(&mut self) {
        self.pixels.fill(PixelStats::default());
        (self.samples, self.iterations) = (0.0, 0);
    }

    /// Adds an iteration of `samples` samples a pixel, given to the pixels by `counts`. `film`: means of the sensor's samples,
    /// w the sum of their squared luminances; `image`: RGB of the same with all other light.
    pub fn add(&mut self, film: &[[f32; 4]], image: &[f32], counts: &SampleCounts, samples: u32) {
        let samples = f64::from(samples);
        let pixels = self.pixels.iter_mut().zip(film).zip(image.chunks_exact(3));
        for (i, ((pixel, &[r, g, b, squares]), all)) in pixels.enumerate() {
            let count = f64::from(counts.of(i as u32));
            pixel.samples += count;
            pixel.sum += count * luminance([r, g, b]);
            pixel.squares += f64::from(squares);
            pixel.light += samples * luminance([all[0], all[1], all[2]]);
        }
        self.samples += samples;
        self.iterations += 1;
    }

    /// Least and most samples that a pixel has had.
    pub fn range(&self) -> [u64; 2] {
        let samples = || self.pixels.iter().map(|pixel| pixel.samples as u64);
        [samples().min().unwrap_or(0), samples().max().unwrap_or(0)]
    }

    /// Counts for an iteration of `samples` samples a pixel, the same sum over the pixels to one or two: in proportion to
    /// the root of the variance of a sample over the squared light of the pixel, both of 3 x 3 pixels together, within
    /// bounds: the mean of relative errors, sum of variance over count and squared light, is least so (Neyman 1934, "On the Two
    /// Different Aspects of the Representative Method", optimum allocation). As many everywhere until each pixel has two samples.
    pub fn counts(&self, samples: u32) -> SampleCounts {
        if samples == 1 || self.samples < 2.0 {
            return SampleCounts::Uniform(samples);
        }
        let mut errors = self.relative_errors();
        let max_error = errors.iter().copied().filter(|error| error.is_finite()).fold(0.0, f64::max);
        if max_error == 0.0 {
            return SampleCounts::Uniform(samples);
        }
        // Infinite errors count as the greatest finite one, and errors of 0 as a small part of it.
        errors.iter_mut().for_each(|error| *error = error.clamp(MIN_RELATIVE_ERROR * max_error, max_error));
        let wanted = f64::from(samples);
        let (min, max) = ((MIN_SHARE * wanted).max(1.0), f64::from(MAX_SHARE * samples));
        let factor = factor(&errors, wanted - min, max - min);
        self.round_shares(errors.iter().map(|&error| (min + factor * error).min(max)))
    }

    /// Root of the variance of a pixel's sample over the squared light, of 3 x 3 pixels together; infinite where squares are
    /// beyond all floats.
    fn relative_errors(&self) -> Vec<f64> {
        let (width, height) = (self.width, self.pixels.len() / self.width);
        let light = self.pixels.iter().map(|f| f.light).sum::<f64>() / self.pixels.len() as f64;
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
        (0..self.pixels.len()).into_par_iter().with_min_len(1 << 12).map(error).collect()
    }

    /// Whole numbers that differ from `shares` by less than one, their sums in every part of the image too: what is cut off a
    /// pixel is given to the next. Where it begins changes from iteration to iteration, so that none is always cut.
    fn round_shares(&self, shares: impl Iterator<Item = f64>) -> SampleCounts {
        let golden = 0.618_033_988_749_895;
        let mut carried = (golden * f64::from(self.iterations)).fract() - 0.5;
        let round = |share: f64| {
            let count = (share + carried).round().max(1.0);
            carried += share - count;
            count as u8
        };
        SampleCounts::PerPixel(shares.map(round).collect())
    }
}

/// The factor f for which min(f error, most) has the average `wanted` < `max`; errors are positive. What pixels cannot take that
/// have their most goes to the others in the next pass, so f only grows.
fn factor(errors: &[f64], wanted: f64, max: f64) -> f64 {
    let mut factor = 0.0;
    for _ in 0..MAX_PASSES {
        let (mut left, mut free) = (wanted * errors.len() as f64, 0.0);
        for &error in errors {
            if factor * error >= max {
                left -= max;
            } else {
                free += error;
            }
        }
        let next = left / free;
        if next.is_nan() || next <= factor * (1.0 + 1e-9) {
            break;
        }
        factor = next;
    }
    factor
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 x 10 pixels after an iteration of four samples each: the sum of squares of each pixel's luminance, whose mean is 1.
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
        assert_eq!(after(|_| 4.0).counts(4), SampleCounts::Uniform(4), "no sample differs from another");
        assert_eq!(after(|_| 9.0).counts(1), SampleCounts::Uniform(1));
        assert!(counts(&after(|_| 9.0), 4).iter().all(|&n| n == 4), "as much error everywhere");
    }

    #[test]
    fn samples_go_where_the_error_is() {
        // The left half has a variance of (40 - 4) / 3, the right one of (13 - 4) / 3: a root twice as great.
        let allocation = after(|i| if i % 20 < 10 { 40.0 } else { 13.0 });
        let pixel = counts(&allocation, 8);
        let sum = |columns: std::ops::Range<usize>| -> u32 {
            (0..200).filter(|i| columns.contains(&(i % 20))).map(|i| pixel[i]).sum()
        };
        assert!(sum(0..20).abs_diff(8 * 200) <= 1, "{}", sum(0..20));
        // Nine columns each away from the border: 2 + 2 f and 2 + f have the mean 8, so f = 4.
        assert!(sum(0..9).abs_diff(10 * 90) <= 2 && sum(11..20).abs_diff(6 * 90) <= 2, "{} {}", sum(0..9), sum(11..20));
    }

    #[test]
    fn no_pixel_has_none_and_none_has_all() {
        for samples in [2, 3, 4, 16] {
            let pixel = counts(&after(|i| if i == 105 { 1e9 } else { 4.0 }), samples);
            let [min, max] = [pixel.iter().min().unwrap(), pixel.iter().max().unwrap()];
            assert!(*min >= (samples / 4).max(1) && *max == 4 * samples, "{samples}: {min} to {max}");
            assert!(*max <= MAX_SAMPLES_PER_PIXEL);
            // Nine pixels have that much, all others share the rest alike.
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

    #[test]
    fn a_restart_clears_the_film() {
        let mut allocation = after(|i| i as f32);
        allocation.restart();
        assert_eq!(allocation.counts(4), SampleCounts::Uniform(4));
    }
}
