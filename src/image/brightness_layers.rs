//! Damps fireflies: rare samples that are much brighter than all others around them. The film keeps the sums of its iterations by
//! brightness as well. A layer of brightness counts fully only if enough values of about this brightness fell into a pixel and its
//! neighbours. See Zirr, Hanika and Dachsbacher 2018, "Re-weighting Firefly Samples for Improved Finite-Sample Monte Carlo Estimates".
//!
//! The damped image is biased: it is too dark where light is rare. Every layer that receives light at all counts fully after enough
//! iterations, so the bias vanishes.

#![warn(missing_docs)]

use rayon::prelude::*;

use crate::image::luminance;

/// Number of layers above the lowest one.
pub const LAYERS: usize = 7;
/// Binary logarithm of the ratio of the brightness of two layers.
const STEP: f32 = 3.0;
/// The lowest layer lies this many steps below the median brightness.
const STEPS_BELOW_MEDIAN: f32 = 2.0;
/// Numbers of further values with which a layer counts fully, in a pixel and its eight neighbours, and in the pixel alone: these, times
/// the root of the number of iterations (docs/notebook/fireflies.md).
const ENOUGH_AROUND: f32 = 8.0;
const ENOUGH_IN_PIXEL: f32 = 2.0;

/// Sums of w r, w g and w b over the values of a layer, and the number of these values. A value between two layers counts in both, with
/// weights that add up to 1.
type Layer = [f32; 4];

/// The iterations of an image by their brightness.
#[derive(Debug, Clone)]
pub struct BrightnessLayers {
    width: usize,
    /// Binary logarithm of the luminance of the lowest layer; `None` before the first iteration with light.
    lowest: Option<f32>,
    /// Per pixel, the layers above the lowest one.
    pixels: Vec<[Layer; LAYERS]>,
}

impl BrightnessLayers {
    /// Layers without values, of an image of this size.
    pub fn new(width: u32, height: u32) -> BrightnessLayers {
        let pixels = vec![[[0.0; 4]; LAYERS]; width as usize * height as usize];
        BrightnessLayers { width: width as usize, lowest: None, pixels }
    }

    /// Adds an iteration, see [`crate::image::film::Film::add`].
    pub fn add(&mut self, rgb: &[f32], samples: u32) {
        let Some(lowest) = self.lowest.or_else(|| lowest_layer(rgb)) else { return };
        self.lowest = Some(lowest);
        let (pixels, _) = rgb.as_chunks::<3>();
        self.pixels.par_iter_mut().zip(pixels).with_min_len(1 << 12).for_each(|(layers, &rgb)| {
            let at = (log2(luminance(rgb) as f32) - lowest) / STEP;
            let at = at.clamp(0.0, LAYERS as f32);
            let above = at.ceil() as usize;
            let weight = at - (above as f32 - 1.0);
            for (layer, weight) in [(above, weight), (above.wrapping_sub(1), 1.0 - weight)] {
                if let Some(layer) = layer.checked_sub(1).and_then(|k| layers.get_mut(k)) {
                    (0..3).for_each(|k| layer[k] = (layer[k] + weight * samples as f32 * rgb[k]).min(f32::MAX));
                    layer[3] += weight;
                }
            }
        });
    }

    /// Adds the layers of other iterations of the same image. The order of the parts changes only the last bits, except for values
    /// outside of the layers of a part.
    pub fn merge(&mut self, other: &BrightnessLayers) {
        let Some(lowest_of_other) = other.lowest else { return };
        let lowest = self.lowest.unwrap_or(lowest_of_other);
        let common = lowest.max(lowest_of_other);
        let steps = |lowest: f32| ((common - lowest) / STEP).round() as usize;
        let (down, down_other) = (steps(lowest), steps(lowest_of_other));
        self.lowest = Some(common);
        self.pixels.par_iter_mut().zip(&other.pixels).with_min_len(1 << 12).for_each(|(pixel, other)| {
            let mut sum = [[0.0; 4]; LAYERS];
            for (layers, down) in [(*pixel, down), (*other, down_other)] {
                for (to, from) in sum.iter_mut().zip(layers.iter().skip(down)) {
                    (0..4).for_each(|k| to[k] = (to[k] + from[k]).min(f32::MAX));
                }
            }
            *pixel = sum;
        });
    }

    /// Binary logarithm of the luminance of the lowest layer; `None` if all iterations are black.
    pub(super) fn lowest(&self) -> Option<f32> {
        self.lowest
    }

