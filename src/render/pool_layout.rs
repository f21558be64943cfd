//! The layout of an iteration's light-vertex pool, for the kernels.

use crate::estimators::PoolShape;
use crate::wgsl::layout::NONE;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoolLayout {
    pub deterministic: u32,
    /// Number of vertices on emitters right after the deterministic vertices: see `emitter_vertex_count` in `shared/frame.wgsl`.
    pub emitter_vertices: u32,
    /// Roots of the trees over emitter points and over scattered vertices; NONE for a tree that is empty or not built.
    pub tree3_root: u32,
    pub tree4_root: u32,
    /// Number of vertices of the longest light path; 0 if the pool is not ordered by path.
    pub longest_path: u32,
    /// Number of all light vertices; 0 if the pool is not ordered by trees.
    pub vertices: u32,
    /// The lists of photons and the levels of their cells, as in `shared/frame.wgsl`.
    pub photon_list_mask: u32,
    pub photon_levels: [i32; 2],
}

impl PoolLayout {
    /// The values that determine the number of candidate slots per shade point.
    pub fn shape(&self, queries: u32, time_groups: u32) -> PoolShape {
        PoolShape {
            has_emitter_vertices: self.emitter_vertices > 0,
            longest_path: self.longest_path,
            trees: u32::from(self.tree3_root != NONE) + u32::from(self.tree4_root != NONE),
            queries,
            time_groups,
        }
    }
}
