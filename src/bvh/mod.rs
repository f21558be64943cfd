//! The bounding volume hierarchy over the triangles of the scene: compressed wide nodes (CWBVH) of obvhs, 80 bytes each.

mod dense;
pub mod hash;
mod joined;
mod parts;

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

/// Maximum number of triangles in a leaf of the compressed wide nodes.
const MAX_LEAF_TRIANGLES: u32 = 3;

/// The nodes in the layout of the kernels, and the order of the triangles in the leaves.
#[derive(Clone)]
pub struct Bvh {
    /// Five 16-byte words per node; one empty node if there are no triangles.
    pub nodes: Vec<[u32; 4]>,
    /// Index of the input triangle in each leaf slot.
    pub order: Vec<u32>,
    /// The same hierarchy for traversal on the host.
    pub host: CwBvh,
}

/// Maximum number of levels. One more fits the kernels' traversal stacks: the root that [`Bvh::joined`] may add.
pub const MAX_LEVELS: usize = STACK_SIZE as usize - 1;

impl Bvh {
    fn new(host: CwBvh) -> Bvh {
        let mut nodes: Vec<[u32; 4]> = bytemuck::cast_slice::<_, u32>(&host.nodes).as_chunks::<4>().0.to_vec();
        if nodes.is_empty() {
            nodes = vec![[0; 4]; 5];
        }
        Bvh { nodes, order: host.primitive_indices.clone(), host }
    }

    /// Number of levels of nodes; 0 for an empty hierarchy.
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

/// Builds the hierarchy over triangles with these `corners`, which must be finite. It has at most [`MAX_LEVELS`] levels, even if
/// many triangles share one place. Without triangles no ray hits anything.
pub fn build(corners: &[[[f32; 3]; 3]]) -> Bvh {
    let triangle = |c: &[[f32; 3]; 3]| Triangle { v0: c[0].into(), v1: c[1].into(), v2: c[2].into() };
    let boxes: Vec<Aabb> = corners.iter().map(|c| triangle(c).aabb()).collect();
    let groups = Groups::find(&boxes);
    let places = groups.as_ref().map_or(&boxes, |groups| &groups.boxes);
    if dense::are_nested(places) {
        return Bvh::new(wide(&dense::halved(&boxes)));
    }
    let outer = clustered(places);
    let bvh = Bvh::new(wide(&match &groups {
        None => outer,
        Some(groups) => groups.expand(outer, &boxes),
    }));
    // Triangles nested over many orders of magnitude can make the hierarchy deeper than the stacks.
    if bvh.levels() > MAX_LEVELS { Bvh::new(wide(&dense::halved(&boxes))) } else { bvh }
}

const PARAMETERS: BvhBuildParams = BvhBuildParams::medium_build();

/// Builds a hierarchy with the steps of `obvhs::cwbvh::builder::build_cwbvh_from_tris`. That function itself panics on deep
/// hierarchies in debug builds.
fn clustered(boxes: &[Aabb]) -> Bvh2 {
    let mut bvh = merged(boxes);
    ReinsertionOptimizer::default().run(&mut bvh, PARAMETERS.reinsertion_batch_ratio, None);
    bvh
}

/// The hierarchy of obvhs's builder, PLOC. Its `max_depth` is more than the number of passes.
fn merged(boxes: &[Aabb]) -> Bvh2 {
    PlocBuilder::with_capacity(boxes.len()).build(
        PARAMETERS.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        PARAMETERS.sort_precision,
        PARAMETERS.search_depth_threshold,
    )
}

fn wide(bvh: &Bvh2) -> CwBvh {
    wide_with(bvh, MAX_LEAF_TRIANGLES)
}

fn wide_with(bvh: &Bvh2, max_leaf_triangles: u32) -> CwBvh {
    bvh2_to_cwbvh(bvh, max_leaf_triangles, true, false)
}

#[cfg(test)]
mod tests;
