//! The light that `taugate detect` reads: the images of gates, or a scan.

use std::path::Path;

use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::detector::light::{Light, Values};
use taugate::internals::files::has_extension;
use taugate::internals::image::accumulation::file::read_about;
use taugate::internals::image::array_set::read_whole;
use taugate::internals::image::exr_header::{read_corner, read_settings};
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_file::description_path;
use taugate::internals::image::npy_read::{DescribedResponse, described, is_counts, is_scan, read, read_scan};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::job::memory;
use taugate::internals::settings::doppler::Doppler;

use crate::app::accumulated;

/// How the user can need less memory.
pub const REMEDY: &str = "render fewer gates, or fewer pixels or points";

/// The light in a file.
pub struct Input {
    pub light: Light,
    /// Column and row of the first pixel in the whole image, if they are known.
    pub corner: Option<[i64; 2]>,
    /// The description of the radiance: the JSON file beside an array, or the gates of an image or of sums.
    pub description: Value,
}

impl Input {
    /// Reads an array (.npy), an image (.exr) or sums (.acc).
    pub fn read(path: &Path) -> Result<Input, Error> {
        match has_extension(path, "npy") {
            true => read_whole(path, || Input::read_files(path)),
            false => Input::read_files(path),
        }
    }

    fn read_files(path: &Path) -> Result<Input, Error> {
        let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
        let (values, gates) = if has_extension(path, "exr") {
            let (array, gates) = exr_responses::read(path)?;
            let gates = gates.ok_or_else(|| fail("names no gate; give an image that taugate rendered with --gate"))?;
            (Values::Images(array), gates)
        } else if has_extension(path, "npy") {
            if is_counts(path) {
                return Err(fail("holds counts of a detector, not light; give the light"));
            }
            let values = match is_scan(path) {
                true => Values::Scan(read_scan(path)?),
                false => Values::Images(read(path)?),
            };
            let gates = described(path, values.gates()).ok_or_else(|| {
                fail("comes without the JSON file that names its gates; keep that file beside the array")
            })?;
            (values, gates)
        } else if accumulated::is_sums(path) {
            let (array, gates) = accumulated::array(path)?;
            (Values::Images(array), gates)
        } else {
            return Err(Error::settings(format!(
                "{} must be an array (.npy), an image (.exr) or sums (.acc) of taugate render",
                path.display()
            )));
        };
        let images = values.gates();
        let light = Light::new(values, &gates).map_err(|error| fail(&error.to_string()))?;
        let beside = || serde_json::from_slice(&std::fs::read(description_path(path)).ok()?).ok();
        let of_file = if has_extension(path, "npy") { beside().filter(Value::is_object) } else { None };
        let description = of_file.unwrap_or_else(|| description(images, &gates));
        if records_speeds(path, &description) {
            return Err(fail(
                "records velocities or beats, but a detector counts the light of travel times; render it without --doppler and --fmcw, or scan it without --fmcw",
            ));
        }
        let corner = corner(path, &description)?;
        Ok(Input { light, corner, description })
    }
}

/// Bytes of `values` numbers of 32 bits.
pub fn bytes_of(values: usize) -> u64 {
    4 * values as u64
}

/// Fails if the light in the file needs more memory than is `free`.
pub fn check_readable_in(free: Option<u64>, path: &Path) -> Result<(), Error> {
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let needed = if has_extension(path, "npy") {
        // The bytes of the file, and the numbers in them.
        2 * length
    } else if accumulated::is_sums(path) {
        // The sums, and the means of 32 bits.
        length + length / 2
    } else {
        return Ok(());
    };
    memory::check_bytes(needed, free, &format!("the light in {}", path.display()), REMEDY)
}

/// Column and row of the first pixel in the whole image, if they are known. `description` is that of the file.
fn corner(path: &Path, description: &Value) -> Result<Option<[i64; 2]>, Error> {
    if has_extension(path, "exr") {
        return Ok(read_corner(path).map(|corner| corner.map(i64::from)));
    }
    if accumulated::is_sums(path) {
        let [x0, _, y0, _] = read_about(path)?.crop;
        return Ok(Some([x0, y0].map(i64::from)));
    }
    Ok(description["crop"][0].as_i64().zip(description["crop"][2].as_i64()).map(<[i64; 2]>::from))
}

/// Whether the settings in the file `path`, or in the JSON file beside it, are those of a sensor of velocities. A scan with --doppler keeps its
/// velocities in another file.
fn records_speeds(path: &Path, description: &Value) -> bool {
    let of_sums = || accumulated::is_sums(path).then(|| read_about(path).ok()).flatten().map(|about| about.settings);
    let settings = description["settings"].as_str().map(String::from).or_else(|| read_settings(path)).or_else(of_sums);
    let experiment = settings.and_then(|settings| Experiment::parse(&settings).ok());
    experiment.is_some_and(|e| {
        let has_colours_of_speeds = e.render.doppler.is_some_and(|doppler| doppler != Doppler::OFF) && e.scan.is_none();
        e.gate.fmcw.is_some() || has_colours_of_speeds
    })
}

/// Describes the gates of `images` with the names that the JSON file beside an array has.
fn description(images: usize, gates: &[DescribedResponse]) -> Value {
    let axes = if images > 1 { "height, width, response, channel" } else { "height, width, channel" };
    let mut description = json!({ "responses": gates, "axes": axes });
    let (first, last, count) = (&gates[0], &gates[gates.len() - 1], gates.len() as f64);
    let width = (last.gate_end_m.unwrap_or(f64::INFINITY) - first.gate_begin_m) / count;
    let begins = |k: usize| first.gate_begin_m + k as f64 * width;
    let are_near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * width;
    let is_bin = |(k, gate): (usize, &DescribedResponse)| {
        are_near(gate.gate_begin_m, begins(k)) && gate.gate_end_m.is_some_and(|end| are_near(end, begins(k + 1)))
    };
    if gates.iter().enumerate().all(is_bin) {
        description["start_opl"] = first.gate_begin_m.into();
        description["bin_width_opl"] = width.into();
        description["temporal_bins"] = gates.len().into();
    }
    description
}
