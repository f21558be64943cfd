//! Renders that write their sums to a file, and renders that go on from sums.

use std::mem::take;

use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::job::sums::{Checkpoint, Earlier, Identity};
use taugate::internals::render::Renderer;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::table::OutputTable;
use taugate::internals::settings::{Sampling, Settings};

use crate::errors::{Result, settings as mistake};

/// The files with sums of a render. Without such files it does nothing.
#[derive(Default)]
pub struct SumFiles {
    checkpoint: Option<Checkpoint>,
    earlier: Option<Earlier>,
    identity: Option<Identity>,
    /// Seconds of rendering in the sums that the render continues.
    pub before: f64,
    /// Why the last write failed.
    failure: Option<taugate::Error>,
}

impl SumFiles {
    /// The files that `wanted` names. `experiment` is that of the render, with all defaults; `None` if no file has the whole scene.
    /// Fails if the sums that exist belong to another render, or lack the variances of several gates that this render must have.
    pub fn new(
        wanted: &OutputTable,
        experiment: Option<Experiment>,
        settings: &Settings,
        has_variance: bool,
    ) -> Result<SumFiles> {
        let checkpoint = resolve::checkpoint(wanted)?;
        if checkpoint.is_none() && wanted.resume.is_none() {
            return Ok(SumFiles::default());
        }
        let Some(experiment) = experiment else {
            return Err(mistake(
                "a scene from arrays, or with moved nodes, is in no file, so its render cannot be continued; leave out checkpoint and \
                 resume",
            ));
        };
        let identity = Identity::new(experiment, settings, Shard::ALL)?;
        // Lock the checkpoint before reading it, so that the sums are those of the last render that wrote the file.
        let lock = Checkpoint::new(checkpoint.as_ref())?;
        let earlier = Earlier::read(wanted.resume.as_deref(), checkpoint.as_ref())?;
        if let Some(earlier) = &earlier {
            if !earlier.shard(None)?.is_all() {
                return Err(mistake("these sums are a shard; continue them with the program: taugate render --resume"));
            }
            earlier.check(&identity, has_variance)?;
        }
        let before = earlier.as_ref().map_or(0.0, |earlier| earlier.sums.about.seconds);
        Ok(SumFiles { checkpoint: lock, earlier, identity: Some(identity), before, failure: None })
    }

    /// Makes `renderer` go on from the earlier sums, if there are any. Adds their layers to `layers`. Returns notes.
    pub fn resume(&mut self, renderer: &mut Renderer, layers: &mut Layers, settings: &Settings) -> Result<Vec<String>> {
        let Some(mut earlier) = self.earlier.take() else { return Ok(vec![]) };
        layers.add_missing(take(&mut earlier.sums.layers));
        let note = earlier.note(Shard::ALL, settings.sampling() == Sampling::Adaptive);
        let notes = [earlier.describe()].into_iter().chain(note).collect();
        renderer.resume(earlier.sums)?;
        Ok(notes)
    }

    /// Writes the sums after `seconds` of rendering if it is time.
    pub fn update(&mut self, renderer: &Renderer, layers: &Layers, seconds: f64) {
        if let (Some(checkpoint), Some(identity)) = (&mut self.checkpoint, &self.identity)
            && let Err(error) = checkpoint.update(identity, renderer, layers, seconds)
        {
            self.failure = Some(error);
        }
    }

    /// Writes the sums at the end. Returns a warning if the file does not have them: the image must not be lost with the file.
    pub fn finish(mut self, renderer: &Renderer, layers: &Layers, seconds: f64) -> Option<String> {
        if let (Some(checkpoint), Some(identity)) = (&self.checkpoint, &self.identity)
            && renderer.film().samples() > 0
        {
            self.failure = identity.write(checkpoint.path(), renderer, layers, seconds).err();
        }
        self.failure.map(|error| format!("{error}; the checkpoint does not have this image"))
    }
}
