//! Tests whether two images differ only by noise. The z-test works on cells, which are pooled until their means are nearly
//! normal. If the noise has heavy tails, such as the fireflies of `pt` in fog, its variance is not known from few samples: the bright
//! samples that an image lacks are missing in its mean and in its variance alike. Such noise is skewed, and the test then does not
//! judge.

use serde::Serialize;

use crate::compare::statistics::{normal_score, sidak_threshold};
use crate::error::{Error, Result};
use crate::image::batches::{CELL, CellBatches};

/// Probability of a false alarm: that two images of the same scene are found to differ, whatever the number of cells (Sidak).
pub const SIGNIFICANCE: f64 = 1e-3;
/// Minimum number of independent batches per image for a variance estimate.
pub const MIN_BATCHES: usize = 8;
/// A cell is tested alone if the standard error of its mean is at most this fraction of the mean. A hundred equal hits reach it.
const MAX_RELATIVE_ERROR: f64 = 0.1;
/// Cells grow until cells that are tested alone hold at least this fraction of the light.
const MIN_JUDGED_SHARE: f64 = 0.75;
/// Relative rounding error of f32 means. It is the only error of a cell without noise.
const ROUNDING: f64 = 1e-6;
/// Skewness of the noise from which the test finds no difference, and how far chance can exceed it, in standard deviations of the
/// skewness of normal noise. In simulations with 9 cells and 32 batches, noise with heavy tails is hardly ever found to differ from its
/// own mean. Without these limits, it is found to differ in 76 % (lognormal, sigma = 2) and 96 % (Pareto, alpha = 1.2) of the cases. With
/// 8 batches, the test finds only a part of such noise. Normal noise hardly ever exceeds the limit.
const MAX_SKEWNESS: f64 = 0.25;
const SKEWNESS_BY_CHANCE: f64 = 2.0;
/// Cells that are counted as independent for the skewness: cells share light paths.
const MAX_INDEPENDENT_CELLS: usize = 9;
/// Fraction of the greatest possible skewness from which two images are not found to agree, either: few batches have most of the
/// noise.
const DOMINATED: f64 = 0.5;
/// Maximum number of cells in the report.
const MAX_REPORTED_CELLS: usize = 5;

/// One tested mean.
#[derive(Debug, Clone, Serialize)]
pub struct Cell {
    /// Columns [x0, x1) of the cell; all columns of the image for the rest.
    pub x: [usize; 2],
    /// Rows [y0, y1) of the cell; all rows of the image for the rest.
    pub y: [usize; 2],
    pub channel: &'static str,
    pub mean: f64,
    pub reference: f64,
    /// z of image minus reference: Student's t, converted to the normal value with the same tail probability.
    pub z: f64,
    /// Skewness of the noise of this mean, the larger one of the two images.
    pub skewness: f64,
    /// Whether this is the rest: the union of all cells that are too noisy to be tested alone.
    pub rest: bool,
}

/// What the test found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Agree,
    Differ,
    /// The noise has heavy tails, so its size is not known.
    TooFewSamples,
}

/// Result of the test.
#[derive(Debug, Clone, Serialize)]
pub struct Agreement {
    /// Side of a cell in pixels.
    pub cell: usize,
    /// Number of tested means: cells times channels, and the rest per channel.
    pub tests: usize,
    /// |z| above which a tested mean is significant.
    pub threshold: f64,
    pub max_z: f64,
    pub verdict: Verdict,
    /// Skewness of the noise, averaged over the tested means: the larger one of the two images; or that of a mean that differs, if it is
    /// larger. Heavy tails give a large value.
    pub skewness: f64,
    /// Fraction of the light in cells that are tested alone, 0 to 1.
    pub judged: f64,
    pub worst: Vec<Cell>,
    /// z per pixel and channel, R, G, B interleaved.
    #[serde(skip)]
    pub map: Vec<f32>,
}

impl Agreement {
    /// Whether no tested mean differs by more than its noise, as far as the variance of the noise is known.
    pub fn is_within_noise(&self) -> bool {
        self.max_z <= self.threshold
    }
}

/// Mean and variance of the mean in both images.
struct Pair {
    a: (f64, f64),
    b: (f64, f64),
}

impl Pair {
    fn of(a: &CellBatches, b: &CellBatches, cells: &[usize], channel: usize) -> Pair {
        Pair { a: a.pooled(cells, channel), b: b.pooled(cells, channel) }
    }

    fn mean(&self) -> f64 {
        0.5 * (self.a.0 + self.b.0)
    }

    fn is_normal(&self) -> bool {
        self.a.1.max(self.b.1).sqrt() <= MAX_RELATIVE_ERROR * self.mean()
    }

