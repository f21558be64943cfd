//! A job that is ready to run, and how far it has come.

#![warn(missing_docs)]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::exposure::{self, Exposed, Exposure};
use super::feasible;
use super::iterations::{Abandons, End, Iterations};
use super::ready::Ready;
use super::sum_files::SumFiles;
use super::sums::Identity;
use crate::error::{Error, Result};
use crate::image::exr_file::{self, Provenance};
use crate::image::film::Film;
use crate::image::layers::Layers;
use crate::image::response_film::ResponseFilm;
use crate::input::experiment::Experiment;
use crate::render::Renderer;
use crate::render::schedule::Schedule;
use crate::settings::Budget;
use crate::settings::shard::Shard;

/// A [`Job`](super::Job) whose scene is on a device. It is rendered iteration by iteration, and has an image after the first one.
pub struct ReadyJob {
    #[doc(hidden)]
    pub ready: Ready,
    /// The moments that the render shows; `None` if it shows a single one.
    #[doc(hidden)]
    pub exposure: Option<Exposure>,
    #[doc(hidden)]
    pub layers: Layers,
    #[doc(hidden)]
    pub sums: SumFiles,
    /// The part of the iterations to render.
    #[doc(hidden)]
    pub shard: Shard,
    /// The experiment with all defaults, but without outputs.
    #[doc(hidden)]
    pub config: Experiment,
    /// Whether a black image is accepted.
    #[doc(hidden)]
    pub may_be_dark: bool,
    /// Whether a sample that is not finite ends the render.
    #[doc(hidden)]
    pub strict: bool,
    /// Warnings about the settings and the scene.
    #[doc(hidden)]
    pub warnings: Vec<String>,
    /// Time of rendering in this process.
    #[doc(hidden)]
    pub elapsed: Duration,
}

/// How far a render has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Fraction of the budget that is used, 0 to 1.
    pub fraction: f64,
    /// Samples per pixel.
    pub samples: u64,
    /// Seconds of rendering, without the preparation. They include those of earlier sums.
    pub seconds: f64,
}

impl Progress {
    #[doc(hidden)]
    pub fn new(budget: &Budget, samples: u64, seconds: f64) -> Progress {
        let used = match *budget {
            Budget::Spp(spp) => samples as f64 / f64::from(spp),
            Budget::Seconds(all) => seconds / all,
        };
        Progress { fraction: used.min(1.0), samples, seconds }
    }
}

/// A render after one of its iterations.
#[doc(hidden)]
pub struct Step<'a> {
    pub renderer: &'a Renderer,
    pub progress: Progress,
    /// Time of rendering in this process.
    pub elapsed: Duration,
    /// Why the checkpoint could not be written, if it was time for that.
    pub not_written: Option<Error>,
}

impl ReadyJob {
    /// Continues the sums in the file `path` (`.acc`) if it exists, and keeps the sums of this render there. [`ReadyJob::run`] writes
    /// the file at its end, and before that when `every` has passed since the last time. A render that is killed can so be continued by
    /// another process: the image gets the same bits as without the interruption, unless the budget changes or is a time.
    ///
    /// Fails if the render has begun, or if the scene is not from a file. Also fails if the file holds the sums of another render, if
    /// another process uses it, or if it cannot be read.
    pub fn keep_sums(&mut self, path: &Path, every: Duration) -> Result<()> {
        if self.film().samples() > 0 {
            return Err(Error::advice(
                "the render has begun, so it cannot continue other sums; ",
                "keep sums before it runs",
            ));
        }
        if self.config.scene.is_none() {
            return Err(Error::settings("a scene from arrays is in no file, so its render cannot be continued"));
        }
        let settings = self.ready.settings.clone();
        let mut sums = SumFiles::open(None, Some(&(path.into(), every.as_secs_f64())))?;
        let shard = sums.shard(None)?;
        sums.identify(Identity::new(self.config.clone(), &settings, shard)?);
        sums.check(self.ready.renderer.has_response_variance())?;
        let continued = self.continue_sums(sums, shard)?;
        self.warnings.extend(continued.and_then(|(_, note)| note));
        Ok(())
    }

    /// Continues the sums of earlier processes, if there are any. See [`SumFiles::resume`].
    #[doc(hidden)]
    pub fn continue_sums(&mut self, mut sums: SumFiles, shard: Shard) -> Result<Option<(String, Option<String>)>> {
        let Ready { renderer, settings, .. } = &mut self.ready;
        let lines = sums.resume(renderer, &mut self.layers, settings, shard, exposure::lengths(&self.config.input))?;
        (self.sums, self.shard) = (sums, shard);
        Ok(lines)
    }

    /// Renders until the budget of the settings is used, or until `stop` is true. Calls `watch` after each iteration, which takes from
    /// milliseconds to minutes. Another thread may set `stop` at any time. The iteration in progress is then abandoned, unless its job
    /// has several responses or a shaped one. A later call goes on where this one ended.
    ///
    /// Returns why the render ended. Fails if no light was found when the budget is used, because the gate misses all light; the error
    /// says when light arrives. An experiment with `force`, or a steady state, accepts a black image. Also fails if the sums of
    /// [`ReadyJob::keep_sums`] cannot be written at the end, and as [`Renderer::iterate`] does; but a device that is lost after the
    /// first iteration gives [`End::Failed`].
    pub fn run(&mut self, stop: &Arc<AtomicBool>, mut watch: impl FnMut(&Progress)) -> Result<End> {
        let end = self.iterate(stop, Abandons::SafeOnes, |step| watch(&step.progress))?;
        self.write_checkpoint()?;
        if matches!(end, End::Complete) {
            self.warn_of_moments();
            self.check_light()?;
        }
        Ok(end)
    }

