//! Throughput of whole kernels in a render of the cluttered room, in millions of work items per second, by device timestamps.

use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::Device;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::render::{Renderer, Stats};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::values::Resolution;

use super::Sizes;

/// A kernel, the name of its work items, and their number in [`Stats`].
type Items = (&'static str, &'static str, fn(&Stats) -> u64);

const ITEMS: [Items; 5] = [
    ("light_trace", "rays", |s| s.light_rays),
    ("sensor_trace", "rays", |s| s.closest_rays - s.light_rays),
    ("shell_query", "candidates", |s| s.candidates),
    ("connect", "candidates", |s| s.live_candidates),
    ("gather", "shade points", |s| s.shade_points),
];

pub fn report(device: &Device, sizes: Sizes) {
    let scene = build(Kind::ClutteredRoom { triangles: sizes.triangles.min(20_000) });
    for estimator in Estimator::ALL {
        let mut experiment = Experiment::default();
        experiment.camera.resolution = Some(Resolution([sizes.side as u32 / 2; 2]));
        experiment.gate.gate = Some(Gate { lo: 8.6, hi: 8.85 });
        experiment.render.estimator = Some(estimator);
        let settings = resolve(&experiment, &scene).expect("settings").settings;
        let mut renderer = Renderer::new(device, &scene, &settings).expect("renderer");
        for _ in 0..4 {
            renderer.iterate(1).expect("iteration");
        }
        let stats = renderer.stats();
        let rate = |(kernel, what, count): &Items| {
            let seconds = stats.device_seconds.get(*kernel).copied().unwrap_or(0.0);
            (seconds > 0.0).then(|| format!("{kernel} {:.2} M {what}/s", count(stats) as f64 / seconds / 1e6))
        };
        let rates: Vec<String> = ITEMS.iter().filter_map(rate).collect();
        println!("{:<10}{}", estimator.name(), rates.join(", "));
    }
}
