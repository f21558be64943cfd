//! Decoders of PNG, JPEG and WebP images, with limits of size and memory.

use std::fmt::Display;
use std::io::Cursor;

use image_webp::WebPDecoder;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::jpeg;

/// Maximum width and height of an image in pixels.
pub const MAX_SIDE: u32 = 16384;
/// Maximum size in bytes of the rows and the metadata that a PNG decoder keeps.
const MAX_DECODER_BYTES: usize = 64 << 20;

/// Why an image cannot be decoded.
#[derive(Debug)]
pub enum Failure {
    /// The file has another format.
    Format,
    /// The file is damaged or too large, or a variant of its format that is not read. A clause says why.
    File(String),
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Jpeg,
    WebP,
}

impl Format {
    /// The format that the first bytes of a file announce.
    fn of(bytes: &[u8]) -> Option<Format> {
        match bytes {
            [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Format::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Format::Jpeg),
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some(Format::WebP),
            _ => None,
        }
    }
}

/// A decoder that has read the header of an image.
pub struct Decoder<'a> {
    /// Width and height in pixels, at most [`MAX_SIDE`].
    pub size: [u32; 2],
    /// Channels of a decoded pixel: grey, grey and alpha, RGB, or RGB and alpha.
    pub channels: usize,
    /// Whether a decoded channel has 16 bits instead of 8.
    pub is_deep: bool,
    data: Data<'a>,
}

enum Data<'a> {
    Png(Box<png::Reader<Cursor<&'a [u8]>>>),
    Jpeg(Box<JpegDecoder<ZCursor<&'a [u8]>>>),
    WebP(Box<WebPDecoder<Cursor<&'a [u8]>>>),
}

impl<'a> Decoder<'a> {
    /// Reads the header of the image in `bytes`.
    pub fn new(bytes: &'a [u8]) -> Result<Decoder<'a>, Failure> {
        match Format::of(bytes) {
            Some(Format::Png) => Decoder::png(bytes),
            Some(Format::Jpeg) => Decoder::jpeg(bytes),
            Some(Format::WebP) => Decoder::webp(bytes),
            None => Err(Failure::Format),
        }
    }

    fn png(bytes: &'a [u8]) -> Result<Decoder<'a>, Failure> {
        let limits = png::Limits { bytes: MAX_DECODER_BYTES };
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
        let size = checked(decoder.read_header_info().map_err(failed("PNG"))?.size().into())?;
        // Palettes, transparent colours, and channels of less than 8 bits become channels of 8 bits.
        decoder.set_transformations(png::Transformations::EXPAND);
        let reader = decoder.read_info().map_err(failed("PNG"))?;
        let (color, depth) = reader.output_color_type();
        let (channels, is_deep) = (color.samples(), depth == png::BitDepth::Sixteen);
        Ok(Decoder { size, channels, is_deep, data: Data::Png(Box::new(reader)) })
    }

    fn jpeg(bytes: &'a [u8]) -> Result<Decoder<'a>, Failure> {
        if jpeg::samples_colour_finer(bytes) {
            let message = "a colour channel of this JPEG has more samples than its first channel";
            return Err(Failure::File(message.into()));
        }
        // The size is checked below, with the same message as that of other formats.
        let any = usize::MAX;
        let options = DecoderOptions::default().set_strict_mode(false).set_max_width(any).set_max_height(any);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(failed("JPEG"))?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        let size = checked([width as u32, height as u32])?;
        // Everything else becomes RGB: YCbCr, CMYK and YCCK.
        let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
        let (channels, colors) = if is_grey { (1, ColorSpace::Luma) } else { (3, ColorSpace::RGB) };
        decoder.set_options(options.jpeg_set_out_colorspace(colors));
        Ok(Decoder { size, channels, is_deep: false, data: Data::Jpeg(Box::new(decoder)) })
    }

    fn webp(bytes: &'a [u8]) -> Result<Decoder<'a>, Failure> {
        let decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(failed("WebP"))?;
        let size = checked(decoder.dimensions().into())?;
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        Ok(Decoder { size, channels, is_deep: false, data: Data::WebP(Box::new(decoder)) })
    }

    /// Bytes of a decoded pixel.
    pub fn pixel_bytes(&self) -> usize {
        if self.is_deep { 2 * self.channels } else { self.channels }
    }

    /// Decodes the image into `pixels`, row by row. Channels of 16 bits have their high byte first. An animation gives its first image.
    pub fn read(self, pixels: &mut [u8]) -> Result<(), Failure> {
        match self.data {
            Data::Png(mut reader) => reader.next_frame(pixels).map(drop).map_err(failed("PNG")),
            Data::Jpeg(mut decoder) => decoder.decode_into(pixels).map_err(failed("JPEG")),
            Data::WebP(mut decoder) => decoder.read_image(pixels).map_err(failed("WebP")),
        }
    }
}

fn checked([width, height]: [u32; 2]) -> Result<[u32; 2], Failure> {
    match width.max(height) > MAX_SIDE {
        true => Err(Failure::File(format!("it has {width} x {height} pixels"))),
        false => Ok([width, height]),
    }
}

fn failed<E: Display>(format: &'static str) -> impl Fn(E) -> Failure {
    move |error| Failure::File(format!("this {format} is damaged or unusual ({error})"))
}

/// Maximum number of bytes that the decoder of this image with `texels` texels takes besides its result. It may take them before
/// it notices that the file is too short. Tables do not count, because the length of the file limits them.
pub fn memory_of_decoder(bytes: &[u8], texels: u64) -> u64 {
    /// Maximum size of a data partition of a lossy WebP image in bytes. The file gives the size in 24 bits, and the decoder
    /// allocates this size.
    const PART: u64 = 1 << 24;
    match (Format::of(bytes), bytes.get(12..16)) {
        // Two bytes for each coefficient of a progressive image, in up to four channels.
        (Some(Format::Jpeg), _) => 8 * texels,
        // In bytes per texel: a copy with alpha (4), the data of two transforms (1/4 each), and the entropy image (3/8).
        (Some(Format::WebP), Some(b"VP8L")) => 5 * texels,
        // Luma (1) and chroma (1/2).
        (Some(Format::WebP), Some(b"VP8 ")) => 2 * texels + PART,
        // The alpha of a lossy image (1) is decoded as a lossless one (5). An animation has a frame (4) and a canvas (4).
        (Some(Format::WebP), _) => 8 * texels + PART,
        // Rows only.
        (Some(Format::Png) | None, _) => 0,
    }
}
