//! Reads the images of textures as 8-bit texels.
//!
//! A small file can describe a huge image. So the headers of all images are read first, and their sizes are checked before any
//! image is decoded.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use super::decoder::{Decoder, Failure, MAX_SIDE, memory_of_decoder};
use super::document::{Document, Warnings, label, printable};
use super::resolve::Folders;
use super::texture::{Channels, FROM_AVIF, FROM_KTX2, FROM_OTHERS, ImageUse};
use super::{Checked, resolve};
use crate::scene::Image;

/// Maximum number of texels of all images together: 2 GiB, the usual limit of an array on a device.
const MAX_TEXELS: u64 = 1 << 29;
/// Bytes that images and their decoders may take together, however short the files are: the bytes of 8192 x 8192 texels. Together
/// with [`BYTES_PER_BYTE`], this limit stops small files that decode to gigabytes.
const FREE_BYTES: u64 = 4 << 26;
/// Bytes that images may take for each byte of their files, beyond [`FREE_BYTES`]. Deflate packs at most 1032 bytes into one, and
/// the byte of a grey texel becomes four bytes.
const BYTES_PER_BYTE: u64 = 4 * 1032;
/// Maximum number of texels of the images that are decoded at the same time, unless a single image has more. See
/// [`memory_of_decoder`].
const MAX_TEXELS_AT_ONCE: u64 = 1 << 25;

/// Decodes `images`; returns them in that order.
pub fn load(doc: &Document, folders: Folders, images: &[ImageUse], warnings: &mut Warnings) -> Checked<Vec<Image>> {
    let sources: Vec<Source> = images.iter().map(|image| Source::new(doc, folders, image)).collect();
    let headers: Vec<ImageHeader> = sources.iter().map(Source::header).collect::<Checked<_>>()?;
    let sizes: Vec<[u32; 2]> = headers.iter().map(|header| header.size).collect();
    check_total(&sources, &headers)?;
    let texels: Vec<u64> = sizes.iter().map(texel_count).collect();
    let mut decoded = Vec::with_capacity(images.len());
    for run in runs(&texels, MAX_TEXELS_AT_ONCE) {
        let run: Vec<Checked<(Image, bool)>> =
            run.into_par_iter().map(|index| sources[index].decode(sizes[index])).collect();
        for outcome in run {
            let (mut image, is_deep) = outcome?;
            if let Channels::Glossiness(factor) = images[decoded.len()].channels {
                to_roughness(&mut image, factor);
            }
            if is_deep {
                let name = &sources[decoded.len()].name;
                warnings.once("deep images", || {
                    format!("images with 16 bits per channel are read as 8 bits (first: {name})")
                });
            }
            decoded.push(image);
        }
    }
    Ok(decoded)
}

/// Converts the texels of a glossiness texture to those of a metallic-roughness texture. The glossiness is alpha times `factor`.
fn to_roughness(image: &mut Image, factor: f32) {
    let table: Vec<u8> = (0..=255u8).map(|alpha| (255.0 - factor * f32::from(alpha)).round() as u8).collect();
    image.rgba.iter_mut().for_each(|texel| *texel = [255, table[usize::from(texel[3])], 255, 255]);
}

fn texel_count([width, height]: &[u32; 2]) -> u64 {
    u64::from(*width) * u64::from(*height)
}

/// What is known of an image before it is decoded.
struct ImageHeader {
    /// Width and height in pixels.
    size: [u32; 2],
    /// Bytes of the file.
    file: u64,
    /// Bytes of memory that [`rgba8`] and its decoder take together.
    memory: u64,
}

