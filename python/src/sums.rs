//! The sums of parts of a render, which a farm of machines renders and joins.

use std::io::Cursor;
use std::sync::Mutex;

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use taugate::internals::image::accumulation::file::{self, Parts, Problem};
use taugate::internals::image::accumulation::{About, Accumulation};
use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::job::{feasible, iterations};
use taugate::internals::render::schedule::{Schedule, samples_before};
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::values::Seconds;
use taugate::internals::settings::{Budget, MAX_SPP, Settings};

use crate::camera::View;
use crate::engine::{self, lock};
use crate::errors::{Failure, Result, settings};
use crate::flags::Words;
use crate::image::Image;
use crate::scene::NativeScene;

/// The sums of some iterations of a render.
#[pyclass(frozen, module = "taugate._native")]
pub struct Sums(Mutex<Accumulation>);

#[pymethods]
impl Sums {
    /// Reads the bytes of a file `.acc`.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Sums> {
        Ok(Sums(Mutex::new(py.detach(|| read(bytes))?)))
    }

    /// The bytes of a file `.acc`.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| bytes(lock(&self.0).parts()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Adds a part of the same render with other iterations.
    fn merge(&self, py: Python<'_>, other: &Sums) -> PyResult<()> {
        engine::check_process()?;
        if std::ptr::eq(self, other) {
            return Err(settings("sums cannot be merged with themselves").into());
        }
        let merged = py.detach(|| {
            let other = lock(&other.0).clone();
            lock(&self.0).merge("the sums", &other, "the part").map_err(Failure::from)
        });
        Ok(merged?)
    }

    /// Samples per pixel.
    #[getter]
    fn samples(&self) -> u64 {
        lock(&self.0).film.samples()
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> u32 {
        lock(&self.0).film.iterations()
    }

    /// Seconds of rendering, summed over the parts.
    #[getter]
    fn seconds(&self) -> f64 {
        lock(&self.0).about.seconds
    }

    /// Root mean square of the standard errors of all pixels and channels, relative to the mean of the image. Infinite with fewer than
    /// two iterations, or if the image is black.
    fn relative_error(&self, py: Python<'_>) -> PyResult<f64> {
        engine::check_process()?;
        Ok(py.detach(|| {
            let sums = lock(&self.0);
            let average = |values: Vec<f32>| values.iter().map(|&x| f64::from(x)).sum::<f64>() / values.len() as f64;
            let (variance, mean) = (average(sums.film.variance_of_mean()), average(sums.film.mean()));
            match sums.film.iterations() >= 2 && mean > 0.0 {
                true => variance.sqrt() / mean,
                false => f64::INFINITY,
            }
        }))
    }

    /// Whether no pixel has light.
    fn is_black(&self, py: Python<'_>) -> PyResult<bool> {
        engine::check_process()?;
        Ok(py.detach(|| lock(&self.0).film.mean().iter().all(|&x| x == 0.0)))
    }
}

/// Fails with one sentence if the render of `scene` with `flags` cannot be divided into parts. Returns the fingerprint of the files,
/// and the budget of the settings: samples per pixel, or seconds. The fingerprint is `None` if the scene is from arrays or has moved
/// nodes.
#[pyfunction]
pub fn check_parts(
    py: Python<'_>,
    scene: &NativeScene,
    flags: Vec<Words>,
) -> PyResult<(Option<String>, Option<u32>, Option<f64>)> {
    let checked = py.detach(|| {
        let job = scene.job(&flags)?;
        let Experiment { scan, output, render, input, .. } = &job.experiment;
        let refusals = [
            (
                input.shutter.is_some() || input.rolling.is_some(),
                "a farm renders a single moment; leave out shutter and rolling, or use taugate.render",
            ),
            (scan.is_some(), "a farm does not divide the points of a scan; measure it with taugate.scan"),
            (
                output.aov.is_some(),
                "the sums of a farm have no auxiliary layers; leave out aov, and make them with taugate.render(..., aov=..., spp=1)",
            ),
            (
                render.strict == Some(true),
                "a farm counts samples that are not finite as 0; leave out strict, or use taugate.render",
            ),
        ];
        if let Some((_, message)) = refusals.into_iter().find(|(refused, _)| *refused) {
            return Err(settings(message));
        }
        let (spp, seconds) = match job.resolved.settings.budget() {
            Budget::Spp(spp) => (Some(spp), None),
            Budget::Seconds(seconds) => (None, Some(seconds)),
        };
        Ok((scene.fingerprint(&job.experiment)?, spp, seconds))
    });
    Ok(checked?)
}

