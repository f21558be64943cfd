//! Reads what the device reports about the contributions of sensor subpaths (`shared/observed.wgsl`). Their entries stay on the device
//! until the tile is complete, or until there may be no room for those of another bounce.

use std::panic::resume_unwind;
use std::time::Instant;

use super::*;
use crate::render::contribution::Contribution;
use crate::render::responses::{Arrival, IndexInTile};
use crate::render::stats::computes_wrongly;
use crate::threads::spawn_scoped;

/// Margin for tiles with more entries per path than earlier tiles.
pub(super) const LIKELY: f64 = 1.125;
/// Minimum number of entries that are copied together with the film, if the device's memory is not mapped. Copying so few takes no
/// longer than another wait for the device.
const MIN_COPY: usize = 1 << 16;

/// The contributions of the sensor subpaths of a tile: bounce by bounce, first light of s = 0 (emitter hits, the sky), then
/// connections, each in the order of the paths. They come in several parts.
#[derive(Default)]
pub struct Found {
    /// For a plan with several responses. In each part, the pixels ascend within each bounce, first for s = 0 and then for connections.
    pub arrivals: Vec<Vec<Arrival<IndexInTile>>>,
    /// For a plan that observes times or strategies: all light of s = 0, and every connection that is not blocked.
    /// [`Observe::Times`] leaves out emitters in view, and s = 0 from the sky.
    pub contributions: Vec<Vec<Contribution>>,
}

impl SensorSubpaths<'_> {
    /// Whether the host reads the entries.
    pub(super) fn reads_entries(&self) -> bool {
        self.plan.observe != Observe::Nothing && self.adding.is_none()
    }

    /// Maximum number of entries of a bounce that traces `paths` paths and has `shade_points` shade points.
    pub(super) fn entries_of(&self, paths: u32, shade_points: u32) -> usize {
        paths as usize + shade_points as usize * (self.tracer.slots + self.plan.merged_entries()) as usize
    }

    /// Whether the entries of the next bounce fit behind those that the host has not read yet.
    pub(super) fn has_room(&self) -> bool {
        let next = self.entries_of(self.living, self.living);
        !self.reads_entries() || self.unread + next <= self.tracer.observed
    }

    /// Number of entries that the host has not read yet, according to the counters after a bounce. Fails if they are too many.
    pub(super) fn unread_after(&self, counters: &[u32; COUNTERS]) -> Result<usize> {
        if !self.reads_entries() {
            return Ok(0);
        }
        // As in sensor_trace.wgsl, connect.wgsl and merge.wgsl. The paths of the next bounce are listed, but not traced.
        let total = |list: u32| counters[(COUNTER_TOTALS + list) as usize];
        let next = counters[LIVING[1 - self.parity()] as usize];
        let traced =
            self.constants.count.wrapping_add(total(LIVING[0])).wrapping_add(total(LIVING[1])).wrapping_sub(next);
        let merged = self.plan.merged_entries().wrapping_mul(total(SHADE));
        let unread =
            traced.wrapping_add(total(CANDIDATES)).wrapping_add(merged).wrapping_sub(self.constants.first) as usize;
        match unread <= self.unread {
            true => Ok(unread),
            false => Err(computes_wrongly(&format!(
                "it reported {unread} contributions of paths that have {} at most",
                self.unread
            ))),
        }
    }

    /// Records the copy of the entries that the tile is likely to have, so that they need no wait of their own. Returns their number.
    pub(super) fn record_likely(&mut self) -> Result<usize> {
        if !self.reads_entries() {
            return Ok(0);
        }
        let likely = (f64::from(self.constants.count) * self.tracer.entries_per_path) as usize;
        let count = likely.max(MIN_COPY).min(self.unread);
        self.record_copy(count)?;
        Ok(count)
    }

    fn record_copy(&mut self, count: usize) -> Result<()> {
        let SensorTracer { buffers, recorder, .. } = &mut *self.tracer;
        recorder.read_back(&buffers.observed, (count * size_of::<SensorContribution>()) as u64)
    }

    /// Reads the first `count` entries, and makes room for others. `copied`: how many of them the last submit has copied, if the device's
    /// memory is not mapped.
    pub(super) fn read_observed(&mut self, count: usize, copied: usize) -> Result<()> {
        if count == 0 {
            return Ok(());
        }
        if count > copied {
            self.record_copy(count)?;
            let SensorSubpaths { tracer, stats, longest, .. } = self;
            *longest = longest.max(stats.submit(&mut tracer.recorder)?);
        }
        let start = Instant::now();
        let (arrivals, contributions) = match self.plan.observe {
            Observe::Nothing => (vec![], vec![]),
            Observe::Responses => (self.read(count, &|entry| self.arrival(entry))?, vec![]),
            Observe::Times | Observe::Strategies => (vec![], self.read(count, &|entry| self.contribution(entry))?),
        };
        self.found.arrivals.extend(arrivals);
        self.found.contributions.extend(contributions);
        self.stats.add_host(stage::READ_FILM, start.elapsed());
        self.constants.first += count as u32;
        self.unread = 0;
        Ok(())
    }

    /// The values that `keep` returns for the first `count` entries, in their order. Several threads call `keep`.
    fn read<T: Send>(
        &self,
        count: usize,
        keep: &(impl Fn(&SensorContribution) -> Result<Option<T>> + Sync),
    ) -> Result<Vec<Vec<T>>> {
        // In a bounce, the paths ascend twice, or three times: see `shared/observed.wgsl`.
        let lists = if self.plan.merged_entries() > 0 { 2 } else { 1 };
        let descents = lists * (self.constants.bounce as usize + 1);
        self.tracer.buffers.observed.with(count, |entries| in_parts(entries, MIN_PART, descents, keep))?
    }

    #[inline]
    fn arrival(&self, entry: &SensorContribution) -> Result<Option<Arrival<IndexInTile>>> {
        let Some((pixel, rgb)) = self.light(entry)? else { return Ok(None) };
        Ok(Some(Arrival { pixel, tau: entry.detail, rgb }))
    }

    fn contribution(&self, entry: &SensorContribution) -> Result<Option<Contribution>> {
        let Some((pixel, rgb)) = self.light(entry)? else { return Ok(None) };
        let is_ellipsoidal = !matches!(entry.vertex, NONE | SKY_VERTEX) && entry.vertex & ELLIPSOIDAL != 0;
        let s = match if is_ellipsoidal { entry.vertex & !ELLIPSOIDAL } else { entry.vertex } {
            NONE => 0,
            SKY_VERTEX => 1,
            vertex => match self.pool.vertices.get(vertex as usize) {
                Some(vertex) => (vertex.flags & VERTEX_DEPTH) + 1,
                None => return Err(computes_wrongly("it connected a light vertex that does not exist")),
            },
        };
        let has_tau = self.plan.observe == Observe::Times;
        let (tau, mis_weight) = if has_tau { (entry.detail, 1.0) } else { (f32::NAN, entry.detail) };
        let pixel = tiles::crop_pixel(self.plan.crop, self.tile.pixels()[pixel.0 as usize][0]);
        let t = (entry.path >> PATH_BITS) + 2;
        Ok(Some(Contribution { rgb, pixel, tau, mis_weight, s, t, ellipsoidal: is_ellipsoidal }))
    }

    /// The pixel of an entry, and its contribution to the mean of the pixel. `None` for an entry without light, and for a connection for
    /// which no shadow ray was traced. The kernels count values that are not finite as dropped, so they are left out too.
    #[inline]
    fn light(&self, entry: &SensorContribution) -> Result<Option<(IndexInTile, [f32; 3])>> {
        let SensorContribution { red, green, blue, detail, .. } = *entry;
        let is_black = |r: f32, g: f32, b: f32| r == 0.0 && g == 0.0 && b == 0.0;
        let is_traced = detail > NOT_TRACED;
        if is_black(red, green, blue) || !is_traced {
            return Ok(None);
        }
        let path = (entry.path & PATH_MASK) as usize;
        let index =
            *self.pixel_indices.get(path).ok_or_else(|| computes_wrongly("it traced a path that does not exist"))?;
        let pixels = self.tile.pixels();
        let share = 1.0 / (pixels[index as usize + 1][1] - pixels[index as usize][1]) as f32;
        let (red, green, blue) = (red * share, green * share, blue * share);
        let has_light = red.is_finite() && green.is_finite() && blue.is_finite() && !is_black(red, green, blue);
        Ok(has_light.then_some((IndexInTile(index), [red, green, blue])))
    }
}

