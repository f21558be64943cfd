//! Short renders that tell which settings have the least error per second: they render the reference.

use super::job::{Entry, Job};
use super::reference::{Goal, relative};
use crate::error::Result;
use crate::gpu::Device;
use crate::metrics::Means;
use crate::render::Prepared;
use crate::resolve::default_splat_paths;
use crate::scene::Scene;
use crate::settings::{DEFAULT_BUCKETS, Estimator, Importance, Settings};

/// Seeds, far from those of races and references.
const SEEDS: u32 = 0x4000_0100;
/// A pilot takes this part of a variant's time in the suite, within bounds in seconds.
const PILOT: (f64, f64, f64) = (0.25, 0.2, 15.0);
/// Of settings that are chosen for a reference alone.
const LEAST_LIGHT_PATHS: u32 = 256;

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
/// has met one is luck. Each is measured against the mean of the others: its own noise would hide its error.
pub fn fastest(pilots: &[Pilot]) -> &Pilot {
    let cost = |at: usize| {
        let others: Vec<&Pilot> = pilots.iter().enumerate().filter(|(i, _)| *i != at).map(|(_, p)| p).collect();
        let mean = |i: usize| others.iter().map(|p| p.mean[i]).sum::<f32>() / others.len() as f32;
        let cost = pilots[at].cost(&(0..pilots[at].mean.len()).map(mean).collect::<Vec<f32>>());
        cost.all * cost.trimmed
    };
    match pilots.len() {
        1 => &pilots[0],
        n => &pilots[(0..n).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).expect("there is a pilot")],
    }
}

/// Renders every variant for a short while each, and what may be faster: `bdpt` and `lcs` by default, and with one light path a
/// pixel, since small images cannot pay for more.
pub fn pilots(
    device: &Device,
    job: &Job,
    prepared: &Prepared,
    entries: &[&Entry],
    goal: Goal,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Vec<Pilot>>> {
    let (part, least, most) = PILOT;
    let seconds = (part * goal.seconds).clamp(least, most);
    let mut candidates: Vec<(String, Settings)> =
        entries.iter().map(|e| (e.variant.clone(), e.settings.clone())).collect();
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let plain = with(&job.scene, entries[0], estimator);
        let frugal = frugal(plain.clone());
        let also =
            [(estimator.to_string(), plain), (format!("{estimator} with {} light paths", frugal.light_paths), frugal)];
        for (name, settings) in also {
            if candidates.iter().all(|(_, known)| *known != settings) {
                candidates.push((name, settings));
            }
        }
    }
    let mut pilots = vec![];
    for (i, (variant, settings)) in candidates.into_iter().enumerate() {
        let measured = i < entries.len();
        let mut lane = job.lane(device, &settings, prepared)?;
        lane.restart(SEEDS + i as u32);
        while lane.clock < seconds || lane.renderer.film().iterations() < 4 {
            lane.run_until(lane.clock + seconds / 8.0, seconds)?;
            if !watch(0.0, &format!("{}: trying {variant}", job.name)) {
                return Ok(None);
            }
        }
        let film = lane.renderer.film();
        let (variance, mean) = (film.variance_of_mean(), film.mean());
        pilots.push(Pilot { variant, settings, measured, variance, mean, seconds: lane.clock });
    }
    Ok(Some(pilots))
}

/// An entry's settings with another estimator as it is by default: what is looked at and which paths count stay the entry's, and
/// so does the number of light paths.
pub fn with(scene: &Scene, entry: &Entry, estimator: Estimator) -> Settings {
    Settings {
        estimator,
        queries: estimator.default_queries(),
        leaf_size: estimator.leaf_size(),
        splat_paths: default_splat_paths(estimator, entry.settings.resolution, scene),
        buckets: DEFAULT_BUCKETS,
        single_tree: false,
        importance: Importance::ALL,
        cull: true,
        ..entry.settings.clone()
    }
}

/// With one light path a pixel at most.
pub fn frugal(settings: Settings) -> Settings {
    let pixels = settings.crop.width() * settings.crop.height();
    Settings { light_paths: settings.light_paths.min(pixels.max(LEAST_LIGHT_PATHS)), ..settings }
}
