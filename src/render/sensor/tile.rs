//! Renders one tile of sensor subpaths, from its samples to the film.

use super::*;
use crate::render::responses::IndexInTile;
use crate::render::stats::computes_wrongly;

/// Maximum number of bounces per submit if the host does not wait for each bounce. Few paths live longer.
const MAX_BOUNCES_PER_SUBMIT: u32 = 16;

impl SensorTracer {
    pub(super) fn run_tile(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        tile: &Tile,
        is_last: bool,
        arrivals: Option<&mut Vec<Vec<Arrival<IndexInTile>>>>,
        stats: &mut Stats,
    ) -> Result<()> {
        let constants = stats.timed(stage::RECORD, || self.start_tile(bindings, tile))?;
        let mut longest = match (arrivals, self.waits_per_bounce) {
            (Some(arrivals), _) => {
                let (samples, indices) = (tile.samples(), tile.pixel_indices());
                let keep = |seen: SensorContribution| {
                    let share = 1.0 / (samples[seen.path as usize][1] >> 16) as f32;
                    let rgb = seen.rgb.map(|x| x * share);
                    // The kernels count values that are not finite as dropped, so the host leaves them out.
                    let has_light = rgb.iter().all(|x| x.is_finite()) && rgb != [0.0; 3];
                    let pixel = IndexInTile(indices[seen.path as usize]);
                    has_light.then_some(Arrival { pixel, tau: seen.tau_or_weight, rgb })
                };
                let take = &mut |part| arrivals.push(part);
                self.observe_bounces(plan, bindings, &samples, &constants, stats, &keep, take)?
            }
            (None, true) => self.run_bounces(plan, bindings, &constants, stats)?,
            (None, false) => self.record_bounces(plan, bindings, &constants, stats)?,
        };
        stats.timed(stage::RECORD, || self.record_film(bindings, &constants, is_last))?;
        longest = longest.max(stats.submit(&mut self.recorder)?);
        let counters = self.read_counters(constants.count, stats)?;
        let total = |list: u32| u64::from(counters[(COUNTER_TOTALS + list) as usize]);
        stats.closest_rays += tile.sample_count() as u64 + total(LIVING[0]) + total(LIVING[1]);
        stats.shade_points += total(SHADE);
        stats.live_candidates += total(CANDIDATES);
        self.tile.adapt(tile.sample_count(), is_last, longest);
        Ok(())
    }

    /// Records the start of one path per sample. Returns the constants that all dispatches of the tile share.
    pub(super) fn start_tile(&mut self, bindings: &SensorBindings, tile: &Tile) -> Result<Dispatch> {
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

    /// Runs the bounces, one submit each, until no path lives. Returns the seconds of the longest submit that traced paths.
    fn run_bounces(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        constants: &Dispatch,
        stats: &mut Stats,
    ) -> Result<f64> {
        let (mut living, mut longest) = (constants.count, 0.0f64);
        for bounce in 0..plan.max_depth {
            let seconds;
            (living, seconds) = self.run_bounce(bindings, &Dispatch { bounce, ..*constants }, living, stats)?;
            longest = longest.max(seconds);
            if living == 0 {
                break;
            }
        }
        Ok(longest)
    }

    /// Records all bounces without waiting for each of them. Submits after every [`MAX_BOUNCES_PER_SUBMIT`] bounces and
    /// leaves the last submit to the caller. Returns the seconds of the longest submit made here, 0 if there was none.
    fn record_bounces(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        constants: &Dispatch,
        stats: &mut Stats,
    ) -> Result<f64> {
        let mut longest = 0.0f64;
        for bounce in 0..plan.max_depth {
            if bounce > 0 && bounce % MAX_BOUNCES_PER_SUBMIT == 0 {
                self.record_counters()?;
                longest = longest.max(stats.submit(&mut self.recorder)?);
                if self.read_counters(constants.count, stats)?[LIVING[bounce as usize % 2] as usize] == 0 {
                    break;
                }
            }
            stats.timed(stage::RECORD, || self.record_bounce(bindings, &Dispatch { bounce, ..*constants }))?;
        }
        Ok(longest)
    }

    /// Records the kernel that averages the samples of each pixel. With the last tile, the submit also reads the film back.
    fn record_film(&mut self, bindings: &SensorBindings, constants: &Dispatch, is_last: bool) -> Result<()> {
        let resolve = &self.kernels.resolve;
        let groups = resolve.groups(constants.count as usize);
        self.recorder.dispatch("resolve", resolve, &bindings.resolve, constants, groups)?;
        if is_last {
            self.buffers.read_film(&mut self.recorder)?;
        }
        self.record_counters()
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
