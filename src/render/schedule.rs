//! Number of samples per pixel in each iteration. Short iterations give more batches to estimate the variance from; long
//! iterations share the cost of the light paths among more samples.
//!
//! Except in scans, the length of an iteration depends on its index alone; only the last iteration may be shorter. So a longer
//! render begins with the same bits as a shorter one. A render with a budget of seconds begins with the same bits as one with a
//! budget of samples. `docs/notebook/schedule.md` compares lengths.

use std::time::Duration;

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

/// Samples per pixel of all iterations of `shard` in a render with `spp` samples per pixel.
pub fn samples_of_shard(shard: Shard, spp: u32) -> u64 {
    (shard.index()..)
        .step_by(shard.count() as usize)
        .map(|iteration| u64::from(spp).saturating_sub(samples_before(iteration)).min(samples_in(iteration).into()))
        .take_while(|&samples| samples > 0)
        .sum()
}

/// As [`next_samples`], for a render of which this machine renders `shard`. `iteration` is the number of the shard's next
/// iteration in the whole render. `iterations` and `done` are the iterations and the samples per pixel of the shard so far. A budget
/// of samples holds for all shards together, a budget of seconds for each shard.
pub fn next_samples_of(
    shard: Shard,
    budget: &Budget,
    iteration: u32,
    iterations: u32,
    done: u64,
    elapsed: Duration,
) -> u32 {
    let done = if shard.is_all() || matches!(budget, Budget::Seconds(_)) { done } else { samples_before(iteration) };
    samples_after(budget, samples_in(iteration), iterations, done, elapsed)
}

/// Samples per pixel in the next iteration, after `iterations` iterations with `done` samples per pixel in total; 0 when the
/// budget is used up. A budget of samples may shorten the last iteration. A budget of seconds ends after the iteration whose
/// end is nearest to the budget. The first iteration always runs; the second one runs unless the time is over.
pub fn next_samples(budget: &Budget, iterations: u32, done: u64, elapsed: Duration) -> u32 {
    samples_after(budget, samples_in(iterations), iterations, done, elapsed)
}

/// As [`next_samples`], for a next iteration of `samples` samples.
fn samples_after(budget: &Budget, samples: u32, iterations: u32, done: u64, elapsed: Duration) -> u32 {
    match *budget {
        Budget::Spp(spp) => u64::from(spp).saturating_sub(done).min(samples.into()) as u32,
        Budget::Seconds(_) if done == 0 => samples,
        Budget::Seconds(seconds) => {
            let elapsed = elapsed.as_secs_f64();
            let half = 0.5 * elapsed / done as f64 * f64::from(samples);
            let fits = iterations < MIN_ITERATIONS || elapsed + half <= seconds;
            if elapsed < seconds && fits { samples } else { 0 }
        }
    }
}

/// Target for the samples of all points together in an iteration of a scan. These samples share the cost of the light subpaths.
const SCAN_SAMPLES: u32 = 4096;

