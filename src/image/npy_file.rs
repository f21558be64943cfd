//! Writes images as NumPy arrays (`.npy`), with a JSON file beside each that says what the array contains.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::Result;
use crate::image::array_set::{ArraySet, Role};
use crate::image::depth;
use crate::image::exr_file::{Provenance, version};
use crate::image::film::Film;
use crate::image::response_film::ResponseFilm;
use crate::settings::response_specs::ResponseSpec;
use crate::settings::{Response, Responses};

/// The file beside an array. The names of the first three fields are those of mitransient; lengths are metres of optical path.
#[derive(Serialize)]
pub struct Description<'a> {
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
    /// FMCW sensors: the beat frequency in Hz per metre of optical path; the gates are lengths of paths at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    beat_hz_per_m: Option<f64>,
}

impl Bins {
    pub(super) fn of(responses: &Responses) -> Option<Bins> {
        responses.uniform().map(|gates| Bins {
            start_opl: gates.whole().lo,
            bin_width_opl: gates.width(),
            temporal_bins: gates.count(),
            beat_hz_per_m: responses.chirp().map(|chirp| chirp.hertz_per_metre()),
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

/// The array of depths beside the array `path` of a continuous-wave sensor.
pub fn depth_path(path: &Path) -> PathBuf {
    path.with_extension("depth.npy")
}

/// The array of velocities beside the array `path` of a scan.
pub fn velocity_path(path: &Path) -> PathBuf {
    path.with_extension("velocity.npy")
}

/// Writes the array of a render and the files beside it, as one [`ArraySet`]. `has_variance`: whether the variances are written too. The
/// arrays have 32-bit floats; row 0 is at the top.
///
/// | file | shape |
/// |---|---|
/// | the means, and their variances | (height, width, 3) for one response, (height, width, responses, 3) for several |
/// | the depths of a continuous-wave sensor in metres | (height, width); NaN without light. With two frequencies, both agree on the depth |
pub fn write(
    path: &Path,
    film: &Film,
    responses: Option<&ResponseFilm>,
    provenance: &Provenance,
    has_variance: bool,
) -> Result<()> {
    let mut set = ArraySet::new(path);
    let shape = shape(film, responses);
    match responses {
        None => set.add(Role::Array, &shape, film.shown())?,
        Some(all) => set.add(Role::Array, &shape, (0..all.pixels()).flat_map(|pixel| all.means_of(pixel)))?,
    }
    match responses.filter(|_| has_variance) {
        None if has_variance => set.add(Role::Variance, &shape, film.variance_of_mean())?,
        None => {}
        Some(all) => set.add(Role::Variance, &shape, (0..all.pixels()).flat_map(|pixel| all.variances_of(pixel)))?,
    }
    if let Some(images) = responses.filter(|_| provenance.responses.have_depths()) {
        let depths = depth::planes(images, &provenance.responses).pop().map_or(vec![], |(_, depths)| depths);
        set.add(Role::Depth, &[film.height() as usize, film.width() as usize], depths)?;
    }
    set.publish(&description(film, responses, provenance))
}

/// The JSON file beside the array of a render, without the record of the arrays.
pub fn description<'a>(film: &Film, responses: Option<&ResponseFilm>, provenance: &'a Provenance) -> Description<'a> {
    let crop = provenance.crop;
    Description {
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
    }
}

fn shape(film: &Film, responses: Option<&ResponseFilm>) -> Vec<usize> {
    let mut shape = vec![film.height() as usize, film.width() as usize];
    shape.extend(responses.map(ResponseFilm::responses));
    shape.push(3);
    shape
}

/// The arrays beside the array `path` that not every array has: its variances and its depths.
pub fn paths_beside(path: &Path) -> [PathBuf; 2] {
    [variance_path(path), depth_path(path)]
}

/// The header of a `.npy` file of version 1.0 with values of the type `kind`: `<f4` or `<f8`, little-endian floats. Its length is a
/// multiple of 64 bytes, so that programs can map the array into memory.
pub(super) fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    header_of(&format!("'{kind}'"), shape)
}

/// The header of a `.npy` file of version 1.0. `kind`: the type of a value as Python writes it, a name in quotes or a list of fields. The
/// length of the header is a multiple of 64 bytes, so that programs can map the array into memory.
pub(crate) fn header_of(kind: &str, shape: &[usize]) -> Vec<u8> {
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
