//! LAS 1.4, point format 6, with the extra bytes `channel`, `object_id`, `velocity` and `velocity_deviation`, and the same compressed (LAZ). Sources: ASPRS, LAS
//! Specification 1.4 R15; Isenburg, "LASzip: lossless compression of LiDAR data", 2013.

use std::io::{self, Cursor, Write};

use glam::DVec3;
use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlr};

use super::Point;

const HEADER_BYTES: u16 = 375;
/// Point format 6, and the extra bytes.
const POINT_BYTES: u16 = 30 + EXTRA_BYTES;
const EXTRA_BYTES: u16 = 2 + 4 + 4 + 4;
/// Number of returns that the header counts.
const RETURNS: usize = 15;
/// The header of a variable length record.
const RECORD_HEADER_BYTES: u16 = 54;
const DESCRIPTOR_BYTES: u16 = 192;
/// Names and types of the extra bytes: 3 is a 16-bit, 5 a 32-bit unsigned integer, 9 a 32-bit float.
const EXTRA: [(&str, u8); 4] = [("channel", 3), ("object_id", 5), ("velocity", 9), ("velocity_deviation", 9)];
/// Set in the point format of compressed files.
const COMPRESSED: u8 = 0x80;
/// Coordinates are multiples of this length in metres, unless the cloud is too large for 32 bits.
const RESOLUTION: f64 = 1e-4;

/// Writes the file. Its intensity is the intensity times the square of the range, so a white diffuse target that faces the sensor has the
/// greatest number, 65535, at any range.
pub fn write(writer: &mut impl Write, points: &[Point]) -> io::Result<()> {
    let grid = Grid::of(points);
    write_header(writer, points, &grid, None)?;
    write_extra_bytes(writer)?;
    points.iter().try_for_each(|point| write_point(writer, point, &grid))
}

/// As [`write()`], compressed.
pub fn write_compressed(writer: &mut impl Write, points: &[Point]) -> io::Result<()> {
    let grid = Grid::of(points);
    let items = LazItemRecordBuilder::default_for_point_format_id(6, EXTRA_BYTES).map_err(io::Error::other)?;
    let record = LazVlr::from_laz_items(items);
    let mut contents = vec![];
    record.write_to(&mut contents)?;
    // The compressor counts positions from the begin of the file.
    let mut file = Cursor::new(vec![]);
    write_header(&mut file, points, &grid, Some(&contents))?;
    write_extra_bytes(&mut file)?;
    write_record_header(&mut file, LazVlr::USER_ID, LazVlr::RECORD_ID, contents.len() as u16, LazVlr::DESCRIPTION)?;
    file.write_all(&contents)?;
    let mut compressor = LasZipCompressor::new(file, record).map_err(io::Error::other)?;
    let mut raw = vec![];
    for point in points {
        raw.clear();
        write_point(&mut raw, point, &grid)?;
        compressor.compress_one(&raw)?;
    }
    compressor.done()?;
    writer.write_all(compressor.into_inner().get_ref())
}

/// How coordinates become integers, and the bounds of the cloud.
struct Grid {
    scale: f64,
    low: DVec3,
    high: DVec3,
}

impl Grid {
    fn of(points: &[Point]) -> Grid {
        let positions = || points.iter().map(|point| point.position);
        let low = positions().reduce(DVec3::min).unwrap_or_default();
        let high = positions().reduce(DVec3::max).unwrap_or_default();
        Grid { scale: RESOLUTION.max((high - low).max_element() / f64::from(i32::MAX)), low, high }
    }
}

/// `compression`: the contents of the record that describes the compression.
fn write_header(
    writer: &mut impl Write,
    points: &[Point],
    &Grid { scale, low, high }: &Grid,
    compression: Option<&[u8]>,
) -> io::Result<()> {
    let mut header = vec![];
    let of_compression = compression.map_or(0, |contents| RECORD_HEADER_BYTES + contents.len() as u16);
    let records = RECORD_HEADER_BYTES + DESCRIPTOR_BYTES * EXTRA.len() as u16 + of_compression;
    header.extend(b"LASF");
    header.extend([0; 2]);
    // Point formats from 6 on declare their coordinate system as WKT; there is none.
    header.extend(16u16.to_le_bytes());
    header.extend([0; 16]);
    header.extend([1, 4]);
    header.extend(text::<32>("taugate"));
    header.extend(text::<32>(concat!("taugate ", env!("CARGO_PKG_VERSION"))));
    // Day and year are unknown.
    header.extend([0; 4]);
    header.extend(HEADER_BYTES.to_le_bytes());
    header.extend(u32::from(HEADER_BYTES + records).to_le_bytes());
    header.extend((1 + u32::from(compression.is_some())).to_le_bytes());
    header.push(6 | if compression.is_some() { COMPRESSED } else { 0 });
    header.extend(POINT_BYTES.to_le_bytes());
    // The counts of older versions.
    header.extend([0; 24]);
    let lengths = [scale; 3].into_iter().chain(low.to_array());
    let bounds = (0..3).flat_map(|axis| [high[axis], low[axis]]);
    lengths.chain(bounds).for_each(|x| header.extend(x.to_le_bytes()));
    // No waveforms, and no extended records.
    header.extend([0; 20]);
    header.extend((points.len() as u64).to_le_bytes());
    let mut returns = [0u64; RETURNS];
    points.iter().for_each(|point| returns[usize::from(point.echo) - 1] += 1);
    returns.iter().for_each(|count| header.extend(count.to_le_bytes()));
    debug_assert_eq!(header.len(), usize::from(HEADER_BYTES));
    writer.write_all(&header)
}

