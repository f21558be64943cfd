//! The files with sums that belong to a render: it continues the sums of one file, and keeps its own in another.

use std::mem::take;
use std::path::{Path, PathBuf};

use super::sums::{Checkpoint, Earlier, Identity};
use crate::error::Result;
use crate::image::layers::Layers;
use crate::render::Renderer;
use crate::render::schedule::Lengths;
use crate::settings::shard::Shard;
use crate::settings::{Sampling, Settings};

/// The files of --resume and --checkpoint. Without such files it does nothing.
#[derive(Default)]
pub struct SumFiles {
    checkpoint: Option<Checkpoint>,
    earlier: Option<Earlier>,
    identity: Option<Identity>,
    before: Before,
}

/// What earlier processes did: samples per pixel, and seconds of rendering.
#[derive(Debug, Clone, Copy, Default)]
pub struct Before {
    pub samples: u64,
    pub seconds: f64,
}

impl SumFiles {
    /// Locks the file of --checkpoint, and reads the sums that the render continues. `checkpoint`: the file, and the seconds between
    /// two writes. Fails if another render writes this file, or if the sums cannot be read.
    pub fn open(resume: Option<&Path>, checkpoint: Option<&(PathBuf, f64)>) -> Result<SumFiles> {
        // Lock the checkpoint before reading it, so that the sums are those of the last render that wrote the file.
        let lock = Checkpoint::new(checkpoint)?;
        let earlier = Earlier::read(resume, checkpoint)?;
        let before = earlier.as_ref().map_or(Before::default(), |Earlier { sums, .. }| Before {
            samples: sums.about.samples_per_pixel,
            seconds: sums.about.seconds,
        });
        Ok(SumFiles { checkpoint: lock, earlier, identity: None, before })
    }

    /// Whether the render continues sums.
    pub fn has_earlier(&self) -> bool {
        self.earlier.is_some()
    }

    /// The part of the image that is in the sums which the render continues.
    pub fn before(&self) -> Before {
        self.before
    }

    /// The shard to render: that of the flag, else that of the sums. Fails if the two differ.
    pub fn shard(&self, typed: Option<Shard>) -> Result<Shard> {
        self.earlier.as_ref().map_or(Ok(typed.unwrap_or(Shard::ALL)), |earlier| earlier.shard(typed))
    }

    /// The render that the files belong to. Call this before the functions below.
    pub fn identify(&mut self, identity: Identity) -> &Identity {
        self.identity.insert(identity)
    }

    pub fn identity(&self) -> Option<&Identity> {
        self.identity.as_ref()
    }

    /// Fails if the earlier sums belong to another render, or lack variances that this render must write.
    pub fn check(&self, has_variance: bool) -> Result<()> {
        match (&self.earlier, &self.identity) {
            (Some(earlier), Some(identity)) => earlier.check(identity, has_variance),
            _ => Ok(()),
        }
    }

    /// Makes `renderer` continue the earlier sums, and adds their layers to `layers`. Returns a line about them, and a note if the image
    /// will differ from that of a render that never stopped; `None` without earlier sums.
    pub fn resume(
        &mut self,
        renderer: &mut Renderer,
        layers: &mut Layers,
        settings: &Settings,
        shard: Shard,
        lengths: Lengths,
    ) -> Result<Option<(String, Option<String>)>> {
        let Some(mut earlier) = self.earlier.take() else { return Ok(None) };
        layers.add_missing(take(&mut earlier.sums.layers));
        let lines = (earlier.describe(), earlier.note(shard, settings.sampling() == Sampling::Adaptive, lengths));
        renderer.resume(earlier.sums)?;
        Ok(Some(lines))
    }

    /// Writes the checkpoint after `seconds` of rendering, if it is time. Fails if it cannot be written; a later call tries again.
    pub fn update(&mut self, renderer: &Renderer, layers: &Layers, seconds: f64) -> Result<()> {
        match (&mut self.checkpoint, &self.identity) {
            (Some(checkpoint), Some(identity)) => checkpoint.update(identity, renderer, layers, seconds),
            _ => Ok(()),
        }
    }

    /// The file of --checkpoint.
    pub fn checkpoint(&self) -> Option<&Path> {
        self.checkpoint.as_ref().map(Checkpoint::path)
    }

    /// Writes the sums to a file, if the render was identified.
    pub fn write(&self, path: &Path, renderer: &Renderer, layers: &Layers, seconds: f64) -> Result<()> {
        self.identity.as_ref().map_or(Ok(()), |identity| identity.write(path, renderer, layers, seconds))
    }
}
