//! 8-bit sRGB pictures for viewing: linear values times an exposure, clamped to [0, 1].

use std::io;
use std::path::Path;

use crate::error::Result;
use crate::files::write_atomically;

/// Automatic exposure maps this quantile of the lit pixels' luminance to [`BRIGHT`]. Brighter pixels, such as lamps, may
/// saturate.
const QUANTILE: f64 = 0.97;
/// Linear value of that quantile, before the sRGB curve.
const BRIGHT: f32 = 0.9;

/// Writes linear R, G, B (interleaved, row 0 at the top), times the factor `exposure`, as an sRGB picture.
pub fn write(path: &Path, width: u32, height: u32, rgb: &[f32], exposure: f32) -> Result<()> {
    write_atomically(path, |writer| encode(writer, width, height, rgb, exposure))
}

/// Encodes the picture that [`write`] writes.
pub fn encode(writer: impl io::Write, width: u32, height: u32, rgb: &[f32], exposure: f32) -> io::Result<()> {
    encode_bytes(writer, width, height, &expose(rgb, exposure))
}

/// Writes a picture of 8-bit sRGB bytes, R, G, B interleaved.
pub fn write_bytes(path: &Path, width: u32, height: u32, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |writer| encode_bytes(writer, width, height, bytes))
}

/// Encodes the picture that [`write_bytes`] writes.
pub fn encode_bytes(writer: impl io::Write, width: u32, height: u32, bytes: &[u8]) -> io::Result<()> {
    let mut encoder = png::Encoder::new(writer, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut image = encoder.write_header().map_err(into_io)?;
    image.write_image_data(bytes).map_err(into_io)?;
    image.finish().map_err(into_io)
}

/// Keeps the kind of a disk error, because the message to the user depends on it.
fn into_io(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        other => other.into(),
    }
}

/// Multiplies linear values by `exposure` and encodes them to sRGB bytes. NaN becomes black.
pub fn expose(rgb: &[f32], exposure: f32) -> Vec<u8> {
    rgb.iter().map(|&v| (255.0 * srgb(v * exposure) + 0.5) as u8).collect()
}

/// The automatic exposure: the factor that brings the 97th percentile of the lit pixels' luminance to 0.9; 1 for a black image.
pub fn exposure(rgb: &[f32]) -> f32 {
    let mut lit: Vec<f32> = lit(rgb).collect();
    if lit.is_empty() {
        return 1.0;
    }
    let at = rank(lit.len());
    let (_, &mut bright, _) = lit.select_nth_unstable_by(at, f32::total_cmp);
    (BRIGHT / bright).min(f32::MAX)
}

/// The automatic exposure of many images together, of which only one is in memory at a time. `each` calls its argument with every
/// image. This function calls `each` at most twice.
pub fn common_exposure(each: impl Fn(&mut dyn FnMut(&[f32])) -> Result<()>) -> Result<f32> {
    // The bits of positive numbers have the order of the numbers. The first pass counts the values by their upper 16 bits, and finds the
    // upper 16 bits of the quantile. The second pass counts only the values with these upper bits, by their lower 16 bits.
    let mut upper = vec![0; 1 << 16];
    each(&mut |rgb| lit(rgb).for_each(|y| upper[(y.to_bits() >> 16) as usize] += 1))?;
    let count = upper.iter().sum();
    if count == 0 {
        return Ok(1.0);
    }
    let (high, rest) = bin(&upper, rank(count));
    let mut lower = vec![0; 1 << 16];
    each(&mut |rgb| {
        let equal = lit(rgb).map(f32::to_bits).filter(|bits| bits >> 16 == high);
        equal.for_each(|bits| lower[(bits & 0xffff) as usize] += 1);
    })?;
    let (low, _) = bin(&lower, rest);
    Ok((BRIGHT / f32::from_bits(high << 16 | low)).min(f32::MAX))
}

/// The luminance of each pixel that is lit.
fn lit(rgb: &[f32]) -> impl Iterator<Item = f32> {
    let luminance = |p: &[f32]| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
    rgb.chunks_exact(3).map(luminance).filter(|&y| y > 0.0 && y.is_finite())
}

/// Rank of the quantile among `count` values, from 0.
fn rank(count: usize) -> usize {
    ((count - 1) as f64 * QUANTILE).round() as usize
}

/// The bin that holds the value of this rank, and the rank of the value inside the bin.
fn bin(counts: &[usize], mut rank: usize) -> (u32, usize) {
    for (bin, &count) in counts.iter().enumerate() {
        if rank < count {
            return (bin as u32, rank);
        }
        rank -= count;
    }
    // Only if the images have changed between two passes.
    (counts.len() as u32 - 1, 0)
}

/// The sRGB transfer curve of a linear value, clamped to [0, 1]; NaN gives 0.
fn srgb(linear: f32) -> f32 {
    if linear.is_nan() || linear <= 0.0 {
        0.0
    } else if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        (1.055 * linear.min(1.0).powf(1.0 / 2.4) - 0.055).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(rgb: &[f32]) -> Vec<u8> {
        expose(rgb, exposure(rgb))
    }

    #[test]
    fn black_and_odd_values_are_black() {
        assert_eq!(auto(&[0.0; 6]), [0; 6]);
        assert_eq!(auto(&[f32::NAN, -1.0, 0.0]), [0; 3]);
    }

    #[test]
    fn images_one_by_one_have_the_exposure_of_all_together() {
        let images: Vec<Vec<f32>> = (0..7u32)
            .map(|image| {
                (0..300).map(|i| ((i * 37 + image * 101) % 89) as f32 * (10.0 + image as f32).exp2()).collect()
            })
            .collect();
        for count in 0..=images.len() {
            let some = &images[..count];
            let each = |see: &mut dyn FnMut(&[f32])| {
                some.iter().for_each(|image| see(image));
                Ok(())
            };
            assert_eq!(common_exposure(each).unwrap(), exposure(&some.concat()), "{count} images");
        }
    }

    #[test]
    fn the_bright_end_is_where_it_should_be_at_any_scale() {
        for scale in [1e-30_f32, 1e-3, 1.0, 1e20] {
            // 199 grey pixels, and one that is a thousand times brighter and must not darken the others.
            let mut image = vec![scale; 3 * 200];
            image[597..].fill(1000.0 * scale);
            let bytes = auto(&image);
            assert_eq!(bytes[0], (255.0 * srgb(0.9)).round() as u8, "{scale}");
            assert_eq!(bytes[599], 255, "{scale}");
        }
    }
}
