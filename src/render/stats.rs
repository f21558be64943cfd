//! What a render did and where its time went.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::gpu::Timing;

/// Counts and seconds, added up over all iterations.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Stats {
    pub iterations: u64,
    /// Sensor subpaths.
    pub samples: u64,
    pub light_paths: u64,
    /// Light vertices that were kept: emitter points, scattered, deterministic.
    pub emitter_vertices: u64,
    pub scattered_vertices: u64,
    pub deterministic_vertices: u64,
    /// Rays that looked for the closest hit, and rays between two points.
    pub closest_rays: u64,
    pub shadow_rays: u64,
    /// Shade points, connections tried there, and those that survived gate, facing and depth. A query of a tree that ends
    /// at a dead node was tried.
    pub shade_points: u64,
    pub candidates: u64,
    pub live_candidates: u64,
    /// Contributions that arrived inside the gate.
    pub inside_gate: u64,
    /// Contributions that were not finite and were dropped.
    pub dropped: u64,
    /// Seconds on the device, by kernel.
    pub device_seconds: BTreeMap<String, f64>,
    /// Seconds on the host, by phase; `render` is the wall time of all iterations.
    pub host_seconds: BTreeMap<String, f64>,
    /// Longest single submit.
    pub longest_submit: f64,
    pub scene_bytes: u64,
    /// All device buffers at once, at most.
    pub device_bytes: u64,
    pub triangles: u64,
}

impl Stats {
    pub(super) fn add_timing(&mut self, timing: &Timing) {
        for (label, seconds) in timing {
            *self.device_seconds.entry(label.to_string()).or_default() += seconds;
        }
    }

    /// Runs `work` and adds its wall time to `phase`.
    pub(super) fn timed<T>(&mut self, phase: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add_host(phase, start.elapsed().as_secs_f64());
        result
    }

    pub(super) fn add_host(&mut self, phase: &str, seconds: f64) {
        *self.host_seconds.entry(phase.to_string()).or_default() += seconds;
    }

    pub(super) fn add_submit(&mut self, seconds: f64) {
        self.longest_submit = self.longest_submit.max(seconds);
    }

    /// Part of the connections tried that survived gate, facing and depth, 0 to 1; none if none was tried.
    pub fn live_share(&self) -> Option<f64> {
        (self.candidates > 0).then(|| self.live_candidates as f64 / self.candidates as f64)
    }

    /// Contributions inside the gate a sensor subpath, light vertices in view included.
    pub fn inside_gate_per_sample(&self) -> f64 {
        self.inside_gate as f64 / self.samples.max(1) as f64
    }

    /// Rays of both kinds.
    pub fn rays(&self) -> u64 {
        self.closest_rays + self.shadow_rays
    }
}
