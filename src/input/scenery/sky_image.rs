//! The image of a sky, from an EXR or a Radiance HDR file.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, SIGNATURE};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::image::exr_file::read_picture;
use crate::scene::SkyImage;
use crate::settings::MAX_PIXELS;
use crate::settings::sky::is_radiance_hdr;

/// Pixels of an HDR file per byte: a run of 2 bytes holds one of the four channels of at most 127 pixels.
const PIXELS_PER_BYTE: u64 = 16;

/// Reads an equirectangular image. Fails if a value is negative, not finite, or too large after it is multiplied by `scale`, or if
/// the image is black.
pub fn read(path: &Path, scale: f32) -> Result<SkyImage> {
    let fail = |message: String| Error::File { path: path.into(), message };
    let sky = if is_radiance_hdr(path) { read_hdr(path)? } else { read_exr(path)? };
    sky.check(scale).map_err(|message| fail(format!("{message}; correct the image")))?;
    match sky.rgb.iter().flatten().any(|&channel| channel > 0.0) {
        true => Ok(sky),
        false => Err(fail("is black, so this sky has no light; choose another image".into())),
    }
}

fn read_exr(path: &Path) -> Result<SkyImage> {
    let picture = read_picture(path)?;
    Ok(SkyImage { width: picture.width, height: picture.height, rgb: picture.rgb.as_chunks::<3>().0.to_vec() })
}

/// Reads an RGBE image. The header's EXPOSURE and COLORCORR say by what the radiance was multiplied. A header of a few bytes may claim
/// any size, so the size is checked before memory is allocated.
fn read_hdr(path: &Path) -> Result<SkyImage> {
    let fail = |message: String| Error::File { path: path.into(), message };
    let unreadable = |e: image::ImageError| fail(format!("is not a Radiance HDR image ({e}); convert it to EXR"));
    let length = check_readable(path)?;
    let mut file = BufReader::new(File::open(path).map_err(|e| read_error(path, e))?);
    let signature = signature(&mut file).map_err(|e| read_error(path, e))?;
    let decoder = HdrDecoder::new(signature.chain(file)).map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        let limit = MAX_PIXELS >> 20;
        return Err(fail(format!(
            "has {width} x {height} pixels, but taugate reads 1 to {limit} megapixels; scale it down"
        )));
    }
    if pixels > PIXELS_PER_BYTE * length {
        return Err(fail(format!(
            "has a header of {width} x {height} pixels, too many for its {length} bytes; write the image again"
        )));
    }
    let metadata = decoder.metadata();
    let exposure = metadata.exposure.unwrap_or(1.0);
    let (r, g, b) = metadata.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [r, g, b].map(|correction| correction * exposure);
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return Err(fail("has an EXPOSURE or a COLORCORR that is not above 0; correct the header".into()));
    }
    let mut rgb = vec![[0.0f32; 3]; pixels as usize];
    decoder.read_image(bytemuck::cast_slice_mut(&mut rgb)).map_err(unreadable)?;
    for texel in &mut rgb {
        *texel = [0, 1, 2].map(|k| texel[k] / factors[k]);
    }
    Ok(SkyImage { width, height, rgb })
}

/// Skips the signature `#?RGBE`, which many programs write, and returns the signature that the decoder expects instead. Returns nothing
/// and skips nothing if the file begins otherwise.
fn signature(file: &mut impl BufRead) -> std::io::Result<&'static [u8]> {
    const RGBE: &[u8] = b"#?RGBE";
    if !file.fill_buf()?.starts_with(RGBE) {
        return Ok(b"");
    }
    file.consume(RGBE.len());
    Ok(SIGNATURE)
}
