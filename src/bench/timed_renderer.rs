//! A renderer with a clock, which can take turns with other renderers.

use std::time::Instant;

use crate::error::Result;
use crate::gpu::Device;
use crate::job::iterations;
use crate::render::schedule::{Schedule, ends_nearer, samples_in};
use crate::render::{PreparedScene, Renderer, Stats};
use crate::scene::Scene;
use crate::settings::Settings;

/// A renderer, and the time it has rendered since its last restart.
pub struct TimedRenderer {
    pub renderer: Renderer,
    /// Wall time of all iterations in seconds. It includes the building of light trees, but not the BVH and the compilation of
    /// kernels.
    pub clock: f64,
    /// Statistics at the last restart.
    before: Stats,
    settings: Settings,
}

impl TimedRenderer {
    /// Renders one iteration and discards it, so that all kernels are compiled.
    pub fn new(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<TimedRenderer> {
        let mut renderer = Renderer::from_prepared(device, scene, settings, prepared)?;
        renderer.iterate(1)?;
        let before = renderer.stats().clone();
        let mut timed = TimedRenderer { renderer, clock: 0.0, before, settings: settings.clone() };
        timed.restart(settings.seed());
        Ok(timed)
    }

    /// Discards the film and sets the clock to 0.
    pub fn restart(&mut self, seed: u32) {
        self.renderer.restart(seed, self.settings.responses().clone()).expect("the settings were checked");
        self.before = self.renderer.stats().clone();
        self.clock = 0.0;
    }

    /// Renders at least one iteration, and more until [`TimedRenderer::has_reached`] `end`.
    pub fn run_until(&mut self, end: f64) -> Result<()> {
        let start = Instant::now();
        let schedule = Schedule::Turn { first: self.renderer.rendered().end, before: self.clock, end };
        iterations::run(&mut self.renderer, schedule)?;
        self.clock += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Whether the present clock is nearer to `end` than the clock after another iteration. So the clock stops before and after the
    /// end alike. On average, a renderer with long iterations gets no more time than one with short ones.
    pub fn has_reached(&self, end: f64) -> bool {
        let film = self.renderer.film();
        !ends_nearer(samples_in(film.iterations()), film.samples(), self.clock, end)
    }

    /// A counter of the statistics, counted since the restart.
    pub fn count(&self, of: impl Fn(&Stats) -> u64) -> u64 {
        of(self.renderer.stats()) - of(&self.before)
    }
}