/// Fails if the images together have too many texels, or too many for the length of their files; names the largest image.
fn check_total(sources: &[Source], headers: &[ImageHeader]) -> Checked<()> {
    let gibibytes = |texels: u64| texels as f64 * 4.0 / f64::from(1 << 30);
    let total: u64 = headers.iter().map(|header| texel_count(&header.size)).sum();
    let largest = sources.iter().zip(headers).max_by_key(|(_, header)| texel_count(&header.size));
    let Some((largest, ImageHeader { size: [width, height], .. })) = largest else { return Ok(()) };
    let name = &largest.name;
    if total > MAX_TEXELS {
        return Err(format!(
            "the images of the textures need {:.1} GiB, but taugate reads at most {} GiB; the largest is {name} with {width} x \
             {height} pixels; scale images down",
            gibibytes(total),
            gibibytes(MAX_TEXELS),
        ));
    }
    let bytes: u64 = headers.iter().map(|header| header.file).sum();
    if headers.iter().map(|header| header.memory).sum::<u64>() > FREE_BYTES + BYTES_PER_BYTE * bytes {
        return Err(format!(
            "the images of the textures have {bytes} bytes, too few for their {total} pixels; the largest is {name} with {width} x \
             {height} pixels; scale images of a single colour down, or save damaged images again"
        ));
    }
    Ok(())
}

/// Splits the images with these sizes into runs of consecutive images. The sum of each run is at most `limit`, but a larger
/// image is a run of its own.
fn runs(sizes: &[u64], limit: u64) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = vec![];
    let mut sum = 0;
    for (index, size) in sizes.iter().enumerate() {
        sum += size;
        match runs.last_mut() {
            Some(run) if sum <= limit => run.end = index + 1,
            _ => {
                sum = *size;
                runs.push(index..index + 1);
            }
        }
    }
    runs
}

/// Where the data of an image comes from. The data is read again whenever it is needed, because all files together may not fit
/// into memory.
struct Source<'a> {
    doc: &'a Document<'a>,
    folders: Folders<'a>,
    index: usize,
    /// The image and its user, for messages.
    name: String,
}

impl<'a> Source<'a> {
    fn new(doc: &'a Document, folders: Folders<'a>, image: &ImageUse) -> Source<'a> {
        let label = label(doc.root.images.get(image.index).and_then(|i| i.name.as_deref()), "image", image.index);
        Source { doc, folders, index: image.index, name: format!("image `{label}` ({})", image.what) }
    }

    fn bytes(&self) -> Checked<Cow<'a, [u8]>> {
        let name = &self.name;
        let image = (self.doc.root.images.get(self.index))
            .ok_or_else(|| format!("{name} does not exist; re-export the file"))?;
        match (&image.buffer_view, &image.uri) {
            (Some(view), _) => Ok(Cow::Borrowed(self.doc.view(view.value(), name)?.bytes)),
            (None, Some(uri)) => Ok(Cow::Owned(resolve::uri_bytes(uri, self.folders, name)?)),
            (None, None) => Err(format!("{name} has no data; re-export the file with its textures")),
        }
    }

    fn header(&self) -> Checked<ImageHeader> {
        let bytes = self.bytes()?;
        let decoder = Decoder::new(&bytes).map_err(|e| self.failed(e, &bytes))?;
        let texels = texel_count(&decoder.size);
        let result = texels * 4 * decoder.pixel_bytes().div_ceil(4) as u64;
        let memory = result + memory_of_decoder(&bytes, texels);
        Ok(ImageHeader { size: decoder.size, file: bytes.len() as u64, memory })
    }

    /// The texels of the image, and whether the file has more than 8 bits per channel.
    fn decode(&self, size: [u32; 2]) -> Checked<(Image, bool)> {
        let bytes = self.bytes()?;
        let decoder = Decoder::new(&bytes).map_err(|e| self.failed(e, &bytes))?;
        let name = &self.name;
        if decoder.size != size {
            return Err(format!("{name} changed while it was read; read the scene again"));
        }
        let is_deep = decoder.is_deep;
        let [width, height] = size;
        let rgba = rgba8(decoder, texel_count(&size) as usize).map_err(|e| self.failed(e, &bytes))?;
        if rgba.is_empty() {
            return Err(format!("{name} has no pixels; save it again as PNG or JPEG"));
        }
        Ok((Image { width, height, rgba }, is_deep))
    }

    /// The message for an image that cannot be decoded.
    fn failed(&self, failure: Failure, bytes: &[u8]) -> String {
        let uri = self.doc.root.images.get(self.index).and_then(|image| image.uri.as_deref());
        let file = match uri {
            Some(uri) if !resolve::is_data(uri) => format!(" from `{}`", printable(uri, 120)),
            _ => String::new(),
        };
        let (why, remedy) = match failure {
            Failure::Format if bytes.starts_with(b"\xabKTX 2") => ("KTX2 is not read".into(), FROM_KTX2.into()),
            Failure::Format if bytes.get(4..12) == Some(b"ftypavif") => ("AVIF is not read".into(), FROM_AVIF.into()),
            Failure::Format => ("its format is not read".into(), FROM_OTHERS.into()),
            Failure::File(why) => {
                let remedy = format!("save it as PNG, JPEG or WebP of at most {MAX_SIDE} x {MAX_SIDE} pixels");
                (printable(&why, 200), remedy)
            }
        };
        format!("{} cannot be decoded{file}: {why}; {remedy}", self.name)
    }
}

