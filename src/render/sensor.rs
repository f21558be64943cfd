//! Phase 3 of Algorithm 1: sensor subpaths run in tiles. Each bounce traces them to shade points, queries light vertices for
//! the shade points and connects them.

mod bounce;
mod buffers;
mod kernels;
mod observe;
mod phase;
mod subpaths;
mod tiles;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::compaction::{COUNTERS, indirect_over, mark_words};
use super::plan::{Observe, Plan};
use super::pool::DevicePool;
use super::samples::MAX_SAMPLES_PER_PIXEL;
use super::stats::{Stats, stage};
use super::submit_size::TileSize;
use crate::error::Result;
use crate::estimators::Ellipsoids;
use crate::gpu::{BufferDesc, BufferList, Device, DeviceInfo, Recorder};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Dispatch, NONE, PathVertex, SensorContribution};
use buffers::Buffers;
use kernels::{Kernels, SensorBindings};
pub use observe::Found;
pub use phase::SensorPhase;
use subpaths::SensorSubpaths;
pub use tiles::Tiles;

/// Indices of the list counters: living paths (two lists that alternate between bounces), shade points, live candidates.
const LIVING: [u32; 2] = [LIVING_LIST, LIVING_LIST + 1];
const SHADE: u32 = SHADE_LIST;
const CANDIDATES: u32 = CANDIDATE_LIST;

/// Number of workgroups per dispatch that every Vulkan device allows.
pub const MIN_GROUP_LIMIT: u32 = 65_535;

/// Minimum number of shade points in a submit of queries. Larger batches are multiples of it, so they fill whole workgroups.
const MIN_QUERY_BATCH: usize = 256;

/// Minimum and maximum work of a submit that searches for ellipsoids, in candidates times parts of the BVH. Except in the last
/// batch of a bounce, the number of candidates is a multiple of the minimum, so a batch fills whole workgroups.
const MIN_SEARCH_BATCH: usize = 64;
const MAX_SEARCH_BATCH: usize = 1 << 20;

/// Maximum number of bytes of observed contributions that the device keeps, on a CPU and on a card, unless one bounce needs more.
const MAX_OBSERVED_BYTES: [u64; 2] = [64 << 20, 256 << 20];

/// Kernels and buffers of the sensor subpaths.
pub struct SensorTracer {
    kernels: Kernels,
    buffers: Buffers,
    recorder: Recorder,
    /// Whether the host reads the lengths of the lists after each bounce. See [`Drive`](crate::gpu::Drive).
    waits_per_bounce: bool,
    slots: u32,
    /// Maximum number of paths in a tile that the buffers allow, and of entries in `buffers.observed`.
    capacity: usize,
    observed: usize,
    /// The largest number of entries per path that the host has read after a tile. Predicts how many it copies with the film.
    entries_per_path: f64,
    /// Maximum number of paths in the next tile, adapted to the time that submits take.
    tile: TileSize,
    /// Number of shade points that one submit queries, adapted in the same way.
    query_batch: usize,
    /// Work of one submit that searches for ellipsoids, adapted in the same way.
    search_batch: usize,
    /// Number of parts of the BVH for these searches.
    parts: usize,
    /// Becomes true when the iteration is to be abandoned.
    stop: Arc<AtomicBool>,
    /// Whether a part of the present iteration was left out. Then the whole iteration must be dropped.
    abandoned: bool,
}