    /// z of Welch's test.
    fn z(&self, freedoms: [f64; 2]) -> f64 {
        let floor = (ROUNDING * self.mean()).powi(2);
        let variances = [self.a.1 + floor, self.b.1 + floor];
        let both = variances[0] + variances[1];
        let freedom = both * both / (0..2).map(|i| variances[i].powi(2) / freedoms[i]).sum::<f64>();
        normal_score((self.a.0 - self.b.0) / both.sqrt(), freedom)
    }
}

/// Compares two images of the same size that were rendered with different seeds. Fails if one has fewer than [`MIN_BATCHES`]
/// batches.
pub fn agreement(size: [u32; 2], a: &CellBatches, b: &CellBatches) -> Result<Agreement> {
    if let Some(few) = [a.len(), b.len()].into_iter().find(|&n| n < MIN_BATCHES) {
        return Err(Error::advice(
            format!("the noise of an image with {few} iterations is unknown; "),
            format!("render both with at least {MIN_BATCHES} (--spp 16)"),
        ));
    }
    let [width, height] = size.map(|side| side as usize);
    let grid = a.grid();
    let mut factor = 1;
    let groups = loop {
        let groups = grouped(grid, factor);
        if groups.len() == 1 || judged_part(a, b, &groups) >= MIN_JUDGED_SHARE {
            break groups;
        }
        factor *= 2;
    };

    let side = factor * CELL;
    let (columns, freedoms) = (width.div_ceil(side), [a, b].map(CellBatches::freedom));
    let mut tested: Vec<Cell> = vec![];
    let mut map = vec![0.0f32; 3 * width * height];
    let (mut light, mut judged) = (0.0, 0.0);
    // The sums of the skewness over the tested means, of both images.
    let mut skewness = [0.0; 2];
    let mut skewness_of = |cells: &[usize], channel: usize| {
        let own = [a, b].map(|image| image.skewness(cells, channel));
        skewness.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        f64::max(own[0], own[1])
    };
    for channel in 0..3 {
        let name = ["R", "G", "B"][channel];
        let (mut rest, mut rest_groups) = (vec![], vec![]);
        for (i, cells) in groups.iter().enumerate() {
            let pair = Pair::of(a, b, cells, channel);
            let pixels: usize = cells.iter().map(|&c| a.pixels(c)).sum();
            light += pair.mean() * pixels as f64;
            if pair.a.0 == 0.0 && pair.b.0 == 0.0 {
                continue;
            }
            if !pair.is_normal() && groups.len() > 1 {
                rest.extend(cells);
                rest_groups.push(i);
                continue;
            }
            judged += pair.mean() * pixels as f64;
            let (z, skewness) = (pair.z(freedoms), skewness_of(cells, channel));
            let (x, y) = (i % columns * side, i / columns * side);
            let (x, y) = ([x, width.min(x + side)], [y, height.min(y + side)]);
            tested.push(Cell { x, y, channel: name, mean: pair.a.0, reference: pair.b.0, z, skewness, rest: false });
            fill(&mut map, width, x, y, channel, z);
        }
        if !rest.is_empty() {
            let pair = Pair::of(a, b, &rest, channel);
            let (z, skewness) = (pair.z(freedoms), skewness_of(&rest, channel));
            for i in rest_groups {
                let (x, y) = (i % columns * side, i / columns * side);
                fill(&mut map, width, [x, width.min(x + side)], [y, height.min(y + side)], channel, z);
            }
            let (mean, reference) = (pair.a.0, pair.b.0);
            tested.push(Cell {
                x: [0, width],
                y: [0, height],
                channel: name,
                mean,
                reference,
                z,
                skewness,
                rest: true,
            });
        }
    }
    let threshold = sidak_threshold(SIGNIFICANCE, tested.len());
    let tests = tested.len();
    tested.sort_by(|a, b| b.z.abs().total_cmp(&a.z.abs()));
    let max_z = tested.first().map_or(0.0, |cell| cell.z.abs());
    // The noise of most means may be normal, and that of a few, such as the rest, may have heavy tails.
    let limit_of_one = f64::max(skewness_limit(a, 1, true), skewness_limit(b, 1, true));
    let significant = || tested.iter().take_while(|cell| cell.z.abs() > threshold);
    let differ_by_tails = significant().all(|cell| cell.skewness > limit_of_one);
    let skewness_of_worst = significant().map(|cell| cell.skewness).fold(f64::NEG_INFINITY, f64::max);
    tested.truncate(MAX_REPORTED_CELLS);
    let judged = if light > 0.0 { judged / light } else { 1.0 };
    let images = [a, b].into_iter().zip(skewness.map(|sum| sum / tests.max(1) as f64));
    let differ = max_z > threshold;
    let is_skewed = images.clone().any(|(image, skewness)| skewness > skewness_limit(image, tests, differ));
    let verdict = match differ {
        _ if is_skewed => Verdict::TooFewSamples,
        true if differ_by_tails => Verdict::TooFewSamples,
        true => Verdict::Differ,
        false => Verdict::Agree,
    };
    let skewness = images.map(|(_, skewness)| skewness).fold(skewness_of_worst, f64::max);
    Ok(Agreement { cell: side, tests, threshold, max_z, verdict, skewness, judged, worst: tested, map })
}

