//! One bounce of a tile of sensor subpaths: trace, query, connect.

use super::*;

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
        stats.timed(stage::RECORD, || self.record_trace(bound, constants, living))?;
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

    pub(super) fn read_counters(&self, stats: &mut Stats) -> Result<[u32; COUNTERS]> {
        let mut counters = [0u32; COUNTERS];
        stats.timed(stage::READ_COUNTERS, || self.buffers.counters.read(0, &mut counters))?;
        Ok(counters)
    }

    /// Records the start of a path for every sample; returns what all dispatches of the tile share.
    pub(super) fn start_tile(&mut self, bound: &Bound, samples: &[TileSample]) -> Result<Dispatch> {
        let count = samples.len() as u32;
        let none = Dispatch { list_a: NONE, list_b: NONE, emitter: NONE, ..bytemuck::Zeroable::zeroed() };
        let constants = Dispatch { count, counter: LIVING[0], ..none };
        self.buffers.tile_samples.write(0, samples)?;
        let mut counters = [0u32; COUNTERS];
        counters[LIVING[0] as usize] = count;
        self.buffers.counters.write(0, &counters)?;
        let mut arguments = [1u32; COUNTERS];
        arguments[LIVING[0] as usize * 3] = self.kernels.trace.groups(count as usize);
        self.buffers.arguments.write(0, &arguments)?;
        let groups = self.kernels.start.groups(count as usize);
        self.recorder.dispatch("sensor_start", &self.kernels.start, &bound.start, &constants, groups)?;
        Ok(constants)
    }

    /// Traces the living paths of a bounce and lists those that go on and the new shade points.
    fn record_trace(&mut self, bound: &Bound, constants: &Dispatch, count: u32) -> Result<()> {
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let parity = constants.bounce as usize % 2;
        let (living, next) = (LIVING[parity], LIVING[1 - parity]);
        let lists = Dispatch { counter: living, list_a: next, list_b: SHADE, ..*constants };
        r.dispatch_indirect("sensor_trace", &k.trace, &bound.trace[parity], &lists, arguments(b, living))?;
        k.compaction.record(r, &bound.compact_paths[parity], &lists, count as usize)
    }

    /// Queries the `all` > 0 new shade points of a bounce: recorded with what follows if they are few, else in submits of their
    /// own, so that none is long though tiles are great.
    fn query(&mut self, bound: &Bound, constants: &Dispatch, all: u32, stats: &mut Stats) -> Result<()> {
        let (mut done, all) = (0, all as usize);
        while done < all {
            let part = self.part;
            let constants = Dispatch { counter: SHADE, rank: done as u32, ..*constants };
            let groups = self.kernels.query.groups(part.min(all - done));
            self.recorder.dispatch("shell_query", &self.kernels.query, &bound.query, &constants, groups)?;
            if all <= LEAST_PART {
                return Ok(());
            }
            let factor = change(stats.submit(&mut self.recorder)?);
            done += part;
            if factor < 1.0 || done <= all {
                let most = self.capacity.max(LEAST_PART);
                self.part = ((self.part as f64 * factor) as usize).clamp(LEAST_PART, most) / LEAST_PART * LEAST_PART;
            }
        }
        Ok(())
    }

    /// Connects the shade points to what was found for them and adds it to their paths.
    fn record_connections(&mut self, bound: &Bound, constants: &Dispatch, count: u32) -> Result<()> {
        let at = |counter: u32| Dispatch { counter, ..*constants };
        let lists = Dispatch { list_a: CANDIDATES, list_b: NONE, ..at(SHADE) };
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let entries = count as usize * self.slots as usize;
        k.compaction.record(r, &bound.compact_candidates, &lists, entries)?;
        r.dispatch_indirect("connect", &k.connect, &bound.connect, &at(CANDIDATES), arguments(b, CANDIDATES))?;
        r.dispatch_indirect("gather", &k.gather, &bound.gather, &at(SHADE), arguments(b, SHADE))
    }
}

/// Where the size of a dispatch over a list stands.
fn arguments(buffers: &Buffers, list: u32) -> (&Buffer, u64) {
    (&buffers.arguments, 3 * u64::from(list))
}
