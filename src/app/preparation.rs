//! The clock of what comes before the first iteration.

use std::time::Instant;

use taugate::internals::render::{Stage, Stats};

/// Runs from its making on; knows where the time went.
pub struct Preparation {
    started: Instant,
    parts: Vec<(String, f64)>,
    seconds: f64,
}

impl Preparation {
    pub fn new() -> Preparation {
        Preparation { started: Instant::now(), parts: vec![], seconds: 0.0 }
    }

    /// Runs `work` and remembers how long it took.
    pub fn timed<T>(&mut self, part: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.parts.push((part.into(), start.elapsed().as_secs_f64()));
        result
    }

    /// Stops the clock.
    pub fn finish(&mut self) {
        self.seconds = self.started.elapsed().as_secs_f64();
    }

    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Parts as [`Stats::stages`] has them, with those of the renderer.
    pub fn stages(&self, renderer: &Stats) -> Vec<Stage> {
        let own = renderer.prepare_seconds.iter().map(|(name, seconds)| (name.clone(), *seconds));
        Stage::list(self.parts.iter().cloned().chain(own), self.seconds)
    }
}