/// Renders the iterations `begin` to `end` (not included) of a render. Returns the bytes of a file `.acc`, without the state of
/// adaptive sampling, and the number of samples that were not finite. `spp` limits the samples per pixel of the whole render.
/// `contents` identifies the scene.
#[pyfunction]
pub fn accumulate<'py>(
    py: Python<'py>,
    scene: &NativeScene,
    flags: Vec<Words>,
    contents: String,
    begin: u32,
    end: u32,
    spp: Option<u32>,
) -> PyResult<(Bound<'py, PyBytes>, u64)> {
    let (bytes, dropped) = py.detach(|| {
        scene.with_renderer(&flags, |renderer, settings, config| {
            let started = std::time::Instant::now();
            iterations::run(renderer, Schedule::Part { numbers: begin..end, spp })?;
            let description = about(settings, config, contents)?;
            let about = renderer.about(&description, started.elapsed().as_secs_f64());
            let (film, responses) = (renderer.film(), renderer.responses()?);
            // Each part adapts by itself, so no other part needs the state of its adaptive sampling.
            let bytes = bytes(Parts { about: &about, film, responses, adaptive: None, layers: &Layers::default() })?;
            Ok((bytes, renderer.stats().dropped))
        })
    })?;
    Ok((PyBytes::new(py, &bytes), dropped))
}

/// Fails like a render of a black image, with advice about the gate, unless such an image is accepted.
#[pyfunction]
pub fn refuse_black(py: Python<'_>, scene: &NativeScene, flags: Vec<Words>) -> PyResult<()> {
    let checked = py.detach(|| {
        let job = scene.job(&flags)?;
        if job.may_be_dark() {
            return Ok(());
        }
        let device = engine::device(job.experiment.render.device.as_deref())?;
        Err(feasible::nothing_inside(&device, &job.scene, &job.resolved.settings).into())
    });
    checked.map_err(|failure: Failure| failure.into())
}

/// The image of sums, as if `scene` had been rendered with `flags` here. Its settings name the samples that the sums have. `dropped`
/// samples were not finite.
#[pyfunction]
pub fn image_of_sums(
    py: Python<'_>,
    scene: &NativeScene,
    flags: Vec<Words>,
    sums: &Sums,
    dropped: u64,
) -> PyResult<Image> {
    let image = py.detach(|| {
        let job = scene.job(&flags)?;
        let settings = &job.resolved.settings;
        let mut sums = lock(&sums.0).clone();
        // The sums name the files by their paths on a worker. These are replaced by the paths on this machine.
        let mut config = job.config();
        let samples = sums.film.samples().clamp(1, MAX_SPP.into());
        (config.render.spp, config.render.time) = (Some(samples as u32), None);
        let About { settings: printed, files, .. } = about(settings, config, String::new())?;
        (sums.about.settings, sums.about.files) = (printed, files);
        Result::Ok(Image {
            sums,
            responses: settings.responses().clone(),
            layers: Layers::default(),
            view: View::of(&job.scene, settings)?,
            warnings: job.warnings(),
            notes: job.notes,
            dropped,
        })
    });
    Ok(image?)
}

/// The end (not included) of the shortest part that begins at iteration `begin` and has at least `samples` samples per pixel. Also
/// returns the samples per pixel of this part.
#[pyfunction]
pub fn part(begin: u32, samples: f64) -> (u32, u64) {
    let mut end = begin + 1;
    while ((samples_before(end) - samples_before(begin)) as f64) < samples {
        end += 1;
    }
    (end, samples_before(end) - samples_before(begin))
}

/// Samples per pixel of all iterations before `number`.
#[pyfunction]
pub fn samples_before_iteration(number: u32) -> u64 {
    samples_before(number)
}

/// Seconds of a duration such as `8h`.
#[pyfunction]
pub fn seconds(text: &str) -> PyResult<f64> {
    let parsed: taugate::Result<Seconds> = text.parse();
    parsed.map(|seconds| seconds.0).map_err(|error| Failure::from(error).into())
}

/// The description of the sums of a render, before its first iteration. `config` is the experiment with all defaults.
fn about(settings: &Settings, config: Experiment, contents: String) -> Result<About> {
    let experiment = config.with_absolute_paths()?;
    Ok(About::new(settings, experiment.to_toml(), &experiment.input_files(), contents, Shard::ALL))
}

/// The sums in the bytes of a file `.acc`.
pub fn read(bytes: &[u8]) -> Result<Accumulation> {
    file::read_from(&mut Cursor::new(bytes)).map_err(|problem| match problem {
        Problem::Contents(message) => settings(format!("these are no sums: {message}")),
        Problem::Io(error) => settings(format!("the sums cannot be read: {error}")),
    })
}

/// The bytes of a file `.acc`.
pub fn bytes(parts: Parts) -> Result<Vec<u8>> {
    let mut file = Cursor::new(vec![]);
    file::write_to(&mut file, parts).map_err(|e| settings(format!("the sums cannot be written: {e}")))?;
    Ok(file.into_inner())
}
