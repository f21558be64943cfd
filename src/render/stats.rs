//! What a render did and where its time went.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::gpu::Recorder;

/// Host stages of an iteration, as [`Stats::stages`] names them. They do not overlap.
pub(super) mod stage {
    pub const COMPILE: &str = "compile kernels";
    pub const ALLOCATE: &str = "allocate buffers";
    pub const RECORD: &str = "record commands";
    pub const READ_LIGHT: &str = "read light vertices";
    pub const BUILD_TREES: &str = "build trees";
    pub const UPLOAD: &str = "upload";
    pub const READ_COUNTERS: &str = "read counters";
    pub const ALLOT: &str = "allot samples";
    pub const READ_FILM: &str = "read film";
    pub const ADD_TO_FILM: &str = "add to film";
}

/// A part of a render's wall time.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Stage {
    pub name: String,
    pub seconds: f64,
    /// Of the wall time.
    pub share: f64,
}

impl Stage {
    /// `parts` of `wall` seconds that do not overlap, the longest first, and what they leave as `unexplained`.
    pub fn list(parts: impl IntoIterator<Item = (String, f64)>, wall: f64) -> Vec<Stage> {
        let stage = |(name, seconds)| Stage { name, seconds, share: seconds / wall.max(1e-9) };
        let mut all: Vec<Stage> = parts.into_iter().map(stage).collect();
        all.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
        let explained: f64 = all.iter().map(|stage| stage.seconds).sum();
        all.push(stage(("unexplained".into(), wall - explained)));
        all
    }
}

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
    /// Rays that looked for the closest hit, those of light subpaths among them, and rays between two points.
    pub closest_rays: u64,
    pub light_rays: u64,
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
    /// Seconds on the device, by kernel: timestamps. Empty where the device has none.
    pub device_seconds: BTreeMap<String, f64>,
    /// Seconds on the host during iterations, by stage, submits apart.
    pub host_seconds: BTreeMap<String, f64>,
    /// Wall time of all submits, the wait for the device included.
    pub submit_seconds: f64,
    /// Seconds before the first iteration, by stage.
    pub prepare_seconds: BTreeMap<String, f64>,
    /// How often the host waited for the device during iterations.
    pub waits: u64,
    /// Longest single submit.
    pub longest_submit: f64,
    pub scene_bytes: u64,
    /// All device buffers at once, at most.
    pub device_bytes: u64,
    pub triangles: u64,
}

impl Stats {
    /// Submits what was recorded and waits for it; returns the wall time.
    pub(super) fn submit(&mut self, recorder: &mut Recorder) -> Result<f64> {
        let start = Instant::now();
        let timing = recorder.submit()?;
        let seconds = start.elapsed().as_secs_f64();
        for (label, seconds) in timing {
            add(&mut self.device_seconds, label, seconds);
        }
        self.submit_seconds += seconds;
        self.longest_submit = self.longest_submit.max(seconds);
        Ok(seconds)
    }

    /// Runs `work` and adds its wall time to a stage of [`stage`].
    pub(super) fn timed<T>(&mut self, stage: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        add(&mut self.host_seconds, stage, start.elapsed().as_secs_f64());
        result
    }

    /// As [`Stats::timed`] for work before the first iteration.
    pub(super) fn prepared<T>(&mut self, stage: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add_prepared(stage, start.elapsed().as_secs_f64());
        result
    }

    pub(super) fn add_prepared(&mut self, stage: &str, seconds: f64) {
        add(&mut self.prepare_seconds, stage, seconds);
    }

    /// Where `wall` seconds of iterations went, the longest first: kernels by their timestamps, what submits took beyond
    /// those, host work. None of them overlap. The last is what none of them explains, `unexplained`: it is negative if the
    /// clocks of host and device disagree.
    pub fn stages(&self, wall: f64) -> Vec<Stage> {
        let kernels: f64 = self.device_seconds.values().sum();
        let host = self.host_seconds.iter().map(|(name, &seconds)| (name.clone(), seconds));
        let device = self.device_seconds.iter().map(|(name, &seconds)| (format!("kernel {name}"), seconds));
        let waits = ("submits and waits".to_string(), self.submit_seconds - kernels);
        Stage::list(host.chain(device).chain([waits]), wall)
    }

    /// Part of the connections tried that survived gate, facing and depth, 0 to 1; none if none was tried.
    pub fn live_share(&self) -> Option<f64> {
        (self.candidates > 0).then(|| self.live_candidates as f64 / self.candidates as f64)
    }

    /// Fails where the counts contradict each other, as only a device that computes wrongly lets them.
    pub(super) fn check(&self) -> Result<()> {
        let (tried, live, rays) = (self.candidates, self.live_candidates, self.shadow_rays);
        if rays <= live && live <= tried {
            return Ok(());
        }
        Err(Error::Device(format!(
            "it computes wrongly: {tried} connections were tried, {live} of them are inside the gate, and {rays} of those were \
             traced; run taugate devices --check, update the driver, or choose another --device"
        )))
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

fn add(to: &mut BTreeMap<String, f64>, name: &str, seconds: f64) {
    match to.get_mut(name) {
        Some(sum) => *sum += seconds,
        None => drop(to.insert(name.into(), seconds)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_counts_blame_the_device() {
        let counts = |candidates, live_candidates, shadow_rays| {
            Stats { candidates, live_candidates, shadow_rays, ..Stats::default() }.check()
        };
        assert!(counts(0, 0, 0).is_ok() && counts(3, 2, 1).is_ok() && counts(3, 3, 3).is_ok());
        for wrong in [counts(1000, 1011, 900), counts(1000, 900, 901)] {
            let error = wrong.unwrap_err();
            assert!(
                matches!(error, Error::Device(_)) && error.to_string().contains("taugate devices --check"),
                "{error}"
            );
        }
    }
}
