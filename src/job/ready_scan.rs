//! A scan that is ready to run, and how far it has come.

#![warn(missing_docs)]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::iterations::End;
use super::ready_job::Progress;
use super::{Job, feasible};
use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::image::exr_file::Provenance;
use crate::image::scan_file::{Description, ScanArrays};
use crate::image::scan_layers::ScanLayers;
use crate::input::resolve::Resolved;
use crate::input::scan_table::ScanTable;
use crate::scan::{Measurement, Moving, PreparedScan, check_memory, scene_at};
use crate::scene::surrounding_indices;
use crate::settings::aov::Aov;
use crate::settings::table::InputTable;
use crate::settings::{Sampling, Settings};

/// The scan of a [`Job`] whose scene is on a device. It is measured point by point of the laser.
pub struct ReadyScan {
    measurement: Measurement,
    table: ScanTable,
    /// Settings of a render of one point of the laser.
    settings: Settings,
    /// The point of the laser at which the most light is missing that no strategy forms.
    darkest: usize,
    /// The experiment with all defaults, but without outputs, as TOML.
    config: String,
    aov: Aov,
    /// Whether an array without light is accepted.
    may_be_dark: bool,
    /// Whether a sample that is not finite ends the scan.
    strict: bool,
    warnings: Vec<String>,
    elapsed: Duration,
}

impl ReadyScan {
    /// Checks the scan and puts its scene on the device that `open` opens. `say` gets each warning as soon as it is known, because an
    /// error or a long wait may follow.
    #[doc(hidden)]
    pub fn new(mut job: Job, open: impl FnOnce() -> Result<Device>, say: &mut dyn FnMut(&str)) -> Result<ReadyScan> {
        let Some(table) = job.experiment.scan.clone() else {
            return Err(Error::settings("this experiment is no scan, because it has no table [scan]"));
        };
        let InputTable { shutter, rolling, .. } = &job.experiment.input;
        if shutter.is_some() || rolling.is_some() {
            return Err(Error::advice(
                "a scan has no shutter: each shot takes an instant; ",
                "leave out --shutter and --rolling, and give the scan a duration and a trajectory if the LiDAR moves",
            ));
        }
        let scan = table.scan().map_err(Error::settings)?;
        job.resolved.settings = job.resolved.settings.change().sampling(Sampling::Uniform).build()?;
        let (config, mut warnings) = (job.config().to_toml(), job.warnings());
        warnings.iter().for_each(|warning| say(warning));
        let Job { experiment, scene, resolved: Resolved { settings, .. }, .. } = job;
        let has_variance = experiment.output.variance.unwrap_or(false);
        check_memory(&scan, &settings, has_variance)?;
        let moving = Moving::new(&experiment, &scan)?;
        let aov = experiment.output.aov.unwrap_or_default();
        if moving.is_some() && aov != Aov::default() && scan.sensor_points.is_some() {
            return Err(Error::advice(
                "each point of the sensor has one surface in the layers, and here objects move from one point of the laser to the next; ",
                "leave out --aov",
            ));
        }
        let prepared = PreparedScan::new(&scan, scene, &settings, moving);
        let prepared = prepared.map_err(|error| error.in_scene(experiment.scene.as_deref()))?;
        let (of_scene, darkest) = prepared.warnings(&scan, &settings);
        of_scene.iter().for_each(|warning| say(warning));
        warnings.extend(of_scene);
        let mut measurement = Measurement::new(&open()?, scan, prepared, has_variance)?;
        if aov != Aov::default() {
            measurement.look_at_surfaces(aov);
        }
        Ok(ReadyScan {
            measurement,
            table,
            settings,
            darkest,
            config,
            aov,
            may_be_dark: experiment.gate.force.unwrap_or(false),
            strict: experiment.render.strict.unwrap_or(false),
            warnings,
            elapsed: Duration::ZERO,
        })
    }

    /// Measures until all points of the laser are measured, or until `stop` is true. Calls `watch` after each point, or after the beams of
    /// a LiDAR that share a render. Another thread may set `stop` at any time. The point in progress is then left out, and a later call
    /// goes on with it.
    ///
    /// Returns why the measurement ended. Fails if no light was found at any point, because the gate misses all light, unless the
    /// experiment has `force`. Also fails if the device is lost; but [`End::Failed`] says so if a point has been measured.
    pub fn run(&mut self, stop: &Arc<AtomicBool>, mut watch: impl FnMut(&Progress)) -> Result<End> {
        self.measure(stop, |_, progress| watch(progress))
    }

