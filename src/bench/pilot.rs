//! Short renders that find the settings with the smallest error per second. These settings then render the reference.

use super::case::{Case, Entry};
use super::quality::{ReferenceTarget, relative};
use crate::compare::metrics::Means;
use crate::error::Result;
use crate::gpu::Device;
use crate::render::PreparedScene;
use crate::settings::{Estimator, Settings};

/// First of the pilots' seeds, which differ from the seeds of races and references.
const FIRST_SEED: u32 = 0x4000_0100;
/// Time of a pilot: a fraction of a variant's time in the suite, and its lower and upper bound in seconds.
const PILOT_TIME: (f64, f64, f64) = (0.25, 0.2, 15.0);
/// [`frugal`] settings never reduce the number of light paths below this one.
const MIN_LIGHT_PATHS: u32 = 256;

/// Side in pixels of the blocks in [`fastest`].
const BLOCK: usize = 8;

/// A short render, which measures how fast settings converge.
pub struct Pilot {
    pub variant: String,
    pub settings: Settings,
    /// Whether the suite measures these settings. If not, they may only render the reference.
    pub measured: bool,
    variance: Vec<f32>,
    mean: Vec<f32>,
    pub seconds: f64,
}

impl Pilot {
    /// relMSE times seconds, over all pixels and trimmed. The product stays constant while a render goes on. The relMSE is estimated
    /// from the stated variance, relative to the image `common_mean`.
    pub fn cost(&self, common_mean: &[f32]) -> Means {
        relative(&self.variance, common_mean).scaled(self.seconds)
    }
}

/// A pilot that misses at least this fraction of the lit blocks cannot estimate its own error.
const MAX_MISSED: f64 = 0.05;

/// The pilot with the smallest product of two costs: over all pixels (rare bright samples count) and trimmed (they do not, because a
/// short render meets them by luck). A pilot that misses light that others found comes last: its variance, and so its cost, is too
/// small.
///
/// All pilots are compared with the same image: the mean of all pilots over blocks of pixels. With single pixels, the noise
/// of the other pilots would dominate the error of the best one.
pub fn fastest<'a>(pilots: impl Iterator<Item = &'a Pilot>) -> &'a Pilot {
    let pilots: Vec<&Pilot> = pilots.collect();
    let n = pilots.len() as f32;
    let width = pilots[0].settings.crop().width() as usize;
    let mean: Vec<f32> = (0..pilots[0].mean.len()).map(|i| pilots.iter().map(|p| p.mean[i]).sum::<f32>() / n).collect();
    let common_mean = over_blocks(&mean, width);
    let cost = |pilot: &Pilot| {
        let cost = pilot.cost(&common_mean);
        cost.all * cost.trimmed
    };
    let misses_light = |pilot: &Pilot| missed(&common_mean, &over_blocks(&pilot.mean, width)) >= MAX_MISSED;
    let order = |a: &Pilot, b: &Pilot| misses_light(a).cmp(&misses_light(b)).then(cost(a).total_cmp(&cost(b)));
    pilots.iter().copied().min_by(|a, b| order(a, b)).expect("there is a pilot")
}

/// Fraction of the values above 0 of `common_mean` that are 0 in `found`.
fn missed(common_mean: &[f32], found: &[f32]) -> f64 {
    let lit = common_mean.iter().filter(|&&x| x > 0.0).count();
    let black = common_mean.iter().zip(found).filter(|&(&mean, &found)| mean > 0.0 && found == 0.0).count();
    black as f64 / lit.max(1) as f64
}

/// Replaces each block of [`BLOCK`] x [`BLOCK`] pixels (smaller at the edges) by its mean. The image is interleaved RGB.
fn over_blocks(image: &[f32], width: usize) -> Vec<f32> {
    let height = image.len() / (3 * width);
    let mut out = vec![0.0; image.len()];
    for (y0, x0) in (0..height).step_by(BLOCK).flat_map(|y| (0..width).step_by(BLOCK).map(move |x| (y, x))) {
        let (y1, x1) = ((y0 + BLOCK).min(height), (x0 + BLOCK).min(width));
        let pixels = || (y0..y1).flat_map(|y| (x0..x1).map(move |x| 3 * (y * width + x)));
        for channel in 0..3 {
            let mean = pixels().map(|at| image[at + channel]).sum::<f32>() / ((y1 - y0) * (x1 - x0)) as f32;
            pixels().for_each(|at| out[at + channel] = mean);
        }
    }
    out
}