/// As [`next_samples`], for a scan with `points` sensor points. All iterations except the last have the same length. A budget of
/// samples limits this length to a quarter of the budget, rounded up. With a budget of seconds, the first two iterations always run.
pub fn scan_samples(budget: &Budget, points: u32, done: u64, elapsed: Duration) -> u32 {
    let samples = (SCAN_SAMPLES / points).clamp(2, MAX_AIMED_SAMPLES);
    match *budget {
        Budget::Spp(spp) => u64::from(spp).saturating_sub(done).min(samples.min(spp.div_ceil(4)).into()) as u32,
        Budget::Seconds(seconds) => {
            let half = 0.5 * elapsed.as_secs_f64() / done.max(1) as f64 * f64::from(samples);
            let fits = done <= samples.into() || elapsed.as_secs_f64() + half <= seconds;
            if done == 0 || fits { samples } else { 0 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples per pixel of each iteration, for a budget of `spp` samples.
    fn lengths(spp: u32) -> Vec<u32> {
        let (mut done, mut lengths) = (0, vec![]);
        loop {
            match next_samples(&Budget::Spp(spp), lengths.len() as u32, done, Duration::MAX) {
                0 => return lengths,
                samples => {
                    done += u64::from(samples);
                    lengths.push(samples);
                }
            }
        }
    }

    #[test]
    fn a_budget_of_samples_is_used_exactly_and_in_batches() {
        let cases = [(1, 1), (2, 1), (7, 4), (16, 8), (20, 9), (32, 12), (64, 20), (100, 25), (128, 28), (1000, 137)];
        for (spp, iterations) in cases {
            let lengths = lengths(spp);
            assert_eq!((lengths.iter().sum::<u32>(), lengths.len()), (spp, iterations), "{spp} samples");
            assert_eq!(iterations_of(spp) as usize, iterations, "{spp} samples");
        }
    }

    #[test]
    fn longer_renders_begin_with_shorter_ones() {
        let long = lengths(1000);
        for spp in 1..1000 {
            let short = lengths(spp);
            let (last, whole) = short.split_last().unwrap();
            assert_eq!(whole, &long[..whole.len()], "{spp} samples");
            assert!(*last <= long[whole.len()], "{spp} samples: only the last iteration may be shortened");
        }
        let endless = |iteration| next_samples(&Budget::Seconds(1e9), iteration, 9, Duration::from_secs(1));
        assert!(long.iter().enumerate().all(|(i, &samples)| endless(i as u32) == samples));
    }

    #[test]
    fn shards_share_the_iterations_of_the_whole_render() {
        for i in 0..200 {
            assert_eq!(samples_before(i), (0..i).map(|i| u64::from(samples_in(i))).sum::<u64>(), "{i}");
        }
        for (spp, count) in [(1, 1), (7, 2), (64, 3), (100, 7), (1000, 4), (5, 9)] {
            let whole = lengths(spp);
            let mut all = vec![0; whole.len()];
            for index in 0..count {
                let shard = Shard::new(index, count).unwrap();
                let mut done = 0;
                for (iterations, number) in (index..).step_by(count as usize).enumerate() {
                    match next_samples_of(shard, &Budget::Spp(spp), number, iterations as u32, done, Duration::MAX) {
                        0 => break,
                        samples => {
                            all[number as usize] = samples;
                            done += u64::from(samples);
                        }
                    }
                }
                assert_eq!(done, samples_of_shard(shard, spp), "{spp} samples, shard {shard}");
            }
            assert_eq!(all, whole, "{spp} samples");
        }
    }

    /// Expected variance that the film estimates (`Film::variance_of_mean`), divided by the true variance of the mean. The film joins
    /// `shards` shards. The pixel has the average number of samples in the first iteration of each, and `share` times the average in
    /// all others.
    fn stated_over_true(lengths: &[u32], shards: usize, share: f64) -> f64 {
        let weights = || lengths.iter().map(|&samples| f64::from(samples));
        // Variance of iteration i if each sample has variance 1.
        let variance = |i: usize, weight: f64| if i < shards { 1.0 / weight } else { 1.0 / (share * weight) };
        let [all, n] = [weights().sum::<f64>(), lengths.len() as f64];
        let of_mean = weights().enumerate().map(|(i, w)| w * w * variance(i, w)).sum::<f64>() / (all * all);
        let spread = weights().enumerate().map(|(i, w)| w * variance(i, w)).sum::<f64>() - all * of_mean;
        spread / ((n - 1.0) * all) / of_mean
    }

    #[test]
    fn the_stated_variance_is_right_where_samples_follow_the_error() {
        let long = lengths(1000);
        for share in [0.25, 4.0] {
            assert!((stated_over_true(&long[..8], 1, share) - 1.0).abs() < 1e-12);
            for iterations in 9..long.len() {
                let ratio = stated_over_true(&long[..iterations], 1, share);
                assert!((0.96..1.07).contains(&ratio), "{iterations} iterations, {share} times the samples: {ratio}");
            }
        }
        // Counterexample: if the iterations grow while the errors are learned, the estimate is wrong.
        assert!(stated_over_true(&[1, 1, 2, 4, 8], 1, 4.0) > 1.4);
    }

    #[test]
    fn the_stated_variance_of_8_to_16_shards_is_off_by_a_third_at_most() {
        let long = lengths(1000);
        let ratios = |share: f64| {
            let films = (8..=16).flat_map(|shards| [64, 128, 256, 512].map(|spp| (shards, spp)));
            films
                .map(|(shards, spp)| {
                    let iterations = (0..).take_while(|&i| samples_before(i) < spp).count();
                    stated_over_true(&long[..iterations], shards, share)
                })
                .collect::<Vec<f64>>()
        };
        let (many, few) = (ratios(4.0), ratios(0.25));
        let (greatest, least) = (many.into_iter().fold(0.0, f64::max), few.into_iter().fold(f64::MAX, f64::min));
        println!("{greatest:.3} and {least:.3}");
        assert!((1.3..1.37).contains(&greatest) && (0.78..0.82).contains(&least), "{greatest} {least}");
    }

    #[test]
    fn a_shard_with_a_budget_of_seconds_has_two_iterations() {
        // The first iteration of the last shard takes 9 of 10 s, so the end of the second one is far from the budget.
        let shard = Shard::new(4, 5).unwrap();
        let next = |iteration, iterations, seconds| {
            next_samples_of(shard, &Budget::Seconds(10.0), iteration, iterations, 2, Duration::from_secs(seconds))
        };
        assert_eq!([next(9, 1, 9), next(9, 1, 10), next(14, 2, 9)], [4, 0, 0]);
    }

    #[test]
    fn a_budget_of_seconds_ends_with_the_nearest_iteration() {
        let next = |iterations, done, seconds| {
            next_samples(&Budget::Seconds(16.0), iterations, done, Duration::from_secs_f64(seconds))
        };
        assert_eq!(next(0, 0, 99.0), 2, "the first iteration always runs");
        assert_eq!([next(1, 2, 15.9), next(1, 2, 16.0)], [2, 0], "the second iteration runs unless the time is over");
        // Each sample takes 1 s: the iterations take 2 s, then 4 s.
        assert_eq!([next(6, 12, 12.0), next(7, 14, 14.0), next(8, 16, 16.0)], [2, 2, 0]);
        // The next iteration would take 4 samples. After 12.8 s its end is nearer to the budget of 16 s; after 14.4 s and 15.2 s
        // it is not.
        assert_eq!([next(8, 16, 12.8), next(8, 16, 14.4), next(8, 16, 15.2)], [4, 0, 0]);
        assert_eq!([next(20, 64, 15.0), next(20, 64, 15.1)], [8, 0]);
    }
}
