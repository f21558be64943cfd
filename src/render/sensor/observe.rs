//! The sensor subpaths as the probe runs them: without a film, every contribution shown with its travel time.

use super::*;

impl SensorTracer {
    /// As [`SensorTracer::run`] for a plan that probes, a bounce a submit: shows `see` the light (RGB) and the travel time of
    /// every emitter that was hit and every connection that was not blocked.
    pub fn observe(
        &mut self,
        plan: &Plan,
        bound: &Bound,
        samples: u32,
        see: &mut impl FnMut([f32; 3], f32),
    ) -> Result<()> {
        assert!(plan.probe && (1..=MOST_SAMPLES).contains(&samples));
        let all = plan.crop_pixels * u64::from(samples);
        let mut first = 0;
        while first < all {
            let whole_pixels = (self.tile / samples as usize).max(1) * samples as usize;
            let count = (whole_pixels as u64).min(all - first) as u32;
            let constants = self.start_tile(bound, first as u32, count)?;
            for bounce in 0..plan.max_depth {
                self.record_bounce(bound, &Dispatch { bounce, ..constants }, count)?;
                self.recorder.submit()?;
                if self.show(bounce, see)? == 0 {
                    break;
                }
            }
            first += u64::from(count);
        }
        Ok(())
    }

    /// Shows what the bounce has found; returns how many paths go on.
    fn show(&self, bounce: u32, see: &mut impl FnMut([f32; 3], f32)) -> Result<u32> {
        let b = &self.buffers;
        let mut counters = [0u32; COUNTERS];
        b.counters.read(0, &mut counters)?;
        let length = |list: u32| counters[list as usize] as usize;
        let parity = bounce as usize % 2;

        // Emitters that were hit, by the paths that were traced.
        let traced = b.living[parity].to_vec::<u32>(length(LIVING[parity]))?;
        b.emitted.with::<[f32; 4], _>(self.capacity, |emitted| {
            traced.iter().map(|&path| emitted[path as usize]).for_each(|[r, g, b, tau]| see([r, g, b], tau));
        })?;

        // Connections; a negative travel time marks those for which no ray was traced.
        let slots = b.slot_list.to_vec::<u32>(length(CANDIDATES))?;
        let entries = self.capacity * self.slots as usize;
        b.contributions.with::<[f32; 4], _>(entries, |contributions| {
            let live = slots.iter().map(|&slot| contributions[slot as usize]).filter(|c| c[3] >= 0.0);
            live.for_each(|[r, g, b, tau]| see([r, g, b], tau));
        })?;
        Ok(counters[LIVING[1 - parity] as usize])
    }
}
