//! Renders that go on after an interruption, and shards of a render on several machines.

use super::samples::MAX_SHARE;
use super::schedule::samples_before;
use super::{Renderer, ResponseSums};
use crate::error::{Error, Result};
use crate::image::accumulation::{Accumulation, AdaptiveState, Iterations};
use crate::settings::shard::Shard;

#[warn(missing_docs)]
impl Renderer {
    /// The iterations in the film.
    #[doc(hidden)]
    pub fn done(&self) -> &Iterations {
        &self.done
    }

    /// The number of the next iteration.
    #[doc(hidden)]
    pub fn next(&self) -> u32 {
        self.next
    }

    /// Sample of the random sequences at which the next iteration begins.
    #[doc(hidden)]
    pub fn next_sample(&self) -> u32 {
        self.first_sample
    }

    /// What adaptive sampling has learned; `None` if the sampling is uniform.
    #[doc(hidden)]
    pub fn adaptive_state(&self) -> Option<AdaptiveState> {
        self.allocation.as_ref().map(|allocation| allocation.state())
    }

    /// Continues the render of `earlier`, which has the same settings and the same scene: the film becomes its film, and the next
    /// iteration follows its last one. A renderer of the whole render then adds the same bits as one that was never interrupted. Fails
    /// without any change if the images differ in size.
    #[doc(hidden)]
    pub fn resume(&mut self, earlier: Accumulation) -> Result<()> {
        let Accumulation { about, film, responses, adaptive } = earlier;
        let count = self.responses().map_or(1, |film| film.responses());
        let fits = (film.width(), film.height()) == (self.film.width(), self.film.height())
            && responses.as_ref().map_or(1, |film| film.responses()) == count
            && adaptive.is_some() == self.allocation.is_some();
        if !fits {
            return Err(Error::Settings("the sums of the earlier render do not fit the image of this one".into()));
        }
        self.film = film;
        if let (Some(sums), Some(film)) = (&mut self.responses, responses) {
            *sums = ResponseSums::new(&self.plan, film.has_variance());
            sums.resume(film);
        }
        if let (Some(allocation), Some(state)) = (&mut self.allocation, &adaptive) {
            allocation.resume(state);
        }
        (self.next, self.first_sample) = (about.iterations.end(), about.next_sample);
        self.done = about.iterations;
        Ok(())
    }

    /// As [`Renderer::go_to`], for the next iteration of `shard`. For the whole render there is nothing to do.
    #[doc(hidden)]
    pub fn go_to_next_of(&mut self, shard: Shard) {
        if shard.is_all() {
            return;
        }
        let from = self.done.end();
        self.go_to((from..).find(|&number| shard.has(number)).expect("a shard has no last iteration"));
    }

    /// Makes iteration `number` the next one, for a part of a render. Its random numbers are those of this iteration in the whole
    /// render, and no other iteration has them.
    #[doc(hidden)]
    pub fn go_to(&mut self, number: u32) {
        self.next = number;
        let before = samples_before(self.next) as u32;
        // With adaptive sampling a pixel may have had this many samples in the iterations before.
        self.first_sample = if self.allocation.is_some() { MAX_SHARE * before } else { before };
    }
}
