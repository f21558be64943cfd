//! A renderer with a clock: what runs in turns with others.

use std::time::Instant;

use crate::error::Result;
use crate::gpu::Device;
use crate::render::{Prepared, Renderer, Stats};
use crate::scene::Scene;
use crate::settings::Settings;

/// Samples a pixel and iteration at most, and the part of the whole time that an iteration should take at most: as
/// `taugate render --time` has them.
const MOST_SAMPLES: u32 = 8;
const BATCHES: f64 = 16.0;

/// One renderer's progress since its last restart.
pub struct Lane {
    pub renderer: Renderer,
    /// Wall time of all iterations, tree building included; building the BVH and compiling kernels are not.
    pub clock: f64,
    /// Statistics at the last restart.
    before: Stats,
    settings: Settings,
}

impl Lane {
    /// Compiles everything, by rendering an iteration that is forgotten.
    pub fn new(device: &Device, scene: &Scene, settings: &Settings, prepared: &Prepared) -> Result<Lane> {
        let mut renderer = Renderer::from_prepared(device, scene, settings, prepared)?;
        renderer.iterate(1)?;
        let before = renderer.stats().clone();
        let mut lane = Lane { renderer, clock: 0.0, before, settings: settings.clone() };
        lane.restart(settings.seed);
        Ok(lane)
    }

    pub fn restart(&mut self, seed: u32) {
        self.renderer.restart(seed, self.settings.gate);
        self.before = self.renderer.stats().clone();
        self.clock = 0.0;
    }

    /// Renders until the clock shows `end` or more, at least one iteration; `whole` is the time that the lane will have in all.
    pub fn run_until(&mut self, end: f64, whole: f64) -> Result<()> {
        loop {
            let samples = self.next_samples(whole);
            let start = Instant::now();
            self.renderer.iterate(samples)?;
            self.clock += start.elapsed().as_secs_f64();
            if self.clock >= end {
                return Ok(());
            }
        }
    }

    /// Begins with one sample; later an iteration takes up to half of the time so far, and a sixteenth of the whole.
    fn next_samples(&self, whole: f64) -> u32 {
        let done = self.renderer.film().samples();
        if done == 0 {
            return 1;
        }
        let each = self.clock / done as f64;
        let part = (whole / BATCHES).min(0.5 * self.clock);
        ((part / each) as u32).clamp(1, MOST_SAMPLES)
    }

    /// A count of the statistics since the restart.
    pub fn count(&self, of: impl Fn(&Stats) -> u64) -> u64 {
        of(self.renderer.stats()) - of(&self.before)
    }
}
