//! Decodes PNG and JPEG images to 8-bit texels.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use ::image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use rayon::prelude::*;

use super::document::{Document, Warnings, label};
use super::{Checked, resolve};
use crate::scene::Image;

/// Maximum width and height of an image in pixels.
const MAX_SIDE: u32 = 16384;
/// Maximum number of texels of all images together: 4 GiB.
const MAX_TEXELS: u64 = 1 << 30;

/// Decodes the glTF images with indices `sources` in parallel; returns them in that order.
pub fn load(doc: &Document, folder: &Path, sources: &[usize], warnings: &mut Warnings) -> Checked<Vec<Image>> {
    let texels = AtomicU64::new(0);
    let decoded: Vec<Checked<(Image, bool)>> =
        sources.par_iter().map(|&source| decode(doc, folder, source, &texels)).collect();
    let mut images = Vec::with_capacity(sources.len());
    for (outcome, &source) in decoded.into_iter().zip(sources) {
        let (image, is_deep) = outcome?;
        if is_deep {
            warnings.once("deep images", || {
                format!("images with 16 bits per channel are read as 8 bits (first: {})", name(doc, source))
            });
        }
        images.push(image);
    }
    Ok(images)
}

fn name(doc: &Document, index: usize) -> String {
    format!("image `{}`", label(doc.root.images.get(index).and_then(|image| image.name.as_deref()), "image", index))
}

/// The texels of one image, and whether the file had more than 8 bits per channel. `texels` counts the texels of all images so
/// far.
fn decode(doc: &Document, folder: &Path, index: usize, texels: &AtomicU64) -> Checked<(Image, bool)> {
    let name = name(doc, index);
    let source = doc.root.images.get(index).ok_or_else(|| format!("{name} does not exist; re-export the file"))?;
    let bytes = match (&source.buffer_view, &source.uri) {
        (Some(view), _) => Cow::Borrowed(doc.view(view.value(), &name)?.bytes),
        (None, Some(uri)) => Cow::Owned(resolve::uri_bytes(uri, folder, &name)?),
        (None, None) => return Err(format!("{name} has no data; re-export the file with its textures")),
    };
    let failed = |e: ::image::ImageError| {
        format!("{name} cannot be decoded ({e}); save it as PNG or JPEG of at most {MAX_SIDE} x {MAX_SIDE} pixels")
    };
    let mut reader = ImageReader::new(Cursor::new(bytes.as_ref()))
        .with_guessed_format()
        .map_err(|e| failed(::image::ImageError::IoError(e)))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(u64::from(MAX_SIDE) * u64::from(MAX_SIDE) * 8);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let size = u64::from(width) * u64::from(height);
    if texels.fetch_add(size, Ordering::Relaxed).saturating_add(size) > MAX_TEXELS {
        return Err(format!("the images have more than {MAX_TEXELS} pixels in total ({name}); scale them down"));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(failed)?;
    let is_deep = image.color().bytes_per_pixel() > image.color().channel_count();
    let rgba = image.into_rgba8().into_raw().as_chunks::<4>().0.to_vec();
    if width == 0 || height == 0 || rgba.len() as u64 != size {
        return Err(format!("{name} has no pixels; save it again as PNG or JPEG"));
    }
    Ok((Image { width, height, rgba }, is_deep))
}
