//! Traces sensor subpaths without a film and reports every contribution to the host.

use super::*;
use crate::gpu::ReadBack;
use crate::render::plan::Observe;
use crate::render::stats::computes_wrongly;
use crate::wgsl::layout::Candidate;
use crate::wgsl::layout::constants::NOT_TRACED;

/// A contribution of a sensor subpath.
pub struct SensorContribution {
    /// Value for one sample of the pixel. With [`Observe::Strategies`] the MIS weight is not included.
    pub rgb: [f32; 3],
    /// With [`Observe::Strategies`] the MIS weight; otherwise the travel time in units of the render space.
    pub tau_or_weight: f32,
    /// Index of the subpath in its tile.
    pub path: u32,
    /// Row-major index in the crop.
    pub pixel: u32,
    /// Number of vertices of the sensor subpath, the one on the sensor included.
    pub t: u32,
    /// Index in the pool of the connected light vertex, or SKY_VERTEX; `None` if the subpath hit an emitter or left the scene, and
    /// always with [`Observe::Responses`].
    pub vertex: Option<u32>,
    /// Whether an auxiliary vertex lies between the two subpaths. False with [`Observe::Responses`].
    pub ellipsoidal: bool,
}

impl SensorTracer {
    /// As [`SensorTracer::run`], for a plan that observes contributions. The host waits for each bounce. Calls `visit` with
    /// every emitter hit and every connection that is not blocked.
    pub fn observe(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        counts: &SampleCounts,
        visit: &mut impl FnMut(SensorContribution),
    ) -> Result<()> {
        assert!(plan.observe != Observe::Nothing);
        let mut tiles = Tiles::new(plan.crop, counts);
        while let Some((tile, _)) = tiles.next(self.tile.get()) {
            let constants = self.start_tile(bindings, tile)?;
            self.observe_bounces(plan, bindings, &tile.samples(), &constants, &mut Stats::default(), visit)?;
        }
        Ok(())
    }

    /// Runs the bounces of a tile until no path lives or the iteration is abandoned, and calls `visit` with every contribution.
    /// Returns the seconds of the longest submit that traced paths.
    pub(super) fn observe_bounces(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        tile: &[TileSample],
        constants: &Dispatch,
        stats: &mut Stats,
        visit: &mut impl FnMut(SensorContribution),
    ) -> Result<f64> {
        let (mut living, mut longest) = (constants.count, 0.0f64);
        for bounce in 0..plan.max_depth {
            let traced = living;
            let seconds;
            (living, seconds) = self.run_bounce(bindings, &Dispatch { bounce, ..*constants }, living, stats)?;
            longest = longest.max(seconds);
            // The lists of an abandoned bounce contradict each other.
            if self.is_abandoned() {
                break;
            }
            let seen =
                Seen { bounce, traced, shade_points: self.read_counters(constants.count, stats)?[SHADE as usize] };
            stats.timed(stage::RECORD, || self.record_report(plan, tile, &seen))?;
            longest = longest.max(stats.submit(&mut self.recorder)?);
            stats.timed(stage::READ_FILM, || self.report(plan, tile, &seen, visit))?;
            if living == 0 {
                break;
            }
        }
        Ok(longest)
    }

    /// Records the copies of everything that [`SensorTracer::report`] reads.
    fn record_report(&mut self, plan: &Plan, tile: &[TileSample], seen: &Seen) -> Result<()> {
        let (b, r) = (&self.buffers, &mut self.recorder);
        let (shade_points, entries) = seen.lengths(self.slots);
        let mut read = |buffer: &ReadBack, count: usize, size: usize| r.read_back(buffer, (count * size) as u64);
        read(&b.living[seen.parity()], seen.traced as usize, size_of::<u32>())?;
        read(&b.emitted, tile.len(), size_of::<[f32; 4]>())?;
        if shade_points > 0 {
            read(&b.shade_list, shade_points, size_of::<u32>())?;
            read(&b.slot_list, entries, size_of::<u32>())?;
            read(&b.contributions, entries, size_of::<[f32; 4]>())?;
            if plan.observe.has_vertices() {
                read(&b.candidates, entries, size_of::<Candidate>())?;
            }
        }
        self.record_counters()
    }

