//! Traces sensor subpaths without a film and reports every contribution to the host.

use std::panic::resume_unwind;

use super::*;
use crate::gpu::ReadBack;
use crate::render::plan::Observe;
use crate::render::stats::computes_wrongly;
use crate::threads::spawn_scoped;
use crate::wgsl::layout::Candidate;
use crate::wgsl::layout::constants::NOT_TRACED;

/// A contribution of a sensor subpath.
pub struct SensorContribution {
    /// Value for one sample of the pixel. With [`Observe::Strategies`] the MIS weight is not included.
    pub rgb: [f32; 3],
    /// With [`Observe::Strategies`] the MIS weight; otherwise the travel time in units of the render space, 0 for
    /// light from the sky.
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
    /// As [`SensorTracer::run`], for a plan that observes contributions. The host waits for each bounce. Calls `visit` with all light of
    /// s = 0 (emitter hits, the sky) and with every connection that is not blocked. [`Observe::Times`] leaves out emitters in view, and
    /// s = 0 from the sky.
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
            let take = &mut |part: Vec<SensorContribution>| part.into_iter().for_each(&mut *visit);
            self.observe_bounces(plan, bindings, &tile.samples(), &constants, &mut Stats::default(), &Some, take)?;
        }
        Ok(())
    }

    /// Runs the bounces of a tile until no path lives, `max_depth` is reached, or the iteration is abandoned. Several threads call `keep`
    /// with the contributions. `take` gets the values that `keep` returns, bounce by bounce: first light of s = 0, then connections,
    /// each in the order of paths. Returns the seconds of the longest submit that traced or connected paths.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn observe_bounces<T: Send>(
        &mut self,
        plan: &Plan,
        bindings: &SensorBindings,
        tile: &[TileSample],
        constants: &Dispatch,
        stats: &mut Stats,
        keep: &(impl Fn(SensorContribution) -> Option<T> + Sync),
        take: &mut impl FnMut(Vec<T>),
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
            stats.timed(stage::READ_FILM, || self.report(plan, tile, &seen, keep, take))?;
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

    /// Calls `keep` with the contributions that a bounce has found for a tile, and `take` with the values that it returns.
    fn report<T: Send>(
        &self,
        plan: &Plan,
        tile: &[TileSample],
        seen: &Seen,
        keep: &(impl Fn(SensorContribution) -> Option<T> + Sync),
        take: &mut impl FnMut(Vec<T>),
    ) -> Result<()> {
        let (b, slots) = (&self.buffers, self.slots);
        let no_path = || computes_wrongly("it listed a path that does not exist");
        let found = |path: u32, [r, g, b, tau_or_weight]: [f32; 4], vertex: Option<u32>| {
            let pixel = tiles::crop_pixel(plan.crop, tile.get(path as usize).ok_or_else(no_path)?[0]);
            let ellipsoidal = vertex.is_some_and(|vertex| vertex != SKY_VERTEX && vertex & ELLIPSOIDAL != 0);
            let vertex = vertex.map(|vertex| if ellipsoidal { vertex & !ELLIPSOIDAL } else { vertex });
            let rgb = [r, g, b];
            Ok(keep(SensorContribution { rgb, tau_or_weight, path, pixel, t: seen.bounce + 2, vertex, ellipsoidal }))
        };

        // Emitter hits of the traced paths.
        let traced = b.living[seen.parity()].with(seen.traced as usize, <[u32]>::to_vec)?;
        let emitted = |emitted: &[[f32; 4]]| {
            in_parts(&traced, MIN_PART, |path| match emitted.get(path as usize) {
                Some(&value) if has_light(value) => found(path, value, None),
                Some(_) => Ok(None),
                None => Err(no_path()),
            })
        };
        b.emitted.with(tile.len(), emitted)??.into_iter().for_each(&mut *take);

        let (shade_points, entries) = seen.lengths(slots);
        if shade_points == 0 {
            return Ok(());
        }
        // Connections, without those for which no shadow ray was traced.
        let candidates = self.read_counters(tile.len() as u32, &mut Stats::default())?[CANDIDATES as usize];
        let slot_list = b.slot_list.with(candidates as usize, <[u32]>::to_vec)?;
        let shade_list = b.shade_list.with(shade_points, <[u32]>::to_vec)?;
        // `in_parts` checks that the slots ascend. If the shade points ascend too, connections come in the order of their paths.
        in_order(&shade_list)?;
        let vertices_of = |candidates: &[Candidate]| candidates.iter().map(|candidate| candidate.vertex).collect();
        let vertices: Vec<u32> = match plan.observe.has_vertices() {
            true => b.candidates.with(entries, vertices_of)?,
            false => vec![],
        };
        let no_candidate = || computes_wrongly("it listed a candidate that does not exist");
        let connections = |contributions: &[[f32; 4]]| {
            in_parts(&slot_list, MIN_PART, |slot| {
                let value = *contributions.get(slot as usize).ok_or_else(no_candidate)?;
                match has_light(value) && value[3] > NOT_TRACED {
                    true => found(shade_list[(slot / slots) as usize], value, vertices.get(slot as usize).copied()),
                    false => Ok(None),
                }
            })
        };
        b.contributions.with(entries, connections)??.into_iter().for_each(take);
        Ok(())
    }
}

