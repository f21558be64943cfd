//! A film keeps its precision over a hundred thousand iterations.

use taugate::internals::image::film::Film;

/// Level and spread of each channel: levels from far below to far above 1, and spreads down to the last bits of the level.
const CHANNELS: [(f32, f32); 6] = [(1.0, 0.5), (1.0, 1e-3), (1.0, 1e-6), (1e-12, 1e-13), (3e9, 1e9), (1e18, 1e12)];

/// Value in iteration `i`: level, level - spread or level + spread, with a period of 5 whose mean is not the level.
fn value((level, spread): (f32, f32), i: u32) -> f32 {
    level + spread * [1.0, -1.0, 0.0, 1.0, 1.0][i as usize % 5]
}

/// Exact mean and variance of the mean, from two passes in f64 over one period. `iterations` must be a multiple of the period.
fn exact(channel: (f32, f32), iterations: u32) -> (f64, f64) {
    let values: Vec<f64> = (0..5).map(|i| f64::from(value(channel, i))).collect();
    let mean = values.iter().sum::<f64>() / 5.0;
    let spread = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() * f64::from(iterations / 5);
    (mean, spread / (f64::from(iterations - 1) * f64::from(iterations)))
}

#[test]
fn a_hundred_thousand_iterations_lose_nothing() {
    const ITERATIONS: u32 = 100_000;
    let mut film = Film::new(2, 1);
    for i in 0..ITERATIONS {
        film.add(&CHANNELS.map(|channel| value(channel, i)), 16);
    }
    assert_eq!((film.iterations(), film.samples()), (ITERATIONS, 16 * u64::from(ITERATIONS)));
    let (means, variances) = (film.mean(), film.variance_of_mean());
    for (k, channel) in CHANNELS.into_iter().enumerate() {
        let (mean, variance) = exact(channel, ITERATIONS);
        let off = [f64::from(means[k]) / mean - 1.0, f64::from(variances[k]) / variance - 1.0];
        println!("{channel:?}: mean off by {:.1e}, variance by {:.1e}", off[0], off[1]);
        assert!(off.iter().all(|x| x.abs() < 1e-7), "{channel:?}: mean and variance off by {off:?}");
    }
}

/// Iterations with different sample counts: every sample has the same weight in the mean.
#[test]
fn uneven_iterations_count_by_their_samples() {
    let mut film = Film::new(1, 1);
    let mut sum = 0.0;
    for i in 0..100_000u32 {
        let samples = 1 + i % 16;
        let x = value((1.0, 0.25), i) + f32::from(u8::from(i % 2 == 0));
        film.add(&[x; 3], samples);
        sum += f64::from(x) * f64::from(samples);
    }
    assert!((f64::from(film.mean()[0]) * film.samples() as f64 / sum - 1.0).abs() < 1e-7);
}
