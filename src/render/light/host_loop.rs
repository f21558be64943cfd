//! Traces light subpaths with a wait for each bounce: the host reads the new vertices and lists the paths that continue.

use super::*;
use crate::wgsl::layout::constants::{PATH_ALIVE, VERTEX_VALID};

impl Subpaths {
    /// Traces a batch, one bounce per submit. After each bounce, the host reads the new vertices and splats.
    pub(super) fn run_bounces(
        &mut self,
        plan: &Plan,
        batch: &Batch,
        pool: &mut LightPool,
        visit: &mut impl FnMut(Contribution),
        stats: &mut Stats,
    ) -> Result<()> {
        let constants = batch.constants();
        let mut living: Vec<u32> = (0..batch.count).collect();
        self.buffers.counters.write(&[batch.count])?;
        self.record_start(batch, &constants)?;
        stats.submit(&mut self.recorder)?;
        if batch.kind == BatchKind::BeamEvents {
            return stats.timed(stage::READ_LIGHT, || self.report_splats(plan, &living, 2, visit))?.add_to(stats);
        }
        stats.timed(stage::READ_LIGHT, || self.collect(plan, &living, batch, pool))?;
        if !plan.traces_light {
            return Ok(());
        }
        living = stats.timed(stage::READ_LIGHT, || self.survivors(&living))?;
        for bounce in 0..plan.max_depth - 1 {
            if living.is_empty() {
                break;
            }
            stats.timed(stage::UPLOAD, || {
                self.buffers.counters.write(&[living.len() as u32])?;
                self.buffers.list.write(0, &living)
            })?;
            let constants = Dispatch { bounce, ..constants };
            let groups = self.trace.0.groups(living.len());
            self.recorder.dispatch("light_trace", &self.trace.0, &self.trace.1, &constants, groups)?;
            if plan.splats {
                let groups = self.splat.0.groups(living.len());
                self.recorder.dispatch("light_splat", &self.splat.0, &self.splat.1, &constants, groups)?;
            }
            stats.submit(&mut self.recorder)?;
            stats.closest_rays += living.len() as u64;
            stats.light_rays += living.len() as u64;
            stats.timed(stage::READ_LIGHT, || self.collect(plan, &living, batch, pool))?;
            if plan.splats {
                let tally = stats.timed(stage::READ_LIGHT, || self.report_splats(plan, &living, bounce + 2, visit))?;
                tally.add_to(stats)?;
            }
            living = stats.timed(stage::READ_LIGHT, || self.survivors(&living))?;
        }
        Ok(())
    }

    /// Adds the new vertices of stored paths to the pool, in the order of the paths.
    fn collect(&self, plan: &Plan, living: &[u32], batch: &Batch, pool: &mut LightPool) -> Result<()> {
        self.buffers.vertices.with::<PathVertex, _>(self.vertices_in_use(living), |vertices| {
            for &slot in living.iter().take_while(|&&slot| batch.is_stored(plan, slot)) {
                let vertex = &vertices[slot as usize];
                if vertex.flags & VERTEX_VALID != 0 {
                    pool.push(batch.first + slot, vertex, plan.max_depth);
                }
            }
        })
    }

    fn survivors(&self, living: &[u32]) -> Result<Vec<u32>> {
        self.buffers.states.with::<PathState, _>(self.vertices_in_use(living), |states| {
            living.iter().copied().filter(|&slot| states[slot as usize].flags & PATH_ALIVE != 0).collect()
        })
    }

    fn vertices_in_use(&self, living: &[u32]) -> usize {
        living.last().map_or(0, |&slot| slot as usize + 1)
    }

    fn report_splats(
        &self,
        plan: &Plan,
        living: &[u32],
        s: u32,
        visit: &mut impl FnMut(Contribution),
    ) -> Result<Tally> {
        let n = self.vertices_in_use(living);
        let mut tally = Tally::new(plan);
        let details = self.buffers.splat_details.to_vec::<f32>(if plan.observe.has_splat_details() { n } else { 0 })?;
        self.buffers.splats.with::<[u32; 4], _>(n, |splats| {
            for &slot in living {
                let detail = details.get(slot as usize).copied().unwrap_or(1.0);
                tally.report(splats[slot as usize], detail, s, visit);
            }
        })?;
        Ok(tally)
    }
}
