//! Scans: one render per laser point, all with the same renderer.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::Instant;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::Value;
use taugate::internals::image::array_set::{self, ArraySet, Role};
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::image::scan_file::{ScanArrays, ScanFilm};
use taugate::internals::input::scan_table::Scan;
use taugate::internals::render::schedule::scan_samples;
use taugate::internals::render::{MemoryPlan, PreparedScene, Renderer, check_aimed_points};
use taugate::internals::scene::Scene;
use taugate::internals::settings::{Budget, Sampling, Settings};

use crate::engine::{self, Step, early_end, watched};
use crate::errors::{Failure, Result, settings as mistake, shown};
use crate::flags::Words;
use crate::image::array;
use crate::scene::NativeScene;
use crate::shared::{feasible, memory};
use crate::state::Job;

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

/// Writes the array of a scan, its variances and its description (JSON) as the command line does: all of them or none.
#[pyfunction]
#[pyo3(signature = (path, data, variance, description))]
pub fn write_scan(
    py: Python<'_>,
    path: PathBuf,
    data: PyReadonlyArrayDyn<'_, f32>,
    variance: Option<PyReadonlyArrayDyn<'_, f32>>,
    description: &str,
) -> PyResult<()> {
    let mut about: Value = serde_json::from_str(description)
        .map_err(|e| PyErr::from(mistake(format!("the description is no JSON: {e}"))))?;
    let object = about.as_object_mut().ok_or_else(|| PyErr::from(mistake("the description must be a dict")))?;
    // The record of a scan that was loaded is that of the earlier files.
    object.remove("files");
    let mut set = ArraySet::new(&path);
    for (role, array) in [(Role::Array, Some(data)), (Role::Variance, variance)] {
        let Some(array) = array else { continue };
        set.add(role, array.shape(), array.as_array().iter().copied()).map_err(Failure::from)?;
    }
    Ok(py.detach(|| set.publish(&about)).map_err(Failure::from)?)
}

/// Fails if the array `path`, or an array beside it, is not the one that the JSON file describes. Returns the path of the variances, if
/// there are any.
#[pyfunction]
pub fn check_scan(py: Python<'_>, path: PathBuf) -> PyResult<Option<PathBuf>> {
    py.detach(|| array_set::check_files(&path)).map_err(Failure::from)?;
    Ok(array_set::beside(&path, Role::Variance))
}

struct Measured {
    /// The arrays and their description.
    arrays: Option<(ScanArrays, String)>,
    warnings: Vec<String>,
    interrupt: Option<PyErr>,
}

