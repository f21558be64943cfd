//! Reads the header of an EXR file, and refuses files that the decoder could not handle.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::meta::BlockDescription;
use exr::meta::header::Header;
use exr::prelude::{AttributeValue, IntegerBounds, MetaData, Vec2};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::image::exr_file::text;
use crate::settings::MAX_PIXELS;
use crate::settings::aov::Aov;

/// Maximum size in bytes of a decoded block of an EXR file: a tile or some rows, with all channels. The decoder holds one block
/// per thread. A block of our own largest image, with all auxiliary layers, has 16 MiB.
const MAX_BLOCK_BYTES: u64 = 64 << 20;
/// Number of pixels that an image may have even if its file is short. Together with [`PIXELS_PER_BYTE`], this stops small files that
/// claim gigabytes.
const FREE_PIXELS: u64 = 8 << 20;
/// Pixels that an image may have for each byte of its file, beyond [`FREE_PIXELS`]. Deflate packs at most 1032 bytes into one, and
/// a pixel of three 16-bit channels has 6.
const PIXELS_PER_BYTE: u64 = 256;
/// Names of the channels of an image.
pub(super) const COLOR_CHANNELS: [&str; 3] = ["R", "G", "B"];

/// The header of the first image in the file; `None` if it cannot be read.
fn first(path: &Path) -> Option<Header> {
    let file = File::open(path).ok()?;
    let meta = MetaData::read_from_buffered(BufReader::new(file), false).ok()?;
    meta.headers.into_iter().next()
}

/// The settings as an experiment file that [`super::exr_file::write`] stored, `tof:settings`; `None` if the file cannot be read or
/// has none.
pub fn read_settings(path: &Path) -> Option<String> {
    match first(path)?.own_attributes.other.get(&text("tof:settings"))? {
        AttributeValue::Text(settings) => Some(settings.to_string()),
        _ => None,
    }
}

/// Column and row of the first pixel in the whole image; `None` if the file cannot be read.
pub fn read_corner(path: &Path) -> Option<[i32; 2]> {
    let corner = first(path)?.own_attributes.layer_position;
    Some([corner.x(), corner.y()])
}

/// The first of the layers `wanted` that the file lacks; `None` if it has them all. A file that cannot be read has none.
pub fn missing_layer(path: &Path, wanted: Aov) -> Option<&'static str> {
    let channels = first(path).map_or(vec![], |header| header.channels.list.to_vec());
    let has = |layer: &str| channels.iter().any(|channel| channel.name.to_string().split('.').next() == Some(layer));
    wanted.names().find(|layer| !has(layer))
}

/// Width and height of an image that [`super::exr_file::read_picture`] accepts, see [`header`].
pub fn read_size(path: &Path) -> Result<[u32; 2]> {
    let size = window(&header(path, COLOR_CHANNELS.len())?).size;
    Ok([size.width() as u32, size.height() as u32])
}

/// The region of the pixels of a picture, in the coordinates of the data window. Other programs store only a part of the display
/// window if the rest is black, or more than it, so their pictures are the display window. An image of taugate is its data window: a
/// crop leaves the other pixels unknown.
pub(super) fn window(header: &Header) -> IntegerBounds {
    match header.own_attributes.other.contains_key(&text("tof:version")) {
        true => header.data_window(),
        false => header.shared_attributes.display_window,
    }
}

/// The header of an image of which `channels` channels will be read, or all channels if it has fewer. Fails if the decoder would
/// allocate too much memory, if the file is not one flat image, or if it has no channels R, G, B. A header of a few bytes may claim
/// any size, so this is checked before memory is allocated.
pub(super) fn header(path: &Path, channels: usize) -> Result<Header> {
    let fail = |message: String| Err(Error::File { path: path.into(), message });
    let length = check_readable(path)?;
    let file = File::open(path).map_err(|e| read_error(path, e))?;
    let meta = MetaData::read_from_buffered(BufReader::new(file), false).map_err(|e| unreadable(path, e))?;
    let [header] = &meta.headers[..] else {
        return fail(format!("has {} parts; extract one into a file of its own", meta.headers.len()));
    };
    if header.deep {
        return fail("is a deep image, which taugate does not read; flatten it".into());
    }
    let sizes = [window(header).size, header.layer_size].map(|Vec2(width, height)| (width as u64, height as u64));
    let (width, height) =
        sizes.into_iter().max_by_key(|(width, height)| width.saturating_mul(*height)).unwrap_or_default();
    if width.saturating_mul(height) > MAX_PIXELS {
        return fail(format!(
            "has a header of {width} x {height} pixels, but taugate reads at most {} megapixels; crop the image",
            MAX_PIXELS >> 20
        ));
    }
    let images = channels.min(header.channels.list.len()).div_ceil(COLOR_CHANNELS.len()) as u64;
    if images * width * height > FREE_PIXELS + PIXELS_PER_BYTE * length {
        return fail(format!(
            "has a header of {width} x {height} pixels, too many for its {length} bytes; write the image again"
        ));
    }
    let ranges = |window: IntegerBounds| {
        let IntegerBounds { position, size } = window;
        [(position.x(), size.width()), (position.y(), size.height())].map(|(at, size)| (i64::from(at), size as i64))
    };
    let mut ranges = ranges(window(header)).into_iter().zip(ranges(header.data_window()));
    if !ranges.all(|((a, length_a), (b, length_b))| a < b + length_b && b < a + length_a) {
        return fail(
            "stores no pixel of its display window; write it again with both windows in the same place".into(),
        );
    }
    if block_bytes(header) > MAX_BLOCK_BYTES {
        return fail(format!(
            "has blocks of {} MiB, but taugate reads at most {} MiB; write it with smaller tiles or fewer channels",
            block_bytes(header) >> 20,
            MAX_BLOCK_BYTES >> 20
        ));
    }
    let names = || header.channels.list.iter().map(|channel| channel.name.to_string());
    if !COLOR_CHANNELS.iter().all(|wanted| names().any(|name| name == *wanted)) {
        let names = names().collect::<Vec<_>>().join(", ");
        return fail(format!("has no channels R, G, B, only {names}; write it with these names"));
    }
    if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return fail("has subsampled channels; write it with R, G, B at full resolution".into());
    }
    Ok(header.clone())
}

/// Maximum size of a decoded block in bytes, all channels included.
fn block_bytes(header: &Header) -> u64 {
    let Vec2(width, height) = header.layer_size;
    let (columns, rows) = match &header.blocks {
        BlockDescription::Tiles(tiles) => (tiles.tile_size.width().min(width), tiles.tile_size.height().min(height)),
        BlockDescription::ScanLines => (width, header.compression.scan_lines_per_block().min(height)),
    };
    (columns as u64 * rows as u64).saturating_mul(header.channels.bytes_per_pixel as u64)
}

pub(super) fn unreadable(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => read_error(path, error),
        other => {
            Error::File { path: path.into(), message: format!("is not an EXR file that taugate can read: {other}") }
        }
    }
}