/// The average skewness over `tests` means of an image beyond which the test does not find that it differs, or agrees.
fn skewness_limit(image: &CellBatches, tests: usize, differ: bool) -> f64 {
    // Three channels share a cell.
    let cells = (tests / 3).clamp(1, MAX_INDEPENDENT_CELLS) as f64;
    let limit = MAX_SKEWNESS + SKEWNESS_BY_CHANCE * (6.0 / image.len() as f64 / cells).sqrt();
    if differ { limit } else { limit.max(DOMINATED * image.max_skewness()) }
}

/// Groups the cells of the grid into squares of `factor` x `factor` cells, row by row.
fn grouped([columns, rows]: [usize; 2], factor: usize) -> Vec<Vec<usize>> {
    let across = columns.div_ceil(factor);
    let mut groups = vec![vec![]; across * rows.div_ceil(factor)];
    for cell in 0..columns * rows {
        groups[cell / columns / factor * across + cell % columns / factor].push(cell);
    }
    groups
}

fn judged_part(a: &CellBatches, b: &CellBatches, groups: &[Vec<usize>]) -> f64 {
    let (mut light, mut judged) = (0.0, 0.0);
    for cells in groups {
        for channel in 0..3 {
            let pair = Pair::of(a, b, cells, channel);
            let here = pair.mean() * cells.iter().map(|&c| a.pixels(c)).sum::<usize>() as f64;
            light += here;
            judged += if pair.is_normal() { here } else { 0.0 };
        }
    }
    if light > 0.0 { judged / light } else { 1.0 }
}

fn fill(map: &mut [f32], width: usize, x: [usize; 2], y: [usize; 2], channel: usize, z: f64) {
    for row in y[0]..y[1] {
        for column in x[0]..x[1] {
            map[3 * (row * width + column) + channel] = z as f32;
        }
    }
}

/// Colours of the map, 8-bit R, G, B: white if equal, red if the image is brighter than the reference, blue if it is darker. Up
/// to the threshold the colours are pale, beyond it they are saturated. The channel with the largest |z| determines the colour.
pub fn colours(map: &[f32], threshold: f64) -> Vec<u8> {
    let colour = |z: &[f32]| {
        let z = z.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
        let part = (f64::from(z.abs()) / threshold).min(1.0);
        // Up to the threshold colours have at most half strength, so that significant differences stand out.
        let fade = if f64::from(z.abs()) > threshold { 1.0 } else { 0.5 * part };
        let pale = |full: f64| (255.0 + fade * (full - 255.0)).round() as u8;
        if z >= 0.0 { [pale(178.0), pale(24.0), pale(43.0)] } else { [pale(33.0), pale(102.0), pale(172.0)] }
    };
    map.chunks_exact(3).flat_map(colour).collect()
}

#[cfg(test)]
mod tests {
    use rand_pcg::Pcg64Mcg;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    use super::*;
    use crate::image::film::Film;

    const SIZE: [u32; 2] = [80, 48];

    /// A film merged from two halves of 20 iterations of noise around 1. The upper three fifths of the pixels are around
    /// `bright`.
    fn halves(seed: u64, bright: f32) -> CellBatches {
        let mut state = seed;
        let mut half = || {
            let mut film = Film::new(SIZE[0], SIZE[1]);
            for i in 0..20 {
                let pixels = (SIZE[0] * SIZE[1]) as usize;
                let mut image = vec![0.0f32; 3 * pixels];
                for (at, v) in image.iter_mut().enumerate() {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let uniform = (state >> 40) as f32 / (1u64 << 24) as f32;
                    *v = 2.0 * uniform * if 5 * at < 9 * pixels { bright } else { 1.0 };
                }
                film.add(&image, 1 + i % 3);
            }
            film
        };
        let mut both = half();
        both.merge(&half());
        both.cells().clone()
    }

