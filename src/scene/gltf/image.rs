//! Decodes PNG, JPEG and WebP images to 8-bit texels.
//!
//! A small file can describe a huge image. So the headers of all images are read first, and their sizes are checked before any
//! image is decoded.

use std::borrow::Cow;
use std::io::Cursor;
use std::ops::Range;

use ::image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::document::{Document, Warnings, label, printable};
use super::resolve::Folders;
use super::texture::{Channels, FROM_AVIF, FROM_KTX2, FROM_OTHERS, ImageUse};
use super::{Checked, jpeg, resolve};
use crate::scene::Image;

/// Maximum width and height of an image in pixels.
const MAX_SIDE: u32 = 16384;
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
/// Maximum size in bytes of the rows and the metadata that a PNG decoder keeps.
const MAX_DECODER_BYTES: u64 = 64 << 20;

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
        let decoder = decoder(&bytes).map_err(|e| self.failed(&e, &bytes))?;
        let size = <[u32; 2]>::from(decoder.dimensions());
        let texels = texel_count(&size);
        let result = texels * 4 * u64::from(decoder.color_type().bytes_per_pixel().div_ceil(4));
        Ok(ImageHeader { size, file: bytes.len() as u64, memory: result + memory_of_decoder(&bytes, texels) })
    }

    /// The texels of the image, and whether the file has more than 8 bits per channel.
    fn decode(&self, size: [u32; 2]) -> Checked<(Image, bool)> {
        let bytes = self.bytes()?;
        let decoder = decoder(&bytes).map_err(|e| self.failed(&e, &bytes))?;
        let name = &self.name;
        if decoder.dimensions() != size.into() {
            return Err(format!("{name} changed while it was read; read the scene again"));
        }
        let color = decoder.color_type();
        let [width, height] = size;
        let rgba = rgba8(decoder, texel_count(&size) as usize).map_err(|e| self.failed(&e, &bytes))?;
        if rgba.is_empty() {
            return Err(format!("{name} has no pixels; save it again as PNG or JPEG"));
        }
        Ok((Image { width, height, rgba }, color.bytes_per_pixel() > color.channel_count()))
    }

    /// The message for an image that cannot be decoded.
    fn failed(&self, error: &ImageError, bytes: &[u8]) -> String {
        let uri = self.doc.root.images.get(self.index).and_then(|image| image.uri.as_deref());
        let file = match uri {
            Some(uri) if !resolve::is_data(uri) => format!(" from `{}`", printable(uri, 120)),
            _ => String::new(),
        };
        let (why, remedy) = if bytes.starts_with(b"\xabKTX 2") {
            ("KTX2 is not read".into(), FROM_KTX2.into())
        } else if bytes.get(4..12) == Some(b"ftypavif") {
            ("AVIF is not read".into(), FROM_AVIF.into())
        } else if matches!(error, ImageError::Unsupported(_)) {
            ("its format is not read".into(), FROM_OTHERS.into())
        } else {
            let remedy = format!("save it as PNG, JPEG or WebP of at most {MAX_SIDE} x {MAX_SIDE} pixels");
            (printable(&error.to_string(), 200), remedy)
        };
        format!("{} cannot be decoded{file}: {why}; {remedy}", self.name)
    }
}

/// A decoder that has read the header of the image.
fn decoder(bytes: &[u8]) -> Result<impl ImageDecoder + use<'_>, ImageError> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(ImageError::IoError)?;
    if reader.format() == Some(ImageFormat::Jpeg) && jpeg::samples_colour_finer(bytes) {
        let message = "a colour channel of this JPEG has more samples than its first channel";
        return Err(ImageError::IoError(std::io::Error::other(message)));
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    reader.into_decoder()
}

