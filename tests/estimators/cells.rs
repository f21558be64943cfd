//! Helpers for statistical tests: settings, images of independent seeds, means over cells of pixels, and z-tests of these means.

pub use crate::device::device;
use taugate::internals::compare::statistics::sidak_threshold;
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::scene::Scene;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Sampling, Settings, SettingsBuilder};

/// Significance level of a test over all its cells together (Sidak's correction). Averages over the channels are one family of
/// values, and the single channels are another.
pub const SIGNIFICANCE: f64 = 1e-3;
/// Whether tests run with all estimators, variants and seeds, because the environment variable `TAUGATE_LONG_TESTS` is set.
pub fn is_long() -> bool {
    std::env::var_os("TAUGATE_LONG_TESTS").is_some()
}

/// Number of independent seeds from which each variance is estimated.
pub fn seeds() -> u32 {
    if is_long() { 32 } else { 24 }
}

pub fn settings(estimator: Estimator, resolution: [u32; 2]) -> SettingsBuilder {
    let settings = Settings::builder().estimator(estimator).resolution(resolution).budget(Budget::Spp(1)).seed(1);
    settings.light_paths(2000).splat_paths(500).sampling(Sampling::Uniform)
}

pub fn renderer(scene: &Scene, settings: &Settings) -> Renderer {
    Renderer::new(&device(), scene, settings).unwrap_or_else(|e| panic!("{e}"))
}

pub fn tuned(scene: &Scene, settings: &Settings, tuning: Tuning) -> Renderer {
    Renderer::with_tuning(&device(), scene, settings, tuning).unwrap_or_else(|e| panic!("{e}"))
}

/// Means over square cells of pixels: one value per cell and seed.
pub struct Cells {
    /// Averages over the three channels: `[cell][seed]`
    pub batches: Vec<Vec<f64>>,
    /// `[3 * cell + channel][seed]`
    channels: Vec<Vec<f64>>,
}

impl Cells {
    /// Values of something without channels: `[cell][seed]`.
    pub fn grey(batches: Vec<Vec<f64>>) -> Cells {
        Cells { batches, channels: vec![] }
    }

    /// Renders [`seeds`] independent images with `iterations` x `samples` samples per pixel and averages each over cells of
    /// `cell` x `cell` pixels. Panics if contributions were dropped because they are not finite.
    pub fn measure(
        renderer: &mut Renderer,
        gate: Gate,
        cell: usize,
        iterations: u32,
        samples: u32,
        first_seed: u32,
    ) -> Cells {
        let mut channels: Vec<Vec<f64>> = vec![];
        for seed in 0..seeds() {
            renderer.restart(first_seed + seed, gate).unwrap();
            for _ in 0..iterations {
                renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
            }
            let film = renderer.film();
            let pooled = pool_channels(&film.mean(), film.width() as usize, cell);
            channels.resize(3 * pooled.len(), vec![]);
            for (batch, value) in channels.iter_mut().zip(pooled.into_iter().flatten()) {
                batch.push(value);
            }
        }
        assert_eq!(renderer.stats().dropped, 0, "contributions that are not finite");
        let average =
            |rgb: &[Vec<f64>]| (0..rgb[0].len()).map(|seed| (0..3).map(|c| rgb[c][seed]).sum::<f64>() / 3.0).collect();
        Cells { batches: channels.chunks(3).map(average).collect(), channels }
    }

    /// The cells of an image that is `factor` times as bright.
    pub fn times(&self, factor: f64) -> Cells {
        let times = |values: &Vec<Vec<f64>>| values.iter().map(|v| v.iter().map(|x| factor * x).collect()).collect();
        Cells { batches: times(&self.batches), channels: times(&self.channels) }
    }

    /// The cells of the sum of two images, seed by seed.
    pub fn plus(&self, other: &Cells) -> Cells {
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        let sums = |a: &[Vec<f64>], b: &[Vec<f64>]| a.iter().zip(b).map(|(a, b)| sum(a, b)).collect();
        Cells { batches: sums(&self.batches, &other.batches), channels: sums(&self.channels, &other.channels) }
    }

    pub fn mean(&self, cell: usize) -> f64 {
        mean(&self.batches[cell])
    }