    #[test]
    fn equals_agree_and_others_do_not() {
        let same = agreement(SIZE, &halves(1, 1.0), &halves(2, 1.0)).unwrap();
        assert!(same.verdict == Verdict::Agree && same.tests == 45 && same.max_z > 0.5, "{same:?}");
        let other = agreement(SIZE, &halves(1, 1.0), &halves(2, 1.05)).unwrap();
        assert_eq!(other.verdict, Verdict::Differ, "{other:?}");
    }

    #[test]
    fn light_that_one_misses_is_found() {
        let dark = agreement(SIZE, &halves(1, 0.0), &halves(2, 1.0)).unwrap();
        assert_eq!(dark.verdict, Verdict::Differ, "{dark:?}");
        let black = || {
            CellBatches::from_floats(
                1,
                1,
                &[16.0, 8.0].into_iter().chain([1.0, 0.0, 0.0, 0.0].into_iter().cycle().take(32)).collect::<Vec<f32>>(),
            )
            .unwrap()
        };
        let nothing = agreement([1, 1], &black(), &black()).unwrap();
        assert!(nothing.verdict == Verdict::Agree && nothing.max_z == 0.0, "{nothing:?}");
    }

    /// Batches of an image of 4 x 1 cells. `noise` draws the mean of a cell in a batch from two uniform numbers.
    fn drawn(seed: u64, noise: impl Fn([f64; 2]) -> f64) -> CellBatches {
        drawn_in(4, seed, noise)
    }

    /// As [`drawn`], of `cells` x 1 cells.
    fn drawn_in(cells: usize, seed: u64, noise: impl Fn([f64; 2]) -> f64) -> CellBatches {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut uniform = || (random.next_u32() as f64 + 0.5) / 2f64.powi(32);
        let mut floats = vec![CELL as f32, 32.0];
        for _ in 0..32 {
            // The samples of the batch, then the colours of its cells.
            floats.extend([1.0]);
            floats.extend((0..cells).flat_map(|_| [noise([uniform(), uniform()]) as f32; 3]));
        }
        CellBatches::from_floats((cells * CELL) as u32, CELL as u32, &floats).unwrap()
    }

    fn normal([u, v]: [f64; 2]) -> f64 {
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    /// Images whose noise is lognormal with sigma = 2 are compared with their true mean, 1. They look too dark, because samples that
    /// are bright and rare are missing.
    #[test]
    fn heavy_tails_are_not_judged() {
        let truth = drawn(0, |u| 1.0 + 1e-3 * normal(u));
        let size = [4 * CELL as u32, CELL as u32];
        let (mut by_z, mut wrong, mut unjudged) = (0, 0, 0);
        for seed in 1..=50 {
            let found = agreement(size, &drawn(seed, |u| (2.0 * normal(u) - 2.0).exp()), &truth).unwrap();
            by_z += usize::from(found.max_z > found.threshold);
            wrong += usize::from(found.verdict == Verdict::Differ);
            unjudged += usize::from(found.verdict == Verdict::TooFewSamples);
        }
        // At its level, the z-test should find none. The cells are so noisy that they are joined.
        assert!(by_z >= 4, "the z-test alone finds only {by_z} of 50 differences");
        assert!(wrong <= 1 && unjudged >= 30, "{wrong} wrong differences, {unjudged} of 50 without a verdict");
        // Beside many cells with normal noise.
        let (mut by_z, mut wrong) = (0, 0);
        for seed in 1..=150 {
            let of = |seed: u64, tail: f64| {
                let cell = std::cell::Cell::new(0);
                drawn_in(40, seed, |u| {
                    let is_heavy = cell.replace((cell.get() + 1) % 40) == 0;
                    if is_heavy { tail * (2.0 * normal(u) - 2.0).exp() + (1.0 - tail) } else { 1.0 + 0.02 * normal(u) }
                })
            };
            let found = agreement([40 * CELL as u32, CELL as u32], &of(seed, 1.0), &of(1000 + seed, 0.0)).unwrap();
            by_z += usize::from(found.max_z > found.threshold);
            wrong += usize::from(found.verdict == Verdict::Differ);
        }
        assert!(by_z >= 6 && wrong <= 3, "{by_z} differences by z, {wrong} of them reported");
        // Normal noise of the same variance is judged, and a difference is found.
        for seed in 1..=50 {
            let of = |mean: f64| drawn(seed, |u| mean + 0.2 * normal(u));
            assert_eq!(agreement(size, &of(1.0), &truth).unwrap().verdict, Verdict::Agree, "{seed}");
            assert_eq!(agreement(size, &of(1.3), &truth).unwrap().verdict, Verdict::Differ, "{seed}");
        }
    }
}
