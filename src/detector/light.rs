//! The light that a detector sees, and the counts of all its pixels.

use rayon::prelude::*;

use super::{Bins, Detector};
use crate::error::{Error, Result};
use crate::image::npy_read::{DescribedResponse, ImageArray, ScanArray};

/// The radiance that the detector sees. The pixels of a scan are its pairs of points; they have one channel.
pub struct Light {
    values: Values,
    bins: Bins,
}

/// The images of gates, or a scan.
pub enum Values {
    /// The images of gates.
    Images(ImageArray),
    /// The result of a scan.
    Scan(ScanArray),
}

impl Values {
    /// Number of gates.
    pub fn gates(&self) -> usize {
        match self {
            Values::Images(array) => array.images(),
            Values::Scan(scan) => scan.responses(),
        }
    }

    fn numbers(&self) -> &[f32] {
        match self {
            Values::Images(array) => &array.values,
            Values::Scan(scan) => &scan.values,
        }
    }
}

impl Light {
    /// The light `values` in `gates`. Fails if a value is not finite, or if a gate is empty.
    pub fn new(values: Values, gates: &[DescribedResponse]) -> Result<Light> {
        if values.numbers().iter().any(|value| !value.is_finite()) {
            return Err(Error::settings(match values {
                Values::Images(_) => "has values that are not finite; render an image without such pixels",
                Values::Scan(_) => "lacks pairs of points, because its scan was interrupted; measure it again",
            }));
        }
        let bins = Bins::new(gates.iter().map(DescribedResponse::gate).collect())?
            .weighted(gates.iter().map(DescribedResponse::integral).collect())?
            .repeated(gates[0].repeat_m);
        Ok(Light { values, bins })
    }

    /// The gates.
    pub fn bins(&self) -> &Bins {
        &self.bins
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        match &self.values {
            Values::Images(array) => array.width * array.height,
            Values::Scan(scan) => scan.pairs(),
        }
    }

    /// Width and height of the images; `None` for a scan.
    pub fn size(&self) -> Option<[usize; 2]> {
        match &self.values {
            Values::Images(array) => Some([array.width, array.height]),
            Values::Scan(_) => None,
        }
    }

    /// Number of gates.
    pub fn gates(&self) -> usize {
        self.values.gates()
    }

    /// Number of values in memory.
    pub fn numbers(&self) -> usize {
        self.values.numbers().len()
    }

    /// Number of channels of the counts. `mono`: whether the detector has no colours.
    pub fn channels(&self, mono: bool) -> usize {
        match self.values {
            Values::Images(_) if !mono => 3,
            _ => 1,
        }
    }

    /// The shape of the counts. For a scan, it is the shape of the light.
    pub fn shape(&self, mono: bool) -> Vec<usize> {
        match &self.values {
            Values::Images(array) => {
                let mut shape = vec![array.height, array.width];
                shape.extend(array.responses);
                shape.push(self.channels(mono));
                shape
            }
            Values::Scan(scan) => scan.shape.clone(),
        }
    }

    /// Index by pixel, gate and channel of the count that is the number `i` of the array of counts.
    pub fn index(&self, i: usize) -> usize {
        match &self.values {
            Values::Images(_) => i,
            Values::Scan(scan) => i % scan.pairs() * scan.responses() + i / scan.pairs(),
        }
    }

    /// The radiance of each gate in a pixel, for one of `channels` channels.
    pub fn radiance(&self, pixel: usize, channels: usize, channel: usize) -> Vec<f64> {
        match &self.values {
            Values::Images(array) => {
                let light = array.pixel([pixel % array.width, pixel / array.width]);
                light.iter().map(|rgb| of_channel(rgb, channels, channel)).collect()
            }
            Values::Scan(scan) => scan.values.iter().skip(pixel).step_by(scan.pairs()).map(|&x| x.into()).collect(),
        }
    }
}

/// The value of one of `channels` channels, 1 or 3. The only channel is the mean of red, green and blue.
pub fn of_channel(rgb: &[f32; 3], channels: usize, channel: usize) -> f64 {
    match channels {
        1 => rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0,
        _ => f64::from(rgb[channel]),
    }
}

/// The counts of all pixels, in the order of the array of shape [`Light::shape`]. `background`: R, G, B of the daylight per pixel, as
/// radiance in W / (m^2 sr). `mono`: whether the detector has no colours. Fails if the gates do not suit the detector, or if the counts
/// cannot be drawn or exceed the numbers of the array.
pub fn counts(detector: &Detector, light: &Light, background: &[[f32; 3]], mono: bool, seed: u32) -> Result<Vec<f32>> {
    let bins = &light.bins;
    detector.check_numbers()?;
    detector.check_gates(bins, background.iter().any(|rgb| *rgb != [0.0; 3]))?;
    let channels = light.channels(mono);
    let of_background = |pixel: usize, channel: usize| of_channel(&background[pixel], channels, channel);
    let means_of = |pixel: usize, channel: usize| {
        detector.means(light.radiance(pixel, channels, channel).into_iter(), of_background(pixel, channel), bins)
    };
    let pixels = 0..light.pixels();
    let draws_of = |pixel: usize| {
        let of_channel = |channel| {
            let means = means_of(pixel, channel);
            detector.check(&means, bins)?;
            Ok(detector.draws(&means, bins))
        };
        (0..channels).map(of_channel).sum::<Result<f64>>()
    };
    Detector::check_draws(pixels.clone().into_par_iter().map(draws_of).sum::<Result<f64>>()?)?;
    let count_pixel = |(pixel, counts_of_pixel): (usize, &mut [f32])| {
        for channel in 0..channels {
            let means = means_of(pixel, channel);
            // A seed per pixel and channel: counts do not depend on the order of the work.
            let seed = (u64::from(seed) << 32) ^ (3 * pixel + channel) as u64;
            let steady = detector.steady_means(of_background(pixel, channel), bins);
            for (k, count) in detector.counts(&means, &steady, bins, seed).into_iter().enumerate() {
                counts_of_pixel[k * channels + channel] = count as f32;
            }
        }
    };
    let per_pixel = light.gates() * channels;
    let mut counts = vec![0.0; pixels.len() * per_pixel];
    counts.par_chunks_mut(per_pixel).enumerate().for_each(count_pixel);
    if counts.iter().any(|count| !count.is_finite()) {
        return Err(Error::advice(
            "counts exceed the largest number of the output, 3e38; ",
            "lower --photons or --pulses",
        ));
    }
    match light.size() {
        Some(_) => Ok(counts),
        None => Ok((0..counts.len()).map(|i| counts[light.index(i)]).collect()),
    }
}
