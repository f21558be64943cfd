//! Measures the time that a render takes before its first iteration.

use std::time::Instant;

use crate::render::{Stage, Stats};

/// A clock that starts in `start` and records the seconds of each part of the preparation.
pub struct Preparation {
    started: Instant,
    parts: Vec<(String, f64)>,
    seconds: f64,
}

impl Preparation {
    pub fn start() -> Preparation {
        Preparation { started: Instant::now(), parts: vec![], seconds: 0.0 }
    }

    /// Runs `work` and records its wall time under the name `part`.
    pub fn timed<T>(&mut self, part: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.parts.push((part.into(), start.elapsed().as_secs_f64()));
        result
    }

    /// Records the total time.
    pub fn finish(&mut self) {
        self.seconds = self.started.elapsed().as_secs_f64();
    }

    /// Seconds from `start` to `finish`; 0 before `finish`.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The stages of the preparation, in the form of [`Stats::stages`]: the parts timed here, then the parts timed by the renderer.
    pub fn stages(&self, renderer: &Stats) -> Vec<Stage> {
        let own = renderer.prepare_seconds.iter().map(|(name, seconds)| (name.clone(), *seconds));
        Stage::list(self.parts.iter().cloned().chain(own), self.seconds, 0.0)
    }
}
