//! One iteration: Algorithm 1 of the paper.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::Renderer;
use super::contribution::Contribution;
use super::light_phase::{Beside, Progress};
use super::parts::Part;
use super::plan::{Iteration, Observe};
use super::responses::{Arrival, ResponseImages};
use super::samples::{Allocation, SampleCounts};
use super::schedule::{Following, Planned};
use super::sensor::Tiles;
use super::stats::{Stats, stage};
use super::sums::{Image, Sums};
use crate::error::{Error, Result};
#[cfg(doc)]
use crate::image::film::Film;
use crate::threads;

#[warn(missing_docs)]
impl Renderer {
    /// Renders one iteration (Algorithm 1 of the paper) and adds it to the film. An iteration has a new pool of light vertices and
    /// `samples` samples per pixel: in every pixel, or on average if the sampling is adaptive. `samples` is 1 to 16. With aimed camera
    /// rays and uniform sampling it is 1 to 1024. Fails if it is out of range or if a buffer does not fit the device. Also fails if the
    /// device is lost, or if its counts contradict each other. After an error the film is as before. But a render of several or shaped
    /// responses begins anew if the iteration has already changed over 4 million pixels of its images. Then [`Film::samples`] is 0. If a
    /// graphics card kept these images and is lost, the film may lack the iterations of the last seconds.
    pub fn iterate(&mut self, samples: u32) -> Result<()> {
        self.iterate_unless(samples, &Arc::default()).map(drop)
    }

    /// As [`Renderer::iterate`], but gives up soon after `stop` has become true. Returns whether the iteration was added to the
    /// film. If not, the film is as before, and the next call renders the same iteration. A render of several responses may begin
    /// anew instead, see [`Renderer::iterate`].
    #[doc(hidden)]
    pub fn iterate_unless(&mut self, samples: u32, stop: &Arc<AtomicBool>) -> Result<bool> {
        self.iterate_rows(samples, 0..self.plan.crop.height(), stop)
    }

    /// As [`Renderer::iterate_unless`], for some rows of the image. `rows`: those of the crop, from 0. The calls of an iteration take the
    /// rows from top to bottom. Between two calls, the scene may change (`moments.rs`). Without all its rows, an iteration is not part of
    /// the film; [`Renderer::abandon`] gives it up.
    pub(crate) fn iterate_rows(&mut self, samples: u32, rows: Range<u32>, stop: &Arc<AtomicBool>) -> Result<bool> {
        let max = self.plan.max_samples();
        if !(1..=max).contains(&samples) {
            return Err(Error::advice(
                format!("an iteration takes 1 to {max} samples per pixel, not {samples}; "),
                "render more iterations instead",
            ));
        }
        if rows.start == 0 {
            self.begin(samples)?;
        }
        let whole = self.plan.crop;
        self.plan.set_crop(whole.rows(rows.clone()));
        let done = match self.plan.dark {
            true => Ok(Some(self.black_part(samples))),
            false => self.render_part(samples, rows.start * whole.width(), stop, &mut |_| {}),
        };
        self.plan.set_crop(whole);
        match done {
            Ok(Some(part)) => {
                self.add_part(part, rows.end == whole.height())?;
                Ok(true)
            }
            other => {
                self.abandon();
                other.map(|_| false)
            }
        }
    }

    /// Renders one iteration of a plan that observes times or strategies, and calls `visit` with each contribution. The film does not
    /// change.
    pub(super) fn observe(&mut self, samples: u32, visit: &mut impl FnMut(Contribution)) -> Result<()> {
        self.begin(samples)?;
        match self.render_part(samples, 0, &Arc::default(), visit)? {
            Some(part) => self.add_part(part, true),
            None => Ok(()),
        }
    }