/// Renders every variant for a short time. Also renders settings that may be faster: estimators such as `bdpt` and `lcs` with
/// their defaults, and the same with at most one light path per pixel, which suits small images. `None` if `watch` stops the
/// work.
pub fn pilots(
    device: &Device,
    case: &Case,
    prepared: &PreparedScene,
    entries: &[&Entry],
    target: ReferenceTarget,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Vec<Pilot>>> {
    let (part, min, max) = PILOT_TIME;
    let seconds = (part * target.seconds).clamp(min, max);
    let mut candidates: Vec<(String, Settings)> =
        entries.iter().map(|e| (e.variant.clone(), e.settings.clone())).collect();
    let renders = |e: &Estimator| e.record().renders_references || target.estimator == Some(*e);
    for estimator in Estimator::ALL.into_iter().filter(renders) {
        let plain = with_defaults_of(entries[0], estimator);
        let frugal = frugal(plain.clone());
        let also = [
            (estimator.to_string(), plain),
            (format!("{estimator} with {} light paths", frugal.light_paths()), frugal),
        ];
        for (name, settings) in also {
            if candidates.iter().all(|(_, known)| *known != settings) {
                candidates.push((name, settings));
            }
        }
    }
    let mut pilots = vec![];
    for (i, (variant, settings)) in candidates.into_iter().enumerate() {
        let measured = i < entries.len();
        let mut timed = case.timed(device, &settings, prepared)?;
        timed.restart(FIRST_SEED + i as u32);
        while timed.clock < seconds || timed.renderer.film().iterations() < 4 {
            timed.run_until(timed.clock + seconds / 8.0)?;
            if !watch(0.0, &format!("{}: trying {variant}", case.name)) {
                return Ok(None);
            }
        }
        let film = timed.renderer.film();
        let (variance, mean) = (film.variance_of_mean(), film.mean());
        pilots.push(Pilot { variant, settings, measured, variance, mean, seconds: timed.clock });
    }
    Ok(Some(pilots))
}

/// The settings of an entry with another estimator and the defaults of that estimator. Camera, gate, emitters and the set of
/// paths stay the same. If the entry gives a number of light paths, this number stays too.
pub fn with_defaults_of(entry: &Entry, estimator: Estimator) -> Settings {
    let plain =
        entry.settings.change().estimator(estimator).splat_paths(None).queries(None).buckets(None).leaf_size(None);
    let plain = plain.frontier(None).single_tree(None).importance(None).sampling(None).no_cull(None);
    plain.build().expect("defaults are inside their limits")
}

/// Settings with at most one light path per pixel, or at most [`MIN_LIGHT_PATHS`] in an image of fewer pixels.
pub fn frugal(settings: Settings) -> Settings {
    let pixels = settings.crop().width() * settings.crop().height();
    let paths = settings.light_paths().min(pixels.max(MIN_LIGHT_PATHS));
    settings.change().light_paths(paths).build().expect("fewer light paths are inside the limits")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Budget;

    fn pilot(mean: Vec<f32>, variance: f32) -> Pilot {
        let settings = Settings::builder().resolution([24, 8]).budget(Budget::Spp(1)).build().unwrap();
        Pilot {
            variant: String::new(),
            settings,
            measured: true,
            variance: vec![variance; mean.len()],
            mean,
            seconds: 1.0,
        }
    }

    #[test]
    fn a_pilot_that_saw_nothing_is_not_the_fastest() {
        // Three blocks; the first pilot has found light in one of them only.
        let bright = |x: usize| if x < 8 { 1.0 } else { 0.0 };
        let blind = || pilot((0..192).flat_map(|i| [bright(i % 24); 3]).collect(), 1e-3);
        let noisy = || pilot(vec![1.0; 576], 0.1);
        assert_eq!(fastest([blind(), noisy()].iter()).variance[0], 0.1);
        assert_eq!(fastest([blind(), blind()].iter()).variance[0], 1e-3);
        assert_eq!(fastest([noisy(), pilot(vec![1.0; 576], 0.05)].iter()).variance[0], 0.05);
    }

    #[test]
    fn blocks_have_their_means_and_edges_are_blocks_too() {
        // 10 x 9 pixels: blocks of 8 x 8, 2 x 8, 8 x 1 and 2 x 1.
        let image: Vec<f32> = (0..90).flat_map(|i| [i as f32, 1.0, if i == 89 { 4.0 } else { 0.0 }]).collect();
        let blocks = over_blocks(&image, 10);
        assert_eq!(&blocks[..3], &[38.5, 1.0, 0.0]);
        assert_eq!(&blocks[3 * 8..3 * 8 + 3], &[43.5, 1.0, 0.0]);
        assert_eq!(&blocks[3 * 80..3 * 80 + 3], &[83.5, 1.0, 0.0]);
        assert_eq!(&blocks[3 * 89..], &[88.5, 1.0, 2.0]);
    }
}