/// Decodes `texels` texels. The decoder writes the image to the end of the returned buffer. Then the pixels are converted in
/// place, from the first to the last. So an image with 8 bits per channel takes no memory besides its result.
fn rgba8(decoder: Decoder, texels: usize) -> Result<Vec<[u8; 4]>, Failure> {
    let (channels, is_deep, size) = (decoder.channels, decoder.is_deep, decoder.pixel_bytes());
    let mut rgba = vec![[0; 4]; texels * size.div_ceil(4)];
    let bytes = rgba.as_flattened_mut();
    let start = bytes.len() - texels * size;
    decoder.read(&mut bytes[start..])?;
    let narrow = |high: u8, low: u8| narrow(u16::from_be_bytes([high, low]));
    match (channels, is_deep) {
        (1, false) => convert(bytes, texels, |[l]| [l, l, l, 255]),
        (2, false) => convert(bytes, texels, |[l, a]| [l, l, l, a]),
        (3, false) => convert(bytes, texels, |[r, g, b]| [r, g, b, 255]),
        (_, false) => {}
        (1, true) => convert(bytes, texels, |[l, m]| [narrow(l, m), narrow(l, m), narrow(l, m), 255]),
        (2, true) => convert(bytes, texels, |[l, m, a, b]| [narrow(l, m), narrow(l, m), narrow(l, m), narrow(a, b)]),
        (3, true) => convert(bytes, texels, |[r, s, g, h, b, c]| [narrow(r, s), narrow(g, h), narrow(b, c), 255]),
        (_, true) => {
            convert(bytes, texels, |[r, s, g, h, b, c, a, d]| [narrow(r, s), narrow(g, h), narrow(b, c), narrow(a, d)])
        }
    }
    rgba.truncate(texels);
    rgba.shrink_to_fit();
    Ok(rgba)
}

/// Replaces `texels` pixels of `N` bytes at the end of `bytes` by as many texels of 4 bytes at the beginning. `bytes` has room for
/// the longer of the two. So texel k ends no later than pixel k, and no pixel is overwritten before it is read.
fn convert<const N: usize>(bytes: &mut [u8], texels: usize, rgba: impl Fn([u8; N]) -> [u8; 4]) {
    let start = bytes.len() - texels * N;
    for k in 0..texels {
        let mut pixel = [0; N];
        pixel.copy_from_slice(&bytes[start + N * k..start + N * (k + 1)]);
        bytes[4 * k..4 * (k + 1)].copy_from_slice(&rgba(pixel));
    }
}

/// The nearest 8-bit value of a 16-bit channel.
fn narrow(channel: u16) -> u8 {
    ((u32::from(channel) + 128) / 257) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_bounded_and_lose_no_image() {
        assert_eq!(runs(&[], 10), []);
        assert_eq!(runs(&[3, 7, 1, 30, 2, 9], 10), [0..2, 2..3, 3..4, 4..5, 5..6]);
        assert_eq!(runs(&[5; 5], 15), [0..3, 3..5]);
    }
}
