//! How many samples an iteration takes: few enough that there are batches for the variance, enough to pay for its light paths.

use std::time::Duration;

use crate::settings::Budget;

/// Samples a pixel and iteration at most.
pub const MOST_SAMPLES: u32 = 8;
/// Iterations that a budget is divided into at least, if one has more than [`WORTH_THE_LIGHT`] samples a pixel.
const BATCHES: u32 = 16;
/// And at least if one has not.
const FEWEST_BATCHES: u32 = 8;
/// With so many samples a pixel, the light paths of an iteration are the smaller part of its time.
const WORTH_THE_LIGHT: u32 = 4;

/// Samples a pixel in the next iteration; 0 when the budget is used. A budget of samples is cut the same way on every
/// machine; one of time begins with a single sample and learns from what it took.
pub fn next_samples(budget: &Budget, done: u64, elapsed: Duration) -> u32 {
    match *budget {
        Budget::Spp(spp) => {
            let left = u64::from(spp).saturating_sub(done).min(u64::from(u32::MAX)) as u32;
            let least = (spp / FEWEST_BATCHES).clamp(1, WORTH_THE_LIGHT);
            left.min((spp / BATCHES).clamp(least, MOST_SAMPLES))
        }
        Budget::Seconds(seconds) if done > 0 && elapsed.as_secs_f64() >= seconds => 0,
        Budget::Seconds(seconds) => samples_within(seconds, done, elapsed.as_secs_f64()),
    }
}

/// Samples a pixel in the next iteration of a render of `seconds` that took `elapsed` of them for `done` samples: 1 at least. No
/// more than were done before, since the first samples say little of what one takes, and no more than fit, if any do.
pub fn samples_within(seconds: f64, done: u64, elapsed: f64) -> u32 {
    if done == 0 {
        return 1;
    }
    let each = elapsed / done as f64;
    let in_all = seconds / each;
    let least = (in_all / f64::from(FEWEST_BATCHES)).clamp(1.0, WORTH_THE_LIGHT.into());
    let wanted = (in_all / f64::from(BATCHES)).clamp(least, MOST_SAMPLES.into());
    let fitting = if elapsed < seconds { ((seconds - elapsed) / each).round() } else { wanted };
    wanted.min(done as f64).min(fitting).max(1.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_budget_is_used_exactly_and_in_batches() {
        let cases = [(1, 1), (7, 7), (16, 8), (20, 10), (32, 8), (64, 16), (100, 17), (128, 16), (1000, 125)];
        for (spp, iterations) in cases {
            let (mut done, mut count) = (0, 0);
            loop {
                let next = next_samples(&Budget::Spp(spp), done, Duration::ZERO);
                if next == 0 {
                    break;
                }
                done += u64::from(next);
                count += 1;
            }
            assert_eq!((done, count), (u64::from(spp), iterations), "{spp} samples");
        }
    }

    #[test]
    fn a_time_budget_renders_once_at_least_and_then_fits() {
        let budget = Budget::Seconds(16.0);
        let next = |done, seconds| next_samples(&budget, done, Duration::from_secs_f64(seconds));
        assert_eq!(next(0, 99.0), 1);
        // Half a second each: four at a time are worth their light, but not before four are known. A second each: two, so
        // that there are eight iterations.
        assert_eq!([next(1, 0.5), next(2, 1.0), next(3, 1.5), next(4, 2.0), next(8, 4.0)], [1, 2, 3, 4, 4]);
        assert_eq!([next(1, 1.0), next(4, 4.0)], [1, 2]);
        // A sixteenth of the time, and eight at most.
        assert_eq!([next(20, 3.0), next(1000, 1.0)], [6, 8]);
        // What is left of the time.
        assert_eq!([next(14, 14.0), next(15, 15.0), next(16, 15.9)], [2, 1, 1]);
        assert_eq!([next(1, 16.0), next(5, 17.0)], [0, 0]);
        assert_eq!(samples_within(16.0, 100, 20.0), 5, "whoever goes on past the end goes on as before");
    }
}
