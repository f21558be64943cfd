//! A render that goes on with the scene at another moment, as while the shutter of a camera is open.

use std::mem::take;
use std::time::Duration;

use super::parts::Begun;
use super::responses::ResponseSums;
use super::stats::Stats;
use super::sums::Sums;
use super::{Iterations, Renderer};
use crate::image::accumulation::MergedLight;
use crate::image::film::Film;

/// How far a render has come: all that stays when the scene changes.
pub struct Paused {
    sums: Sums,
    responses: Option<ResponseSums>,
    stats: Stats,
    begun: Option<Begun>,
    done: Iterations,
    next: u32,
    first_sample: u32,
    dropped_before: u64,
    merged: MergedLight,
}

impl Renderer {
    /// Takes the images and counts so far out of the renderer, which may then change its scene or make room for another renderer.
    /// [`Renderer::go_on`] comes next.
    pub(crate) fn pause(&mut self) -> Paused {
        // The light of the next iteration is that of another scene.
        (self.ahead, self.counts_ahead) = (None, None);
        Paused {
            sums: std::mem::replace(&mut self.sums, Sums::new(Film::new(1, 1), None)),
            responses: self.responses.take(),
            stats: take(&mut self.stats),
            begun: self.begun.take(),
            done: take(&mut self.done),
            next: self.next,
            first_sample: self.first_sample,
            dropped_before: self.dropped_before,
            merged: take(&mut self.merged),
        }
    }

    /// Goes on where another renderer, or this one, has paused. Both have the same settings.
    pub(crate) fn go_on(&mut self, paused: Paused) {
        let Paused { sums, responses, stats, begun, done, next, first_sample, dropped_before, merged } = paused;
        let own = std::mem::replace(&mut self.stats, stats);
        self.stats.scene_bytes = own.scene_bytes.max(self.stats.scene_bytes);
        (self.sums, self.responses, self.begun, self.done) = (sums, responses, begun, done);
        (self.next, self.first_sample, self.dropped_before) = (next, first_sample, dropped_before);
        self.merged = merged;
        if let Some(responses) = &mut self.responses {
            responses.follow(&self.plan);
        }
    }

    /// Turns the phases of a heterodyne sensor until the render pauses.
    pub(crate) fn turn_waves(&mut self, turns: f64) {
        if let Some(responses) = &mut self.responses {
            responses.turn_waves(turns);
        }
    }

    /// Adds wall time of work on the host to a stage of the statistics.
    pub(crate) fn add_time(&mut self, stage: &str, time: Duration) {
        self.stats.add_host(stage, time);
    }
}
