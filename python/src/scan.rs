//! Scans.

use std::path::PathBuf;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::Value;
use taugate::internals::image::array_set::{self, ArraySet, Role, forget_arrays};
use taugate::internals::image::scan_file::ScanArrays;
use taugate::internals::job::Job;
use taugate::internals::job::ready_scan::ReadyScan;

use crate::engine::{self, early_end, watched};
use crate::errors::{Failure, Result, settings as mistake, shown};
use crate::flags::Words;
use crate::image::array;
use crate::scene::NativeScene;

/// The array of a scan, its description as JSON, with the setting `variance` its variances, and with `doppler` its velocities.
type Arrays<'py> = (Bound<'py, PyAny>, String, Option<Bound<'py, PyAny>>, Option<Bound<'py, PyAny>>);

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
    let result = py.detach(|| run(scene.scan_job(&flags)?, progress.as_ref()));
    engine::forget_lost();
    let Measured { arrays, warnings, interrupt } = result?;
    let arrays = arrays.map(|(ScanArrays { shape, means, variances, velocities }, description)| {
        let variances = variances.map(|values| array(py, values, &shape)).transpose()?;
        let of_velocities = [&shape[..], &[2]].concat();
        let velocities = velocities.map(|values| array(py, values, &of_velocities)).transpose()?;
        PyResult::Ok((array(py, means, &shape)?, description, variances, velocities))
    });
    Ok((arrays.transpose()?, shown(&warnings), interrupt))
}

/// Writes the array of a scan, its variances, its velocities, its layers (the bytes of their `.npy` file) and its description (JSON) as the command line
/// does: all of them or none.
#[pyfunction]
#[pyo3(signature = (path, data, variance, velocity, layers, description))]
pub fn write_scan(
    py: Python<'_>,
    path: PathBuf,
    data: PyReadonlyArrayDyn<'_, f32>,
    variance: Option<PyReadonlyArrayDyn<'_, f32>>,
    velocity: Option<PyReadonlyArrayDyn<'_, f32>>,
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
    for (role, array) in [(Role::Array, Some(data)), (Role::Variance, variance), (Role::Velocity, velocity)] {
        let Some(array) = array else { continue };
        set.add(role, array.shape(), array.as_array().iter().copied()).map_err(Failure::from)?;
    }
    if let Some(layers) = layers {
        set.add_with(Role::Layers, |writer| writer.write_all(layers)).map_err(Failure::from)?;
    }
    Ok(py.detach(|| set.publish(&about)).map_err(Failure::from)?)
}

/// Fails if the array `path`, or an array beside it, is not the one that the JSON file describes. Returns the paths of the variances, of
/// the velocities and of the layers, if there are any.
#[pyfunction]
pub fn check_scan(py: Python<'_>, path: PathBuf) -> PyResult<[Option<PathBuf>; 3]> {
    py.detach(|| array_set::check_files(&path)).map_err(Failure::from)?;
    Ok([Role::Variance, Role::Velocity, Role::Layers].map(|role| array_set::beside(&path, role)))
}

struct Measured {
    /// The arrays and their description.
    arrays: Option<(ScanArrays, String)>,
    warnings: Vec<String>,
    interrupt: Option<PyErr>,
}

fn run(job: Job, progress: Option<&Py<PyAny>>) -> Result<Measured> {
    if !job.is_scan() {
        return Err(mistake("this is no scan; load an experiment (.toml) with a table [scan]"));
    }
    if job.experiment.output.aov.is_some() {
        return Err(mistake(
            "the program writes the layers of a scan (aov): taugate render SCAN.toml --aov all -o scan.npy",
        ));
    }
    let device = job.experiment.render.device.clone();
    let mut scan = ReadyScan::new(job, || engine::device(device.as_deref()), &mut |_| {})?;
    let (end, failure) = watched(progress, |steps, stop| {
        // `watched` keeps the receiver until this thread ends, so this cannot fail.
        scan.run(stop, |progress| {
            let _ = steps.send(*progress);
        })
    })?;
    let has_result = scan.measured() > 0;
    let interrupt = early_end(end, failure, scan.device(), has_result)?.filter(|_| !scan.is_complete());
    let warnings = scan.warnings();
    Ok(Measured { arrays: has_result.then(|| scan.into_arrays()), warnings, interrupt })
}