impl SensorTracer {
    /// Files of the kernels except the compaction; their entry points have the same names.
    pub fn files(plan: &Plan) -> Vec<&'static str> {
        let ellipsoids = kernels::ellipsoid_file(plan);
        let others = [
            plan.estimator.query_kernel,
            "sensor_trace",
            "connect",
            "sensor_start",
            "list_samples",
            "gather",
            "resolve",
        ];
        let merge = plan.merging.is_some().then_some("merge");
        ellipsoids.into_iter().chain(merge).chain(others).collect()
    }

    /// Allocates the buffers for `slots` candidate slots per shade point.
    pub fn new(device: &Device, plan: &Plan, slots: u32, kernels: Kernels, stats: &mut Stats) -> Result<SensorTracer> {
        let capacity = SensorTracer::capacity(device.info(), plan, slots);
        let observed = SensorTracer::observed_capacity(device.info(), plan, capacity, slots);
        let mut buffers =
            stats.timed(stage::ALLOCATE, || Buffers::new(device, plan, capacity, slots as usize, observed))?;
        buffers.bvh_parts.write(0, &plan.bvh_parts)?;
        // The order of contributions that the host observes must not depend on the time that submits take.
        let is_fixed = plan.tuning.tile.is_some() || plan.observe.has_strategies();
        let tile = TileSize::new(plan.tuning.tile.unwrap_or(1 << 13), capacity, is_fixed);
        Ok(SensorTracer {
            kernels,
            buffers,
            recorder: Recorder::new(device)?,
            // The host divides the search for ellipsoids into submits, so it must know the number of candidates.
            waits_per_bounce: device.info().drive.waits_per_bounce
                || plan.estimator.ellipsoids == Ellipsoids::Enumerated,
            slots,
            capacity,
            observed,
            entries_per_path: 0.0,
            tile,
            query_batch: MIN_QUERY_BATCH,
            search_batch: MIN_SEARCH_BATCH,
            parts: plan.bvh_parts.len(),
            stop: Arc::default(),
            abandoned: false,
        })
    }

    /// Whether the iteration is abandoned. Once true, the answer stays true until the next iteration.
    fn is_abandoned(&mut self) -> bool {
        self.abandoned |= self.stop.load(Ordering::Relaxed);
        self.abandoned
    }

    /// Frees the buffers before larger ones are allocated, and keeps the compiled kernels.
    fn into_kernels(self) -> Kernels {
        self.kernels
    }

    /// Maximum number of paths in a tile.
    fn capacity(info: &DeviceInfo, plan: &Plan, slots: u32) -> usize {
        // Enough paths to use all cores; few enough for the limits and caches of the device.
        let usual: u64 = if info.is_cpu() { 1 << 16 } else { 1 << 20 };
        let wanted = plan.tuning.tile.map_or(usual, |tile| tile as u64);
        let limit = info.largest_buffer();
        let by_vertices = limit / size_of::<PathVertex>() as u64;
        let by_slots = limit / (16 * u64::from(slots));
        let by_observed = match plan.observe {
            Observe::Nothing => u64::MAX,
            _ => limit / (size_of::<SensorContribution>() as u64 * u64::from(1 + slots + plan.merged_entries())),
        };
        // Every slot may hold a live candidate, and one dispatch over the candidates must not exceed the limit on workgroups.
        let by_groups = u64::from(MIN_GROUP_LIMIT * plan.tuning.workgroup) / u64::from(slots);
        let all = plan.image_pixels * u64::from(plan.sensor_samples(plan.max_samples()));
        let of_a_pixel = plan.sensor_samples(MAX_SAMPLES_PER_PIXEL.max(plan.max_samples()));
        let fitting = by_vertices.min(by_slots).min(by_observed).min(by_groups);
        wanted.min(fitting).min(all).max(of_a_pixel.into()) as usize
    }

    /// Number of entries in the buffer of observed contributions: those of at least one bounce of `paths` paths.
    fn observed_capacity(info: &DeviceInfo, plan: &Plan, paths: usize, slots: u32) -> usize {
        if plan.observe == Observe::Nothing {
            return 1;
        }
        let size = size_of::<SensorContribution>() as u64;
        let of_bounce = paths as u64 * u64::from(1 + slots + plan.merged_entries());
        let [on_cpu, on_card] = MAX_OBSERVED_BYTES;
        let usual = (if info.is_cpu() { on_cpu } else { on_card }) / size;
        let wanted = plan.tuning.observed.map_or(usual, |count| count as u64).min(info.largest_buffer() / size);
        (of_bounce * u64::from(plan.max_depth)).min(wanted).max(of_bounce) as usize
    }

    /// Descriptors of the buffers that [`SensorTracer::new`] allocates.
    pub fn buffer_descs(info: &DeviceInfo, plan: &Plan, slots: u32) -> Vec<BufferDesc> {
        let capacity = SensorTracer::capacity(info, plan, slots);
        let observed = SensorTracer::observed_capacity(info, plan, capacity, slots);
        BufferList::of(|list| Buffers::new(list, plan, capacity, slots as usize, observed))
    }
}
