//! Traces light subpaths with a wait for each bounce: the host reads the new vertices and lists the paths that continue.

use super::*;
use crate::wgsl::layout::constants::{PATH_ALIVE, VERTEX_VALID};

impl Subpaths {
    /// Starts the paths of a batch (round 0), or traces a bounce. Then reads the new vertices and splats. Returns the number of paths that
    /// continue; 0 after the last round.
    pub(super) fn run_round<V: FnMut(Contribution)>(
        &mut self,
        batch: &Batch,
        round: u32,
        is_last: bool,
        sink: &mut Sink<'_, V>,
        stats: &mut Stats,
    ) -> Result<u32> {
        let constants = batch.constants();
        if round == 0 {
            self.living = (0..batch.count).collect();
            self.buffers.counters.write(&[batch.count])?;
            self.record_start(batch, &constants)?;
        } else {
            let living = self.living.len();
            stats.timed(stage::UPLOAD, || {
                self.buffers.counters.write(&[living as u32])?;
                self.buffers.list.write(0, &self.living)
            })?;
            let constants = Dispatch { bounce: round - 1, ..constants };
            let (trace, splat) = (&self.trace, &self.splat);
            self.recorder.dispatch("light_trace", &trace.0, &trace.1, &constants, trace.0.groups(living))?;
            if sink.plan.splats {
                self.recorder.dispatch("light_splat", &splat.0, &splat.1, &constants, splat.0.groups(living))?;
            }
            stats.add_light_rays(living as u64);
        }
        stats.submit(&mut self.recorder)?;
        stats.timed(stage::READ_LIGHT, || {
            self.collect(batch, sink)?;
            self.living = if is_last { vec![] } else { self.survivors()? };
            Ok(self.living.len() as u32)
        })
    }

    /// Adds the new vertices to the pool, and reports their splats, in the order of the paths.
    fn collect<V: FnMut(Contribution)>(&self, batch: &Batch, sink: &mut Sink<'_, V>) -> Result<()> {
        let n = self.slots_in_use();
        let has_details = sink.plan.observe.has_splat_details();
        let details = self.buffers.splat_details.to_vec::<f32>(if has_details { n } else { 0 })?;
        let splats = self.buffers.splats.to_vec::<[u32; 4]>(if sink.plan.splats { n } else { 0 })?;
        self.buffers.vertices.with::<PathVertex, _>(n, |vertices| {
            for &slot in &self.living {
                let at = slot as usize;
                if vertices[at].flags & VERTEX_VALID != 0 {
                    let splat = splats.get(at).copied().unwrap_or_default();
                    sink.add(batch, slot, &vertices[at], splat, details.get(at).copied().unwrap_or(1.0));
                }
            }
        })
    }

    /// The paths that continue.
    fn survivors(&self) -> Result<Vec<u32>> {
        self.buffers.states.with::<PathState, _>(self.slots_in_use(), |states| {
            self.living.iter().copied().filter(|&slot| states[slot as usize].flags & PATH_ALIVE != 0).collect()
        })
    }

    fn slots_in_use(&self) -> usize {
        self.living.last().map_or(0, |&slot| slot as usize + 1)
    }
}
