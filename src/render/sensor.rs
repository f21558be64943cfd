//! Phase 3 of Algorithm 1: sensor subpaths in tiles; at every bounce shade points, queries, connections.

mod bounce;
mod buffers;
mod kernels;
mod observe;
mod pace;
mod phase;
mod tiles;

use super::device_scene::DeviceScene;
use super::plan::Plan;
use super::pool::DevicePool;
use super::samples::{MOST_IN_PIXEL, MOST_SAMPLES, SampleCounts};
use super::stats::{Stats, stage};
use crate::error::Result;
use crate::gpu::{Buffer, Device, DeviceInfo, Need, Recorder};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Dispatch, NONE, PathVertex};
use buffers::{BUFFERS, Buffers, needs};
use kernels::{Bound, Kernels};
pub use observe::Seen;
use pace::{change, next_tile};
pub use phase::SensorPhase;
use tiles::{TileSample, Tiles};

/// Counters of the lists: living paths (two, in turn), shade points, live candidates.
const LIVING: [u32; 2] = [0, 1];
const SHADE: u32 = 2;
const CANDIDATES: u32 = 3;
const COUNTERS: usize = 16;

/// Workgroups a dispatch that every Vulkan device allows.
const LEAST_GROUP_LIMIT: u32 = 65_535;

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
        let tally = stats.timed(stage::READ_FILM, || self.buffers.add_film(image, see))?;
        stats.dropped += tally[0];
        stats.shadow_rays += tally[1];
        stats.inside_gate += tally[2];
        stats.candidates += tally[3];
        stats.check()
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
}
