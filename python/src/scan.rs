//! Scans.

use std::path::PathBuf;
use std::time::Instant;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::Value;
use taugate::internals::image::array_set::{self, ArraySet, Role, forget_arrays};
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::image::scan_file::ScanArrays;
use taugate::internals::job::ready_job::Progress;
use taugate::internals::job::{Job, feasible};
use taugate::internals::scan::{Measurement, PreparedScan, check_memory, scene_at};
use taugate::internals::settings::Sampling;

use crate::engine::{self, early_end, watched};
use crate::errors::{Failure, Result, settings as mistake, shown};
use crate::flags::Words;
use crate::image::array;
use crate::scene::NativeScene;

/// The array of a scan, its description as JSON, and, with the setting `variance`, its variances.
type Arrays<'py> = (Bound<'py, PyAny>, String, Option<Bound<'py, PyAny>>);

/// Measures all pairs of points of the scan of `scene`. Returns what the command line writes to files, `None` if no point of the laser
/// was measured; warnings; and the exception that interrupted the scan, if any.
#[pyfunction]
#[pyo3(signature = (scene, flags, progress=None))]
pub fn scan<'py>(
    py: Python<'py>,
    scene: &NativeScene,
    flags: Vec<Words>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Option<Arrays<'py>>, Vec<String>, Option<PyErr>)> {
    let result = py.detach(|| run(&scene.job(&flags)?, progress.as_ref()));
    engine::forget_lost();
    let Measured { arrays, warnings, interrupt } = result?;
    let arrays = arrays.map(|(ScanArrays { shape, means, variances }, description)| {
        let variances = variances.map(|values| array(py, values, &shape)).transpose()?;
        PyResult::Ok((array(py, means, &shape)?, description, variances))
    });
    Ok((arrays.transpose()?, shown(&warnings), interrupt))
}

/// Writes the array of a scan, its variances, its layers (the bytes of their `.npy` file) and its description (JSON) as the command line
/// does: all of them or none.
#[pyfunction]
#[pyo3(signature = (path, data, variance, layers, description))]
pub fn write_scan(
    py: Python<'_>,
    path: PathBuf,
    data: PyReadonlyArrayDyn<'_, f32>,
    variance: Option<PyReadonlyArrayDyn<'_, f32>>,
    layers: Option<&[u8]>,
    description: &str,
) -> PyResult<()> {
    let mut about: Value = serde_json::from_str(description)
        .map_err(|e| PyErr::from(mistake(format!("the description is no JSON: {e}"))))?;
    let object = about.as_object_mut().ok_or_else(|| PyErr::from(mistake("the description must be a dict")))?;
    // The record of a scan that was loaded is that of the earlier files.
    match layers {
        Some(_) => drop(object.remove("files")),
        None => forget_arrays(object),
    }
    let mut set = ArraySet::new(&path);
    for (role, array) in [(Role::Array, Some(data)), (Role::Variance, variance)] {
        let Some(array) = array else { continue };
        set.add(role, array.shape(), array.as_array().iter().copied()).map_err(Failure::from)?;
    }
    if let Some(layers) = layers {
        set.add_with(Role::Layers, |writer| writer.write_all(layers)).map_err(Failure::from)?;
    }
    Ok(py.detach(|| set.publish(&about)).map_err(Failure::from)?)
}

/// Fails if the array `path`, or an array beside it, is not the one that the JSON file describes. Returns the paths of the variances and
/// of the layers, if there are any.
#[pyfunction]
pub fn check_scan(py: Python<'_>, path: PathBuf) -> PyResult<(Option<PathBuf>, Option<PathBuf>)> {
    py.detach(|| array_set::check_files(&path)).map_err(Failure::from)?;
    Ok((array_set::beside(&path, Role::Variance), array_set::beside(&path, Role::Layers)))
}

struct Measured {
    /// The arrays and their description.
    arrays: Option<(ScanArrays, String)>,
    warnings: Vec<String>,
    interrupt: Option<PyErr>,
}

fn run(job: &Job, progress: Option<&Py<PyAny>>) -> Result<Measured> {
    let Job { experiment, scene, resolved, .. } = job;
    let Some(table) = &experiment.scan else {
        return Err(mistake("this is no scan; load an experiment (.toml) with a table [scan]"));
    };
    if experiment.output.aov.is_some() {
        return Err(mistake(
            "the program writes the layers of a scan (aov): taugate render SCAN.toml --aov all -o scan.npy",
        ));
    }
    let scan = table.scan().map_err(mistake)?;
    let settings = resolved.settings.change().sampling(Sampling::Uniform).build()?;
    let has_variance = experiment.output.variance.unwrap_or(false);
    check_memory(&scan, &settings, has_variance)?;

    let ready = PreparedScan::new(&scan, scene.clone(), &settings)?;
    let (of_scene, darkest) = ready.warnings(&scan, &settings);
    let device = engine::device(experiment.render.device.as_deref())?;
    let mut measurement = Measurement::new(&device, &scan, ready, has_variance)?;

    let strict = experiment.render.strict.unwrap_or(false);
    let (started, count) = (Instant::now(), scan.laser_points.len());
    let (end, failure) = watched(progress, |steps, stop| {
        measurement.run(strict, stop, |measurement| {
            let fraction = measurement.measured() as f64 / count as f64;
            let seconds = started.elapsed().as_secs_f64();
            // `watched` keeps the receiver until this thread ends, so this cannot fail.
            let _ = steps.send(Progress { fraction, samples: measurement.samples(), seconds });
        })
    })?;
    let interrupt = early_end(end, failure, &device, measurement.measured() > 0)?;
    let (measured, samples, is_whole) = (measurement.measured(), measurement.samples(), measurement.is_whole());
    let dropped = measurement.renderer().stats().dropped;
    let film = measurement.into_film();
    if is_whole && film.is_black() && !experiment.gate.force.unwrap_or(false) {
        let scene = scene_at(scene.clone(), &scan, &settings, darkest);
        return Err(feasible::nothing_inside(&device, &scene, &settings).into());
    }
    let mut arrays = None;
    if measured > 0 {
        let provenance = Provenance::new(&settings, started.elapsed().as_secs_f64(), job.config().to_toml());
        let description = film.description(table, &scan, measured, samples, None, &provenance);
        let description = serde_json::to_string_pretty(&description)
            .map_err(|e| mistake(format!("the scan cannot be described: {e}")))?;
        arrays = Some((film.into_arrays(&scan), description));
    }
    let mut warnings = [job.warnings(), of_scene].concat();
    if dropped > 0 {
        warnings.push(format!("{dropped} samples were not finite and count as 0"));
    }
    Ok(Measured { arrays, warnings, interrupt: interrupt.filter(|_| !is_whole) })
}