fn has_light([r, g, b, _]: [f32; 4]) -> bool {
    [r, g, b] != [0.0; 3]
}

/// Minimum number of entries of a list for each thread. Starting a thread takes as long as reading about a thousand entries.
const MIN_PART: usize = 1 << 15;

/// Fails if the entries of a list do not ascend.
fn in_order(list: &[u32]) -> Result<()> {
    match list.is_sorted() {
        true => Ok(()),
        false => Err(computes_wrongly("it listed entries out of order")),
    }
}

/// Calls `read` with the entries of `list`, in several threads if the list has at least `min_part` entries for each of them. Returns
/// the values that it found, in the order of the list, in one part per thread. Fails if the entries of a part do not ascend.
fn in_parts<T: Send>(
    list: &[u32],
    min_part: usize,
    read: impl Fn(u32) -> Result<Option<T>> + Sync,
) -> Result<Vec<Vec<T>>> {
    let read_all = &|part: &[u32]| -> Result<Vec<T>> {
        in_order(part)?;
        part.iter().filter_map(|&entry| read(entry).transpose()).collect()
    };
    let threads = rayon::current_num_threads().min(list.len() / min_part).max(1);
    let mut parts = list.chunks(list.len().div_ceil(threads).max(1));
    let first = parts.next().unwrap_or_default();
    // The caller holds the lock of the device. A rayon thread that waits may take up a task that needs this lock, and would
    // then wait forever. So these are plain threads.
    std::thread::scope(|scope| {
        let others = parts.map(|part| spawn_scoped(scope, "read", move || read_all(part)));
        let others = others.collect::<Result<Vec<_>>>()?;
        let others = others.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
        std::iter::once(read_all(first)).chain(others).collect()
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_find_what_one_thread_finds() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let found = |list: &[u32], wrong: &[u32]| {
            let read = |entry: u32| match wrong.contains(&entry) {
                true => Err(computes_wrongly(&format!("entry {entry}"))),
                false => Ok((entry % 4 != 1).then_some(10 * entry)),
            };
            pool.install(|| in_parts(list, 1, read)).map_err(|e| e.to_string())
        };
        for (length, threads) in [(0, 1), (1, 1), (2, 2), (3, 3), (10, 3)] {
            let list: Vec<u32> = (0..length).map(|i| 3 * i).collect();
            let wanted: Vec<u32> = list.iter().filter(|&entry| entry % 4 != 1).map(|entry| 10 * entry).collect();
            let parts = found(&list, &[]).unwrap();
            assert_eq!((parts.len(), parts.concat()), (threads, wanted), "{list:?}");
        }
        // The parts are 0..4, 4..8 and 8..10. The first wrong entry of the list gives the error.
        let list: Vec<u32> = (0..10).collect();
        for (wrong, first) in [(&[9][..], "entry 9"), (&[8, 5, 7], "entry 5"), (&[4, 2], "entry 2")] {
            let error = found(&list, wrong).unwrap_err();
            assert!(error.contains(first), "{error}");
        }
        let error = found(&[0, 1, 2, 3, 5, 4, 6, 7], &[]).unwrap_err();
        assert!(error.contains("entries out of order"), "{error}");
    }
}
