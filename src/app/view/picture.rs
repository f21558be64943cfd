//! Pictures of the render so far, and their binary form for the page.

use std::time::Duration;

use half::f16;
use half::slice::HalfFloatSliceExt;
use taugate::internals::render::{Renderer, luminance};

use super::board::Surfaces;
use super::message::Layer;

/// Bytes of the header in front of the pixels.
const HEADER: usize = 40;
/// The largest value of a picture is scaled to this half float, well below the largest finite one.
const LARGEST_HALF: f32 = 32768.0;
/// A picture contains the images of all responses only if they have at most this many values.
const MAX_RESPONSE_VALUES: usize = 1 << 28;
/// Written instead of the number of a response if the picture shows the sum of several responses.
const SUM: u32 = u32::MAX;
/// Minimum time between two pictures of one image, which gets better slowly; and between any two, as while a camera moves.
pub const BETWEEN_PICTURES: Duration = Duration::from_millis(100);
pub const BETWEEN_FRAMES: Duration = Duration::from_millis(25);

/// The render at one moment. Arrays have three channels per pixel, row 0 at the top.
pub struct Picture {
    pub revision: u32,
    pub size: [u32; 2],
    /// Samples per pixel, on average.
    pub samples: u64,
    /// Samples of each pixel; empty if each has the average.
    pub samples_of_pixels: Vec<u32>,
    /// Means of the sum of all responses.
    pub mean: Vec<f32>,
    /// Variances of `mean`; empty before two iterations.
    pub variance: Vec<f32>,
    /// Number of responses.
    pub count: u32,
    /// Means of each response, one image after the other; empty if there is one response, or if there are too many.
    pub responses: Vec<f32>,
}

impl Picture {
    /// The picture of a render so far.
    pub fn new(renderer: &Renderer, revision: u32) -> Picture {
        let film = renderer.film();
        let variance = if film.iterations() < 2 { vec![] } else { film.variance_of_mean() };
        let mean = film.shown();
        let count = renderer.response_count();
        let fits = count * mean.len() <= MAX_RESPONSE_VALUES;
        // If the device is lost, the next iteration says so.
        let images = if fits { renderer.responses().ok().flatten() } else { None };
        let responses = images.map(|film| (0..count).flat_map(|k| film.mean(k)).collect());
        Picture {
            revision,
            size: [film.width(), film.height()],
            samples: film.samples(),
            samples_of_pixels: renderer.samples_of_pixels(),
            mean,
            variance,
            count: count as u32,
            responses: responses.unwrap_or_default(),
        }
    }

    fn values(&self) -> usize {
        self.mean.len()
    }

    /// The image of a response. `None` if the picture does not contain it.
    fn of_response(&self, response: u32) -> Option<&[f32]> {
        let begin = response as usize * self.values();
        self.responses.get(begin..begin + self.values())
    }

    /// The image of `response` if the picture contains it; otherwise the sum of all responses.
    pub fn shown(&self, response: u32) -> &[f32] {
        self.of_response(response).unwrap_or(&self.mean)
    }

    /// The number of the response in the header of a picture that shows `response`.
    pub fn response_shown(&self, layer: Layer, response: u32) -> u32 {
        let is_sum = self.count > 1 && (layer == Layer::Error || self.of_response(response).is_none());
        if is_sum { SUM } else { response }
    }

    /// Finds the pixel of this picture that covers pixel (x, y) of the full image, which has `full` pixels. Returns the index of
    /// the first channel of this pixel; `None` outside the image.
    pub fn at(&self, [x, y]: [u32; 2], full: [u32; 2]) -> Option<usize> {
        let [width, height] = self.size;
        let scaled = |i: u32, size: u32, full: u32| {
            (i < full).then(|| (u64::from(i) * u64::from(size) / u64::from(full)) as usize)
        };
        Some(3 * (scaled(y, height, full[1])? * width as usize + scaled(x, width, full[0])?))
    }

    /// Number of samples of the pixel whose first channel is `at`.
    pub fn samples_at(&self, at: usize) -> u64 {
        self.samples_of_pixels.get(at / 3).map_or(self.samples, |&samples| samples.into())
    }

    /// Luminances of the pixel whose first channel is `at`, in each response. `None` if `responses` is empty.
    pub fn histogram(&self, at: usize) -> Option<Vec<f32>> {
        let luminance_at = |image: &[f32]| luminance([image[at], image[at + 1], image[at + 2]]) as f32;
        (!self.responses.is_empty()).then(|| self.responses.chunks_exact(self.values()).map(luminance_at).collect())
    }

    /// The relative standard error of the luminance, repeated in all three channels; 0 where it is not known. The errors of the
    /// channels are taken as fully correlated, which is exact for grey light.
    fn relative_error(&self) -> Vec<f32> {
        if self.variance.is_empty() {
            return vec![0.0; self.values()];
        }
        let pixels = self.mean.as_chunks::<3>().0.iter().zip(self.variance.as_chunks::<3>().0);
        let error = pixels.map(|(&mean, variance)| {
            let light = luminance(mean);
            if light > 0.0 { (luminance(variance.map(f32::sqrt)) / light) as f32 } else { 0.0 }
        });
        error.flat_map(|error| [error; 3]).collect()
    }

