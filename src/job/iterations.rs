//! The loop over the iterations of a render.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::error::{Error, ErrorKind, Result};
use crate::render::Renderer;
use crate::render::schedule::Schedule;
use crate::settings::Budget;

/// Adds iterations to the film of a renderer.
pub struct Iterations<'a> {
    pub schedule: Schedule,
    /// Whether a sample that is not finite ends the render.
    pub strict: bool,
    /// Ends the render as soon as it is true.
    pub stop: &'a Arc<AtomicBool>,
    pub abandons: Abandons,
}

/// Which iterations are abandoned when the render has to stop. The others are completed first, which may take long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Abandons {
    All,
    /// None that may clear the images of several or shaped responses.
    SafeOnes,
    /// As `SafeOnes`, and not the first iteration, because there is no image before it.
    LaterOnes,
}

/// Why there are no more iterations.
#[warn(missing_docs)]
#[derive(Debug)]
pub enum End {
    /// The budget is used.
    Complete,
    /// The flag was set that stops the render.
    Stopped,
    /// This number of samples is not finite, and the settings have `strict`.
    NotFinite(u64),
    /// An error of the device. The film has the iterations before.
    Failed(Error),
}

impl End {
    /// As an error if the device failed.
    pub fn or_error(self) -> Result<End> {
        match self {
            End::Failed(error) => Err(error),
            end => Ok(end),
        }
    }
}

/// Adds iterations to the film of its renderer.
pub trait Iterate {
    fn renderer(&mut self) -> &mut Renderer;

    /// As [`Renderer::iterate_unless`].
    fn iterate(&mut self, samples: u32, stop: &Arc<AtomicBool>) -> Result<bool>;
}

impl Iterate for Renderer {
    fn renderer(&mut self) -> &mut Renderer {
        self
    }

    fn iterate(&mut self, samples: u32, stop: &Arc<AtomicBool>) -> Result<bool> {
        self.iterate_unless(samples, stop)
    }
}

impl Iterations<'_> {
    /// Calls `watch` after each iteration with the time since the call of this function. Fails as [`Renderer::iterate`] does. But an
    /// error of the device is [`End::Failed`] if the film has samples.
    pub fn run(&self, of: &mut impl Iterate, watch: impl FnMut(&Renderer, Duration)) -> Result<End> {
        let end = self.add_iterations(of, watch);
        let renderer = of.renderer();
        let error = match end {
            Err(error) => {
                // Between two iterations, too, a lost device may have had the images of responses.
                renderer.abandon();
                error
            }
            Ok(end) => match renderer.settle() {
                Ok(()) => return Ok(end),
                Err(error) => error,
            },
        };
        let is_left = error.kind() == ErrorKind::Device && renderer.rendered().samples > 0;
        if is_left { Ok(End::Failed(error)) } else { Err(error) }
    }

    fn add_iterations(&self, of: &mut impl Iterate, mut watch: impl FnMut(&Renderer, Duration)) -> Result<End> {
        let (started, never) = (Instant::now(), Arc::default());
        let is_bad = |renderer: &Renderer| self.strict && renderer.dropped() > 0;
        // The sums that a render continues may lack samples.
        while !is_bad(of.renderer()) {
            let renderer = of.renderer();
            let Some(samples) = begin(renderer, &self.schedule, started.elapsed()) else { return Ok(End::Complete) };
            if self.stop.load(Ordering::SeqCst) {
                return Ok(End::Stopped);
            }
            let has_samples = renderer.rendered().samples > 0;
            let may_abandon = match self.abandons {
                Abandons::All => true,
                Abandons::SafeOnes => !renderer.may_lose_images(),
                Abandons::LaterOnes => !renderer.may_lose_images() && has_samples,
            };
            match of.iterate(samples, if may_abandon { self.stop } else { &never }) {
                Ok(true) if is_bad(of.renderer()) => break,
                Ok(true) => watch(of.renderer(), started.elapsed()),
                Ok(false) => return Ok(End::Stopped),
                Err(error) => return Err(error),
            }
        }
        Ok(End::NotFinite(of.renderer().dropped()))
    }
}

/// Adds all iterations of a schedule. Fails as [`Renderer::iterate`] does; the film then has the iterations before the error.
pub fn run(renderer: &mut Renderer, schedule: Schedule) -> Result<()> {
    let iterations = Iterations { schedule, strict: false, stop: &Arc::default(), abandons: Abandons::All };
    iterations.run(renderer, |_, _| {})?.or_error().map(drop)
}

/// Makes the next iteration of a schedule that of the renderer, after `elapsed` time of rendering. Announces the iteration after it.
/// Returns the samples per pixel of the next iteration; `None` at the end.
pub fn begin(renderer: &mut Renderer, schedule: &Schedule, elapsed: Duration) -> Option<u32> {
    let rendered = renderer.rendered();
    let next = schedule.next(rendered, elapsed.as_secs_f64())?;
    if let Some(before) = next.after_gap {
        renderer.go_to(next.number, before);
    }
    renderer.announce(schedule.following(rendered, next));
    Some(next.samples)
}

#[warn(missing_docs)]
impl Renderer {
    /// Renders iterations until the film has the samples per pixel of `budget`, or until its seconds have passed since this call. The
    /// number of samples in each iteration is that of `taugate render`, so equal scenes and settings give equal bits. A budget of
    /// seconds ends after the iteration whose end is nearest to it. But it has at least two iterations, unless one takes all its time.
    /// If [`Renderer::is_dark`], it ends after two iterations.
    ///
    /// Fails as [`Renderer::iterate`] does. The film then has the iterations before the error. If the film has samples at the call, a
    /// budget of seconds may end up to one iteration later.
    pub fn render(&mut self, budget: Budget) -> Result<()> {
        run(self, Schedule::whole(budget))
    }
}
