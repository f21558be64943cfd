//! Photon counts of a detector, as `taugate detect` draws them.

use numpy::{PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};
use taugate::internals::detector::light::{Light, Values, counts};
use taugate::internals::detector::{Blind, Detector};
use taugate::internals::image::array_set::forget_arrays;
use taugate::internals::image::npy_file::COUNTS;
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray, ScanArray};
use taugate::internals::settings::optical_path::OpticalPath;

use crate::engine::check_process;
use crate::errors::{Result, settings};
use crate::image::array;

/// The numbers of a detector: photons, pulses, efficiency, dark counts, jitter, dead time, whether only the first photon counts.
type Numbers = (f64, u64, f64, f64, Option<String>, Option<String>, bool);

/// Draws the counts of the light `data`, which `description` (JSON) describes. `background`: R, G, B per pixel. Returns the counts and
/// their description.
#[pyfunction]
pub fn detect<'py>(
    py: Python<'py>,
    data: PyReadonlyArrayDyn<'_, f32>,
    description: &str,
    detector: Numbers,
    background: PyReadonlyArray1<'_, f32>,
    mono: bool,
    seed: u32,
) -> PyResult<(Bound<'py, PyAny>, String)> {
    let (shape, values) = (data.shape().to_vec(), data.as_array().iter().copied().collect());
    let background = background.as_slice()?.as_chunks().0.to_vec();
    let (shape, counts, about) = py.detach(|| run(shape, values, description, &detector, &background, mono, seed))?;
    Ok((array(py, counts, &shape)?, about))
}

fn run(
    shape: Vec<usize>,
    values: Vec<f32>,
    description: &str,
    numbers: &Numbers,
    background: &[[f32; 3]],
    mono: bool,
    seed: u32,
) -> Result<(Vec<usize>, Vec<f32>, String)> {
    check_process()?;
    let (photons, pulses, efficiency, dark_rate, jitter, dead_time, first_photon) = numbers;
    let wrong = |e: serde_json::Error| settings(format!("the description of the light cannot be read: {e}"));
    let mut about: Value = serde_json::from_str(description).map_err(wrong)?;
    if about["unit"] == COUNTS {
        return Err(settings("these are counts of a detector, not light; give the light that they were drawn from"));
    }
    let gates: Vec<DescribedResponse> = serde_json::from_value(about["responses"].clone()).map_err(wrong)?;
    let values = match (&shape[..], about["axes"].as_str().is_some_and(|axes| axes.starts_with("response"))) {
        (_, true) => Values::Scan(ScanArray { shape, values }),
        (&[height, width, 3], _) => Values::Images(ImageArray { width, height, responses: None, values }),
        (&[height, width, count, 3], _) => Values::Images(ImageArray { width, height, responses: Some(count), values }),
        _ => return Err(settings("the light must be an image, a histogram or a scan of taugate")),
    };
    if gates.is_empty() || gates.len() != values.gates() {
        return Err(settings("the description of the light has another number of gates"));
    }
    let light = Light::new(values, &gates).map_err(|error| settings(format!("the light {error}")))?;
    if background.len() != light.pixels() {
        return Err(settings("the background must have one value per pixel"));
    }
    let metres = |text: &Option<String>| -> Result<Option<f64>> {
        Ok(text.as_ref().map(|text| text.parse::<OpticalPath>()).transpose()?.map(|path| path.0))
    };
    let (jitter, dead_time) = (metres(jitter)?, metres(dead_time)?);
    let blind = match (dead_time, first_photon) {
        (Some(_), true) => return Err(settings("--dead-time cannot be used with --first-photon; keep one")),
        (Some(time), false) => Blind::For(time),
        (None, true) => Blind::UntilNextPulse,
        (None, false) => Blind::Never,
    };
    let detector = Detector {
        photons: *photons,
        pulses: *pulses,
        efficiency: *efficiency,
        dark_rate: *dark_rate,
        jitter: jitter.unwrap_or(0.0),
        blind,
    };
    let counts = counts(&detector, &light, background, mono, seed)?;
    let shape = light.shape(mono);
    about.as_object_mut().map(forget_arrays);
    about["unit"] = COUNTS.into();
    about["shape"] = shape.clone().into();
    about["detector"] = json!({
        "photons_per_pulse_and_radiance": photons,
        "pulses": pulses,
        "efficiency": efficiency,
        "dark_counts_per_second": dark_rate,
        "jitter_m": jitter,
        "dead_time_m": dead_time,
        "first_photon": first_photon,
        "mono": mono,
        "seed": seed,
    });
    Ok((shape, counts, about.to_string()))
}
