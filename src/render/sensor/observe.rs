//! Traces sensor subpaths without a film and reports every contribution to the host.

use super::*;
use crate::render::plan::Observe;
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
    /// Index in the pool of the connected light vertex, or SKY_VERTEX; `None` if the subpath hit an emitter or left the scene.
    pub vertex: Option<u32>,
    /// Whether an auxiliary vertex lies between the two subpaths.
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
        while let Some((tile, _)) = tiles.next(self.tile) {
            let constants = self.start_tile(bindings, tile)?;
            self.observe_bounces(plan, bindings, tile, &constants, &mut Stats::default(), visit)?;
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
            let seconds;
            (living, seconds) = self.run_bounce(bindings, &Dispatch { bounce, ..*constants }, living, stats)?;
            longest = longest.max(seconds);
            // The lists of an abandoned bounce contradict each other.
            if self.is_abandoned() {
                break;
            }
            self.record_counters()?;
            stats.submit(&mut self.recorder)?;
            stats.timed(stage::READ_FILM, || self.report(plan, tile, bounce, visit))?;
            if living == 0 {
                break;
            }
        }
        Ok(longest)
    }

    /// Calls `visit` with the contributions that `bounce` has found for a tile.
    fn report(
        &self,
        plan: &Plan,
        tile: &[TileSample],
        bounce: u32,
        visit: &mut impl FnMut(SensorContribution),
    ) -> Result<()> {
        let b = &self.buffers;
        let counters = self.read_counters(&mut Stats::default())?;
        let length = |list: u32| counters[list as usize] as usize;
        let parity = bounce as usize % 2;
        let seen = |[r, g, b, tau_or_weight]: [f32; 4], path: u32, vertex: Option<u32>, ellipsoidal: bool| {
            let pixel = tiles::crop_pixel(plan.crop, tile[path as usize][0]);
            SensorContribution { rgb: [r, g, b], tau_or_weight, path, pixel, t: bounce + 2, vertex, ellipsoidal }
        };

        // Emitter hits of the traced paths.
        let traced = b.living[parity].to_vec::<u32>(length(LIVING[parity]))?;
        b.emitted.with::<[f32; 4], _>(self.capacity, |emitted| {
            let lit = traced.iter().map(|&path| (emitted[path as usize], path)).filter(|(e, _)| *e != [0.0; 4]);
            lit.for_each(|(e, path)| visit(seen(e, path, None, false)));
        })?;

        if length(SHADE) == 0 {
            return Ok(());
        }
        // Connections, without those for which no shadow ray was traced.
        let slots = b.slot_list.to_vec::<u32>(length(CANDIDATES))?;
        let shade_list = b.shade_list.to_vec::<u32>(length(SHADE))?;
        let entries = self.capacity * self.slots as usize;
        let live: Vec<(u32, [f32; 4])> = b.contributions.with::<[f32; 4], _>(entries, |contributions| {
            let all = slots.iter().map(|&slot| (slot, contributions[slot as usize]));
            all.filter(|(_, c)| c[3] > NOT_TRACED).collect()
        })?;
        b.candidates.with::<Candidate, _>(entries, |candidates| {
            for (slot, c) in live {
                let vertex = candidates[slot as usize].vertex;
                let ellipsoidal = vertex != SKY_VERTEX && vertex & ELLIPSOIDAL != 0;
                let vertex = if ellipsoidal { vertex & !ELLIPSOIDAL } else { vertex };
                visit(seen(c, shade_list[(slot / self.slots) as usize], Some(vertex), ellipsoidal));
            }
        })?;
        Ok(())
    }
}