    /// The binary message with this picture: a header of 40 bytes, then half floats, R, G, B of each pixel, row 0 at the top. A
    /// value is its half float times `scale`. The header is little-endian, in words of 32 bits unless noted:
    ///
    /// * "TGP1", `frame`, revision, width, height;
    /// * response, or [`SUM`] if the picture shows the sum of several responses;
    /// * layer (8 bits: 0 radiance, 1 relative error, 2 depth, 3 normals) and 24 bits 0;
    /// * samples per pixel, scale (f32), number of responses.
    ///
    /// Depths and normals come from `surfaces`, whose image has `full` pixels. Depths are in metres, in all three channels. Normals are
    /// linear values that look like (normal + 1) / 2 after the sRGB curve. Without surfaces, the picture shows the radiance.
    pub fn encode(
        &self,
        frame: u32,
        layer: Layer,
        response: u32,
        (surfaces, full): (Option<&Surfaces>, [u32; 2]),
    ) -> Vec<u8> {
        match (layer, surfaces) {
            (Layer::Error, _) => self.message(frame, self.size, layer, response, &self.relative_error()),
            (Layer::Depth, Some(surfaces)) => {
                let depths: Vec<f32> = surfaces.depth.iter().flat_map(|&depth| [depth; 3]).collect();
                self.message(frame, full, layer, response, &depths)
            }
            (Layer::Normal, Some(surfaces)) => {
                let colours: Vec<f32> = surfaces.normal.iter().flat_map(colour_of_normal).collect();
                self.message(frame, full, layer, response, &colours)
            }
            _ => self.message(frame, self.size, Layer::Mean, response, self.shown(response)),
        }
    }

    /// The message with these values.
    fn message(&self, frame: u32, size: [u32; 2], layer: Layer, response: u32, values: &[f32]) -> Vec<u8> {
        let largest = values.iter().copied().fold(0.0f32, f32::max);
        let scale = if largest > 0.0 { (largest / LARGEST_HALF).max(f32::MIN_POSITIVE) } else { 1.0 };
        let scaled: Vec<f32> = values.iter().map(|value| value / scale).collect();
        let mut halves = vec![f16::ZERO; values.len()];
        halves.convert_from_f32_slice(&scaled);

        let mut message = Vec::with_capacity(HEADER + 2 * halves.len());
        message.extend(b"TGP1");
        let response = self.response_shown(layer, response);
        let words = [frame, self.revision, size[0], size[1], response, layer as u32];
        words.into_iter().for_each(|word| message.extend(word.to_le_bytes()));
        message.extend(u32::try_from(self.samples).unwrap_or(u32::MAX).to_le_bytes());
        message.extend(scale.to_le_bytes());
        message.extend(self.count.to_le_bytes());
        halves.iter().for_each(|half| message.extend(half.to_le_bytes()));
        message
    }

    /// The estimated relMSE of the image: variance / (mean^2 + eps), averaged over pixels and channels. eps is (1 % of the image's
    /// mean)^2, as in `taugate compare`. `None` if the variance is not known or the image is black.
    pub fn relmse(&self) -> Option<f64> {
        let mean = self.mean.iter().map(|&x| f64::from(x)).sum::<f64>() / self.values().max(1) as f64;
        if self.variance.is_empty() || mean <= 0.0 {
            return None;
        }
        let eps = (0.01 * mean).powi(2);
        let of = |(&x, &v): (&f32, &f32)| f64::from(v) / (f64::from(x) * f64::from(x) + eps);
        Some(self.mean.iter().zip(&self.variance).map(of).sum::<f64>() / self.values() as f64)
    }
}

