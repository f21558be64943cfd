//! Phase 3 of Algorithm 1: sensor subpaths in tiles; at every bounce shade points, queries, connections.

mod buffers;
mod observe;
mod tiles;

use super::device_scene::DeviceScene;
use super::plan::Plan;
use super::pool::DevicePool;
use super::samples::{MOST_IN_PIXEL, MOST_SAMPLES, SampleCounts};
use super::stats::{Stats, stage};
use crate::error::Result;
use crate::gpu::{Bindings, Buffer, Device, DeviceInfo, Kernel, Need, Recorder};
use crate::settings::Estimator;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Dispatch, NONE, PathVertex};
use buffers::{BUFFERS, Buffers, needs};
pub use observe::Seen;
use tiles::{TileSample, Tiles};

/// Counters of the lists: living paths (two, in turn), shade points, live candidates.
const LIVING: [u32; 2] = [0, 1];
const SHADE: u32 = 2;
const CANDIDATES: u32 = 3;
const COUNTERS: usize = 16;

/// Workgroups a dispatch that every Vulkan device allows.
const LEAST_GROUP_LIMIT: u32 = 65_535;

/// A submit is kept under this on average, so that the worst stays under 0.1 s.
const TARGET_SECONDS: f64 = 0.035;
/// Paths a tile at least.
const LEAST_TILE: usize = 1024;
/// Entries of a list that one workgroup compacts faster than three dispatches do.
const SHORT_LIST: usize = 1 << 13;
/// Shade points a submit that queries them at least, and in steps of which: whole workgroups.
const LEAST_PART: usize = 256;

/// Kernels and buffers of the sensor subpaths.
pub struct SensorTracer {
    kernels: Kernels,
    buffers: Buffers,
    recorder: Recorder,
    slots: u32,
    /// Paths a tile may hold, and how many it holds at present.
    capacity: usize,
    tile: usize,
    /// Shade points that are queried in one submit.
    part: usize,
}

/// Compiled kernels; they do not depend on any buffer.
pub struct Kernels {
    start: Kernel,
    trace: Kernel,
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    short: Kernel,
    query: Kernel,
    connect: Kernel,
    gather: Kernel,
    resolve: Kernel,
}

/// Descriptor sets for one pool; `[0]` where bounce numbers are even.
pub struct Bound {
    start: Bindings,
    trace: [Bindings; 2],
    compact_paths: [[Bindings; 4]; 2],
    query: Bindings,
    compact_candidates: [Bindings; 4],
    connect: Bindings,
    gather: Bindings,
    resolve: Bindings,
}

impl SensorTracer {
    /// Buffers for `slots` candidates a shade point; kernels of a tracer that had fewer, or new ones.
    pub fn new(
        device: &Device,
        plan: &Plan,
        slots: u32,
        kernels: Option<Kernels>,
        stats: &mut Stats,
    ) -> Result<SensorTracer> {
        let capacity = SensorTracer::capacity(device.info(), plan, slots);
        let buffers = stats.timed(stage::ALLOCATE, || Buffers::new(device, plan, capacity, slots as usize))?;
        let kernels = match kernels {
            Some(kernels) => kernels,
            None => stats.timed(stage::COMPILE, || Kernels::new(device, plan))?,
        };
        let tile = plan.tuning.tile.unwrap_or(1 << 13).min(capacity);
        Ok(SensorTracer { kernels, buffers, recorder: Recorder::new(device)?, slots, capacity, tile, part: LEAST_PART })
    }

    /// Paths a tile may hold.
    fn capacity(info: &DeviceInfo, plan: &Plan, slots: u32) -> usize {
        // Enough to fill the machine, little enough for its limits and caches.
        let wanted: u64 = if info.is_cpu() { 1 << 16 } else { 1 << 20 };
        let limit = info.largest_buffer();
        let by_vertices = limit / size_of::<PathVertex>() as u64;
        let by_slots = limit / (16 * u64::from(slots));
        // Every slot may be a live candidate: the workgroups of one dispatch are limited too.
        let by_groups = u64::from(LEAST_GROUP_LIMIT * plan.tuning.workgroup) / u64::from(slots);
        let all = plan.crop_pixels * u64::from(MOST_SAMPLES);
        wanted.min(by_vertices).min(by_slots).min(by_groups).min(all).max(u64::from(MOST_IN_PIXEL)) as usize
    }