    /// Calls `visit` with the contributions that a bounce has found for a tile.
    fn report(
        &self,
        plan: &Plan,
        tile: &[TileSample],
        seen: &Seen,
        visit: &mut impl FnMut(SensorContribution),
    ) -> Result<()> {
        let b = &self.buffers;
        let found = |[r, g, b, tau_or_weight]: [f32; 4], path: u32, vertex: Option<u32>, ellipsoidal: bool| {
            let pixel = tiles::crop_pixel(plan.crop, tile.get(path as usize)?[0]);
            let rgb = [r, g, b];
            Some(SensorContribution { rgb, tau_or_weight, path, pixel, t: seen.bounce + 2, vertex, ellipsoidal })
        };

        // Emitter hits of the traced paths.
        let traced = b.living[seen.parity()].with(seen.traced as usize, <[u32]>::to_vec)?;
        let are_right = b.emitted.with::<[f32; 4], _>(tile.len(), |emitted| {
            traced.iter().all(|&path| match emitted.get(path as usize) {
                Some(e) if *e == [0.0; 4] => true,
                Some(&e) => found(e, path, None, false).map(&mut *visit).is_some(),
                None => false,
            })
        })?;
        let check = |are_right: bool| match are_right {
            true => Ok(()),
            false => Err(computes_wrongly("it listed a path that does not exist")),
        };
        check(are_right)?;

        let (shade_points, entries) = seen.lengths(self.slots);
        if shade_points == 0 {
            return Ok(());
        }
        // Connections, without those for which no shadow ray was traced.
        let candidates = self.read_counters(tile.len() as u32, &mut Stats::default())?[CANDIDATES as usize];
        let slots = b.slot_list.with(candidates as usize, <[u32]>::to_vec)?;
        let shade_list = b.shade_list.with(shade_points, <[u32]>::to_vec)?;
        let live: Option<Vec<(u32, [f32; 4])>> = b.contributions.with::<[f32; 4], _>(entries, |contributions| {
            let all = slots.iter().map(|&slot| Some((slot, *contributions.get(slot as usize)?)));
            all.filter(|found| found.is_none_or(|(_, c)| c[3] > NOT_TRACED)).collect()
        })?;
        let Some(live) = live else { return check(false) };
        let mut show = |slot: u32, c: [f32; 4], vertex: Option<u32>| {
            let ellipsoidal = vertex.is_some_and(|vertex| vertex != SKY_VERTEX && vertex & ELLIPSOIDAL != 0);
            let vertex = vertex.map(|vertex| if ellipsoidal { vertex & !ELLIPSOIDAL } else { vertex });
            found(c, shade_list[(slot / self.slots) as usize], vertex, ellipsoidal).map(&mut *visit).is_some()
        };
        check(match plan.observe.has_vertices() {
            true => b.candidates.with::<Candidate, _>(entries, |candidates| {
                live.into_iter().all(|(slot, c)| show(slot, c, Some(candidates[slot as usize].vertex)))
            })?,
            false => live.into_iter().all(|(slot, c)| show(slot, c, None)),
        })
    }
}

/// A bounce of a tile that the host reads.
struct Seen {
    bounce: u32,
    /// Number of paths that were traced.
    traced: u32,
    shade_points: u32,
}

impl Seen {
    /// Which of the two lists of living paths holds the traced paths.
    fn parity(&self) -> usize {
        self.bounce as usize % 2
    }

    /// Number of shade points, and of their candidate slots.
    fn lengths(&self, slots: u32) -> (usize, usize) {
        (self.shade_points as usize, self.shade_points as usize * slots as usize)
    }
}