    /// Per pixel and layer above the lowest one: the three sums of w x, and the number of values.
    pub(super) fn values(&self) -> impl Iterator<Item = f32> {
        self.pixels.iter().flatten().flatten().copied()
    }

    /// The layers with these [`BrightnessLayers::values`]. `None` if a number is not finite.
    pub(super) fn from_values(width: u32, lowest: Option<f32>, values: Vec<f32>) -> Option<BrightnessLayers> {
        let is_finite = values.iter().chain(&lowest).all(|x| x.is_finite());
        let pixels = values.as_chunks::<4>().0.as_chunks::<LAYERS>().0.to_vec();
        is_finite.then_some(BrightnessLayers { width: width as usize, lowest, pixels })
    }

    /// RGB per pixel of the light that damping takes from the mean over `samples` samples per pixel in this number of iterations.
    pub fn excess(&self, samples: u64, iterations: u32) -> Vec<f32> {
        let root = (iterations as f32).sqrt();
        let (around, in_pixel) = (ENOUGH_AROUND * root, ENOUGH_IN_PIXEL * root);
        let height = self.pixels.len() / self.width;
        let of_pixel = |i: usize| {
            let (x, y) = (i % self.width, i / self.width);
            let mut counts = [0.0; LAYERS + 1];
            let mut neighbours = 0.0;
            for y in y.saturating_sub(1)..(y + 2).min(height) {
                for x in x.saturating_sub(1)..(x + 2).min(self.width) {
                    neighbours += 1.0;
                    self.pixels[y * self.width + x].iter().zip(&mut counts).for_each(|(layer, sum)| *sum += layer[3]);
                }
            }
            let mut excess = [0.0; 3];
            for k in 1..LAYERS {
                // Values of about this brightness are in the layers above and below too.
                let own = self.pixels[i][k - 1][3]
                    + self.pixels[i][k][3]
                    + self.pixels[i].get(k + 1).map_or(0.0, |layer| layer[3]);
                let all = (counts[k - 1] + counts[k] + counts[k + 1]) * 9.0 / neighbours;
                let reliability = ((all - 1.0) / around).max((own - 1.0) / in_pixel).clamp(0.0, 1.0);
                let layer = self.pixels[i][k];
                (0..3).for_each(|c| excess[c] += (1.0 - reliability) * layer[c] / samples as f32);
            }
            excess
        };
        (0..self.pixels.len()).into_par_iter().with_min_len(1 << 12).flat_map_iter(of_pixel).collect()
    }
}

/// Binary logarithm of the luminance of the lowest layer for an image; `None` if it has no light.
fn lowest_layer(rgb: &[f32]) -> Option<f32> {
    let mut lit: Vec<f32> =
        rgb.as_chunks::<3>().0.iter().map(|&rgb| luminance(rgb) as f32).filter(|&x| x > 0.0).collect();
    if lit.is_empty() {
        return None;
    }
    let middle = lit.len() / 2;
    let (_, median, _) = lit.select_nth_unstable_by(middle, f32::total_cmp);
    Some(STEP * ((log2(*median) / STEP).floor() - STEPS_BELOW_MEDIAN))
}

