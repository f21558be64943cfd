//! Counts of the work that a render did, and the time that each part of it took.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::gpu::Recorder;

/// Names of the host stages of an iteration in [`Stats::stages`].
pub(super) mod stage {
    pub const COMPILE: &str = "compile kernels";
    pub const ALLOCATE: &str = "allocate buffers";
    pub const RECORD: &str = "record commands";
    pub const READ_LIGHT: &str = "read light vertices";
    pub const AIM_PHOTONS: &str = "aim photons";
    pub const BUILD_TREES: &str = "build trees";
    pub const UPLOAD: &str = "upload";
    pub const READ_COUNTERS: &str = "read counters";
    pub const ALLOCATE_SAMPLES: &str = "allocate samples";
    pub const READ_FILM: &str = "read film";
    pub const ADD_TO_FILM: &str = "add to film";
    pub const WAIT_FOR_FILM: &str = "wait for film of the iteration before";
    pub const WAIT_FOR_LIGHT: &str = "wait for light of the next iteration";
    pub const SORT_ARRIVALS: &str = "sort arrivals into responses";
}

/// A part of a render's wall time.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Stage {
    pub name: String,
    pub seconds: f64,
    /// Fraction of the wall time.
    pub share: f64,
}

impl Stage {
    /// Stages from `parts` (name, seconds), the longest first. The last stage, `unexplained`, is the rest of the `wall` seconds and of
    /// the seconds of other threads, `beside`.
    pub fn list(parts: impl IntoIterator<Item = (String, f64)>, wall: f64, beside: f64) -> Vec<Stage> {
        let stage = |(name, seconds)| Stage { name, seconds, share: seconds / wall.max(1e-9) };
        let mut all: Vec<Stage> = parts.into_iter().map(stage).collect();
        all.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
        let explained: f64 = all.iter().map(|stage| stage.seconds).sum();
        all.push(stage(("unexplained".into(), wall + beside - explained)));
        all
    }
}

/// Counts and seconds, summed over all iterations.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Stats {
    pub iterations: u64,
    /// Sensor subpaths.
    pub samples: u64,
    pub light_paths: u64,
    /// Stored light vertices of three kinds: points on emissive surfaces, scattered vertices, deterministic vertices.
    pub emitter_vertices: u64,
    pub scattered_vertices: u64,
    pub deterministic_vertices: u64,
    /// Rays that find the closest hit, from sensor and light subpaths.
    pub closest_rays: u64,
    /// The part of `closest_rays` that light subpaths traced. Of the rays for events on beams, the expected number.
    pub light_rays: u64,
    /// Visibility rays between two points.
    pub shadow_rays: u64,
    pub shade_points: u64,
    /// Connections tried at shade points. A tree query that finds no vertex also counts as one connection tried.
    pub candidates: u64,
    /// Candidates that pass the tests of gate, facing and depth.
    pub live_candidates: u64,
    /// Contributions that arrived inside the gate.
    pub inside_gate: u64,
    /// Contributions and light vertices that were not finite and were dropped.
    pub dropped: u64,
    /// Seconds on the device per kernel, from timestamps. Empty if the device has no timestamps.
    pub device_seconds: BTreeMap<String, f64>,
    /// Seconds on the host during iterations, per stage, without the submits.
    pub host_seconds: BTreeMap<String, f64>,
    /// Wall time of all submits in seconds, including the wait for the device.
    pub submit_seconds: f64,
    /// Seconds of work on other iterations in other threads: the light of the next one, the film of the one before. Its stages are in the
    /// other fields too.
    pub beside_seconds: f64,
    /// Seconds before the first iteration, per stage.
    pub prepare_seconds: BTreeMap<String, f64>,
    /// Number of times that the host waited for the device during iterations.
    pub waits: u64,
    /// Wall time of the longest submit in seconds.
    pub longest_submit: f64,
    pub scene_bytes: u64,
    /// Maximum size of all device buffers at one time.
    pub device_bytes: u64,
    pub triangles: u64,
}

impl Stats {
    /// Submits the recorded commands and waits for the device. Returns the wall time in seconds.
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

    /// Adds the counts and times of phases 1 and 2 of an iteration, or of work on its film.
    pub(super) fn add_part(&mut self, part: &Stats) {
        self.light_paths += part.light_paths;
        self.emitter_vertices += part.emitter_vertices;
        self.scattered_vertices += part.scattered_vertices;
        self.deterministic_vertices += part.deterministic_vertices;
        self.closest_rays += part.closest_rays;
        self.light_rays += part.light_rays;
        self.inside_gate += part.inside_gate;
        self.dropped += part.dropped;
        self.submit_seconds += part.submit_seconds;
        self.beside_seconds += part.beside_seconds;
        self.longest_submit = self.longest_submit.max(part.longest_submit);
        part.device_seconds.iter().for_each(|(label, &seconds)| add(&mut self.device_seconds, label, seconds));
        part.host_seconds.iter().for_each(|(stage, &seconds)| add(&mut self.host_seconds, stage, seconds));
    }