    /// Algorithm 1 for the pixels of the plan's crop. Returns `None` if it gave up because of `stop`. Then, and after an error, a part of the
    /// iteration may be in the statistics and in the images of several responses. `offset`: index of the first pixel in the whole crop.
    /// `visit`: see [`Renderer::observe`].
    fn render_part(
        &mut self,
        samples: u32,
        offset: u32,
        stop: &Arc<AtomicBool>,
        visit: &mut impl FnMut(Contribution),
    ) -> Result<Option<Part>> {
        let (iteration, observe, waits) = (self.next_iteration(samples), self.plan.observe, self.device.waits());
        let mut image = vec![0.0f32; self.plan.crop_pixels as usize * 3];

        // Phases 1 and 2: light tracing, hierarchy construction. New vertices that the sensor sees add to the image (t = 1).
        let lit = match self.ahead.take().filter(|lit| lit.iteration == iteration) {
            Some(lit) => lit,
            None => self.light.run(&self.plan, iteration, |_| ())?,
        };
        self.stats.add_part(&lit.stats);
        let pool = lit.pool;
        let mut splats = vec![];
        for splat in lit.splats {
            match observe {
                Observe::Nothing => splat.add_to(&mut image),
                Observe::Responses => {
                    splat.add_to(&mut image);
                    let Arrival { pixel, tau, rgb } = splat.arrival();
                    splats.push(Arrival { pixel: offset + pixel, tau, rgb });
                }
                Observe::Times | Observe::Strategies => visit(splat),
            }
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }

        let counts = &self.begun.as_ref().expect("an iteration has begun").counts;
        let (works_beside, next) = (self.in_flight() > 1, self.light_ahead(counts.max()));
        let Renderer { plan, scene, light, ahead, sensor, sums, counts_ahead, responses, stats, .. } = self;
        let found = std::thread::scope(|scope| -> Result<Option<_>> {
            // Phases 1 and 2 of the next iteration, in another thread. Their first part comes before phase 3 of this one, so that the host
            // builds trees while the device traces sensor subpaths.
            let beside = next.map(|next| light.start(scope, plan, next)).transpose()?;
            // The film of the iteration before, and the sample counts of the next one, in a third thread.
            let (sums, samples_of_next) = (&*sums, next.map(|next| next.samples));
            let add_before = move || add_beside(sums, samples_of_next);
            let adding = works_beside.then(|| threads::spawn_scoped(scope, "film", add_before)).transpose()?;

            // Phase 3: sensor tracing, light-cone shell queries and connections, tile by tile.
            let order = stats.timed(stage::RECORD, || sensor.order(plan.crop));
            let film = responses.as_ref().and_then(ResponseImages::on_device).map(|film| (film, offset));
            let sensor = sensor.prepare(plan, &iteration, scene, &pool, film, stats)?;
            if let Some(responses) = responses {
                stats.timed(stage::SORT_ARRIVALS, || responses.set_splats(splats, sensor.recorder()))?;
            }
            sensor.begin(stop);
            let count = |pixel| plan.sensor_samples(counts.of(offset + pixel));
            let mut tiles = Tiles::new(&order, count);
            stats.timed(stage::WAIT_FOR_LIGHT, || Beside::wait(&beside, Progress::Traced));
            while let Some((tile, is_last)) = stats.timed(stage::RECORD, || tiles.next(sensor.tile_size())) {
                let mut subpaths = sensor.start(plan, tile, &pool, stats)?;
                for bounce in 0..plan.max_depth {
                    subpaths.trace(bounce)?;
                    subpaths.query()?;
                    subpaths.connect()?;
                    if subpaths.have_ended()? {
                        break;
                    }
                }
                if is_last && plan.tuning.holds_for_host {
                    Beside::wait(&beside, Progress::Done);
                    sums.wait();
                }
                let Some(found) = subpaths.resolve(is_last)? else { return Ok(None) };
                found.contributions.into_iter().flatten().for_each(&mut *visit);
                if let Some(responses) = responses {
                    let pixels = || tile.crop_pixels(plan.crop).into_iter().map(|pixel| offset + pixel).collect();
                    stats.timed(stage::SORT_ARRIVALS, || responses.add(pixels, &found.arrivals));
                }
            }

            let (seen, merged) = sensor.film(image.len() / 3, stats)?;
            // An error of the next iteration's light shows in that iteration, which traces it again.
            *ahead = stats.timed(stage::WAIT_FOR_LIGHT, || beside.and_then(|beside| beside.end().ok()));
            if let Some(adding) = adding {
                let join = || adding.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                let (counts, of_film) = stats.timed(stage::WAIT_FOR_FILM, join);
                *counts_ahead = samples_of_next.zip(counts);
                stats.add_part(&of_film);
            }
            Ok(Some(Part { splats: image, seen, merged }))
        })?;
        self.stats.waits += self.device.waits() - waits;
        self.stats.device_bytes = self.stats.device_bytes.max(self.device.bytes_in_use());
        Ok(found)
    }