    /// As [`ReadyScan::run`]. `watch` also gets the measurement.
    #[doc(hidden)]
    pub fn measure(&mut self, stop: &Arc<AtomicBool>, mut watch: impl FnMut(&Measurement, &Progress)) -> Result<End> {
        let (started, earlier, count) = (Instant::now(), self.elapsed, self.points());
        let end = self.measurement.run(self.strict, stop, |measurement| {
            let fraction = measurement.measured() as f64 / count as f64;
            let seconds = (earlier + started.elapsed()).as_secs_f64();
            watch(measurement, &Progress { fraction, samples: measurement.samples(), seconds });
        });
        self.elapsed = earlier + started.elapsed();
        let Measurement { scan, .. } = &self.measurement;
        match self.is_complete() && !self.may_be_dark && self.measurement.film().is_black() {
            true => {
                let (scene, settings) = (self.measurement.scene().0.clone(), &self.settings);
                let scene = scene_at(scene, scan, settings, self.darkest);
                Err(feasible::nothing_inside(self.device(), &scene, settings))
            }
            false => end,
        }
    }

    /// Warnings about the scene, the settings and the samples, one sentence each without a full stop.
    pub fn warnings(&self) -> Vec<String> {
        let dropped = match self.dropped() {
            0 => None,
            n => Some(format!("{n} samples were not finite and count as 0")),
        };
        self.warnings.iter().cloned().chain(dropped).collect()
    }

    /// Number of points of the laser.
    pub fn points(&self) -> usize {
        self.measurement.scan.laser_points.len()
    }

    /// Number of points of the laser that have been measured. They are the first ones.
    pub fn measured(&self) -> usize {
        self.measurement.measured()
    }

    /// Whether all points of the laser have been measured.
    pub fn is_complete(&self) -> bool {
        self.measurement.is_whole()
    }

    /// Number of samples that were not finite. They count as 0 in the array.
    pub fn dropped(&self) -> u64 {
        self.measurement.dropped()
    }

    /// Seconds of measuring so far, without the preparation.
    pub fn seconds(&self) -> f64 {
        self.elapsed.as_secs_f64()
    }

    /// Writes the array so far and its description, `PATH.npy` and `PATH.json`, as `taugate render` does: with variances and auxiliary
    /// layers if the experiment has `variance` or `aov`. Points that have not been measured are NaN. Existing files are replaced. Fails
    /// if a file cannot be written, or if the device is lost.
    pub fn write_npy(&self, path: &Path) -> Result<()> {
        self.write(path, self.layers()?.as_ref())
    }

    /// The auxiliary layers that the experiment wants.
    #[doc(hidden)]
    pub fn layers(&self) -> Result<Option<ScanLayers>> {
        let wanted = Some(self.aov).filter(|aov| *aov != Aov::default());
        wanted.map(|aov| self.measurement.layers(self.device(), aov)).transpose()
    }

    /// As [`ReadyScan::write_npy`], with these layers.
    #[doc(hidden)]
    pub fn write(&self, path: &Path, layers: Option<&ScanLayers>) -> Result<()> {
        self.describe(layers, |description| {
            self.measurement.film().write(path, &self.measurement.scan, layers, description)
        })
    }

    /// The arrays, and their description as JSON.
    #[doc(hidden)]
    pub fn into_arrays(self) -> (ScanArrays, String) {
        let text = |description: &Description| serde_json::to_string_pretty(description);
        let description = self.describe(None, text).expect("a description is plain text and numbers");
        (self.measurement.into_arrays(), description)
    }

    #[doc(hidden)]
    pub fn device(&self) -> &Device {
        self.measurement.renderer().device()
    }

    #[doc(hidden)]
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    fn describe<T>(&self, layers: Option<&ScanLayers>, with: impl FnOnce(&Description) -> T) -> T {
        let provenance = Provenance::new(&self.settings, self.seconds(), self.config.clone());
        let (film, scan) = (self.measurement.film(), &self.measurement.scan);
        let measured = (self.measured(), self.measurement.samples());
        let group_index = surrounding_indices(&self.measurement.scene().0.media)[1];
        with(&film.description(&self.table, scan, measured, group_index, layers, &provenance))
    }
}