    /// Variance of [`Cells::mean`].
    pub fn variance(&self, cell: usize) -> f64 {
        estimate(&self.batches[cell]).1
    }

    /// Mean of each cell, averaged over the channels, and the variance of this mean.
    pub fn averages(&self) -> Vec<(f64, f64)> {
        self.batches.iter().map(|batch| estimate(batch)).collect()
    }

    /// Mean of each channel of each cell, and the variance of this mean: `[3 * cell + channel]`. Empty after [`Cells::grey`].
    pub fn channels(&self) -> Vec<(f64, f64)> {
        self.channels.iter().map(|batch| estimate(batch)).collect()
    }

    /// Mean of all cells and its standard error. The error comes from the spread of the seeds, because cells share a light
    /// pool and are correlated.
    pub fn whole(&self) -> (f64, f64) {
        let n = self.batches[0].len();
        let of_seed = |s: usize| self.batches.iter().map(|b| b[s]).sum::<f64>() / self.batches.len() as f64;
        let all: Vec<f64> = (0..n).map(of_seed).collect();
        let m = mean(&all);
        (m, (all.iter().map(|x| (x - m).powi(2)).sum::<f64>() / ((n - 1) * n) as f64).sqrt())
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean of some values, and the variance of this mean.
fn estimate(values: &[f64]) -> (f64, f64) {
    let (n, m) = (values.len(), mean(values));
    (m, values.iter().map(|x| (x - m).powi(2)).sum::<f64>() / ((n - 1) * n) as f64)
}

/// Means over cells of `cell` x `cell` pixels and all channels, row by row. Cells at the right and lower edge may be smaller.
pub fn pool(rgb: &[f32], width: usize, cell: usize) -> Vec<f64> {
    pool_channels(rgb, width, cell).into_iter().map(|rgb| rgb.iter().sum::<f64>() / 3.0).collect()
}

/// As [`pool`], for each channel.
fn pool_channels(rgb: &[f32], width: usize, cell: usize) -> Vec<[f64; 3]> {
    let height = rgb.len() / 3 / width;
    let columns = width.div_ceil(cell);
    let mut sums = vec![([0.0; 3], 0usize); columns * height.div_ceil(cell)];
    for (i, p) in rgb.chunks_exact(3).enumerate() {
        let (sum, n) = &mut sums[i / width / cell * columns + i % width / cell];
        sum.iter_mut().zip(p).for_each(|(sum, &x)| *sum += f64::from(x));
        *n += 1;
    }
    sums.into_iter().map(|(sum, n)| sum.map(|sum| sum / n as f64)).collect()
}

/// The |z| above which one of `cells` values is significant, with Sidak's correction. The normal quantile is widened to that of
/// Student's t with [`seeds`] - 1 degrees of freedom (the first three terms of the Cornish-Fisher expansion).
pub fn threshold(cells: usize) -> f64 {
    let z = sidak_threshold(SIGNIFICANCE, cells);
    let nu = f64::from(seeds() - 1);
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
    z + first / nu + second / nu.powi(2) + third / nu.powi(3)
}

/// A difference over its standard error. 0 if there is no difference, so that two black cells agree.
pub fn z_score(difference: f64, variance: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / variance.sqrt() }
}

/// Whether |z| exceeds the limit. A z that is not a number does.
pub fn exceeds(z: f64, limit: f64) -> bool {
    z.is_nan() || z.abs() > limit
}

/// Describes the cells, and the channels of cells, in which two independent measurements differ significantly. Empty if they agree.
pub fn disagreements(a: &Cells, b: &Cells) -> Vec<String> {
    assert_eq!(a.batches.len(), b.batches.len());
    let mut wrong = vec![];
    for (what, a, b) in [("cell", a.averages(), b.averages()), ("channel", a.channels(), b.channels())] {
        let limit = threshold(a.len());
        for (i, (a, b)) in a.into_iter().zip(b).enumerate() {
            let z = z_score(a.0 - b.0, a.1 + b.1);
            if exceeds(z, limit) {
                wrong.push(format!("{what} {i}: {:.6} against {:.6}, z = {z:.2}", a.0, b.0));
            }
        }
    }
    wrong
}
