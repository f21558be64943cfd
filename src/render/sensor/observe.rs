//! Reports the contributions of sensor subpaths to the host.

use std::panic::resume_unwind;
use std::time::Instant;

use super::tiles::TileSample;
use super::*;
use crate::gpu::ReadBack;
use crate::render::contribution::Contribution;
use crate::render::pool::SortedPool;
use crate::render::responses::{Arrival, IndexInTile};
use crate::render::stats::computes_wrongly;
use crate::threads::spawn_scoped;
use crate::wgsl::layout::Candidate;
use crate::wgsl::layout::constants::NOT_TRACED;

impl SensorSubpaths<'_> {
    /// The contributions of the present bounce, for a plan that observes times or strategies: all light of s = 0 (emitter hits, the
    /// sky) and every connection that is not blocked. [`Observe::Times`] leaves out emitters in view, and s = 0 from the sky.
    pub fn contributions(&mut self, pool: &SortedPool) -> Result<Vec<Vec<Contribution>>> {
        let (bounce, crop, has_tau) = (self.constants.bounce, self.plan.crop, self.plan.observe == Observe::Times);
        self.read(&|seen: Seen| {
            let Seen { rgb, detail, vertex, sample, .. } = seen;
            let ellipsoidal = vertex.is_some_and(|vertex| vertex != SKY_VERTEX && vertex & ELLIPSOIDAL != 0);
            let s = match vertex.map(|vertex| if ellipsoidal { vertex & !ELLIPSOIDAL } else { vertex }) {
                None => 0,
                Some(SKY_VERTEX) => 1,
                Some(vertex) => match pool.vertices.get(vertex as usize) {
                    Some(vertex) => (vertex.flags & VERTEX_DEPTH) + 1,
                    None => return Err(computes_wrongly("it connected a light vertex that does not exist")),
                },
            };
            let pixel = tiles::crop_pixel(crop, sample[0]);
            let (tau, mis_weight) = if has_tau { (detail, 1.0) } else { (f32::NAN, detail) };
            Ok(Some(Contribution { rgb, pixel, tau, mis_weight, s, t: bounce + 2, ellipsoidal }))
        })
    }

    /// The contributions of the present bounce, for a plan with several responses. In each part, the pixels ascend.
    pub fn arrivals(&mut self) -> Result<Vec<Vec<Arrival<IndexInTile>>>> {
        let indices = std::mem::take(&mut self.pixel_indices);
        let arrivals = self.read(&|Seen { rgb, detail, path, .. }: Seen| {
            // The kernels count values that are not finite as dropped, so the host leaves them out.
            let has_light = rgb.iter().all(|x| x.is_finite()) && rgb != [0.0; 3];
            let pixel = IndexInTile(indices[path as usize]);
            Ok(has_light.then_some(Arrival { pixel, tau: detail, rgb }))
        });
        self.pixel_indices = indices;
        arrivals
    }

    /// Reads what the present bounce has found. Several threads call `keep`. Returns the values that it returns: first for light of
    /// s = 0, then for connections, each in the order of paths. Returns nothing if the iteration is abandoned.
    fn read<T: Send>(&mut self, keep: &(impl Fn(Seen) -> Result<Option<T>> + Sync)) -> Result<Vec<Vec<T>>> {
        // The lists of an abandoned bounce contradict each other.
        if self.tracer.is_abandoned() {
            return Ok(vec![]);
        }
        let entries = self.shade_points as usize * self.tracer.slots as usize;
        self.record_reading(entries)?;
        let live = self.submit()?[CANDIDATES as usize] as usize;
        let start = Instant::now();
        let parts = self.read_lists(entries, live, keep);
        self.stats.add_host(stage::READ_FILM, start.elapsed());
        parts
    }

    /// Records the copies of everything that [`SensorSubpaths::read_lists`] reads.
    fn record_reading(&mut self, entries: usize) -> Result<()> {
        let parity = self.parity();
        let SensorSubpaths { tracer, plan, tile, traced, shade_points, stats, .. } = self;
        let (b, r) = (&tracer.buffers, &mut tracer.recorder);
        let mut read = |buffer: &ReadBack, count: usize, size: usize| r.read_back(buffer, (count * size) as u64);
        stats.timed(stage::RECORD, || {
            read(&b.living[parity], *traced as usize, size_of::<u32>())?;
            read(&b.emitted, tile.sample_count(), size_of::<[f32; 4]>())?;
            if *shade_points == 0 {
                return Ok(());
            }
            read(&b.shade_list, *shade_points as usize, size_of::<u32>())?;
            read(&b.slot_list, entries, size_of::<u32>())?;
            read(&b.contributions, entries, size_of::<[f32; 4]>())?;
            if plan.observe.has_vertices() { read(&b.candidates, entries, size_of::<Candidate>()) } else { Ok(()) }
        })
    }

    /// See [`SensorSubpaths::read`]. The shade points have `entries` candidate slots, with `live` candidates.
    fn read_lists<T: Send>(
        &self,
        entries: usize,
        live: usize,
        keep: &(impl Fn(Seen) -> Result<Option<T>> + Sync),
    ) -> Result<Vec<Vec<T>>> {
        let (b, slots) = (&self.tracer.buffers, self.tracer.slots);
        let no_path = || computes_wrongly("it listed a path that does not exist");
        let found = |path: u32, [r, g, b, detail]: [f32; 4], vertex: Option<u32>| {
            let sample = *self.samples.get(path as usize).ok_or_else(no_path)?;
            let share = 1.0 / (sample[1] >> 16) as f32;
            keep(Seen { rgb: [r, g, b].map(|x| x * share), detail, path, sample, vertex })
        };

        // Emitter hits of the traced paths.
        let traced = b.living[self.parity()].with(self.traced as usize, <[u32]>::to_vec)?;
        let emitted = |emitted: &[[f32; 4]]| {
            in_parts(&traced, MIN_PART, |path| match emitted.get(path as usize) {
                Some(&value) if has_light(value) => found(path, value, None),
                Some(_) => Ok(None),
                None => Err(no_path()),
            })
        };
        let mut parts = b.emitted.with(self.samples.len(), emitted)??;

        if self.shade_points == 0 {
            return Ok(parts);
        }
        // Connections, without those for which no shadow ray was traced.
        let slot_list = b.slot_list.with(live, <[u32]>::to_vec)?;
        let shade_list = b.shade_list.with(self.shade_points as usize, <[u32]>::to_vec)?;
        // `in_parts` checks that the slots ascend. If the shade points ascend too, connections come in the order of their paths.
        in_order(&shade_list)?;
        let vertices_of = |candidates: &[Candidate]| candidates.iter().map(|candidate| candidate.vertex).collect();
        let vertices: Vec<u32> = match self.plan.observe.has_vertices() {
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
        parts.extend(b.contributions.with(entries, connections)??);
        Ok(parts)
    }
}

/// What the device reports about a contribution of a sensor subpath.
struct Seen {
    /// Contribution to the mean of the pixel.
    rgb: [f32; 3],
    /// The number that [`Observe`] adds.
    detail: f32,
    /// Index of the subpath in its tile, and its sample.
    path: u32,
    sample: TileSample,
    /// Index in the pool of the connected light vertex, with the flag ELLIPSOIDAL; SKY_VERTEX for the sky. `None` without a connection:
    /// the subpath hit an emitter or left the scene. Always `None` with [`Observe::Responses`].
    vertex: Option<u32>,
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