/// The linear colour that shows a normal; black without a surface.
fn colour_of_normal(normal: &[f32; 3]) -> [f32; 3] {
    let linear = |shown: f32| if shown <= 0.04045 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) };
    match normal {
        [0.0, 0.0, 0.0] => [0.0; 3],
        _ => normal.map(|x| linear((0.5 * (x + 1.0)).clamp(0.0, 1.0))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Before the surfaces are known.
    const UNKNOWN: (Option<&Surfaces>, [u32; 2]) = (None, [2, 1]);

    fn picture() -> Picture {
        Picture {
            revision: 7,
            size: [2, 1],
            samples: 5,
            samples_of_pixels: vec![],
            mean: vec![1e-9, 2e-9, 3e-9, 0.0, 0.5e-9, 12e-9],
            variance: vec![1e-20; 6],
            count: 1,
            responses: vec![],
        }
    }

    fn word(message: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(message[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn dark_pictures_keep_their_digits() {
        let picture = picture();
        let message = picture.encode(3, Layer::Mean, 0, UNKNOWN);
        assert_eq!(&message[..4], b"TGP1");
        assert_eq!([4, 8, 12, 16, 20, 24, 28, 36].map(|at| word(&message, at)), [3, 7, 2, 1, 0, 0, 5, 1]);
        let scale = f32::from_bits(word(&message, 32));
        let halves = message[HEADER..].as_chunks::<2>().0;
        assert_eq!(halves.len(), 6);
        for (half, value) in halves.iter().zip(&picture.mean) {
            let sent = f16::from_le_bytes(*half).to_f32() * scale;
            assert!((sent - value).abs() <= value * 5e-4, "{sent} {value}");
        }
    }

    #[test]
    fn black_and_tiny_pictures_are_finite() {
        for value in [0.0, f32::MIN_POSITIVE, 1e-45, f32::MAX] {
            let message = Picture { mean: vec![value; 6], ..picture() }.encode(0, Layer::Mean, 0, UNKNOWN);
            let scale = f32::from_bits(word(&message, 32));
            let half = f16::from_le_bytes(message[HEADER..HEADER + 2].try_into().unwrap());
            assert!(scale > 0.0 && (half.to_f32() * scale).is_finite(), "{value}");
        }
    }

    #[test]
    fn errors_are_relative() {
        let message = picture().encode(0, Layer::Error, 0, UNKNOWN);
        let scale = f32::from_bits(word(&message, 32));
        let error = f16::from_le_bytes(message[HEADER..HEADER + 2].try_into().unwrap()).to_f32() * scale;
        let expected = (1e-10 / luminance([1e-9, 2e-9, 3e-9])) as f32;
        assert!((error / expected - 1.0).abs() < 2e-3, "{error} {expected}");
        // By hand, for two pixels of mean 1 and variance 0.1: 0.1 / (1 + 0.01^2).
        let even = Picture { mean: vec![1.0; 6], variance: vec![0.1; 6], ..picture() };
        assert!((even.relmse().unwrap() - 0.1 / 1.0001).abs() < 1e-8);
        assert_eq!(Picture { variance: vec![], ..picture() }.relmse(), None);
    }

    #[test]
    fn depths_and_normals_are_those_of_the_surfaces() {
        let surfaces = Surfaces {
            depth: vec![4.0, 0.0, 2.0],
            normal: vec![[0.0, 0.0, 1.0], [0.0; 3], [-1.0, 0.0, 0.0]],
            object: vec![0, Surfaces::NOTHING, 0],
            names: vec!["wall".into()],
        };
        let of = |layer, surfaces| {
            let message = picture().encode(0, layer, 0, (surfaces, [3, 1]));
            let scale = f32::from_bits(word(&message, 32));
            let halves = message[HEADER..].as_chunks::<2>().0;
            let values: Vec<f32> = halves.iter().map(|half| f16::from_le_bytes(*half).to_f32() * scale).collect();
            ([word(&message, 12), word(&message, 24)], values)
        };
        let close = |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        let (header, depths) = of(Layer::Depth, Some(&surfaces));
        assert_eq!(header, [3, 2]);
        assert!(close(&depths, &[4.0, 4.0, 4.0, 0.0, 0.0, 0.0, 2.0, 2.0, 2.0]), "{depths:?}");
        let (header, normals) = of(Layer::Normal, Some(&surfaces));
        // sRGB 0.5 is 0.2140 in linear light.
        let half = 0.2140;
        assert_eq!(header, [3, 3]);
        assert!(close(&normals, &[half, half, 1.0, 0.0, 0.0, 0.0, 0.0, half, half]), "{normals:?}");
        assert_eq!(of(Layer::Depth, None).0, [2, 0], "without surfaces, the picture shows the radiance");
    }

    #[test]
    fn a_coarse_picture_stands_for_the_whole_image() {
        let picture = Picture { size: [2, 1], ..picture() };
        let at = |x, y| picture.at([x, y], [10, 4]);
        assert_eq!(
            [at(0, 0), at(4, 3), at(5, 0), at(9, 3), at(10, 0), at(0, 4)],
            [Some(0), Some(0), Some(3), Some(3), None, None]
        );
        let samples = |picture: &Picture| [0, 3].map(|at| picture.samples_at(at));
        assert_eq!(samples(&picture), [5, 5]);
        assert_eq!(samples(&Picture { samples_of_pixels: vec![2, 8], ..picture }), [2, 8]);
    }

    #[test]
    fn responses_are_apart() {
        let mut picture = picture();
        picture.responses = (0..18).map(|i| i as f32).collect();
        picture.count = 3;
        assert_eq!(picture.shown(1), [6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
        assert_eq!(picture.shown(3), &picture.mean[..], "there is no fourth response");
        let response = |layer, response| word(&picture.encode(0, layer, response, UNKNOWN), 20);
        assert_eq!([response(Layer::Mean, 1), response(Layer::Mean, 3), response(Layer::Error, 1)], [1, SUM, SUM]);
        let histogram = picture.histogram(3).unwrap();
        assert_eq!((histogram.len(), histogram[1]), (3, luminance([9.0, 10.0, 11.0]) as f32));
    }
}
