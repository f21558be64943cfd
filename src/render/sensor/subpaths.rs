//! The sensor subpaths of one tile, from their samples to the film.

use super::tiles::Tile;
use super::*;
use crate::render::pool::SortedPool;
use crate::render::responses::Adding;
use crate::render::stats::computes_wrongly;

/// Maximum number of bounces per submit if the host does not wait for each bounce. Few paths live longer.
const MAX_BOUNCES_PER_SUBMIT: u32 = 16;

/// The sensor subpaths of a tile while they are traced. Each bounce is [`SensorSubpaths::trace`], [`SensorSubpaths::query`] and
/// [`SensorSubpaths::connect`], in this order. There are two drives ([`Drive`](crate::gpu::Drive)). If the host waits for each bounce,
/// `trace` submits, and `query` does if there are many shade points; both dispatch only over lists that have entries. `connect` only
/// records, for the next submit. In the other drive, all three only record.
pub struct SensorSubpaths<'a> {
    pub(super) tracer: &'a mut SensorTracer,
    pub(super) bindings: &'a SensorBindings,
    /// If the device adds the light to the images of several responses.
    pub(super) adding: Option<&'a Adding>,
    pub(super) plan: &'a Plan,
    pub(super) tile: &'a Tile,
    pub(super) pool: &'a SortedPool,
    /// For each sample of the tile, the index of its pixel in the tile; empty if the host reads no contributions.
    pub(super) pixel_indices: Vec<u32>,
    pub(super) stats: &'a mut Stats,
    /// The constants of the present bounce.
    pub(super) constants: Dispatch,
    /// Number of paths that the present bounce traces, that the next one traces, and of new shade points. All paths of the tile if the
    /// host does not know it.
    pub(super) traced: u32,
    pub(super) living: u32,
    pub(super) shade_points: u32,
    /// Maximum number of observed contributions that the host has not read yet, and what it has read.
    pub(super) unread: usize,
    pub(super) found: Found,
    /// Seconds of the longest submit that traced or connected paths.
    pub(super) longest: f64,
}

impl<'a> SensorSubpaths<'a> {
    /// Starts one path per sample of `tile`.
    pub(super) fn start(
        tracer: &'a mut SensorTracer,
        bindings: &'a SensorBindings,
        adding: Option<&'a Adding>,
        plan: &'a Plan,
        tile: &'a Tile,
        pool: &'a SortedPool,
        stats: &'a mut Stats,
    ) -> Result<SensorSubpaths<'a>> {
        let mut constants = stats.timed(stage::RECORD, || tracer.record_start(bindings, tile))?;
        if adding.is_some() {
            constants.first = NONE;
        }
        let is_read = plan.observe != Observe::Nothing && adding.is_none();
        let pixel_indices = if is_read { tile.pixel_indices() } else { vec![] };
        let all = constants.count;
        Ok(SensorSubpaths {
            tracer,
            bindings,
            adding,
            plan,
            tile,
            pool,
            pixel_indices,
            stats,
            constants,
            traced: all,
            living: all,
            shade_points: all,
            unread: 0,
            found: Found::default(),
            longest: 0.0,
        })
    }

    /// Submits the recorded commands and reads the lengths of the lists.
    pub(super) fn submit(&mut self) -> Result<[u32; COUNTERS]> {
        let SensorSubpaths { tracer, stats, constants, longest, .. } = self;
        stats.timed(stage::RECORD, || tracer.record_counters())?;
        *longest = longest.max(stats.submit(&mut tracer.recorder)?);
        tracer.read_counters(constants.count, stats)
    }

    /// Whether no path continues after this bounce, or the iteration is abandoned. Also reads the observed contributions if there may be
    /// no room for those of the next bounce.
    pub fn have_ended(&mut self) -> Result<bool> {
        let next = self.constants.bounce + 1;
        let is_due = !self.tracer.waits_per_bounce && next.is_multiple_of(MAX_BOUNCES_PER_SUBMIT);
        if next < self.plan.max_depth && !self.tracer.is_abandoned() && (is_due || !self.has_room()) {
            // The device knows how many paths and contributions there are, and the host only how many there may be.
            let counters = self.submit()?;
            self.living = counters[LIVING[next as usize % 2] as usize];
            self.unread = self.unread_after(&counters)?;
            if !self.has_room() {
                self.read_observed(self.unread, 0)?;
            }
        }
        Ok(self.living == 0 || self.tracer.is_abandoned())
    }

    /// Averages the samples of each pixel on the device, and counts the work of the tile. With the last tile, the submit also reads the
    /// film back. Returns the observed contributions of the tile; `None` if the iteration is abandoned.
    pub fn resolve(mut self, is_last: bool) -> Result<Option<Found>> {
        let SensorSubpaths { tracer, bindings, tile, stats, constants, .. } = &mut self;
        stats.timed(stage::RECORD, || tracer.record_film(bindings, constants, tile, is_last))?;
        let copied = self.record_likely()?;
        let counters = self.submit()?;
        // The lists of an abandoned bounce contradict each other.
        if self.tracer.is_abandoned() {
            return Ok(None);
        }
        let unread = self.unread_after(&counters)?;
        self.read_observed(unread, copied)?;
        let reads_entries = self.reads_entries();
        let SensorSubpaths { tracer, tile, stats, found, constants, longest, .. } = self;
        let count = |word: u32| u64::from(counters[word as usize]);
        let total = |list: u32| count(COUNTER_TOTALS + list);
        let samples = tile.sample_count();
        stats.samples += samples as u64;
        stats.closest_rays += samples as u64 + total(LIVING[0]) + total(LIVING[1]);
        stats.shade_points += total(SHADE);
        stats.live_candidates += total(CANDIDATES);
        // The order of the tallies is that of gather.wgsl.
        stats.dropped += count(COUNTER_TALLIES);
        stats.shadow_rays += count(COUNTER_TALLIES + 1);
        stats.inside_gate += count(COUNTER_TALLIES + 2);
        stats.candidates += count(COUNTER_TALLIES + 3);
        tracer.tile.adapt(samples, is_last, longest);
        if reads_entries {
            let entries_per_path = f64::from(constants.first) / samples.max(1) as f64;
            tracer.entries_per_path = tracer.entries_per_path.max(observe::LIKELY * entries_per_path);
        }
        Ok(Some(found))
    }
}

