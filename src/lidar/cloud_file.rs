//! Writes point clouds: PLY, LAS or NumPy arrays with named fields.

use std::io::{self, Write};
use std::path::Path;

use super::Point;
use super::las;
use crate::error::{Error, Result};
use crate::files::{has_extension, write_atomically};
use crate::image::npy_file::header_of;

/// Names of the fields, their types in NumPy, and their types in PLY.
const FIELDS: [(&str, &str, &str); 11] = [
    ("x", "<f8", "double"),
    ("y", "<f8", "double"),
    ("z", "<f8", "double"),
    ("intensity", "<f4", "float"),
    ("echo", "<u1", "uchar"),
    ("n_echoes", "<u1", "uchar"),
    ("time", "<f8", "double"),
    ("channel", "<u2", "ushort"),
    ("object_id", "<u4", "uint"),
    ("velocity", "<f4", "float"),
    ("velocity_deviation", "<f4", "float"),
];

/// Fails if the extension of `path` is that of no point cloud.
pub fn check_extension(path: &Path) -> Result<()> {
    match ["ply", "las", "laz", "npy"].iter().any(|extension| has_extension(path, extension)) {
        true => Ok(()),
        false => Err(Error::settings(format!("the output {} must end in .ply, .las, .laz or .npy", path.display()))),
    }
}

/// Writes the points in the format of the extension of `path`: `.ply` (binary, little-endian), `.las` (version 1.4, point format 6), `.laz` (the
/// same, compressed) or `.npy` (an array of records). An existing file is replaced; after an error, it is unchanged.
pub fn write(path: &Path, points: &[Point]) -> Result<()> {
    check_extension(path)?;
    write_atomically(path, |writer| {
        if has_extension(path, "las") {
            return las::write(writer, points);
        }
        if has_extension(path, "laz") {
            return las::write_compressed(writer, points);
        }
        match has_extension(path, "ply") {
            true => writer.write_all(ply_header(points.len()).as_bytes())?,
            false => {
                let fields: Vec<String> = FIELDS.iter().map(|(name, npy, _)| format!("('{name}', '{npy}')")).collect();
                writer.write_all(&header_of(&format!("[{}]", fields.join(", ")), &[points.len()]))?;
            }
        }
        points.iter().try_for_each(|point| write_record(writer, point))
    })
}

fn ply_header(count: usize) -> String {
    let properties: String = FIELDS.iter().map(|(name, _, ply)| format!("property {ply} {name}\n")).collect();
    format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n")
}

/// Writes the [`FIELDS`] of a point without padding.
fn write_record(writer: &mut impl Write, point: &Point) -> io::Result<()> {
    point.position.to_array().iter().try_for_each(|x| writer.write_all(&x.to_le_bytes()))?;
    writer.write_all(&(point.intensity as f32).to_le_bytes())?;
    writer.write_all(&[point.echo, point.echoes])?;
    writer.write_all(&point.time.to_le_bytes())?;
    writer.write_all(&point.channel.to_le_bytes())?;
    writer.write_all(&point.object.to_le_bytes())?;
    writer.write_all(&point.velocity.to_le_bytes())?;
    writer.write_all(&point.deviation.to_le_bytes())
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;

    fn points() -> Vec<Point> {
        let first = Point {
            shot: 0,
            position: dvec3(1.5, -2.25, 3.0),
            range: 4.0,
            extent: [3.5, 4.5],
            intensity: 0.03,
            echo: 1,
            echoes: 2,
            time: 0.125,
            channel: 300,
            object: 70_000,
            velocity: -7.5,
            deviation: 0.75,
        };
        vec![first, Point { position: dvec3(-1.0, 0.0, 1e3), intensity: 1e-3, echo: 2, range: 1e3, ..first }]
    }

    fn written(name: &str) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        write(&path, &points()).unwrap();
        std::fs::read(path).unwrap()
    }

    fn f64_at(bytes: &[u8], at: usize) -> f64 {
        f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
    }

    #[test]
    fn records_of_ply_and_npy_are_read_back() {
        let ply = written("a.ply");
        let end = ply.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&ply[..end]).unwrap();
        assert!(header.contains("element vertex 2\nproperty double x\n"), "{header}");
        let npy = written("a.npy");
        let begin = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        let header = std::str::from_utf8(&npy[10..begin]).unwrap();
        assert!(header.contains("('velocity_deviation', '<f4')]") && header.contains("(2,)"), "{header}");
        assert_eq!(ply[end..], npy[begin..]);
        let record = &ply[end..];
        assert_eq!(record.len(), 2 * 52);
        assert_eq!([0, 8, 16, 30].map(|at| f64_at(record, at)), [1.5, -2.25, 3.0, 0.125]);
        assert_eq!(f32::from_le_bytes(record[24..28].try_into().unwrap()), 0.03);
        assert_eq!(record[28..30], [1, 2]);
        assert_eq!(u16::from_le_bytes([record[38], record[39]]), 300);
        assert_eq!(u32::from_le_bytes(record[40..44].try_into().unwrap()), 70_000);
        assert_eq!([44, 48].map(|at| f32::from_le_bytes(record[at..at + 4].try_into().unwrap())), [-7.5, 0.75]);
    }

    #[test]
    fn las_is_read_back() {
        let las = written("a.las");
        let u32_at = |at: usize| u32::from_le_bytes(las[at..at + 4].try_into().unwrap());
        let u16_at = |at: usize| u16::from_le_bytes([las[at], las[at + 1]]);
        let u64_at = |at: usize| u64::from_le_bytes(las[at..at + 8].try_into().unwrap());
        assert_eq!((&las[..4], las[24], las[25], u16_at(94), las[104]), (&b"LASF"[..], 1, 4, 375, 6));
        let (offset, length) = (u32_at(96) as usize, usize::from(u16_at(105)));
        assert_eq!(las.len(), offset + 2 * length);
        assert_eq!([247, 255, 263, 271].map(u64_at), [2, 1, 1, 0]);
        for (k, point) in points().iter().enumerate() {
            let at = offset + k * length;
            for axis in 0..3 {
                let stored = f64::from(u32_at(at + 4 * axis) as i32);
                let x = stored * f64_at(&las, 131 + 8 * axis) + f64_at(&las, 155 + 8 * axis);
                assert!((x - point.position[axis]).abs() < 1e-4, "{x} {}", point.position[axis]);
                let [max, min] = [0, 8].map(|side| f64_at(&las, 179 + 16 * axis + side));
                assert!(min <= x + 1e-4 && x <= max + 1e-4);
            }
            // The intensity is the reflectance: that of a white target at the range is full.
            let full = (point.intensity * point.range.powi(2) * 65535.0).round().min(65535.0);
            assert_eq!(f64::from(u16_at(at + 12)), full);
            assert_eq!(las[at + 14], point.echo | point.echoes << 4);
            assert_eq!(f64_at(&las, at + 22), 0.125);
            assert_eq!((u16_at(at + 30), u32_at(at + 32)), (300, 70_000));
        }
    }

    #[test]
    fn other_extensions_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let message = write(&folder.path().join("a.xyz"), &points()).unwrap_err().to_string();
        assert!(message.contains("must end in .ply, .las, .laz or .npy"), "{message}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