    /// As [`ReadyJob::run`], without its last checks, and without the sums at the end.
    #[doc(hidden)]
    pub fn iterate(
        &mut self,
        stop: &Arc<AtomicBool>,
        abandons: Abandons,
        mut watch: impl FnMut(Step<'_>),
    ) -> Result<End> {
        let (started, earlier) = (Instant::now(), self.elapsed);
        let before = self.sums.before().seconds;
        let ReadyJob { ready, exposure, layers, sums, shard, config, strict, .. } = self;
        let (budget, lengths) = (ready.settings.budget(), exposure::lengths(&config.input));
        let own_budget = lengths.budget_of(*shard, budget);
        let schedule = Schedule::Budget { budget, shard: *shard, before: before + earlier.as_secs_f64(), lengths };
        let iterations = Iterations { schedule, strict: *strict, stop, abandons };
        let watch = |renderer: &Renderer, elapsed: Duration| {
            let elapsed = earlier + elapsed;
            let seconds = before + elapsed.as_secs_f64();
            let not_written = sums.update(renderer, layers, seconds).err();
            let progress = Progress::new(&own_budget, renderer.rendered().samples, seconds);
            watch(Step { renderer, progress, elapsed, not_written });
        };
        let end = match exposure {
            Some(exposure) => iterations.run(&mut Exposed { exposure, ready }, watch),
            None => iterations.run(&mut ready.renderer, watch),
        };
        self.elapsed = earlier + started.elapsed();
        end
    }

    /// A new warning if the time of the budget was too short for an exposure. It is then also one of [`ReadyJob::warnings`].
    #[doc(hidden)]
    pub fn warn_of_moments(&mut self) -> Option<&str> {
        let (Budget::Seconds(_), Some(exposure)) = (self.ready.settings.budget(), &self.exposure) else { return None };
        let warning = exposure.warning_after(self.film().samples(), self.film().iterations())?;
        if self.warnings.contains(&warning) {
            return None;
        }
        self.warnings.push(warning);
        self.warnings.last().map(String::as_str)
    }

    /// Frees what only a later job needs.
    #[doc(hidden)]
    pub fn no_job_follows(&mut self) {
        // The shutter needs it for other moments.
        self.ready.prepared.take_if(|_| self.exposure.is_none());
    }

    /// Writes the file of the checkpoint, if there is one and the film has samples.
    #[doc(hidden)]
    pub fn write_checkpoint(&self) -> Result<()> {
        match self.sums.checkpoint().filter(|_| self.film().samples() > 0) {
            Some(path) => self.sums.write(path, &self.ready.renderer, &self.layers, self.seconds()),
            None => Ok(()),
        }
    }

    /// Fails if the render found no light and is a whole one, unless a black image is accepted.
    #[doc(hidden)]
    pub fn check_light(&self) -> Result<()> {
        let Ready { renderer, scene, settings, .. } = &self.ready;
        // A shard may miss light that the other shards find.
        match self.shard.is_all() && !self.may_be_dark && renderer.is_black() {
            true => Err(feasible::nothing_inside(renderer.device(), scene, settings)),
            false => Ok(()),
        }
    }

    /// Warnings about the settings, the scene and the memory of the device, one sentence each without a full stop.
    pub fn warnings(&self) -> impl Iterator<Item = &str> {
        let of_scene = self.ready.warnings.iter().chain(&self.ready.missing);
        self.warnings.iter().chain(of_scene).map(String::as_str)
    }

    /// Mean and variance of the pixels so far. With several responses: of the sum of their images.
    pub fn film(&self) -> &Film {
        self.ready.renderer.film()
    }

    /// The images of the responses so far, with their variances; `None` if there is one response, whose image is
    /// [`ReadyJob::film`]. A graphics card may keep these images. Then this copies them to the host, and fails if the card is lost.
    pub fn responses(&self) -> Result<Option<&ResponseFilm>> {
        self.ready.renderer.responses()
    }

    /// Seconds of rendering so far, without the preparation. They include those of the sums that the render continues.
    pub fn seconds(&self) -> f64 {
        self.sums.before().seconds + self.elapsed.as_secs_f64()
    }

    /// Number of samples that were not finite. They count as 0 in the images.
    pub fn dropped(&self) -> u64 {
        self.ready.renderer.dropped()
    }

    /// Writes the images so far to an EXR file, with all channels and attributes of a file of `taugate render`: mean and variance of
    /// each response, auxiliary layers, and the settings. An existing file is replaced. Fails if the file cannot be written.
    pub fn write_exr(&self, path: &Path) -> Result<()> {
        let merged = self.ready.renderer.merged();
        let provenance =
            Provenance { merged, ..Provenance::new(&self.ready.settings, self.seconds(), self.config.to_toml()) };
        exr_file::write_responses(path, self.film(), self.responses()?, &provenance, &self.layers)
    }
}