/// Binary logarithm of a positive number, linear between powers of two, so that all machines agree; -127 or more.
fn log2(x: f32) -> f32 {
    x.max(0.0).to_bits() as f32 / (1u32 << (f32::MANTISSA_DIGITS - 1)) as f32 - 127.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The image of an iteration of 8 x 8 pixels: noise around 1, and dots.
    fn noise(number: u32, dots: &[(usize, f32)]) -> Vec<f32> {
        let value = |pixel: usize| {
            let random = (pixel as u32 * 31 + number * 17 + 5).wrapping_mul(2_654_435_761) >> 24;
            let dot = dots.iter().find(|(at, _)| *at == pixel).map_or(0.0, |(_, value)| *value);
            0.5 + random as f32 / 256.0 + dot
        };
        (0..64).flat_map(|pixel| [value(pixel), 0.5 * value(pixel), 2.0 * value(pixel)]).collect()
    }

    /// The layers of these iterations, and the numbers of samples and iterations.
    fn layers(iterations: impl IntoIterator<Item = (u32, Vec<f32>)>) -> (BrightnessLayers, [u32; 2]) {
        let mut layers = BrightnessLayers::new(8, 8);
        let mut all = [0; 2];
        for (samples, image) in iterations {
            layers.add(&image, samples);
            all = [all[0] + samples, all[1] + 1];
        }
        (layers, all)
    }

    fn excess(layers: &BrightnessLayers, [samples, iterations]: [u32; 2]) -> Vec<f32> {
        layers.excess(samples.into(), iterations)
    }

    #[test]
    fn a_single_dot_disappears_and_its_surroundings_stay() {
        let dot = 5000.0;
        let dots = |i: u32| if i == 7 { vec![(27, dot)] } else { vec![] };
        let (layers, count) = layers((0..20).map(|i| (4, noise(i, &dots(i)))));
        let excess = excess(&layers, count);
        for (i, &excess) in excess.iter().enumerate() {
            let expected = if i / 3 == 27 { [1.0, 0.5, 2.0][i % 3] * (dot + 1.0) / 20.0 } else { 0.0 };
            assert!((excess - expected).abs() <= 1e-3 * expected, "{i}: {excess} {expected}");
        }
    }

    #[test]
    fn light_that_returns_or_has_bright_neighbours_stays() {
        // A lamp of one pixel, in every iteration; and in each iteration another dot of an area.
        let area = [33, 34, 35, 41, 42, 43, 49, 50, 51];
        let (layers, count) = layers((0..400).map(|i| (4, noise(i, &[(9, 5000.0), (area[i as usize % 9], 5000.0)]))));
        assert!(excess(&layers, count).iter().all(|&excess| excess == 0.0));
    }

    #[test]
    fn the_bias_falls_with_the_number_of_iterations() {
        // One iteration of ten has the dot, so a tenth of its light is expected.
        let share = |count: u32| {
            let (layers, count) =
                layers((0..count).map(|i| (2, noise(i, if i % 10 == 3 { &[(27, 900.0)] } else { &[] }))));
            excess(&layers, count)[3 * 27] / 90.0
        };
        let [few, more, many] = [10, 150, 10_000].map(share);
        assert!(few > 0.99 && (0.2..0.8).contains(&more) && many == 0.0, "{few} {more} {many}");
    }

    #[test]
    fn parts_merge_to_the_whole() {
        // The brightness of the first iteration of a part chooses its layers.
        let image = |i: u32| noise(i, if i.is_multiple_of(5) { &[(27, 700.0), (28, 0.3)] } else { &[] });
        let dim = |i: u32| image(i).iter().map(|x| if i == 20 { 0.1 * x } else { *x }).collect::<Vec<f32>>();
        let all = |numbers: std::ops::Range<u32>| layers(numbers.map(|i| (1 + i % 4, dim(i))));
        let (whole, count) = all(0..40);
        let (first, second, black) = (all(0..20).0, all(20..40).0, BrightnessLayers::new(8, 8));
        assert!(first.lowest() != second.lowest());
        for parts in [[&first, &second, &black], [&black, &second, &first]] {
            let mut sum = parts[0].clone();
            parts[1..].iter().for_each(|part| sum.merge(part));
            assert_eq!(sum.lowest(), whole.lowest());
            for (a, b) in excess(&sum, count).iter().zip(excess(&whole, count)) {
                assert!((a - b).abs() <= 1e-4 * b.abs(), "{a} {b}");
            }
        }
    }

    #[test]
    fn values_outside_of_the_layers_are_finite() {
        let image = |x: f32| vec![x; 192];
        let (black, count) = layers([(4, image(0.0))]);
        assert!(black.lowest().is_none() && excess(&black, count).iter().all(|&excess| excess == 0.0));
        let (extreme, count) = layers([1e-40, 1.0, f32::MAX, f32::MAX, 0.0].map(|x| (8, image(x))));
        assert!(excess(&extreme, count).iter().all(|&excess| excess.is_finite() && excess >= 0.0));
        let values: Vec<f32> = extreme.values().collect();
        assert!(BrightnessLayers::from_values(8, extreme.lowest(), values.clone()).is_some());
        assert!(BrightnessLayers::from_values(8, Some(f32::NAN), values).is_none());
    }

    #[test]
    fn the_logarithm_is_exact_at_powers_of_two_and_grows_between_them() {
        for (x, expected) in [(1.0, 0.0), (8.0, 3.0), (0.25, -2.0), (3.0, 1.5), (0.0, -127.0)] {
            assert_eq!(log2(x), expected, "{x}");
        }
    }
}