impl SensorTracer {
    /// Records the start of one path per sample. Returns the constants that all dispatches of the tile share.
    fn record_start(&mut self, bindings: &SensorBindings, tile: &Tile) -> Result<Dispatch> {
        let (k, b) = (&self.kernels, &mut self.buffers);
        let count = tile.sample_count() as u32;
        let none = Dispatch { list_a: NONE, list_b: NONE, emitter: NONE, ..bytemuck::Zeroable::zeroed() };
        let constants = Dispatch { count, counter: LIVING[0], ..none };
        let (counters, arguments) = k.compaction.one_list(LIVING[0], count, k.trace.groups(count as usize));
        b.tile_pixels.write(0, tile.pixels())?;
        b.counters.write(&counters)?;
        b.arguments.write(0, &arguments)?;
        let over_pixels = Dispatch { count: tile.pixel_count() as u32, ..constants };
        let groups = k.list_samples.groups(tile.pixel_count());
        self.recorder.dispatch("list_samples", &k.list_samples, &bindings.list_samples, &over_pixels, groups)?;
        let groups = k.start.groups(count as usize);
        self.recorder.dispatch("sensor_start", &k.start, &bindings.start, &constants, groups)?;
        Ok(constants)
    }

    /// Records the kernel that averages the samples of each pixel, and with the last tile the copy of the film.
    fn record_film(
        &mut self,
        bindings: &SensorBindings,
        constants: &Dispatch,
        tile: &Tile,
        is_last: bool,
    ) -> Result<()> {
        let resolve = &self.kernels.resolve;
        let pixels = tile.pixel_count();
        let tallied = (constants.count as usize).div_ceil(TALLIED_PATHS as usize);
        let over_pixels = Dispatch { rank: pixels as u32, ..*constants };
        let groups = resolve.groups(pixels.max(tallied));
        self.recorder.dispatch("resolve", resolve, &bindings.resolve, &over_pixels, groups)?;
        if is_last { self.buffers.read_film(self.kernels.merge.is_some(), &mut self.recorder) } else { Ok(()) }
    }

    pub(super) fn record_counters(&mut self) -> Result<()> {
        self.recorder.read_back(&self.buffers.counters, size_of::<[u32; COUNTERS]>() as u64)
    }

    /// The counters of a tile of `paths` paths. Fails if the device reports a list with too many entries.
    pub(super) fn read_counters(&self, paths: u32, stats: &mut Stats) -> Result<[u32; COUNTERS]> {
        let mut counters = [0u32; COUNTERS];
        let read = || self.buffers.counters.with(COUNTERS, |read| counters.copy_from_slice(read));
        stats.timed(stage::READ_COUNTERS, read)?;
        let lengths = [LIVING[0], LIVING[1], SHADE, CANDIDATES].map(|list| counters[list as usize]);
        let slots = paths * self.slots.max(1);
        if lengths[..3].iter().any(|&length| length > paths) || lengths[3] > slots {
            return Err(computes_wrongly(&format!(
                "{paths} paths gave lists of {} and {} living paths, {} shade points and {} candidates",
                lengths[0], lengths[1], lengths[2], lengths[3]
            )));
        }
        Ok(counters)
    }
}