/// Maximum number of bytes that the decoder of this image with `texels` texels takes besides its result. It may take them before
/// it notices that the file is too short. Tables do not count, because the length of the file limits them.
fn memory_of_decoder(bytes: &[u8], texels: u64) -> u64 {
    /// Maximum size of a data partition of a lossy WebP image in bytes. The file gives the size in 24 bits, and the decoder
    /// allocates this size.
    const PART: u64 = 1 << 24;
    match (::image::guess_format(bytes), bytes.get(12..16)) {
        // Two bytes for each coefficient of a progressive image, in up to four channels.
        (Ok(ImageFormat::Jpeg), _) => 8 * texels,
        // In bytes per texel: a copy with alpha (4), the data of two transforms (1/4 each), and the entropy image (3/8).
        (Ok(ImageFormat::WebP), Some(b"VP8L")) => 5 * texels,
        // Luma (1) and chroma (1/2).
        (Ok(ImageFormat::WebP), Some(b"VP8 ")) => 2 * texels + PART,
        // The alpha of a lossy image (1) is decoded as a lossless one (5). An animation has a frame (4) and a canvas (4).
        (Ok(ImageFormat::WebP), _) => 8 * texels + PART,
        // Rows only.
        _ => 0,
    }
}

/// Decodes `texels` texels. The decoder writes the image to the end of the returned buffer. Then the pixels are converted in
/// place, from the first to the last. So an image with 8 bits per channel takes no memory besides its result.
fn rgba8(decoder: impl ImageDecoder, texels: usize) -> Result<Vec<[u8; 4]>, ImageError> {
    let color = decoder.color_type();
    let size = usize::from(color.bytes_per_pixel());
    let mut rgba = vec![[0; 4]; texels * size.div_ceil(4)];
    let bytes = rgba.as_flattened_mut();
    let start = bytes.len() - texels * size;
    decoder.read_image(&mut bytes[start..])?;
    let narrow = |high: u8, low: u8| narrow(u16::from_ne_bytes([high, low]));
    match color {
        ColorType::L8 => convert(bytes, texels, |[l]| [l, l, l, 255]),
        ColorType::La8 => convert(bytes, texels, |[l, a]| [l, l, l, a]),
        ColorType::Rgb8 => convert(bytes, texels, |[r, g, b]| [r, g, b, 255]),
        ColorType::Rgba8 => {}
        ColorType::L16 => convert(bytes, texels, |[l, m]| [narrow(l, m), narrow(l, m), narrow(l, m), 255]),
        ColorType::La16 => {
            convert(bytes, texels, |[l, m, a, b]| [narrow(l, m), narrow(l, m), narrow(l, m), narrow(a, b)]);
        }
        ColorType::Rgb16 => {
            convert(bytes, texels, |[r, s, g, h, b, c]| [narrow(r, s), narrow(g, h), narrow(b, c), 255]);
        }
        ColorType::Rgba16 => {
            convert(bytes, texels, |[r, s, g, h, b, c, a, d]| [narrow(r, s), narrow(g, h), narrow(b, c), narrow(a, d)])
        }
        _ => {
            let message = format!("{color:?} pixels are not read");
            return Err(ImageError::IoError(std::io::Error::other(message)));
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
    use ::image::DynamicImage;

    use super::*;

    fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn every_pixel_format_becomes_rgba() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as u16
        };
        let deep = DynamicImage::ImageRgba16(::image::ImageBuffer::from_fn(13, 7, |_, _| {
            ::image::Rgba([random(), random(), random(), random()])
        }));
        let kinds = [
            deep.to_luma8().into(),
            deep.to_luma_alpha8().into(),
            deep.to_rgb8().into(),
            deep.to_rgba8().into(),
            deep.to_luma16().into(),
            deep.to_luma_alpha16().into(),
            deep.to_rgb16().into(),
            deep,
        ];
        let check = |image: &DynamicImage, format| {
            let bytes = encode(image, format);
            let expected = ::image::load_from_memory(&bytes).unwrap().into_rgba8();
            let rgba = rgba8(decoder(&bytes).unwrap(), 13 * 7).unwrap();
            assert!(rgba.as_flattened() == expected.as_raw().as_slice(), "{:?} as {format:?}", image.color());
        };
        kinds.iter().for_each(|image| check(image, ImageFormat::Png));
        for (image, format) in
            [(0, ImageFormat::Jpeg), (2, ImageFormat::Jpeg), (2, ImageFormat::WebP), (3, ImageFormat::WebP)]
        {
            check(&kinds[image], format);
        }
    }

    #[test]
    fn runs_are_bounded_and_lose_no_image() {
        assert_eq!(runs(&[], 10), []);
        assert_eq!(runs(&[3, 7, 1, 30, 2, 9], 10), [0..2, 2..3, 3..4, 4..5, 5..6]);
        assert_eq!(runs(&[5; 5], 15), [0..3, 3..5]);
    }
}