    /// Samples per pixel of the iteration, which has `samples` on average.
    pub(super) fn sample_counts(&mut self, samples: u32) -> SampleCounts {
        match self.counts_ahead.take() {
            Some((of_ahead, counts)) if of_ahead == samples => counts,
            _ if !self.plan.adaptive => SampleCounts::Uniform(samples),
            _ => {
                let Renderer { sums, stats, .. } = self;
                let added = stats.timed(stage::ADD_TO_FILM, || sums.get());
                let counts = |allocation: &Allocation| allocation.counts(samples);
                let of_pixels = stats.timed(stage::ALLOCATE_SAMPLES, || added.allocation.as_ref().map(counts));
                of_pixels.unwrap_or(SampleCounts::Uniform(samples))
            }
        }
    }

    /// Gives the image of the iteration to the film, which adds it now or beside the next iteration.
    pub(super) fn add_image(&mut self, image: Image) {
        self.sums.put(image);
        if self.in_flight() == 1 {
            self.stats.timed(stage::ADD_TO_FILM, || _ = self.sums.get());
        }
    }

    fn in_flight(&self) -> u32 {
        self.plan.tuning.in_flight.unwrap_or(self.device.info().drive.in_flight)
    }

    /// The next iteration, if its light is to be traced beside phase 3 of the present one. `max`: see [`Renderer::finish_iteration`].
    fn light_ahead(&self, max: u32) -> Option<Iteration> {
        let (Following::Iteration(next) | Following::Perhaps(next)) = self.following else { return None };
        let Planned { number, samples, after_gap } = next;
        let first_sample = after_gap.map_or(self.first_sample + max, |before| self.first_sample_after_gap(before));
        (self.in_flight() > 1).then_some(Iteration { number, first_sample, samples })
    }

    pub(super) fn next_iteration(&self, samples: u32) -> Iteration {
        Iteration { number: self.next, first_sample: self.first_sample, samples }
    }

    /// `max`: the maximum number of samples of a pixel in the iteration, without those that stop at thin glass. `merged`: mean luminance of
    /// its merged light.
    pub(super) fn finish_iteration(&mut self, max: u32, merged: f64) {
        if let Some(radius) = self.plan.merge_pixels(self.next) {
            self.merged.add(merged, radius);
        }
        self.done.add(self.next);
        self.next += 1;
        self.first_sample += max;
        self.following = Following::Unknown;
        self.stats.iterations += 1;
    }
}

/// Adds the last iteration to `sums`. If the counts of the iteration after the present one do not depend on the present one, chooses them
/// for `samples` samples per pixel. Also returns the times that this took.
fn add_beside(sums: &Sums, samples: Option<u32>) -> (Option<SampleCounts>, Stats) {
    let (start, mut stats) = (Instant::now(), Stats::default());
    let added = stats.timed(stage::ADD_TO_FILM, || sums.get());
    let counts = added.allocation.as_ref().zip(samples).and_then(|(allocation, samples)| {
        stats.timed(stage::ALLOCATE_SAMPLES, || allocation.counts_after_next(samples))
    });
    stats.beside_seconds = start.elapsed().as_secs_f64();
    (counts, stats)
}

#[cfg(test)]
mod tests {
    use crate::generate::{Kind, build};
    use crate::gpu::Device;
    use crate::render::schedule::{Following, Planned};
    use crate::render::{Renderer, Tuning};
    use crate::settings::{Estimator, Sampling, Settings};

    /// The image of the last iteration is not in the film yet when the samples of the next one are known.
    #[test]
    fn samples_of_the_next_iteration_are_chosen_beside_this_one() {
        let settings =
            Settings::builder().estimator(Estimator::Bdpt).resolution([8, 8]).light_paths(100).splat_paths(0);
        let settings = settings.sampling(Sampling::Adaptive).build().unwrap();
        let device = Device::open(None).expect("this test needs a Vulkan device: run ./setup.sh");
        let tuning = Tuning { in_flight: Some(2), ..Tuning::default() };
        let mut renderer = Renderer::with_tuning(&device, &build(Kind::CornellBox), &settings, tuning).unwrap();
        for number in 0..6 {
            let next = Planned { number: number + 1, samples: 3, after_gap: None };
            renderer.announce(Following::Iteration(next));
            renderer.iterate(if number == 0 { 2 } else { 3 }).unwrap();
            // The first ones follow the iteration just before.
            assert_eq!(renderer.counts_ahead.is_some(), number >= 2, "iteration {number}");
            assert!(!renderer.sums.has_all());
        }
        let chosen = renderer.counts_ahead.clone();
        assert_eq!(chosen, Some((3, renderer.sums.get().allocation.as_ref().unwrap().counts(3))));
        renderer.restart(7, renderer.plan.responses.clone()).unwrap();
        assert!(renderer.counts_ahead.is_none());
    }
}