/// The record that names the extra bytes of each point.
fn write_extra_bytes(writer: &mut impl Write) -> io::Result<()> {
    write_record_header(writer, "LASF_Spec", 4, DESCRIPTOR_BYTES * EXTRA.len() as u16, "extra bytes")?;
    for (name, kind) in EXTRA {
        writer.write_all(&[0, 0, kind, 0])?;
        writer.write_all(&text::<32>(name))?;
        writer.write_all(&[0; 4 + 5 * 24])?;
        writer.write_all(&text::<32>(name))?;
    }
    Ok(())
}

/// The header of a variable length record with so many bytes.
fn write_record_header(writer: &mut impl Write, user: &str, id: u16, bytes: u16, about: &str) -> io::Result<()> {
    writer.write_all(&[0; 2])?;
    writer.write_all(&text::<16>(user))?;
    writer.write_all(&id.to_le_bytes())?;
    writer.write_all(&bytes.to_le_bytes())?;
    writer.write_all(&text::<32>(about))
}

fn write_point(writer: &mut impl Write, point: &Point, grid: &Grid) -> io::Result<()> {
    let steps = ((point.position - grid.low) / grid.scale).round();
    steps.to_array().iter().try_for_each(|&x| writer.write_all(&(x as i32).to_le_bytes()))?;
    let reflectance = point.intensity * point.range.powi(2);
    writer.write_all(&((reflectance * f64::from(u16::MAX)).round() as u16).to_le_bytes())?;
    // Flags, classification and user data are 0, as are the scan angle and the source.
    writer.write_all(&[point.echo | point.echoes << 4, 0, 0, 0, 0, 0, 0, 0])?;
    writer.write_all(&point.time.to_le_bytes())?;
    writer.write_all(&point.channel.to_le_bytes())?;
    writer.write_all(&point.object.to_le_bytes())?;
    writer.write_all(&point.velocity.to_le_bytes())?;
    writer.write_all(&point.deviation.to_le_bytes())
}

/// `text`, filled up with zeros.
fn text<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use laz::LasZipDecompressor;

    use super::*;

    /// The points of both kinds of files are the same, byte by byte.
    #[test]
    fn compression_loses_nothing() {
        let point = |k: u32| Point {
            shot: 0,
            position: DVec3::new(f64::from(k) * 0.37, -1.5, f64::from(k % 7)),
            range: 1.0 + f64::from(k),
            extent: [0.0, 2e3],
            intensity: 0.5 / (1.0 + f64::from(k)).powi(2),
            echo: 1 + (k % 2) as u8,
            echoes: 2,
            time: f64::from(k / 2) * 1e-4,
            channel: (k % 3) as u16,
            object: k % 5,
            velocity: -3.25,
            deviation: 0.5,
        };
        let points: Vec<Point> = (0..1000).map(point).collect();
        let [mut plain, mut compressed] = [vec![], vec![]];
        write(&mut plain, &points).unwrap();
        write_compressed(&mut compressed, &points).unwrap();
        let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let [plain_start, start] = [&plain, &compressed].map(|bytes| word(bytes, 96));
        assert!(compressed.len() * 3 < plain.len(), "{} and {} bytes", compressed.len(), plain.len());
        assert_eq!((compressed[104], word(&compressed, 100)), (6 | COMPRESSED, 2));
        let record = plain_start + usize::from(RECORD_HEADER_BYTES);
        let vlr = LazVlr::from_buffer(&compressed[record..start]).unwrap();
        let mut file = Cursor::new(&compressed);
        file.set_position(start as u64);
        let mut points = vec![0; plain.len() - plain_start];
        LasZipDecompressor::new(file, vlr).unwrap().decompress_many(&mut points).unwrap();
        assert!(points == plain[plain_start..]);
    }
}
