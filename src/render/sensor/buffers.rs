//! Buffers of the sensor subpaths: what they need, their names in WGSL, and reading the film back.

use std::cell::RefCell;

use super::TileSample;
use crate::error::Result;
use crate::gpu::{Buffer, BufferDesc, Device, ReadBack, Recorder};
use crate::render::compaction::{ARGUMENTS, COUNTERS, chunk_counts};
use crate::render::plan::{Observe, Plan};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{Candidate, PathState, PathVertex};

/// Buffers of the sensor subpaths of a tile, and the film.
pub struct Buffers {
    pub tile_samples: Buffer,
    pub states: Buffer,
    pub shade_points: Buffer,
    pub radiance: Buffer,
    pub tallies: Buffer,
    pub emitted: Buffer,
    pub living: [Buffer; 2],
    pub shade_list: Buffer,
    pub slot_list: Buffer,
    pub marks: Buffer,
    pub chunk_counts: Buffer,
    pub candidates: Buffer,
    pub contributions: Buffer,
    pub counters: ReadBack,
    pub arguments: Buffer,
    pub film: ReadBack,
    pub film_tallies: ReadBack,
}

/// Buffers of a tracer.
pub const BUFFERS: usize = 18;

/// What the fields of [`Buffers`] need, in their order, for `paths` paths with `slots` candidates a shade point.
pub fn buffer_descs(plan: &Plan, paths: usize, slots: usize) -> [BufferDesc; BUFFERS] {
    let few = "use a smaller --resolution or fewer --queries";
    let entries = paths * slots.max(1);
    let film = plan.crop_pixels as usize;
    let words = |name: &'static str, n: usize| BufferDesc::of::<u32>(name, n, few);
    let quads = |name: &'static str, n: usize| BufferDesc::of::<[f32; 4]>(name, n, few);
    let pixels = |name: &'static str| BufferDesc::of::<[f32; 4]>(name, film, "use a smaller --resolution, or --crop");
    [
        BufferDesc::of::<TileSample>("samples of a tile", paths, few),
        BufferDesc::of::<PathState>("sensor path states", paths, few),
        BufferDesc::of::<PathVertex>("shade points", paths, few),
        quads("path radiance", paths),
        quads("path tallies", paths),
        quads("emitter hits", if plan.observe == Observe::Nothing { 1 } else { paths }),
        words("living paths", paths),
        words("living paths in turn", paths),
        words("shade point list", paths),
        words("candidate list", entries),
        quads("marks", entries.next_multiple_of(CHUNK as usize) / 4),
        BufferDesc::of::<[u32; 2]>("chunk counts", chunk_counts(entries), few),
        BufferDesc::of::<Candidate>("candidates", entries, few),
        quads("contributions", entries),
        words("counters", COUNTERS).read_back(),
        words("dispatch arguments", ARGUMENTS),
        pixels("film pixels").read_back(),
        pixels("film tallies").read_back(),
    ]
}

impl Buffers {
    pub fn new(device: &Device, plan: &Plan, paths: usize, slots: usize) -> Result<Buffers> {
        let buffer_descs = RefCell::new(buffer_descs(plan, paths, slots).into_iter());
        let desc = || buffer_descs.borrow_mut().next().expect("one need per field");
        let next = || Buffer::from_desc(device, &desc());
        let read_back = || ReadBack::from_desc(device, &desc());
        Ok(Buffers {
            tile_samples: next()?,
            states: next()?,
            shade_points: next()?,
            radiance: next()?,
            tallies: next()?,
            emitted: next()?,
            living: [next()?, next()?],
            shade_list: next()?,
            slot_list: next()?,
            marks: next()?,
            chunk_counts: next()?,
            candidates: next()?,
            contributions: next()?,
            counters: read_back()?,
            arguments: next()?,
            film: read_back()?,
            film_tallies: read_back()?,
        })
    }

    pub fn bindings(&self) -> Vec<(&str, &Buffer)> {
        vec![
            ("tile_samples", &self.tile_samples),
            ("states", &self.states),
            ("shade_points", &self.shade_points),
            ("radiance", &self.radiance),
            ("tallies", &self.tallies),
            ("emitted", &self.emitted),
            ("shade_list", &self.shade_list),
            ("slot_list", &self.slot_list),
            ("marks", &self.marks),
            ("chunk_counts", &self.chunk_counts),
            ("candidates", &self.candidates),
            ("contributions", &self.contributions),
            ("counters", self.counters.buffer()),
            ("arguments", &self.arguments),
            ("film", self.film.buffer()),
            ("film_tallies", self.film_tallies.buffer()),
        ]
    }

    /// Records that the submit ends with the film being there for [`Buffers::add_film`].
    pub fn read_film(&self, recorder: &mut Recorder) -> Result<()> {
        recorder.read_back(&self.film, self.film.buffer().size())?;
        recorder.read_back(&self.film_tallies, self.film_tallies.buffer().size())
    }

    /// Adds the film to `image`, calls `visit` with what was added and the sum, and returns its tallies, added up.
    pub fn add_film(&self, image: &mut [f32], visit: impl FnOnce(&[[f32; 4]], &[f32])) -> Result<[u64; 4]> {
        let pixels = image.len() / 3;
        self.film.with::<[f32; 4], _>(pixels, |film| {
            for (to, from) in image.chunks_exact_mut(3).zip(film) {
                for k in 0..3 {
                    to[k] += from[k];
                }
            }
            visit(film, image);
        })?;
        self.film_tallies.with::<[u32; 4], _>(pixels, |tallies| {
            let add = |mut sum: [u64; 4], t: &[u32; 4]| {
                for k in 0..4 {
                    sum[k] += u64::from(t[k]);
                }
                sum
            };
            tallies.iter().fold([0; 4], add)
        })
    }
}
