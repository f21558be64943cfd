use super::*;

const NOTHING: Rendered = Rendered { end: 0, iterations: 0, samples: 0, is_dark: false };

fn add(rendered: Rendered, planned: Planned) -> Rendered {
    let Rendered { iterations, samples, is_dark, .. } = rendered;
    let samples = samples + u64::from(planned.samples);
    Rendered { end: planned.number + 1, iterations: iterations + 1, samples, is_dark }
}

/// All iterations of a schedule that has no clock. Each of them must be announced by the one before.
fn planned(schedule: &Schedule) -> Vec<Planned> {
    let (mut rendered, mut all, mut announced) = (NOTHING, vec![], None);
    while let Some(next) = schedule.next(rendered, f64::MAX) {
        assert!(announced.is_none_or(|announced| announced == Following::Iteration(next)), "{schedule:?}");
        announced = Some(schedule.following(rendered, next));
        (rendered, _) = (add(rendered, next), all.push(next));
    }
    assert!(announced.is_none_or(|announced| announced == Following::Nothing), "{schedule:?}");
    all
}

/// Samples per pixel of each iteration, for a budget of `spp` samples.
fn lengths(spp: u32) -> Vec<u32> {
    let planned = planned(&Schedule::whole(Budget::Spp(spp)));
    assert!(planned.iter().enumerate().all(|(i, planned)| planned.number == i as u32));
    let lengths: Vec<u32> = planned.iter().map(|planned| planned.samples).collect();
    assert_eq!(super::lengths(Shard::ALL, spp.into()).collect::<Vec<_>>(), lengths);
    lengths
}

/// Samples of the next iteration of `shard` in a render of `seconds`, after `elapsed` seconds.
fn timed(seconds: f64, shard: Shard, [end, iterations]: [u32; 2], samples: u64, elapsed: f64) -> u32 {
    let schedule =
        Schedule::Budget { budget: Budget::Seconds(seconds), shard, before: 0.25 * elapsed, lengths: Lengths::Growing };
    let rendered = Rendered { end, iterations, samples, is_dark: false };
    let next = schedule.next(rendered, 0.75 * elapsed);
    let may_follow = |next| matches!(schedule.following(rendered, next), Following::Perhaps(_) | Following::Nothing);
    assert!(next.is_none_or(may_follow));
    next.map_or(0, |next| next.samples)
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
    let endless = |iteration| timed(1e9, Shard::ALL, [iteration; 2], 9, 1.0);
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
            let own =
                planned(&Schedule::Budget { budget: Budget::Spp(spp), shard, before: 0.0, lengths: Lengths::Growing });
            own.iter().for_each(|planned| all[planned.number as usize] = planned.samples);
            let samples = own.iter().map(|planned| planned.samples);
            assert!(samples.eq(super::lengths(shard, spp.into())), "{spp} samples, shard {shard}");
        }
        assert_eq!(all, whole, "{spp} samples");
    }
}

#[test]
fn moments_of_an_exposure_have_equal_weights() {
    let lengths = Lengths::OfMoments;
    let schedule = |spp, shard| Schedule::Budget { budget: Budget::Spp(spp), shard, before: 0.0, lengths };
    let whole = planned(&schedule(41, Shard::ALL));
    assert!(whole.iter().map(|planned| planned.samples).eq([vec![2; 20], vec![1]].concat()));
    assert_eq!(whole.len() as u32, lengths.iterations_of(41));
    let mut all = vec![];
    for index in 0..3 {
        let shard = Shard::new(index, 3).unwrap();
        let own = planned(&schedule(41, shard));
        assert!(own.iter().all(|planned| planned.after_gap == Some(2 * planned.number)));
        assert_eq!(lengths.budget_of(shard, Budget::Spp(41)), Budget::Spp(own.iter().map(|own| own.samples).sum()));
        all.extend(own.iter().map(|planned| (planned.number, planned.samples)));
    }
    all.sort_unstable();
    assert!(all.into_iter().eq(whole.iter().map(|planned| (planned.number, planned.samples))));
    // Another moment may have light.
    let dark = Rendered { end: 5, iterations: 5, samples: 10, is_dark: true };
    let schedule = Schedule::Budget { budget: Budget::Seconds(9.0), shard: Shard::ALL, before: 0.0, lengths };
    assert_eq!(schedule.next(dark, 1.0).map(|planned| planned.samples), Some(2));
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
fn parts_are_cut_from_the_whole_render() {
    let part = |numbers: Range<u32>, spp| {
        planned(&Schedule::Part { numbers, spp }).iter().map(|p| (p.number, p.samples)).collect::<Vec<_>>()
    };
    assert_eq!(part(6..9, None), [(6, 2), (7, 2), (8, 4)]);
    assert_eq!(part(6..9, Some(17)), [(6, 2), (7, 2), (8, 1)]);
    assert_eq!(part(7..20, Some(16)), [(7, 2)]);
    assert_eq!(part(8..20, Some(16)), []);
}

#[test]
fn a_turn_has_an_iteration_and_ends_near_its_end() {
    let next = |end, iterations, samples, elapsed| {
        let schedule = Schedule::Turn { first: 3, before: 6.0, end };
        let rendered = Rendered { end: iterations, iterations, samples, is_dark: false };
        schedule.next(rendered, elapsed).is_some()
    };
    assert!(next(0.0, 3, 6, 0.0), "the first iteration always runs");
    // Each sample takes 1 s.
    assert_eq!([next(9.5, 4, 8, 2.0), next(8.5, 4, 8, 2.0)], [true, false]);
}

#[test]
fn a_dark_render_of_seconds_ends_after_two_iterations() {
    let is_over = |budget, iterations| {
        let rendered = Rendered { end: iterations, iterations, samples: 2 * u64::from(iterations), is_dark: true };
        Schedule::whole(budget).next(rendered, 0.0).is_none()
    };
    assert_eq!([1, 2].map(|iterations| is_over(Budget::Seconds(1e9), iterations)), [false, true]);
    assert!(!is_over(Budget::Spp(100), 2));
}

#[test]
fn a_shard_with_a_budget_of_seconds_has_two_iterations() {
    // The first iteration of the last shard takes 9 of 10 s, so the end of the second one is far from the budget.
    let next = |end, iterations, elapsed| timed(10.0, Shard::new(4, 5).unwrap(), [end, iterations], 2, elapsed);
    assert_eq!([next(5, 1, 9.0), next(5, 1, 10.0), next(10, 2, 9.0)], [4, 0, 0]);
}

#[test]
fn a_budget_of_seconds_ends_with_the_nearest_iteration() {
    let next = |iterations, done, elapsed| timed(16.0, Shard::ALL, [iterations; 2], done, elapsed);
    assert_eq!(next(0, 0, 99.0), 2, "the first iteration always runs");
    assert_eq!([next(1, 2, 15.9), next(1, 2, 16.0)], [2, 0], "the second iteration runs unless the time is over");
    // Each sample takes 1 s: the iterations take 2 s, then 4 s.
    assert_eq!([next(6, 12, 12.0), next(7, 14, 14.0), next(8, 16, 16.0)], [2, 2, 0]);
    // The next iteration would take 4 samples. After 12.8 s its end is nearer to the budget of 16 s; after 14.4 s and 15.2 s
    // it is not.
    assert_eq!([next(8, 16, 12.8), next(8, 16, 14.4), next(8, 16, 15.2)], [4, 0, 0]);
    assert_eq!([next(20, 64, 15.0), next(20, 64, 15.1)], [8, 0]);
}
