//! Algorithm 1: the order of the phases. (A place holder with the calls that the program makes.)

use serde::Serialize;

use crate::error::{Error, Result};
use crate::film::Film;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::Settings;

/// A scene on a device, ready to add iterations to its film.
pub struct Renderer {
    film: Film,
    stats: Stats,
}

/// What a render did so far.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Stats {
    /// Rays traced.
    pub rays: u64,
    /// Sensor samples, all pixels together.
    pub samples: u64,
    /// Samples that were not finite and count as 0.
    pub dropped: u64,
}

impl Renderer {
    /// Uploads the scene and compiles the kernels.
    pub fn new(_device: &Device, _scene: &Scene, settings: &Settings) -> Result<Renderer> {
        let Settings { crop, .. } = settings;
        Ok(Renderer { film: Film::new(crop.width(), crop.height()), stats: Stats::default() })
    }

    /// One iteration: a fresh pool of light vertices and `samples` samples a pixel, added to the film.
    pub fn iterate(&mut self, _samples: u32) -> Result<()> {
        Err(Error::Device("this build has no renderer yet".into()))
    }

    /// The accumulated image, of the crop's size.
    pub fn film(&self) -> &Film {
        &self.film
    }

    pub fn stats(&self) -> &Stats {
        &self.stats
    }
}
