//! How many samples an iteration takes: few enough that there are batches for the variance, enough to pay for its light paths.

use std::time::Duration;

use crate::settings::Budget;

/// Samples a pixel and iteration at most.
pub const MOST_SAMPLES: u32 = 8;
/// Iterations that a budget is divided into at least.
pub const BATCHES: u32 = 16;

/// Samples a pixel in the next iteration; 0 when the budget is used. A budget of samples is cut the same way on every
/// machine; one of time begins with a single sample and learns from what it took.
pub fn next_samples(budget: &Budget, done: u64, elapsed: Duration) -> u32 {
    match *budget {
        Budget::Spp(spp) => {
            let left = u64::from(spp).saturating_sub(done).min(u64::from(u32::MAX)) as u32;
            left.min((spp / BATCHES).clamp(1, MOST_SAMPLES))
        }
        Budget::Seconds(_) if done == 0 => 1,
        Budget::Seconds(seconds) if elapsed.as_secs_f64() >= seconds => 0,
        Budget::Seconds(seconds) => samples_within(seconds / f64::from(BATCHES), done, elapsed.as_secs_f64()),
    }
}

/// Samples a pixel that take about `part` seconds if each takes what the `done` > 0 samples of `elapsed` seconds took: 1 at least.
pub fn samples_within(part: f64, done: u64, elapsed: f64) -> u32 {
    let each = elapsed / done as f64;
    ((part / each) as u32).clamp(1, MOST_SAMPLES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_budget_is_used_exactly_and_in_batches() {
        for (spp, iterations) in [(1, 1), (7, 7), (16, 16), (64, 16), (100, 17), (128, 16), (1000, 125)] {
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
        assert_eq!(next_samples(&budget, 0, Duration::from_secs(99)), 1);
        assert_eq!(next_samples(&budget, 1, Duration::from_millis(250)), 4);
        assert_eq!(next_samples(&budget, 1, Duration::from_secs(3)), 1);
        assert_eq!(next_samples(&budget, 1000, Duration::from_secs(1)), 8);
        assert_eq!(next_samples(&budget, 5, Duration::from_secs(16)), 0);
    }
}