    /// Counts rays of light subpaths.
    pub(super) fn add_light_rays(&mut self, count: u64) {
        self.closest_rays += count;
        self.light_rays += count;
    }

    /// Runs `work` and adds its wall time to `stage`, one of the names in [`stage`].
    pub(super) fn timed<T>(&mut self, stage: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add_host(stage, start.elapsed());
        result
    }

    /// Adds the wall time of work on the host to `stage`.
    pub(super) fn add_host(&mut self, stage: &str, time: Duration) {
        add(&mut self.host_seconds, stage, time.as_secs_f64());
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

    /// Divides the `wall` seconds of the iterations, and the seconds of other threads, into stages, the longest first. These are the
    /// kernels by their timestamps, the rest of the submits, and the host stages. The last stage, `unexplained`, is the remaining time. It is
    /// negative if the clocks of host and device disagree. Shares are those of the `wall` seconds. So with other threads their sum
    /// exceeds 1.
    pub fn stages(&self, wall: f64) -> Vec<Stage> {
        let kernels: f64 = self.device_seconds.values().sum();
        let host = self.host_seconds.iter().map(|(name, &seconds)| (name.clone(), seconds));
        let device = self.device_seconds.iter().map(|(name, &seconds)| (format!("kernel {name}"), seconds));
        let waits = ("submits and waits".to_string(), self.submit_seconds - kernels);
        Stage::list(host.chain(device).chain([waits]), wall, self.beside_seconds)
    }

    /// Fraction of the `wall` seconds of the iterations in which the device ran kernels. `None` if it has no timestamps.
    pub fn device_share(&self, wall: f64) -> Option<f64> {
        (!self.device_seconds.is_empty()).then(|| self.device_seconds.values().sum::<f64>() / wall.max(1e-9))
    }

    /// Seconds of work of all host threads per second of the `wall` seconds of the iterations: the time in which they wait neither for the
    /// device nor for each other. Above 1, several threads worked at a time.
    pub fn host_share(&self, wall: f64) -> f64 {
        let of_stage = |name: &str| self.host_seconds.get(name).copied().unwrap_or_default();
        let waits = self.submit_seconds + of_stage(stage::WAIT_FOR_LIGHT) + of_stage(stage::WAIT_FOR_FILM);
        (wall + self.beside_seconds - waits).max(0.0) / wall.max(1e-9)
    }

    /// Fraction of the tried connections that pass the tests of gate, facing and depth, in 0..=1. `None` if no connection was
    /// tried.
    pub fn live_share(&self) -> Option<f64> {
        (self.candidates > 0).then(|| self.live_candidates as f64 / self.candidates as f64)
    }

    /// Fails if the counts contradict each other. Only a device that computes wrongly can cause this.
    pub(super) fn check(&self) -> Result<()> {
        let (tried, live, rays) = (self.candidates, self.live_candidates, self.shadow_rays);
        if rays <= live && live <= tried {
            return Ok(());
        }
        Err(computes_wrongly(&format!(
            "it counted {tried} tried connections, {live} of them inside the gate and {rays} shadow rays, and none of these numbers \
             may exceed the one before"
        )))
    }

    /// Contributions inside the gate per sensor subpath. The splats of light vertices (t = 1) count too.
    pub fn inside_gate_per_sample(&self) -> f64 {
        self.inside_gate as f64 / self.samples.max(1) as f64
    }

    /// Closest-hit rays and shadow rays together.
    pub fn rays(&self) -> u64 {
        self.closest_rays + self.shadow_rays
    }
}

/// The error of a device whose results contradict each other. `how` says in which way.
pub(super) fn computes_wrongly(how: &str) -> Error {
    Error::Device(format!(
        "it computes wrongly: {how}; run taugate devices --check, update the driver, or choose another --device"
    ))
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
    fn the_host_works_when_it_does_not_wait() {
        let mut stats = Stats { submit_seconds: 5.0, beside_seconds: 3.0, ..Stats::default() };
        assert_eq!(stats.host_share(10.0), 0.8);
        for stage in [stage::WAIT_FOR_FILM, stage::WAIT_FOR_LIGHT, stage::RECORD] {
            stats.add_host(stage, Duration::from_secs(2));
        }
        assert_eq!(stats.host_share(10.0), 0.4);
    }

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
