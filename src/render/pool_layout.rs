//! What the kernels must know of the light-vertex pool of an iteration.

use crate::estimators::PoolShape;
use crate::wgsl::layout::NONE;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoolLayout {
    pub deterministic: u32,
    pub emitter_points: u32,
    /// Roots of the trees over emitter points and over scattered vertices; NONE where a tree is empty or not built.
    pub tree3_root: u32,
    pub tree4_root: u32,
    /// Vertices of the longest light path; 0 where the pool is not ordered by path.
    pub longest_path: u32,
}

impl PoolLayout {
    /// The part of the layout that decides how many candidate slots a shade point has.
    pub fn shape(&self, queries: u32) -> PoolShape {
        PoolShape {
            has_emitter_points: self.emitter_points > 0,
            longest_path: self.longest_path,
            trees: u32::from(self.tree3_root != NONE) + u32::from(self.tree4_root != NONE),
            queries,
        }
    }
}
