//! Number of samples per pixel in each iteration. Short iterations give more batches to estimate the variance from; long
//! iterations share the cost of the light paths among more samples.
//!
//! Except in scans, the length of an iteration depends on its index alone; only the last iteration may be shorter. So a longer
//! render begins with the same bits as a shorter one. A render with a budget of seconds begins with the same bits as one with a
//! budget of samples. `docs/notebook/schedule.md` compares lengths.

use std::ops::Range;

use super::samples::MAX_AIMED_SAMPLES;
use crate::settings::Budget;
use crate::settings::shard::Shard;

/// The variance is estimated from at least two iterations.
const MIN_ITERATIONS: u32 = 2;

/// Samples per pixel in iteration `iteration`, counted from 0.
///
/// The first 8 iterations have 2 samples each. A single sample could not be distributed by error, and fewer iterations for
/// the first 16 samples would estimate the variance too poorly. Iterations of 4 samples follow up to 64 samples, then
/// iterations of 8.
pub fn samples_in(iteration: u32) -> u32 {
    match iteration {
        0..8 => 2,
        8..20 => 4,
        _ => 8,
    }
}

/// Samples per pixel in all iterations before iteration `iteration`.
pub fn samples_before(iteration: u32) -> u64 {
    let i = u64::from(iteration);
    match iteration {
        0..8 => 2 * i,
        8..20 => 16 + 4 * (i - 8),
        _ => 64 + 8 * (i - 20),
    }
}

/// Number of iterations of a render with `spp` samples per pixel.
pub fn iterations_of(spp: u32) -> u32 {
    match spp {
        0..=16 => spp.div_ceil(2),
        17..=64 => 8 + (spp - 16).div_ceil(4),
        _ => 20 + (spp - 64).div_ceil(8),
    }
}

/// Samples per pixel of each iteration of `shard`, in a render with `spp` samples per pixel.
pub fn lengths(shard: Shard, spp: u64) -> impl Iterator<Item = u32> {
    Lengths::Growing.of(shard, spp)
}

/// How long the iterations of a render are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lengths {
    /// As [`samples_in`] says.
    Growing,
    /// Equal and short, because each iteration shows one moment of an exposure. Two samples can still be distributed by error.
    OfMoments,
}

/// Samples per pixel of an iteration that shows one moment of an exposure.
const SAMPLES_OF_MOMENT: u32 = 2;

impl Lengths {
    /// As the function [`samples_in`].
    pub fn samples_in(self, iteration: u32) -> u32 {
        match self {
            Lengths::Growing => samples_in(iteration),
            Lengths::OfMoments => SAMPLES_OF_MOMENT,
        }
    }

    /// As the function [`samples_before`].
    fn samples_before(self, iteration: u32) -> u64 {
        match self {
            Lengths::Growing => samples_before(iteration),
            Lengths::OfMoments => u64::from(SAMPLES_OF_MOMENT) * u64::from(iteration),
        }
    }

    /// As the function [`iterations_of`].
    pub fn iterations_of(self, spp: u32) -> u32 {
        match self {
            Lengths::Growing => iterations_of(spp),
            Lengths::OfMoments => spp.div_ceil(SAMPLES_OF_MOMENT),
        }
    }

    /// As the function [`lengths`].
    fn of(self, shard: Shard, spp: u64) -> impl Iterator<Item = u32> {
        let numbers = (shard.index()..).step_by(shard.count() as usize);
        numbers.map(move |number| self.samples_up_to(spp, number)).take_while(|&samples| samples > 0)
    }

    /// The budget of `shard` alone, if all shards together have `budget`.
    pub fn budget_of(self, shard: Shard, budget: Budget) -> Budget {
        match budget {
            Budget::Spp(spp) => Budget::Spp(self.of(shard, spp.into()).sum()),
            seconds => seconds,
        }
    }

    /// Samples per pixel of iteration `number` in a render with `spp` samples per pixel; 0 if it has no such iteration.
    fn samples_up_to(self, spp: u64, number: u32) -> u32 {
        spp.saturating_sub(self.samples_before(number)).min(self.samples_in(number).into()) as u32
    }
}

/// Which iterations a render has, and how many samples each of them has.
#[derive(Debug, Clone)]
pub enum Schedule {
    /// The iterations of `shard` until `budget` is used. A budget of samples holds for all shards together, a budget of seconds for each
    /// shard. `before`: seconds of rendering in the sums that the render continues.
    ///
    /// A budget of samples may shorten the last iteration. A budget of seconds ends after the iteration whose end is nearest to it. But
    /// the first iteration always runs, and the second one runs unless the time is over. If no light can arrive inside the gate, a
    /// budget of seconds ends after the two iterations that a variance needs. But other moments of an exposure may have light.
    Budget { budget: Budget, shard: Shard, before: f64, lengths: Lengths },
    /// The iterations `numbers` of a render with `spp` samples per pixel; `None` for a render without an end.
    Part { numbers: Range<u32>, spp: Option<u32> },
    /// A point of a scan with `points` sensor points. All iterations except the last have the same length. A budget of samples limits
    /// this length to a quarter of the budget, rounded up. With a budget of seconds, the first two iterations always run.
    Scan { budget: Budget, points: u32 },
    /// Iteration `first`, and more until the end of one is nearest to `end` seconds. `before`: seconds of the earlier iterations.
    Turn { first: u32, before: f64, end: f64 },
}

