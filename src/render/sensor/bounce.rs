//! One bounce of the sensor subpaths of a tile: trace, query, connect.

use super::*;
use crate::render::responses::Adding;
use crate::render::submit_size::size_factor;

impl SensorSubpaths<'_> {
    /// Traces the living paths to their next shade points, and lists these.
    pub fn trace(&mut self, bounce: u32) -> Result<()> {
        self.constants.bounce = bounce;
        self.traced = self.living;
        self.unread += self.entries_of(self.living, self.living);
        let SensorSubpaths { tracer, bindings, adding, constants, traced, stats, .. } = self;
        stats.timed(stage::RECORD, || tracer.record_trace(bindings, *adding, constants, *traced))?;
        if !self.tracer.waits_per_bounce {
            return Ok(());
        }
        // The host reads the list lengths here, because even a dispatch over an empty list costs as much as tracing hundreds
        // of paths.
        let counters = self.submit()?;
        self.living = counters[LIVING[1 - self.parity()] as usize];
        self.shade_points = counters[SHADE as usize];
        self.unread -= self.entries_of(0, self.traced.saturating_sub(self.shade_points));
        Ok(())
    }

    /// Light-cone shell queries: chooses light vertices for the new shade points, and lists the live candidates.
    pub fn query(&mut self) -> Result<()> {
        if self.has_no_work() {
            return Ok(());
        }
        let SensorSubpaths { tracer, bindings, constants, shade_points, stats, .. } = self;
        if !tracer.waits_per_bounce {
            return stats.timed(stage::RECORD, || {
                tracer.record_queries(bindings, constants)?;
                tracer.record_candidates(bindings, constants, *shade_points)
            });
        }
        tracer.query(bindings, constants, *shade_points, stats)?;
        if tracer.is_abandoned() {
            return Ok(());
        }
        stats.timed(stage::RECORD, || tracer.record_candidates(bindings, constants, *shade_points))?;
        tracer.search_ellipsoids(bindings, constants, stats)
    }

    /// Records the connections of the listed candidates, and adds the contributions to the radiance of their paths. Then merges: adds
    /// the light of photons around the shade points.
    pub fn connect(&mut self) -> Result<()> {
        if self.has_no_work() {
            return Ok(());
        }
        let SensorSubpaths { tracer, bindings, adding, constants, stats, .. } = self;
        let at = |counter: u32| Dispatch { counter, ..*constants };
        let (k, b, r) = (&tracer.kernels, &tracer.buffers, &mut tracer.recorder);
        let over = |list: u32| indirect_over(&b.arguments, list);
        stats.timed(stage::RECORD, || {
            r.dispatch_indirect("connect", &k.connect, &bindings.connect, &at(CANDIDATES), over(CANDIDATES))?;
            if let Some(adding) = adding {
                adding.record(r, &b.arguments, CANDIDATES, 1)?;
            }
            r.dispatch_indirect("gather", &k.gather, &bindings.gather, &at(SHADE), over(SHADE))?;
            let (Some(kernel), Some(bound)) = (&k.merge, &bindings.merge) else { return Ok(()) };
            r.dispatch_indirect("merge", kernel, bound, &at(SHADE), over(SHADE))?;
            match adding {
                Some(adding) if adding.merged_entries > 0 => {
                    adding.record(r, &b.arguments, SHADE, adding.merged_entries)
                }
                _ => Ok(()),
            }
        })
    }

    /// Which of the two lists of living paths holds the paths of the present bounce.
    pub(super) fn parity(&self) -> usize {
        self.constants.bounce as usize % 2
    }

    /// Whether the present bounce has no shade points, or the iteration is abandoned.
    fn has_no_work(&mut self) -> bool {
        self.shade_points == 0 || self.tracer.waits_per_bounce && self.tracer.is_abandoned()
    }
}

impl SensorTracer {
    /// Records a bounce of the living paths (at most `max`): their tracing, then the lists of continuing paths and of new shade
    /// points.
    fn record_trace(
        &mut self,
        bindings: &SensorBindings,
        adding: Option<&Adding>,
        constants: &Dispatch,
        max: u32,
    ) -> Result<()> {
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let parity = constants.bounce as usize % 2;
        let (living, next) = (LIVING[parity], LIVING[1 - parity]);
        let lists = Dispatch { counter: living, list_a: next, list_b: SHADE, ..*constants };
        r.dispatch_indirect(
            "sensor_trace",
            &k.trace,
            &bindings.trace[parity],
            &lists,
            indirect_over(&b.arguments, living),
        )?;
        if let Some(adding) = adding {
            adding.record(r, &b.arguments, living, 1)?;
        }
        k.compaction.record(r, &bindings.compact_paths[parity], &lists, max as usize, &b.arguments)
    }