    /// What the buffers of [`SensorTracer::new`] will need.
    pub fn needs(info: &DeviceInfo, plan: &Plan, slots: u32) -> [Need; BUFFERS] {
        needs(plan, SensorTracer::capacity(info, plan, slots), slots as usize)
    }

    pub fn slots(&self) -> u32 {
        self.slots
    }

    /// Frees the buffers and keeps what is slow to make.
    pub fn into_kernels(self) -> Kernels {
        self.kernels
    }

    /// Descriptor sets over the scene, a pool and the tracer's buffers.
    pub fn bind(&self, scene: &DeviceScene, pool: &DevicePool) -> Result<Bound> {
        let (k, b) = (&self.kernels, &self.buffers);
        let shared = || {
            let mut all = scene.bindings();
            all.extend(pool.bindings());
            all.extend(b.bindings());
            all
        };
        let living = |parity: usize| {
            let mut all = shared();
            all.extend([("list", &b.living[parity]), ("source", &b.living[parity])]);
            all.extend([("list_a", &b.living[1 - parity]), ("list_b", &b.shade_list)]);
            all
        };
        let candidates = || {
            let mut all = shared();
            all.extend([("source", &b.shade_list), ("list_a", &b.slot_list), ("list_b", &b.shade_list)]);
            all
        };
        let shade = || {
            let mut all = shared();
            all.push(("list", &b.shade_list));
            all
        };
        let compact = |buffers: &[(&str, &Buffer)]| -> Result<[Bindings; 4]> {
            Ok([k.count.bind(buffers)?, k.scan.bind(buffers)?, k.scatter.bind(buffers)?, k.short.bind(buffers)?])
        };
        Ok(Bound {
            start: k.start.bind(&living(0))?,
            trace: [k.trace.bind(&living(0))?, k.trace.bind(&living(1))?],
            compact_paths: [compact(&living(0))?, compact(&living(1))?],
            query: k.query.bind(&shade())?,
            compact_candidates: compact(&candidates())?,
            connect: k.connect.bind(&shade())?,
            gather: k.gather.bind(&shade())?,
            resolve: k.resolve.bind(&shared())?,
        })
    }

    /// Renders the samples that every pixel of the crop is given by `counts` and adds their means to `image` (RGB); `see`: as in
    /// [`Buffers::add_film`].
    pub fn run(
        &mut self,
        plan: &Plan,
        bound: &Bound,
        counts: &SampleCounts,
        image: &mut [f32],
        see: impl FnOnce(&[[f32; 4]], &[f32]),
        stats: &mut Stats,
    ) -> Result<()> {
        let mut tiles = Tiles::new(plan.crop, counts);
        while let Some((tile, is_last)) = stats.timed(stage::RECORD, || tiles.next(self.tile)) {
            self.run_tile(plan, bound, tile, is_last, stats)?;
            stats.samples += tile.len() as u64;
        }
        stats.timed(stage::READ_FILM, || self.buffers.add_film(image, see)).map(|tally| {
            stats.dropped += tally[0];
            stats.shadow_rays += tally[1];
            stats.inside_gate += tally[2];
            stats.candidates += tally[3];
        })
    }

    fn run_tile(
        &mut self,
        plan: &Plan,
        bound: &Bound,
        samples: &[TileSample],
        is_last: bool,
        stats: &mut Stats,
    ) -> Result<()> {
        let constants = stats.timed(stage::RECORD, || self.start_tile(bound, samples))?;
        let mut living = samples.len() as u32;
        let mut longest = 0.0f64;
        for bounce in 0..plan.max_depth {
            let seconds;
            (living, seconds) = self.run_bounce(bound, &Dispatch { bounce, ..constants }, living, stats)?;
            longest = longest.max(seconds);
            if living == 0 {
                break;
            }
        }
        let groups = self.kernels.resolve.groups(samples.len());
        self.recorder.dispatch("resolve", &self.kernels.resolve, &bound.resolve, &constants, groups)?;
        longest = longest.max(stats.submit(&mut self.recorder)?);
        let counters = self.read_counters(stats)?;
        let total = |list: u32| u64::from(counters[(COUNTER_TOTALS + list) as usize]);
        stats.closest_rays += samples.len() as u64 + total(LIVING[0]) + total(LIVING[1]);
        stats.shade_points += total(SHADE);
        stats.live_candidates += total(CANDIDATES);
        if plan.tuning.tile.is_none() {
            self.tile = next_tile(self.tile, samples.len(), is_last, longest, self.capacity);
        }
        Ok(())
    }

