//! Renders that go on after an interruption, and shards of a render on several machines.

use super::samples::MAX_SHARE;
use super::schedule::{Following, Rendered};
use super::{Allocation, Renderer, ResponseImages};
use crate::error::{Error, Result};
use crate::image::accumulation::{About, Accumulation, AdaptiveState};

#[warn(missing_docs)]
impl Renderer {
    /// Describes the sums so far: `render` with the iterations in the film, after `seconds` of rendering.
    #[doc(hidden)]
    pub fn about(&self, render: &About, seconds: f64) -> About {
        About {
            samples_per_pixel: self.rendered().samples,
            dropped: self.dropped(),
            seconds,
            iterations: self.done.clone(),
            next_sample: self.first_sample,
            merged: self.plan.merging.is_some().then_some(self.merged),
            ..render.clone()
        }
    }

    /// Number of samples that were not finite, in this render and in the sums that it continues. They count as 0.
    #[doc(hidden)]
    pub fn dropped(&self) -> u64 {
        self.dropped_before.saturating_add(self.stats.dropped)
    }

    /// The iterations so far.
    #[doc(hidden)]
    pub fn rendered(&self) -> Rendered {
        let (iterations, samples) = self.sums.length();
        Rendered { end: self.next, iterations, samples, is_dark: self.is_dark() }
    }

    /// Says what comes after the next iteration. It does not change the image: an announced iteration need not follow.
    #[doc(hidden)]
    pub fn announce(&mut self, following: Following) {
        self.following = following;
    }

    /// What was announced for the time after the next iteration, or after the present one. Unknown if nothing was.
    #[doc(hidden)]
    pub fn following(&self) -> Following {
        self.following
    }

    /// The state of adaptive sampling; `None` if the sampling is uniform.
    #[doc(hidden)]
    pub fn adaptive_state(&self) -> Option<AdaptiveState> {
        self.sums.get().allocation.as_ref().map(Allocation::state)
    }

    /// Continues the render of `earlier`, which has the same settings and the same scene. The film becomes its film, and the next
    /// iteration follows its last one. So the image gets the bits of a render that was never interrupted, unless `earlier` lacks
    /// the state of adaptive sampling, which then begins anew. Fails without any change if the images differ in size or number, or
    /// if only `earlier` has such a state.
    #[doc(hidden)]
    pub fn resume(&mut self, earlier: Accumulation) -> Result<()> {
        let Accumulation { about, film, responses, adaptive, .. } = earlier;
        let count = self.response_count();
        let own = self.sums.get_mut();
        let fits = (film.width(), film.height()) == (own.film.width(), own.film.height())
            && responses.as_ref().map_or(1, |film| film.responses()) == count
            && film.damps_fireflies() == own.film.damps_fireflies()
            && (adaptive.is_none() || own.allocation.is_some());
        if !fits {
            return Err(Error::settings("the sums of the earlier render do not fit the image of this one"));
        }
        own.film = film;
        if let (Some(allocation), Some(state)) = (&mut own.allocation, &adaptive) {
            allocation.resume(state);
        }
        if let (Some(sums), Some(film)) = (&mut self.responses, responses) {
            *sums = ResponseImages::new(&self.device, &self.plan, film.has_variance());
            sums.resume(film);
        }
        (self.next, self.first_sample) = (about.iterations.end(), about.next_sample);
        (self.done, self.dropped_before) = (about.iterations, about.dropped);
        self.merged = about.merged.unwrap_or_default();
        (self.ahead, self.counts_ahead, self.kept) = (None, None, None);
        Ok(())
    }

    /// Makes iteration `number` the next one. Its random numbers are those that it has in the whole render, where `before` samples per
    /// pixel precede it.
    #[doc(hidden)]
    pub fn go_to(&mut self, number: u32, before: u32) {
        (self.next, self.first_sample) = (number, self.first_sample_after_gap(before));
    }

    /// The sample of the random sequences at which an iteration begins, if some of the `before` samples per pixel before it may be left
    /// out.
    pub(super) fn first_sample_after_gap(&self, before: u32) -> u32 {
        // With adaptive sampling a pixel may have had this many samples in the iterations before.
        if self.plan.adaptive { MAX_SHARE * before } else { before }
    }
}
