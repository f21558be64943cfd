//! The image of a sky, from an EXR or a Radiance HDR file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::radiance_hdr::{Header, read_rows};
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
    let unreadable = |why: String| fail(format!("is not a Radiance HDR image ({why}); convert it to EXR"));
    let length = check_readable(path)?;
    let mut file = BufReader::new(File::open(path).map_err(|e| read_error(path, e))?);
    let Header { width, height, factors } = Header::read(&mut file).map_err(unreadable)?;
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
    if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
        return Err(fail("has an EXPOSURE or a COLORCORR that is not above 0; correct the header".into()));
    }
    let mut rgb = vec![[0.0f32; 3]; pixels as usize];
    read_rows(&mut file, width, &mut rgb).map_err(|e| unreadable(e.to_string()))?;
    for texel in &mut rgb {
        *texel = [0, 1, 2].map(|k| texel[k] / factors[k]);
    }
    Ok(SkyImage { width, height, rgb })
}
