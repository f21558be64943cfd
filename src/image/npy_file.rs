//! Writes images as NumPy arrays (`.npy`), with a JSON file beside each that says what the array contains.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::image::depth;
use crate::image::exr_file::{Provenance, version};
use crate::image::film::Film;
use crate::image::response_film::ResponseFilm;
use crate::image::scan_layers::layers_path;
use crate::settings::frequencies::Frequencies;
use crate::settings::response_specs::ResponseSpec;
use crate::settings::{Response, Responses};

/// The file beside an array. The names of the first three fields are those of mitransient; lengths are metres of optical path.
#[derive(Serialize)]
struct Description<'a> {
    #[serde(flatten)]
    bins: Option<Bins>,
    /// The responses along the axis T of the array, in order.
    responses: Vec<Entry<'a>>,
    /// Axes of the array and their lengths.
    axes: &'static str,
    shape: Vec<usize>,
    unit: &'static str,
    /// Width and height of the whole image, and the part of it in the array: x0, x1, y0, y1.
    resolution: [u32; 2],
    crop: [u32; 4],
    samples_per_pixel: u64,
    seconds: f64,
    seed: u32,
    version: String,
    /// The experiment file that renders the array again.
    settings: &'a str,
}

/// The gates, if they all have one width and abut.
#[derive(Serialize)]
pub(super) struct Bins {
    start_opl: f64,
    bin_width_opl: f64,
    temporal_bins: u32,
}

impl Bins {
    pub(super) fn of(responses: &Responses) -> Option<Bins> {
        responses.uniform().map(|gates| Bins {
            start_opl: gates.whole().lo,
            bin_width_opl: gates.width(),
            temporal_bins: gates.count(),
        })
    }
}

#[derive(Serialize)]
pub(super) struct Entry<'a> {
    name: &'a str,
    /// The response as `--response` takes it; null for a table that comes from no file.
    response: Option<String>,
    gate_begin_m: f64,
    /// Null for a gate without an end.
    gate_end_m: f64,
    /// The integral of the weights over travel time: the length of a gate with any edges. Null for a gate without an end.
    weight_integral_m: f64,
    /// The period of a pulsed laser: light of all its pulses counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    repeat_m: Option<f64>,
}

impl Entry<'_> {
    pub(super) fn of(response: &Response) -> Entry<'_> {
        let text = ResponseSpec::of(response).map(|spec| spec.to_string());
        Entry {
            name: response.name(),
            response: text,
            gate_begin_m: response.gate().lo,
            gate_end_m: response.gate().hi,
            weight_integral_m: response.integral(),
            repeat_m: response.period(),
        }
    }
}

/// The JSON file beside the array `path`.
pub fn description_path(path: &Path) -> PathBuf {
    path.with_extension("json")
}

/// The array of variances beside the array `path`.
pub fn variance_path(path: &Path) -> PathBuf {
    path.with_extension("variance.npy")
}

/// The unit of a render, in the JSON file.
const RADIANCE: &str = "W/(m^2 sr)";
/// The unit of the counts of a detector, in the JSON file.
pub const COUNTS: &str = "counts over all pulses";

/// Writes the means as 32-bit floats: of shape (height, width, 3) for one response, of shape (height, width, responses, 3) for
/// several. Row 0 is at the top. The files beside an earlier array stay, see [`stale_arrays`].
pub fn write_means(path: &Path, film: &Film, responses: Option<&ResponseFilm>) -> Result<()> {
    match responses {
        None => write_array(path, &shape(film, None), film.mean()),
        Some(all) => {
            write_array(path, &shape(film, responses), (0..all.pixels()).flat_map(|pixel| all.means_of(pixel)))
        }
    }
}

/// Writes the variances of the means, in the same shape.
pub fn write_variances(path: &Path, film: &Film, responses: Option<&ResponseFilm>) -> Result<()> {
    match responses {
        None => write_array(path, &shape(film, None), film.variance_of_mean()),
        Some(all) => {
            write_array(path, &shape(film, responses), (0..all.pixels()).flat_map(|pixel| all.variances_of(pixel)))
        }
    }
}

/// The array of depths beside the array `path` of a continuous-wave sensor.
pub fn depth_path(path: &Path) -> PathBuf {
    path.with_extension("depth.npy")
}

/// Writes the depths in metres, of shape (height, width). For two frequencies, it is the depth that both agree on.
pub fn write_depths(path: &Path, film: &Film, images: &ResponseFilm, frequencies: &Frequencies) -> Result<()> {
    let depths = depth::planes(images, frequencies).pop().map_or(vec![], |(_, depths)| depths);
    write_array(path, &[film.height() as usize, film.width() as usize], depths)
}

