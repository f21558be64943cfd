//! The auxiliary layers of a scan: what each beam, or each point of the sensor, meets first. A NumPy file of records.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::image::array_set;
use crate::image::npy_file::header_of;
use crate::image::npy_read::read_header;
use crate::settings::aov::Aov;

/// The surface on the axis of a beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance from the sensor in metres; 0 without a surface.
    pub range: f32,
    /// Unit normal in world space, on the side of the sensor.
    pub normal: [f32; 3],
    /// Base colour, linear.
    pub albedo: [f32; 3],
    /// Number of the node, as in the layer `object.ID` of an image; 0 without a surface.
    pub object: u32,
    /// Radial velocity in m/s: how fast the surface and the sensor move apart. NaN if it is not known, and without a surface.
    pub velocity: f32,
}

impl Hit {
    /// A beam that meets no surface.
    pub const NONE: Hit = Hit { range: 0.0, normal: [0.0; 3], albedo: [0.0; 3], object: 0, velocity: f32::NAN };
}

/// The layers of a scan.
pub struct ScanLayers {
    /// The chosen layers. An arrival is not among them: the histograms contain it.
    pub chosen: Aov,
    /// One for each point of the sensor.
    pub hits: Vec<Hit>,
    /// Names of the nodes by number, of those that were hit.
    pub objects: BTreeMap<u32, String>,
}

/// The layers beside the array `path` of a scan.
pub fn layers_path(path: &Path) -> PathBuf {
    path.with_extension("aov.npy")
}

/// Bytes of a field of the records; `None` if there is no such field.
fn field_bytes(name: &str) -> Option<usize> {
    match name {
        "range" | "object_id" | "velocity" => Some(4),
        "normal" | "albedo" => Some(12),
        _ => None,
    }
}

/// What a point cloud takes from the layers of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// As [`Hit::range`], [`Hit::object`] and [`Hit::velocity`].
    pub range: f32,
    pub object: u32,
    pub velocity: f32,
}

/// Reads the surface of each record in the layers `path`, which have these `fields`. A missing field is 0, and a missing velocity NaN. Fails if
/// the file does not hold `count` such records, or if it does not belong to the JSON file beside it.
pub fn read_surfaces(path: &Path, fields: &[&str], count: usize) -> Result<Vec<Surface>> {
    let fail = || Error::File { path: path.into(), message: "does not fit its scan; measure the scan again".into() };
    check_readable(path)?;
    let bytes = std::fs::read(path).map_err(|e| read_error(path, e))?;
    array_set::check(path, &bytes)?;
    let header = read_header(&mut &bytes[..]).map_err(|e| read_error(path, e))?;
    let (_, begin) = header.ok_or_else(fail)?;
    let sizes: Vec<usize> = fields.iter().map(|name| field_bytes(name)).collect::<Option<_>>().ok_or_else(fail)?;
    let length = sizes.iter().sum::<usize>().max(1);
    let records = bytes.get(begin as usize..).ok_or_else(fail)?;
    if records.len() != count * length {
        return Err(fail());
    }
    let place = |wanted: &str| {
        let field = fields.iter().position(|name| *name == wanted)?;
        Some(sizes[..field].iter().sum::<usize>())
    };
    let (range, object, velocity) = (place("range"), place("object_id"), place("velocity"));
    let word = |record: &[u8], at: usize| record[at..at + 4].try_into().expect("a field of four bytes");
    let float = |record: &[u8], at: Option<usize>| at.map(|at| f32::from_le_bytes(word(record, at)));
    let surface = |record: &[u8]| Surface {
        range: float(record, range).unwrap_or(0.0),
        object: object.map_or(0, |at| u32::from_le_bytes(word(record, at))),
        velocity: float(record, velocity).unwrap_or(f32::NAN),
    };
    Ok(records.chunks_exact(length).map(surface).collect())
}

impl ScanLayers {
    /// Names of the fields of each record, in order.
    pub fn fields(&self) -> Vec<&'static str> {
        let Aov { depth, normal, albedo, object, velocity, .. } = self.chosen;
        let all =
            [("range", depth), ("normal", normal), ("albedo", albedo), ("object_id", object), ("velocity", velocity)];
        all.into_iter().filter_map(|(name, is_chosen)| is_chosen.then_some(name)).collect()
    }

    /// Writes the records as a `.npy` file, little-endian and without padding.
    pub fn write(&self, writer: &mut dyn Write) -> io::Result<()> {
        let kind = |name: &str| match name {
            "range" | "velocity" => "'<f4'",
            "object_id" => "'<u4'",
            _ => "'<f4', (3,)",
        };
        let fields: Vec<String> = self.fields().into_iter().map(|name| format!("('{name}', {})", kind(name))).collect();
        let Aov { depth, normal, albedo, object, velocity, .. } = self.chosen;
        writer.write_all(&header_of(&format!("[{}]", fields.join(", ")), &[self.hits.len()]))?;
        for hit in &self.hits {
            let floats = |is_chosen: bool, values: &'_ [f32]| if is_chosen { values.to_vec() } else { vec![] };
            let values = [floats(depth, &[hit.range]), floats(normal, &hit.normal), floats(albedo, &hit.albedo)];
            values.concat().iter().try_for_each(|value| writer.write_all(&value.to_le_bytes()))?;
            if object {
                writer.write_all(&hit.object.to_le_bytes())?;
            }
            if velocity {
                writer.write_all(&hit.velocity.to_le_bytes())?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_have_the_chosen_fields() {
        let hit = Hit { range: 2.5, normal: [0.0, 1.0, 0.0], albedo: [0.1; 3], object: 7, velocity: -1.5 };
        let chosen = "depth,object,velocity".parse().unwrap();
        let layers = ScanLayers { chosen, hits: vec![hit, Hit::NONE], objects: BTreeMap::new() };
        let mut bytes = vec![];
        layers.write(&mut bytes).unwrap();
        let (header, records) = bytes.split_at(128);
        let text = String::from_utf8_lossy(&header[10..]);
        let descr = "{'descr': [('range', '<f4'), ('object_id', '<u4'), ('velocity', '<f4')], 'fortran_order': False, 'shape': (2,), }";
        assert!(text.starts_with(descr), "{text}");
        let of_hit = [2.5f32.to_le_bytes(), 7u32.to_le_bytes(), (-1.5f32).to_le_bytes()];
        let wanted = [of_hit.concat(), vec![0; 8], f32::NAN.to_le_bytes().to_vec()].concat();
        assert_eq!(records, wanted);

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scan.aov.npy");
        std::fs::write(&path, &bytes).unwrap();
        let surfaces = read_surfaces(&path, &layers.fields(), 2).unwrap();
        assert_eq!(surfaces[0], Surface { range: 2.5, object: 7, velocity: -1.5 });
        assert_eq!((surfaces[1].range, surfaces[1].object), (0.0, 0));
        for (fields, count) in [(&["range", "object_id"][..], 5), (&["range"], 2), (&["colour"], 2)] {
            let message = read_surfaces(&path, fields, count).unwrap_err().to_string();
            assert!(message.contains("measure the scan again"), "{message}");
        }
    }
}
