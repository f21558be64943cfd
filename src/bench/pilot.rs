//! Short renders that tell which settings have the least error per second: they render the reference.

use super::job::{Entry, Job};
use super::quality::{ReferenceTarget, relative};
use crate::compare::metrics::Means;
use crate::error::Result;
use crate::gpu::Device;
use crate::render::PreparedScene;
use crate::settings::{Estimator, Settings};

/// Seeds, far from those of races and references.
const FIRST_SEED: u32 = 0x4000_0100;
/// A pilot takes this part of a variant's time in the suite, within bounds in seconds.
const PILOT_TIME: (f64, f64, f64) = (0.25, 0.2, 15.0);
/// Of settings that are chosen for a reference alone.
const MIN_LIGHT_PATHS: u32 = 256;

/// Pixels across a block of the image that pilots are measured against.
const BLOCK: usize = 8;

/// A short render that tells how fast settings converge.
pub struct Pilot {
    pub variant: String,
    pub settings: Settings,
    /// Whether the suite measures these settings; others only serve to render the reference.
    pub measured: bool,
    variance: Vec<f32>,
    mean: Vec<f32>,
    pub seconds: f64,
}

impl Pilot {
    /// relMSE times seconds: what stays the same as a render goes on.
    pub fn cost(&self, truth: &[f32]) -> Means {
        relative(&self.variance, truth).scaled(self.seconds)
    }
}

/// The pilot with the least cost, by all pixels and by most of them alike: rare bright samples count, but whether a short render
/// has met one is luck. All are measured against one and the same image, the mean of all of them over blocks of pixels: in a
/// single pixel the best pilot would be measured against the noise of the others, the worst against the best.
pub fn fastest(pilots: &[Pilot]) -> &Pilot {
    let n = pilots.len() as f32;
    let mean: Vec<f32> = (0..pilots[0].mean.len()).map(|i| pilots.iter().map(|p| p.mean[i]).sum::<f32>() / n).collect();
    let truth = over_blocks(&mean, pilots[0].settings.crop().width() as usize);
    let cost = |pilot: &Pilot| {
        let cost = pilot.cost(&truth);
        cost.all * cost.trimmed
    };
    pilots.iter().min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("there is a pilot")
}

/// An RGB image of `width` pixels across, each block of [`BLOCK`] x [`BLOCK`] pixels (less at the edges) its mean.
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

/// Renders every variant for a short while each, and what may be faster: `bdpt` and `lcs` by default, and with one light path a
/// pixel, since small images cannot pay for more.
pub fn pilots(
    device: &Device,
    job: &Job,
    prepared: &PreparedScene,
    entries: &[&Entry],
    target: ReferenceTarget,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Vec<Pilot>>> {
    let (part, min, max) = PILOT_TIME;
    let seconds = (part * target.seconds).clamp(min, max);
    let mut candidates: Vec<(String, Settings)> =
        entries.iter().map(|e| (e.variant.clone(), e.settings.clone())).collect();
    for estimator in Estimator::ALL.into_iter().filter(|e| e.record().renders_references) {
        let plain = with(entries[0], estimator);
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
        let mut timed = job.timed(device, &settings, prepared)?;
        timed.restart(FIRST_SEED + i as u32);
        while timed.clock < seconds || timed.renderer.film().iterations() < 4 {
            timed.run_until(timed.clock + seconds / 8.0)?;
            if !watch(0.0, &format!("{}: trying {variant}", job.name)) {
                return Ok(None);
            }
        }
        let film = timed.renderer.film();
        let (variance, mean) = (film.variance_of_mean(), film.mean());
        pilots.push(Pilot { variant, settings, measured, variance, mean, seconds: timed.clock });
    }
    Ok(Some(pilots))
}

/// An entry's settings with another estimator as it is by default: what is looked at and which paths count stay the entry's, and
/// so does a number of light paths that is not the default.
pub fn with(entry: &Entry, estimator: Estimator) -> Settings {
    let plain =
        entry.settings.change().estimator(estimator).splat_paths(None).queries(None).buckets(None).leaf_size(None);
    let plain = plain.frontier(None).single_tree(None).importance(None).sampling(None).no_cull(None);
    plain.build().expect("defaults are inside their limits")
}

/// With one light path a pixel at most.
pub fn frugal(settings: Settings) -> Settings {
    let pixels = settings.crop().width() * settings.crop().height();
    let paths = settings.light_paths().min(pixels.max(MIN_LIGHT_PATHS));
    settings.change().light_paths(paths).build().expect("fewer light paths are inside the limits")
}

#[cfg(test)]
mod tests {
    use super::*;

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