    /// Traces the `living` paths of a bounce and queries the shade points they leave; what connects them is recorded only. Returns
    /// how many paths go on, and the seconds of the submit that traced them.
    fn run_bounce(
        &mut self,
        bound: &Bound,
        constants: &Dispatch,
        living: u32,
        stats: &mut Stats,
    ) -> Result<(u32, f64)> {
        stats.timed(stage::RECORD, || self.record_trace(bound, constants, living))?;
        let seconds = stats.submit(&mut self.recorder)?;
        // A dispatch costs what tracing hundreds of paths does, even over an empty list: the host looks what there is to do.
        let counters = self.read_counters(stats)?;
        let shade_points = counters[SHADE as usize];
        if shade_points > 0 {
            self.query(bound, constants, shade_points, stats)?;
            stats.timed(stage::RECORD, || self.record_connections(bound, constants, shade_points))?;
        }
        Ok((counters[LIVING[1 - constants.bounce as usize % 2] as usize], seconds))
    }

    fn read_counters(&self, stats: &mut Stats) -> Result<[u32; COUNTERS]> {
        let mut counters = [0u32; COUNTERS];
        stats.timed(stage::READ_COUNTERS, || self.buffers.counters.read(0, &mut counters))?;
        Ok(counters)
    }

    /// Records the start of a path for every sample; returns what all dispatches of the tile share.
    fn start_tile(&mut self, bound: &Bound, samples: &[TileSample]) -> Result<Dispatch> {
        let count = samples.len() as u32;
        let none = Dispatch { list_a: NONE, list_b: NONE, emitter: NONE, ..bytemuck::Zeroable::zeroed() };
        let constants = Dispatch { count, counter: LIVING[0], ..none };
        self.buffers.tile_samples.write(0, samples)?;
        let mut counters = [0u32; COUNTERS];
        counters[LIVING[0] as usize] = count;
        self.buffers.counters.write(0, &counters)?;
        let mut arguments = [1u32; COUNTERS];
        arguments[LIVING[0] as usize * 3] = self.kernels.trace.groups(count as usize);
        self.buffers.arguments.write(0, &arguments)?;
        let groups = self.kernels.start.groups(count as usize);
        self.recorder.dispatch("sensor_start", &self.kernels.start, &bound.start, &constants, groups)?;
        Ok(constants)
    }

    /// Traces the living paths of a bounce and lists those that go on and the new shade points.
    fn record_trace(&mut self, bound: &Bound, constants: &Dispatch, count: u32) -> Result<()> {
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let parity = constants.bounce as usize % 2;
        let (living, next) = (LIVING[parity], LIVING[1 - parity]);
        let lists = Dispatch { counter: living, list_a: next, list_b: SHADE, ..*constants };
        r.dispatch_indirect("sensor_trace", &k.trace, &bound.trace[parity], &lists, arguments(b, living))?;
        self.record_compaction(&bound.compact_paths[parity], &lists, count as usize)
    }

    /// Queries the `all` > 0 new shade points of a bounce: recorded with what follows if they are few, else in submits of their
    /// own, so that none is long though tiles are great.
    fn query(&mut self, bound: &Bound, constants: &Dispatch, all: u32, stats: &mut Stats) -> Result<()> {
        let (mut done, all) = (0, all as usize);
        while done < all {
            let part = self.part;
            let constants = Dispatch { counter: SHADE, rank: done as u32, ..*constants };
            let groups = self.kernels.query.groups(part.min(all - done));
            self.recorder.dispatch("shell_query", &self.kernels.query, &bound.query, &constants, groups)?;
            if all <= LEAST_PART {
                return Ok(());
            }
            let factor = change(stats.submit(&mut self.recorder)?);
            done += part;
            if factor < 1.0 || done <= all {
                let most = self.capacity.max(LEAST_PART);
                self.part = ((self.part as f64 * factor) as usize).clamp(LEAST_PART, most) / LEAST_PART * LEAST_PART;
            }
        }
        Ok(())
    }

