//! Buffers of the sensor subpaths: their sizes, their names in WGSL, and reading the film back.

use super::tiles::{TilePixel, TileSample};
use crate::error::Result;
use crate::estimators::Ellipsoids;
use crate::gpu::{Allocate, Buffer, BufferDesc, Device, Recorder};
use crate::render::compaction::{ARGUMENTS, COUNTERS, chunk_counts, mark_words};
use crate::render::plan::{Observe, Plan};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{
    AuxiliaryPoint, Candidate, FogSegment, PathState, PathVertex, SensorContribution, TriangleChoice,
};

/// Buffers of the sensor subpaths of a tile, and the film.
pub struct Buffers<A: Allocate = Device> {
    pub tile_pixels: A::Buffer,
    pub tile_samples: A::Buffer,
    pub states: A::Buffer,
    pub shade_points: A::Buffer,
    pub segments: A::Buffer,
    pub radiance: A::Buffer,
    pub tallies: A::Buffer,
    pub living: [A::Buffer; 2],
    pub shade_list: A::Buffer,
    pub slot_list: A::Buffer,
    pub marks: A::Buffer,
    pub chunk_counts: A::Buffer,
    pub candidates: A::Buffer,
    pub bvh_parts: A::Buffer,
    pub choices: A::Buffer,
    pub auxiliary_points: A::Buffer,
    pub contributions: A::Buffer,
    pub observed: A::ReadBack,
    pub counters: A::ReadBack,
    pub arguments: A::Buffer,
    pub film: A::ReadBack,
    /// See `resolve.wgsl`. One word if nothing merges.
    pub merged_film: A::ReadBack,
}

impl<A: Allocate> Buffers<A> {
    /// Buffers for `paths` paths with `slots` candidate slots per shade point, and for `observed` contributions.
    pub fn new(to: &A, plan: &Plan, paths: usize, slots: usize, observed: usize) -> Result<Buffers<A>> {
        let few = "use a smaller --resolution or fewer --queries";
        let entries = paths * slots.max(1);
        let marks = paths * mark_words(slots.max(1));
        let words = |name: &'static str, n: usize| BufferDesc::of::<u32>(name, n, few);
        let quads = |name: &'static str, n: usize| BufferDesc::of::<[f32; 4]>(name, n, few);
        Ok(Buffers {
            // A pixel has at least one sample, and a tile has at least one pixel; one more entry ends the list.
            tile_pixels: to.buffer(BufferDesc::of::<TilePixel>("pixels of a tile", paths + 1, few))?,
            tile_samples: to.buffer(BufferDesc::of::<TileSample>("samples of a tile", paths, few))?,
            states: to.buffer(BufferDesc::of::<PathState>("sensor path states", paths, few))?,
            shade_points: to.buffer(BufferDesc::of::<PathVertex>("shade points", paths, few))?,
            segments: to.buffer(BufferDesc::of::<FogSegment>(
                "segments in fog",
                if plan.draws_in_gate() { paths } else { 1 },
                few,
            ))?,
            radiance: to.buffer(quads("path radiance", paths))?,
            tallies: to.buffer(quads("path tallies", paths))?,
            living: [to.buffer(words("living paths", paths))?, to.buffer(words("living paths in turn", paths))?],
            shade_list: to.buffer(words("shade point list", paths))?,
            slot_list: to.buffer(words("candidate list", entries))?,
            marks: to.buffer(quads("marks", marks.next_multiple_of(CHUNK as usize) / 4))?,
            chunk_counts: to.buffer(BufferDesc::of::<[u32; 2]>("chunk counts", chunk_counts(marks), few))?,
            candidates: to.buffer(BufferDesc::of::<Candidate>("candidates", entries, few))?,
            bvh_parts: to.buffer(words("parts of the BVH", plan.bvh_parts.len().max(1)))?,
            choices: to.buffer(BufferDesc::of::<TriangleChoice>(
                "triangles of ellipsoids",
                if plan.estimator.ellipsoids == Ellipsoids::Enumerated { entries } else { 1 },
                few,
            ))?,
            auxiliary_points: to.buffer(BufferDesc::of::<AuxiliaryPoint>(
                "auxiliary vertices",
                if plan.estimator.ellipsoids == Ellipsoids::Resampled { paths } else { 1 },
                few,
            ))?,
            contributions: to.buffer(quads("contributions", entries))?,
            observed: to.read_back_if(
                plan.observe != Observe::Nothing,
                BufferDesc::of::<SensorContribution>("observed contributions", observed, few),
            )?,
            counters: to.read_back(words("counters", COUNTERS))?,
            arguments: to.buffer(words("dispatch arguments", ARGUMENTS))?,
            film: to.read_back(BufferDesc::of::<[f32; 4]>(
                "film pixels",
                plan.image_pixels as usize,
                "use a smaller --resolution, or --crop",
            ))?,
            merged_film: to.read_back_if(
                plan.merging.is_some(),
                BufferDesc::of::<f32>(
                    "merged light of pixels",
                    if plan.merging.is_some() { plan.image_pixels as usize } else { 1 },
                    "use a smaller --resolution, or --merge off",
                ),
            )?,
        })
    }
}

impl Buffers {
    pub fn bindings(&self) -> Vec<(&str, &Buffer)> {
        vec![
            ("tile_pixels", &self.tile_pixels),
            ("tile_samples", &self.tile_samples),
            ("states", &self.states),
            ("shade_points", &self.shade_points),
            ("segments", &self.segments),
            ("radiance", &self.radiance),
            ("tallies", &self.tallies),
            ("shade_list", &self.shade_list),
            ("slot_list", &self.slot_list),
            ("marks", &self.marks),
            ("chunk_counts", &self.chunk_counts),
            ("candidates", &self.candidates),
            ("bvh_parts", &self.bvh_parts),
            ("choices", &self.choices),
            ("auxiliary_points", &self.auxiliary_points),
            ("contributions", &self.contributions),
            ("observed", self.observed.buffer()),
            ("counters", self.counters.buffer()),
            ("arguments", &self.arguments),
            ("film", self.film.buffer()),
            ("merged_film", self.merged_film.buffer()),
        ]
    }

    /// Records the copy of the film to the host, for [`Buffers::film`]. `merges`: also for [`Buffers::merged_light`].
    pub fn read_film(&self, merges: bool, recorder: &mut Recorder) -> Result<()> {
        if merges {
            recorder.read_back(&self.merged_film, self.merged_film.buffer().size())?;
        }
        recorder.read_back(&self.film, self.film.buffer().size())
    }

    /// Mean luminance of the merged light over so many pixels.
    pub fn merged_light(&self, pixels: usize) -> Result<f64> {
        let mean = |film: &[f32]| film.iter().map(|&light| f64::from(light)).sum::<f64>() / pixels as f64;
        self.merged_film.with::<f32, _>(pixels, mean)
    }

    /// The film: per pixel, the mean RGB of its samples, and in w the sum of their squared luminances.
    pub fn film(&self, pixels: usize) -> Result<Vec<[f32; 4]>> {
        self.film.with(pixels, <[_]>::to_vec)
    }
}
