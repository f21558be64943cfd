//! LAS 1.4, point format 6, with the extra bytes `channel` and `object_id`. Source: ASPRS, LAS Specification 1.4 R15.

use std::io::{self, Write};

use glam::DVec3;

use super::Point;

const HEADER_BYTES: u16 = 375;
/// Point format 6, and the extra bytes.
const POINT_BYTES: u16 = 30 + 2 + 4;
/// Number of returns that the header counts.
const RETURNS: usize = 15;
/// The header of a variable length record.
const RECORD_HEADER_BYTES: u16 = 54;
const DESCRIPTOR_BYTES: u16 = 192;
/// Names and types of the extra bytes: 3 is a 16-bit, 5 a 32-bit unsigned integer.
const EXTRA: [(&str, u8); 2] = [("channel", 3), ("object_id", 5)];
/// Coordinates are multiples of this length in metres, unless the cloud is too large for 32 bits.
const RESOLUTION: f64 = 1e-4;

/// Writes the file. Its intensity is the intensity times the square of the range, so a white diffuse target that faces the sensor has the
/// greatest number, 65535, at any range.
pub fn write(writer: &mut impl Write, points: &[Point]) -> io::Result<()> {
    let positions = || points.iter().map(|point| point.position);
    let low = positions().reduce(DVec3::min).unwrap_or_default();
    let high = positions().reduce(DVec3::max).unwrap_or_default();
    let scale = RESOLUTION.max((high - low).max_element() / f64::from(i32::MAX));
    write_header(writer, points, scale, [low, high])?;
    write_extra_bytes(writer)?;
    points.iter().try_for_each(|point| write_point(writer, point, scale, low))
}

fn write_header(writer: &mut impl Write, points: &[Point], scale: f64, [low, high]: [DVec3; 2]) -> io::Result<()> {
    let mut header = vec![];
    let records = RECORD_HEADER_BYTES + DESCRIPTOR_BYTES * EXTRA.len() as u16;
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
    header.extend(1u32.to_le_bytes());
    header.push(6);
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
    writer.write_all(&[0; 2])?;
    writer.write_all(&text::<16>("LASF_Spec"))?;
    writer.write_all(&4u16.to_le_bytes())?;
    writer.write_all(&(DESCRIPTOR_BYTES * EXTRA.len() as u16).to_le_bytes())?;
    writer.write_all(&text::<32>("extra bytes"))?;
    for (name, kind) in EXTRA {
        writer.write_all(&[0, 0, kind, 0])?;
        writer.write_all(&text::<32>(name))?;
        writer.write_all(&[0; 4 + 5 * 24])?;
        writer.write_all(&text::<32>(name))?;
    }
    Ok(())
}

fn write_point(writer: &mut impl Write, point: &Point, scale: f64, low: DVec3) -> io::Result<()> {
    let steps = ((point.position - low) / scale).round();
    steps.to_array().iter().try_for_each(|&x| writer.write_all(&(x as i32).to_le_bytes()))?;
    let reflectance = point.intensity * point.range.powi(2);
    writer.write_all(&((reflectance * f64::from(u16::MAX)).round() as u16).to_le_bytes())?;
    // Flags, classification and user data are 0, as are the scan angle and the source.
    writer.write_all(&[point.echo | point.echoes << 4, 0, 0, 0, 0, 0, 0, 0])?;
    writer.write_all(&point.time.to_le_bytes())?;
    writer.write_all(&point.channel.to_le_bytes())?;
    writer.write_all(&point.object.to_le_bytes())
}

/// `text`, filled up with zeros.
fn text<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    bytes
}
