//! The loop of a render: iterations until the budget is used.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use taugate::internals::render::Renderer;
use taugate::internals::render::schedule::{next_samples_of, samples_of_shard};
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::{Budget, Settings};
use taugate::{Error, ErrorKind};

use super::super::progress::{Before, Position, Progress};
use super::errors::NotFinite;

/// The iterations that were added to the film.
#[derive(Default)]
pub struct Done {
    /// Samples per pixel of each iteration.
    pub schedule: Vec<u32>,
    /// The error of the device that ended the render early. The film is that of the iterations before.
    pub failure: Option<Error>,
}

/// Adds iterations until the budget is used or an interrupt arrives. An interrupt abandons the present iteration, because it may take
/// long. But the first iteration, and any iteration of several or shaped responses, is completed: abandoning it may leave no image.
pub struct Iterations<'a> {
    pub settings: &'a Settings,
    pub shard: Shard,
    /// Work of earlier processes on this render.
    pub before: Before,
    pub strict: bool,
    pub stop: &'a Arc<AtomicBool>,
}

impl Iterations<'_> {
    /// Calls `watch` after every iteration, with the seconds of rendering so far. An error of the device is in the result if the film
    /// has samples; other errors make this function fail.
    pub fn run(
        &self,
        renderer: &mut Renderer,
        progress: &mut Progress,
        watch: &mut dyn FnMut(&Renderer, f64, &mut Progress),
    ) -> anyhow::Result<Done> {
        let Iterations { settings, shard, before, strict, stop } = *self;
        let (budget, started) = (settings.budget(), Instant::now());
        // The budget of this shard alone, to show its progress.
        let own = match budget {
            Budget::Spp(spp) if !shard.is_all() => Budget::Spp(samples_of_shard(shard, spp) as u32),
            other => other,
        };
        let finite = |renderer: &Renderer| match renderer.dropped() {
            dropped if strict && dropped > 0 => Err(NotFinite { dropped }),
            _ => Ok(()),
        };
        // In the sums that the render continues, non-finite samples may already have been dropped.
        finite(renderer)?;
        let mut done = Done::default();
        let never = Arc::default();
        loop {
            renderer.go_to_next_of(shard);
            let elapsed = started.elapsed() + Duration::from_secs_f64(before.seconds);
            let (next, film) = (renderer.next(), renderer.film());
            let samples = next_samples_of(shard, &budget, next, film.iterations(), film.samples(), elapsed);
            if samples == 0 || renderer.can_end_early(&budget) || stop.load(Ordering::Relaxed) {
                return Ok(done);
            }
            let may_abandon = renderer.film().samples() > 0 && !renderer.has_responses();
            match renderer.iterate_unless(samples, if may_abandon { stop } else { &never }) {
                Ok(true) => {}
                Ok(false) => return Ok(done),
                Err(error) if error.kind() == ErrorKind::Device && renderer.film().samples() > 0 => {
                    return Ok(Done { failure: Some(error), ..done });
                }
                Err(error) => return Err(error.into()),
            }
            done.schedule.push(samples);
            finite(renderer)?;
            watch(renderer, before.seconds + started.elapsed().as_secs_f64(), progress);
            progress.update(&Position::of(renderer, started.elapsed(), before), &own);
        }
    }
}