/// The bits of `SensorContribution::path` that hold the path.
const PATH_MASK: u32 = (1 << PATH_BITS) - 1;

/// Minimum number of entries for each thread. Starting a thread takes as long as reading about a thousand entries.
const MIN_PART: usize = 1 << 15;

/// Calls `keep` with `entries`, in several threads if there are at least `min_part` entries for each of them. Returns the values that it
/// returns, in the order of the entries, in one part per thread. Fails if the paths descend more than `descents` times.
fn in_parts<T: Send>(
    entries: &[SensorContribution],
    min_part: usize,
    descents: usize,
    keep: &(impl Fn(&SensorContribution) -> Result<Option<T>> + Sync),
) -> Result<Vec<Vec<T>>> {
    let read_all = &|part: &[SensorContribution]| -> Result<Vec<T>> {
        let (mut found, mut before, mut descended) = (Vec::with_capacity(part.len()), 0, 0);
        for entry in part {
            // Later bounces have larger numbers in the high bits of `path`.
            descended += usize::from(entry.path < before);
            before = entry.path;
            if let Some(value) = keep(entry)? {
                found.push(value);
            }
        }
        match descended > descents {
            true => Err(computes_wrongly("it listed entries out of order")),
            false => Ok(found),
        }
    };
    let threads = rayon::current_num_threads().min(entries.len() / min_part).max(1);
    let mut parts = entries.chunks(entries.len().div_ceil(threads).max(1));
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
        let entry = |path: u32| SensorContribution { path, ..bytemuck::Zeroable::zeroed() };
        let found = |paths: &[u32], wrong: &[u32]| {
            let keep = |entry: &SensorContribution| match wrong.contains(&entry.path) {
                true => Err(computes_wrongly(&format!("entry {}", entry.path))),
                false => Ok((entry.path % 4 != 1).then_some(10 * entry.path)),
            };
            let entries: Vec<_> = paths.iter().copied().map(entry).collect();
            pool.install(|| in_parts(&entries, 1, 1, &keep)).map_err(|e| e.to_string())
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
        // The paths of a bounce ascend twice: first for s = 0, then for connections.
        assert_eq!(found(&[2, 3, 4, 0, 2, 2], &[]).unwrap().concat(), [20, 30, 40, 0, 20, 20]);
        let error = found(&[3, 2, 1, 4, 5, 6, 7, 8, 9], &[]).unwrap_err();
        assert!(error.contains("entries out of order"), "{error}");
    }
}
