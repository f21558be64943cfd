//! A renderer with a clock: what runs in turns with others.

use std::time::Instant;

use crate::error::Result;
use crate::gpu::Device;
use crate::render::schedule::samples_in;
use crate::render::{PreparedScene, Renderer, Stats};
use crate::scene::Scene;
use crate::settings::Settings;

/// One renderer's progress since its last restart.
pub struct TimedRenderer {
    pub renderer: Renderer,
    /// Wall time of all iterations, tree building included; building the BVH and compiling kernels are not.
    pub clock: f64,
    /// Statistics at the last restart.
    before: Stats,
    settings: Settings,
}

impl TimedRenderer {
    /// Compiles everything, by rendering an iteration that is forgotten.
    pub fn new(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<TimedRenderer> {
        let mut renderer = Renderer::from_prepared(device, scene, settings, prepared)?;
        renderer.iterate(1)?;
        let before = renderer.stats().clone();
        let mut timed = TimedRenderer { renderer, clock: 0.0, before, settings: settings.clone() };
        timed.restart(settings.seed());
        Ok(timed)
    }

    pub fn restart(&mut self, seed: u32) {
        self.renderer.restart(seed, self.settings.responses().clone()).expect("the settings were checked");
        self.before = self.renderer.stats().clone();
        self.clock = 0.0;
    }

    /// Renders until the clock shows `end` or more, at least one iteration.
    pub fn run_until(&mut self, end: f64) -> Result<()> {
        loop {
            let samples = samples_in(self.renderer.film().iterations());
            let start = Instant::now();
            self.renderer.iterate(samples)?;
            self.clock += start.elapsed().as_secs_f64();
            if self.clock >= end {
                return Ok(());
            }
        }
    }

    /// A count of the statistics since the restart.
    pub fn count(&self, of: impl Fn(&Stats) -> u64) -> u64 {
        of(self.renderer.stats()) - of(&self.before)
    }
}