/// The iterations of a render so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rendered {
    /// Number of the iteration after the last one. Shards and parts omit iterations, so it may exceed `iterations`.
    pub end: u32,
    /// How many iterations there are, and their samples per pixel.
    pub iterations: u32,
    pub samples: u64,
    /// Whether no light can arrive inside the gate.
    pub is_dark: bool,
}

/// An iteration of a schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planned {
    /// Its number in the whole render.
    pub number: u32,
    /// Samples per pixel, at least 1.
    pub samples: u32,
    /// If iterations before it may be left out here: samples per pixel of all iterations before it in the whole render.
    pub after_gap: Option<u32>,
}

/// What comes after an iteration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Following {
    #[default]
    Unknown,
    Nothing,
    Iteration(Planned),
    /// This iteration or nothing: it depends on the time that iterations take.
    Perhaps(Planned),
}

impl Schedule {
    /// The whole render of a budget.
    pub fn whole(budget: Budget) -> Schedule {
        Schedule::Budget { budget, shard: Shard::ALL, before: 0.0, lengths: Lengths::Growing }
    }

    /// The iteration after `rendered`, after `elapsed` seconds of rendering; `None` at the end.
    pub fn next(&self, rendered: Rendered, elapsed: f64) -> Option<Planned> {
        let Rendered { end, iterations, samples: done, is_dark } = rendered;
        let (number, samples) = match *self {
            Schedule::Budget { budget: Budget::Seconds(_), lengths: Lengths::Growing, .. }
                if is_dark && iterations >= MIN_ITERATIONS =>
            {
                (end, 0)
            }
            Schedule::Budget { budget, shard, before, lengths } => {
                let number = (end..).find(|&number| shard.has(number)).expect("a shard has no last iteration");
                let samples = match budget {
                    Budget::Spp(spp) if shard.is_all() => {
                        u64::from(spp).saturating_sub(done).min(lengths.samples_in(number).into()) as u32
                    }
                    Budget::Spp(spp) => lengths.samples_up_to(spp.into(), number),
                    Budget::Seconds(seconds) => {
                        let (elapsed, samples) = (before + elapsed, lengths.samples_in(number));
                        let fits = iterations < MIN_ITERATIONS || ends_nearer(samples, done, elapsed, seconds);
                        if done == 0 || elapsed < seconds && fits { samples } else { 0 }
                    }
                };
                (number, samples)
            }
            Schedule::Part { ref numbers, spp } => {
                let number = end.max(numbers.start);
                let samples = Lengths::Growing.samples_up_to(spp.map_or(u64::MAX, u64::from), number);
                (number, if numbers.contains(&number) { samples } else { 0 })
            }
            Schedule::Scan { budget, points } => (end, scan_samples(budget, points, done, elapsed)),
            Schedule::Turn { first, before, end: seconds } => {
                let samples = samples_in(end);
                let runs = end <= first || ends_nearer(samples, done, before + elapsed, seconds);
                (end, if runs { samples } else { 0 })
            }
        };
        (samples > 0).then(|| Planned { number, samples, after_gap: self.samples_before_gap(number) })
    }

    /// What comes after the iteration `planned` that follows `rendered`.
    pub fn following(&self, rendered: Rendered, planned: Planned) -> Following {
        let is_timed = match self {
            Schedule::Budget { budget, .. } | Schedule::Scan { budget, .. } => matches!(budget, Budget::Seconds(_)),
            Schedule::Part { .. } => false,
            Schedule::Turn { .. } => true,
        };
        let (iterations, samples) = (rendered.iterations + 1, rendered.samples + u64::from(planned.samples));
        let after = Rendered { end: planned.number + 1, iterations, samples, ..rendered };
        let following = if is_timed { Following::Perhaps } else { Following::Iteration };
        self.next(after, 0.0).map_or(Following::Nothing, following)
    }

    /// See [`Planned::after_gap`].
    fn samples_before_gap(&self, number: u32) -> Option<u32> {
        match self {
            Schedule::Budget { shard, lengths, .. } => (!shard.is_all()).then(|| lengths.samples_before(number) as u32),
            Schedule::Part { .. } => Some(samples_before(number) as u32),
            Schedule::Scan { .. } | Schedule::Turn { .. } => None,
        }
    }
}

/// Whether `seconds` is nearer to the end of another iteration of `samples` samples than to the present time. `done` samples took
/// `elapsed` seconds.
pub fn ends_nearer(samples: u32, done: u64, elapsed: f64, seconds: f64) -> bool {
    elapsed + 0.5 * elapsed / done.max(1) as f64 * f64::from(samples) <= seconds
}

/// Target for the samples of all points together in an iteration of a scan. These samples share the cost of the light subpaths.
const SCAN_SAMPLES: u32 = 4096;

/// Samples of the next iteration of [`Schedule::Scan`]; 0 at the end.
fn scan_samples(budget: Budget, points: u32, done: u64, elapsed: f64) -> u32 {
    let samples = (SCAN_SAMPLES / points).clamp(2, MAX_AIMED_SAMPLES);
    match budget {
        Budget::Spp(spp) => u64::from(spp).saturating_sub(done).min(samples.min(spp.div_ceil(4)).into()) as u32,
        Budget::Seconds(seconds) => {
            let runs = done <= samples.into() || ends_nearer(samples, done, elapsed, seconds);
            if runs { samples } else { 0 }
        }
    }
}

#[cfg(test)]
mod tests;
