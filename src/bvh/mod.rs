//! The bounding volume hierarchy over the scene's triangles: obvhs' compressed wide nodes, 80 bytes each.

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::triangle::Triangle;

/// Nodes as the kernels read them (five 16-byte words each), and the triangles in leaf order.
pub struct Bvh {
    pub nodes: Vec<[u32; 4]>,
    /// Input triangle of each leaf slot.
    pub order: Vec<u32>,
    /// The same hierarchy for traversal on the host.
    pub host: CwBvh,
}

/// Levels the kernels' stacks have room for (STACK_SIZE in `shared/traverse.wgsl`).
pub const MOST_LEVELS: usize = 32;

impl Bvh {
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

/// Builds the hierarchy. `corners` are finite; none gives a hierarchy that no ray hits.
pub fn build(corners: &[[[f32; 3]; 3]]) -> Bvh {
    let triangles: Vec<Triangle> = corners
        .iter()
        .map(|c| Triangle { v0: Vec3A::from(c[0]), v1: Vec3A::from(c[1]), v2: Vec3A::from(c[2]) })
        .collect();
    let mut elapsed = std::time::Duration::ZERO;
    let host = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut elapsed);
    let mut nodes: Vec<[u32; 4]> = bytemuck::cast_slice::<_, u32>(&host.nodes).as_chunks::<4>().0.to_vec();
    if nodes.is_empty() {
        nodes = vec![[0; 4]; 5];
    }
    Bvh { nodes, order: host.primitive_indices.clone(), host }
}