    /// Records queries for the listed shade points, whatever their number.
    fn record_queries(&mut self, bindings: &SensorBindings, constants: &Dispatch) -> Result<()> {
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let shade_points = Dispatch { counter: SHADE, ..*constants };
        let over = indirect_over(&b.arguments, SHADE);
        r.dispatch_indirect(k.query_name, &k.query, &bindings.query, &shade_points, over)?;
        match (&k.ellipsoids, &bindings.ellipsoids) {
            (Some(kernel), Some(bound)) => {
                r.dispatch_indirect("ellipsoid_resample", kernel, bound, &shade_points, over)
            }
            _ => Ok(()),
        }
    }

    /// Queries the `all` > 0 new shade points of a bounce. If they are few, the query joins the next submit. If they are
    /// many, separate submits query them in batches, so that no submit takes long.
    fn query(&mut self, bindings: &SensorBindings, constants: &Dispatch, all: u32, stats: &mut Stats) -> Result<()> {
        let (mut done, all) = (0, all as usize);
        while done < all && !self.is_abandoned() {
            let batch = self.query_batch;
            let constants = Dispatch { counter: SHADE, rank: done as u32, ..*constants };
            let groups = self.kernels.query.groups(batch.min(all - done));
            let (name, kernel) = (self.kernels.query_name, &self.kernels.query);
            self.recorder.dispatch(name, kernel, &bindings.query, &constants, groups)?;
            if let (0, Some(kernel), Some(bound)) = (self.parts, &self.kernels.ellipsoids, &bindings.ellipsoids) {
                self.recorder.dispatch("ellipsoid_resample", kernel, bound, &constants, groups)?;
            }
            if all <= MIN_QUERY_BATCH {
                return Ok(());
            }
            let factor = size_factor(stats.submit(&mut self.recorder)?);
            done += batch;
            // A last batch that was not full and took less than the target time says nothing about a full one.
            if factor < 1.0 || done <= all {
                let max = self.capacity.max(MIN_QUERY_BATCH);
                let size = ((batch as f64 * factor) as usize).clamp(MIN_QUERY_BATCH, max);
                self.query_batch = size / MIN_QUERY_BATCH * MIN_QUERY_BATCH;
            }
        }
        Ok(())
    }

    /// Records the list of the live candidates of the shade points (at most `max`).
    fn record_candidates(&mut self, bindings: &SensorBindings, constants: &Dispatch, max: u32) -> Result<()> {
        let lists = Dispatch { counter: SHADE, list_a: CANDIDATES, list_b: NONE, ..*constants };
        let (k, b, r) = (&self.kernels, &self.buffers, &mut self.recorder);
        let entries = max as usize * mark_words(self.slots as usize);
        k.compaction.record(r, &bindings.compact_candidates, &lists, entries, &b.arguments)
    }

    /// Chooses the triangles of all ellipsoidal connections, if the estimator forms them. Separate submits search parts of the BVH for
    /// some of the candidates, so that no submit takes long.
    fn search_ellipsoids(&mut self, bindings: &SensorBindings, constants: &Dispatch, stats: &mut Stats) -> Result<()> {
        if self.parts == 0 {
            return Ok(());
        }
        self.record_counters()?;
        stats.submit(&mut self.recorder)?;
        let candidates = self.read_counters(constants.count, stats)?[CANDIDATES as usize] as usize;
        let mut done = 0;
        while done < candidates {
            // Few candidates at a time if the BVH has many parts, but enough to fill the cores.
            let wanted = (self.search_batch / self.parts).max(MIN_SEARCH_BATCH);
            let batch = (wanted / MIN_SEARCH_BATCH * MIN_SEARCH_BATCH).min(candidates - done);
            let mut first = 0;
            while first < self.parts {
                let count = (self.search_batch / batch).clamp(1, self.parts - first);
                let part = Dispatch { first: first as u32, count: count as u32, rank: done as u32, ..*constants };
                let factor = size_factor(self.search(bindings, &part, batch, stats)?);
                if self.is_abandoned() {
                    return Ok(());
                }
                // A submit that was smaller than wanted and took less than the target time says nothing about a full one.
                if factor < 1.0 || batch * count >= self.search_batch {
                    let size = (batch * count) as f64 * factor;
                    self.search_batch = (size as usize).clamp(MIN_SEARCH_BATCH, MAX_SEARCH_BATCH);
                }
                first += count;
            }
            done += batch;
        }
        Ok(())
    }

    /// Searches parts of the BVH (`part.first`, `part.count`) for `batch` candidates from `part.rank` on. Returns the seconds.
    fn search(&mut self, bindings: &SensorBindings, part: &Dispatch, batch: usize, stats: &mut Stats) -> Result<f64> {
        let missing = "a tracer with parts of the BVH searches them";
        let (kernel, bound) = (self.kernels.ellipsoids.as_ref(), bindings.ellipsoids.as_ref());
        let (kernel, bound) = (kernel.expect(missing), bound.expect(missing));
        let part = Dispatch { counter: CANDIDATES, ..*part };
        self.recorder.dispatch("ellipsoid_triangles", kernel, bound, &part, kernel.groups(batch))?;
        stats.submit(&mut self.recorder)
    }
}
