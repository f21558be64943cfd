//! The auxiliary layers in the file of an accumulation.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, Write};

use zip::ZipWriter;

use super::arrays::{Archive, any_values, array, start, text};
use super::file::Problem;
use crate::image::layers::{CHANNELS, Layers, Plane};

/// Name of the text with the names of the objects, by their numbers.
const OBJECTS: &str = "objects.json";
/// The channel whose values are numbers of objects.
const IDS: &str = "object.ID";

/// Writes an array for each channel.
pub fn write(zip: &mut ZipWriter<impl Write + Seek>, size: [usize; 2], layers: &Layers) -> io::Result<()> {
    for (name, plane) in &layers.channels {
        match plane {
            Plane::Floats(values) => array(zip, name, &size, values.iter().map(|&value| value.into()))?,
            Plane::Ids(ids) => array(zip, name, &size, ids.iter().map(|&id| id.into()))?,
        }
    }
    if !layers.objects.is_empty() {
        start(zip, OBJECTS, 0)?;
        zip.write_all(&serde_json::to_vec_pretty(&layers.objects)?)?;
    }
    Ok(())
}

/// Reads the channels that are there.
pub fn read<R: Read + Seek>(zip: &mut Archive<R>, size: [usize; 2]) -> Result<Layers, Problem> {
    let mut layers = Layers::default();
    for name in CHANNELS {
        if zip.index_for_name(&format!("{name}.npy")).is_none() {
            continue;
        }
        // Unlike sums, layers need not be finite: nothing is computed from them.
        let (_, values) = any_values(zip, name, |shape| shape == size)?;
        let plane = match name == IDS {
            false => Plane::Floats(values.into_iter().map(|value| value as f32).collect()),
            true => match values.iter().all(|&id| id.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&id)) {
                true => Plane::Ids(values.into_iter().map(|id| id as u32).collect()),
                false => {
                    return Err(Problem::Contents(format!(
                        "its array {name} has values that are not whole numbers from 0 on"
                    )));
                }
            },
        };
        layers.channels.push((name.into(), plane));
    }
    if zip.index_for_name(OBJECTS).is_some() {
        let objects: BTreeMap<u32, String> = serde_json::from_slice(&text(zip, OBJECTS)?)
            .map_err(|e| Problem::Contents(format!("its {OBJECTS} cannot be read ({e})")))?;
        layers.objects = objects;
    }
    Ok(layers)
}