/// Writes the JSON file that describes the arrays.
pub fn write_description(
    path: &Path,
    film: &Film,
    responses: Option<&ResponseFilm>,
    provenance: &Provenance,
) -> Result<()> {
    let crop = provenance.crop;
    let description = Description {
        bins: Bins::of(&provenance.responses),
        responses: provenance.responses.iter().map(Entry::of).collect(),
        axes: if responses.is_some() { "height, width, response, channel" } else { "height, width, channel" },
        shape: shape(film, responses),
        unit: RADIANCE,
        resolution: provenance.resolution,
        crop: [crop.x0, crop.x1, crop.y0, crop.y1],
        samples_per_pixel: film.samples(),
        seconds: provenance.seconds,
        seed: provenance.seed,
        version: version(),
        settings: &provenance.settings,
    };
    write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &description)?))
}

fn shape(film: &Film, responses: Option<&ResponseFilm>) -> Vec<usize> {
    let mut shape = vec![film.height() as usize, film.width() as usize];
    shape.extend(responses.map(ResponseFilm::responses));
    shape.push(3);
    shape
}

/// Writes an array of 32-bit floats in C order. `values` are as many as `shape` says.
pub fn write_array(path: &Path, shape: &[usize], values: impl IntoIterator<Item = f32>) -> Result<()> {
    write_atomically(path, |writer| {
        writer.write_all(&header("<f4", shape))?;
        values.into_iter().try_for_each(|value| writer.write_all(&value.to_le_bytes()))
    })
}

/// The arrays beside the array `path` that not every array has: its variances and its depths.
pub fn paths_beside(path: &Path) -> [PathBuf; 2] {
    [variance_path(path), depth_path(path)]
}

/// The variances, depths and layers of an earlier array of this name, which a new array without them must not keep. The JSON file beside the
/// earlier array tells whether it had them. Without that file, arrays with these names belong to somebody else. Call this function
/// before the new JSON file is written.
pub fn stale_arrays(path: &Path) -> Vec<PathBuf> {
    let text = std::fs::read(description_path(path)).unwrap_or_default();
    let earlier: serde_json::Value = serde_json::from_slice(&text).unwrap_or_default();
    if !earlier["unit"].is_string() || !earlier["shape"].is_array() {
        return vec![];
    }
    let settings = earlier["settings"].as_str().and_then(|text| text.parse::<toml::Table>().ok());
    let has_depths = settings.is_some_and(|settings| settings.get("gate").is_some_and(|gate| gate.get("cw").is_some()));
    let depths = has_depths.then(|| depth_path(path));
    let layers = earlier["aov"].is_array().then(|| layers_path(path));
    [variance_path(path)].into_iter().chain(depths).chain(layers).collect()
}

/// Writes an array as [`write_array`] does, and removes the [`stale_arrays`] beside it.
pub fn write_new_array(path: &Path, shape: &[usize], values: impl IntoIterator<Item = f32>) -> Result<()> {
    let stale = stale_arrays(path);
    write_array(path, shape, values)?;
    remove_stale(&stale)
}

/// Removes [`stale_arrays`], so that no reader takes them for those of the new array.
pub fn remove_stale(stale: &[PathBuf]) -> Result<()> {
    stale.iter().try_for_each(|beside| match std::fs::remove_file(beside) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            let message = format!("belongs to an earlier array, but cannot be removed: {error}; remove it");
            Err(Error::io(beside, message, error))
        }
        _ => Ok(()),
    })
}

/// The header of a `.npy` file with values of the type `kind`: `<f4` or `<f8`, little-endian floats.
pub(super) fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    header_of(&format!("'{kind}'"), shape)
}

/// The header of a `.npy` file of version 1.0. `kind`: the type of a value as Python writes it, a name in quotes or a list of fields. The
/// length of the header is a multiple of 64 bytes, so that programs can map the array into memory.
pub(super) fn header_of(kind: &str, shape: &[usize]) -> Vec<u8> {
    let mut sides = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    if shape.len() == 1 {
        // Python writes a tuple of one number with a comma.
        sides.push(',');
    }
    let mut text = format!("{{'descr': {kind}, 'fortran_order': False, 'shape': ({sides}), }}");
    // Ten bytes precede the text, and a line break ends it.
    let padding = (10 + text.len() + 1).next_multiple_of(64) - (10 + text.len() + 1);
    text.push_str(&" ".repeat(padding));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_as_numpy_writes_it() {
        let bytes = header("<f4", &[2, 3, 300, 3]);
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
        assert_eq!(bytes.len(), 128);
        let text = std::str::from_utf8(&bytes[10..]).unwrap();
        assert!(text.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 300, 3), }"), "{text}");
        assert!(text.ends_with(" \n"));
    }
}