    /// Compacts a list of `entries` entries at most.
    fn record_compaction(&mut self, sets: &[Bindings; 4], lists: &Dispatch, entries: usize) -> Result<()> {
        let (k, r) = (&self.kernels, &mut self.recorder);
        let [count, scan, scatter, short] = sets;
        if entries <= SHORT_LIST {
            return r.dispatch("compact", &k.short, short, lists, 1);
        }
        let chunks = k.count.groups(entries.div_ceil(CHUNK as usize));
        r.dispatch("compact", &k.count, count, lists, chunks)?;
        r.dispatch("compact", &k.scan, scan, lists, 1)?;
        r.dispatch("compact", &k.scatter, scatter, lists, chunks)
    }

    /// Connects the shade points to what was found for them and adds it to their paths.
    fn record_connections(&mut self, bound: &Bound, constants: &Dispatch, count: u32) -> Result<()> {
        let at = |counter: u32| Dispatch { counter, ..*constants };
        let lists = Dispatch { list_a: CANDIDATES, list_b: NONE, ..at(SHADE) };
        self.record_compaction(&bound.compact_candidates, &lists, count as usize * self.slots as usize)?;
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        r.dispatch_indirect("connect", &k.connect, &bound.connect, &at(CANDIDATES), arguments(b, CANDIDATES))?;
        r.dispatch_indirect("gather", &k.gather, &bound.gather, &at(SHADE), arguments(b, SHADE))
    }
}

/// The next tile, given that `count` paths of one of at most `tile`, the last of an image or not, took `longest` seconds in a
/// submit: so that this comes near the target. The image does not depend on it.
fn next_tile(tile: usize, count: usize, is_last: bool, longest: f64, capacity: usize) -> usize {
    let factor = change(longest);
    // The last may hold less than fits.
    if factor >= 1.0 && is_last {
        return tile;
    }
    ((count as f64 * factor) as usize).clamp(LEAST_TILE.min(capacity), capacity)
}

/// By how much to change what one submit does, after one that took `seconds`.
fn change(seconds: f64) -> f64 {
    (TARGET_SECONDS / seconds.max(1e-6)).clamp(0.5, 2.0)
}

/// Where the size of a dispatch over a list stands.
fn arguments(buffers: &Buffers, list: u32) -> (&Buffer, u64) {
    (&buffers.arguments, 3 * u64::from(list))
}

impl Kernels {
    fn new(device: &Device, plan: &Plan) -> Result<Kernels> {
        let constants = plan.constants();
        let make = |file: &'static str, entry: &str| Kernel::new(device, file, entry, &constants);
        Ok(Kernels {
            start: make("sensor_start", "sensor_start")?,
            trace: make("sensor_trace", "sensor_trace")?,
            count: make("compact", "compact_count")?,
            scan: make("compact", "compact_scan")?,
            scatter: make("compact", "compact_scatter")?,
            short: make("compact", "compact_short")?,
            query: match plan.estimator {
                Estimator::Lcs => make("shell_resample", "shell_resample")?,
                Estimator::Pt | Estimator::Bdpt | Estimator::LcsPaper => make("shell_query", "shell_query")?,
            },
            connect: make("connect", "connect")?,
            gather: make("gather", "gather")?,
            resolve: make("resolve", "resolve")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_follow_the_time_that_their_submits_take() {
        let fast = TARGET_SECONDS / 8.0;
        // 8,190 paths are all that fit into 8,192 with three samples a pixel.
        assert_eq!(next_tile(8192, 8190, false, fast, 1 << 16), 2 * 8190);
        assert_eq!(next_tile(8192, 8192, false, fast, 1 << 16), 2 * 8192);
        assert_eq!(next_tile(1 << 16, 1 << 16, false, fast, 1 << 16), 1 << 16);
        // The rest of an image says nothing about a full tile, unless it took too long.
        assert_eq!(next_tile(8192, 2250, true, fast, 1 << 16), 8192);
        assert_eq!(next_tile(8192, 8190, true, 2.0 * TARGET_SECONDS, 1 << 16), 4095);
        assert_eq!(next_tile(1024, 1024, false, 2.0 * TARGET_SECONDS, 1 << 16), LEAST_TILE);
    }
}
