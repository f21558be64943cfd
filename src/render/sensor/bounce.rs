//! One bounce of a tile of sensor subpaths: trace, query, connect.

use super::*;
use crate::render::pace::change;

impl SensorTracer {
    /// Traces the `living` paths of a bounce and queries the shade points they leave; what connects them is recorded only. Returns
    /// how many paths go on, and the seconds of the submit that traced them.
    pub(super) fn run_bounce(
        &mut self,
        bound: &Bound,
        constants: &Dispatch,
        living: u32,
        stats: &mut Stats,
    ) -> Result<(u32, f64)> {
        stats.timed(stage::RECORD, || {
            self.record_trace(bound, constants, living)?;
            self.record_counters()
        })?;
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

    /// Records a bounce of a tile whose paths may all live.
    pub(super) fn record_bounce(&mut self, bound: &Bound, constants: &Dispatch) -> Result<()> {
        self.record_trace(bound, constants, constants.count)?;
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let shade_points = Dispatch { counter: SHADE, ..*constants };
        r.dispatch_indirect("shell_query", &k.query, &bound.query, &shade_points, over(&b.arguments, SHADE))?;
        self.record_connections(bound, constants, constants.count)
    }

    /// Traces the living paths of a bounce, `most` at most, and lists those that go on and the new shade points.
    fn record_trace(&mut self, bound: &Bound, constants: &Dispatch, most: u32) -> Result<()> {
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let parity = constants.bounce as usize % 2;
        let (living, next) = (LIVING[parity], LIVING[1 - parity]);
        let lists = Dispatch { counter: living, list_a: next, list_b: SHADE, ..*constants };
        r.dispatch_indirect("sensor_trace", &k.trace, &bound.trace[parity], &lists, over(&b.arguments, living))?;
        k.compaction.record(r, &bound.compact_paths[parity], &lists, most as usize, &b.arguments)
    }

    /// Queries the `all` > 0 new shade points of a bounce. Queries of a few are recorded with the dispatches that follow; many are
    /// split into submits of their own, so that a large tile makes no long submit.
    fn query(&mut self, bound: &Bound, constants: &Dispatch, all: u32, stats: &mut Stats) -> Result<()> {
        let (mut done, all) = (0, all as usize);
        while done < all {
            let part = self.part;
            let constants = Dispatch { counter: SHADE, rank: done as u32, ..*constants };
            let groups = self.kernels.query.groups(part.min(all - done));
            self.recorder.dispatch("shell_query", &self.kernels.query, &bound.query, &constants, groups)?;
            if all <= MIN_QUERY_BATCH {
                return Ok(());
            }
            let factor = change(stats.submit(&mut self.recorder)?);
            done += part;
            if factor < 1.0 || done <= all {
                let most = self.capacity.max(MIN_QUERY_BATCH);
                self.part = ((self.part as f64 * factor) as usize).clamp(MIN_QUERY_BATCH, most) / MIN_QUERY_BATCH
                    * MIN_QUERY_BATCH;
            }
        }
        Ok(())
    }

    /// Connects the shade points, `most` at most, to what was found for them and adds it to their paths.
    fn record_connections(&mut self, bound: &Bound, constants: &Dispatch, most: u32) -> Result<()> {
        let at = |counter: u32| Dispatch { counter, ..*constants };
        let lists = Dispatch { list_a: CANDIDATES, list_b: NONE, ..at(SHADE) };
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let entries = most as usize * self.slots as usize;
        k.compaction.record(r, &bound.compact_candidates, &lists, entries, &b.arguments)?;
        r.dispatch_indirect("connect", &k.connect, &bound.connect, &at(CANDIDATES), over(&b.arguments, CANDIDATES))?;
        r.dispatch_indirect("gather", &k.gather, &bound.gather, &at(SHADE), over(&b.arguments, SHADE))
    }
}
