//! The bounding volume hierarchy over the scene's triangles: obvhs' compressed wide nodes, 80 bytes each.

mod dense;
pub mod hash;

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::triangle::Triangle;

use crate::wgsl::layout::constants::STACK_SIZE;
use dense::Groups;

/// Triangles that a leaf of compressed wide nodes may hold.
const MAX_LEAF_TRIANGLES: u32 = 3;

/// Nodes as the kernels read them (five 16-byte words each), and the triangles in leaf order.
pub struct Bvh {
    pub nodes: Vec<[u32; 4]>,
    /// Input triangle of each leaf slot.
    pub order: Vec<u32>,
    /// The same hierarchy for traversal on the host.
    pub host: CwBvh,
}

/// Levels the kernels' stacks have room for.
pub const MAX_LEVELS: usize = STACK_SIZE as usize;

impl Bvh {
    fn new(host: CwBvh) -> Bvh {
        let mut nodes: Vec<[u32; 4]> = bytemuck::cast_slice::<_, u32>(&host.nodes).as_chunks::<4>().0.to_vec();
        if nodes.is_empty() {
            nodes = vec![[0; 4]; 5];
        }
        Bvh { nodes, order: host.primitive_indices.clone(), host }
    }

    /// Levels of nodes, 0 for an empty hierarchy.
    pub fn levels(&self) -> usize {
        let mut deepest = 0;
        let mut open = if self.host.nodes.is_empty() { vec![] } else { vec![(0usize, 1usize)] };
        while let Some((i, level)) = open.pop() {
            deepest = deepest.max(level);
            let node = &self.host.nodes[i];
            let first = node.child_base_idx as usize;
            open.extend((first..first + node.imask.count_ones() as usize).map(|child| (child, level + 1)));
        }
        deepest
    }
}

/// Builds the hierarchy, whatever lies in one place. `corners` are finite; none gives a hierarchy that no ray hits.
pub fn build(corners: &[[[f32; 3]; 3]]) -> Bvh {
    let triangle = |c: &[[f32; 3]; 3]| Triangle { v0: c[0].into(), v1: c[1].into(), v2: c[2].into() };
    let boxes: Vec<Aabb> = corners.iter().map(|c| triangle(c).aabb()).collect();
    let bvh = Bvh::new(match Groups::find(&boxes) {
        None => wide(&clustered(&boxes)),
        Some(groups) => wide(&groups.expand(clustered(&groups.boxes), &boxes)),
    });
    // Triangles nested over many orders of magnitude.
    if bvh.levels() > MAX_LEVELS { Bvh::new(wide(&dense::halved(&boxes))) } else { bvh }
}

/// The steps of `obvhs::cwbvh::builder::build_cwbvh_from_tris`, which in debug builds panics on deep hierarchies.
fn clustered(boxes: &[Aabb]) -> Bvh2 {
    const PARAMETERS: BvhBuildParams = BvhBuildParams::medium_build();
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        PARAMETERS.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        PARAMETERS.sort_precision,
        PARAMETERS.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut bvh, PARAMETERS.reinsertion_batch_ratio, None);
    bvh
}

fn wide(bvh: &Bvh2) -> CwBvh {
    bvh2_to_cwbvh(bvh, MAX_LEAF_TRIANGLES, true, false)
}

#[cfg(test)]
mod tests;
