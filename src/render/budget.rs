//! Renders until a budget is used.

use std::time::{Duration, Instant};

use super::Renderer;
use super::schedule::next_samples;
use crate::error::Result;
use crate::settings::Budget;

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
        let started = Instant::now();
        loop {
            match self.next_samples(&budget, started.elapsed()) {
                0 => return Ok(()),
                samples => self.iterate(samples)?,
            }
        }
    }

    /// Samples per pixel in the next iteration, after `elapsed` time of rendering; 0 when the budget is used, or if
    /// [`Renderer::can_end_early`].
    #[doc(hidden)]
    pub fn next_samples(&self, budget: &Budget, elapsed: Duration) -> u32 {
        let film = self.film();
        let is_enough = self.can_end_early(budget);
        if is_enough { 0 } else { next_samples(budget, film.iterations(), film.samples(), elapsed) }
    }

    /// Whether the render can end before its budget of seconds: no light can arrive inside the gate, and the film has the two
    /// iterations that a variance needs. False for a budget of samples, which is always rendered whole.
    #[doc(hidden)]
    pub fn can_end_early(&self, budget: &Budget) -> bool {
        self.is_dark() && matches!(budget, Budget::Seconds(_)) && self.film().iterations() >= 2
    }
}