fn run(job: &Job, progress: Option<&Py<PyAny>>) -> Result<Measured> {
    let Job { experiment, scene, resolved, printed, .. } = job;
    let Some(table) = &experiment.scan else {
        return Err(mistake("this is no scan; load an experiment (.toml) with a table [scan]"));
    };
    let scan = table.scan().map_err(mistake)?;
    let settings = resolved.settings.change().sampling(Sampling::Uniform).build()?;
    let has_variance = experiment.output.variance.unwrap_or(false);
    memory::check(&settings, memory::ImageParts { variance: has_variance, exr: false }, memory::free())?;
    let bytes = ScanFilm::bytes(&scan, settings.responses().len(), has_variance);
    memory::check_bytes(bytes, memory::free(), "the array of the scan", "use fewer gates or points")?;

    let prepared = PreparedScene::new(scene, &settings)?;
    let device = engine::device(experiment.render.device.as_deref())?;
    MemoryPlan::new(scene, &settings, &prepared, Some(device.info()))?.check(device.info())?;
    if !scan.accounts_first_and_last {
        let seen = scan.sensor_points.as_ref().unwrap_or(&scan.laser_points);
        check_aimed_points(&device, scene, &settings, "sensor", &Scan::camera_at(scan.sensor, seen))?;
        check_aimed_points(&device, scene, &settings, "laser", &Scan::camera_at(scan.laser, &scan.laser_points))?;
    }
    let mut renderer = Renderer::from_prepared(&device, scene, &settings, &prepared)?;
    if has_variance {
        renderer.estimate_response_variance();
    }

    let film = ScanFilm::new(&scan, settings.responses().len(), has_variance);
    let strict = experiment.render.strict.unwrap_or(false);
    let started = Instant::now();
    let mut measuring = Measuring {
        scan: &scan,
        scene: scene.clone(),
        prepared,
        settings: &settings,
        strict,
        film,
        measured: 0,
        samples: 0,
    };
    let (ended, failure) = watched(progress, |steps, stop| measuring.run(&mut renderer, &steps, stop))?;
    let interrupt = early_end(ended, failure, &device, measuring.measured > 0)?;
    let Measuring { film, measured, samples, .. } = measuring;
    let is_whole = measured == scan.laser_points.len();
    if is_whole && film.is_black() && !experiment.gate.force.unwrap_or(false) {
        return Err(feasible::nothing_inside(&device, scene, &settings).into());
    }
    let mut arrays = None;
    if measured > 0 {
        let provenance = Provenance::new(&settings, started.elapsed().as_secs_f64(), printed.clone());
        let description = film.description(table, &scan, measured, samples, &provenance);
        let description = serde_json::to_string_pretty(&description)
            .map_err(|e| mistake(format!("the scan cannot be described: {e}")))?;
        arrays = Some((film.into_arrays(&scan), description));
    }
    let mut warnings = [&scene.warnings[..], &resolved.warnings].concat();
    let dropped = renderer.stats().dropped;
    if dropped > 0 {
        warnings.push(format!("{dropped} samples were not finite and count as 0"));
    }
    Ok(Measured { arrays, warnings, interrupt: interrupt.filter(|_| !is_whole) })
}

struct Measuring<'a> {
    scan: &'a Scan,
    scene: Scene,
    prepared: PreparedScene,
    settings: &'a Settings,
    strict: bool,
    film: ScanFilm,
    /// Number of laser points measured so far.
    measured: usize,
    /// Samples per pair of points.
    samples: u64,
}

impl Measuring<'_> {
    /// Measures one laser point after the other, until `stop` is true. A point that `stop` interrupts is left out.
    fn run(&mut self, renderer: &mut Renderer, steps: &Sender<Step>, stop: &Arc<AtomicBool>) -> Result<()> {
        let (started, count) = (Instant::now(), self.scan.laser_points.len());
        let laser = self.scene.lights.len() - 1;
        while self.measured < count {
            self.scene.lights[laser] = self.scan.light(self.measured);
            if !self.prepared.follow(&self.scene, self.settings)?
                || !renderer.set_camera(&self.scan.camera(self.measured))?
            {
                unreachable!("laser and sensor keep their places, and turn");
            }
            renderer.set_lights(&self.prepared, self.settings)?;
            let seed = Scan::seed(self.settings.seed(), self.measured);
            renderer.restart(seed, self.settings.responses().clone())?;
            if !self.point(renderer, stop)? {
                return Ok(());
            }
            self.film.set(self.measured, renderer.film(), renderer.responses());
            (self.measured, self.samples) = (self.measured + 1, renderer.film().samples());
            let fraction = self.measured as f64 / count as f64;
            // `watched` keeps the receiver until this thread ends, so this cannot fail.
            let _ = steps.send(Step { fraction, samples: self.samples, seconds: started.elapsed().as_secs_f64() });
        }
        Ok(())
    }

    /// Renders one point of the laser. Returns false if it was stopped before its end.
    fn point(&self, renderer: &mut Renderer, stop: &AtomicBool) -> Result<bool> {
        let budget = match self.settings.budget() {
            Budget::Seconds(seconds) => Budget::Seconds(seconds / self.scan.laser_points.len() as f64),
            budget => budget,
        };
        let started = Instant::now();
        loop {
            let film = renderer.film();
            let samples = scan_samples(&budget, film.width(), film.samples(), started.elapsed());
            if samples == 0 {
                return Ok(true);
            }
            if stop.load(Ordering::SeqCst) {
                return Ok(false);
            }
            renderer.iterate(samples)?;
            let dropped = renderer.stats().dropped;
            if self.strict && dropped > 0 {
                return Err(Failure::NotFinite(dropped));
            }
        }
    }
}
