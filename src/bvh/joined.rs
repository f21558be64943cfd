//! Joins two hierarchies: one over the surfaces that stay, one over the surfaces that move.

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;

use super::{Bvh, wide_with};

/// Marks a child as a node; the low bits hold 24 plus its slot.
const INNER: u8 = 0b0010_0000;

impl Bvh {
    /// A hierarchy over the triangles of `first`, followed by those of `second`: a root with the roots of both as its children. It
    /// has one level more than the deeper of the two. If one has no triangles, the result is the other one.
    pub fn joined(first: &Bvh, second: &Bvh) -> Bvh {
        let halves = [&first.host, &second.host];
        if let Some(empty) = halves.iter().position(|half| half.primitive_indices.is_empty()) {
            return Bvh::new(halves[1 - empty].clone());
        }
        let (root, is_swapped) = root(halves.map(|half| half.total_aabb));
        let order = if is_swapped { [1, 0] } else { [0, 1] };
        let count = first.order.len() as u32;
        // Order of the nodes: the root, the roots of both halves, the other nodes of the first half, then of the second half.
        let offsets = [2, 1 + first.host.nodes.len() as u32];
        let moved = |half: usize, node: &CwBvhNode| CwBvhNode {
            child_base_idx: node.child_base_idx + offsets[half],
            primitive_base_idx: node.primitive_base_idx + [0, count][half],
            ..*node
        };
        let mut nodes = vec![root];
        nodes.extend(order.map(|half| moved(half, &halves[half].nodes[0])));
        for (half, bvh) in halves.iter().enumerate() {
            nodes.extend(bvh.nodes[1..].iter().map(|node| moved(half, node)));
        }
        let triangles = first.order.iter().copied().chain(second.order.iter().map(|i| count + i));
        Bvh::new(CwBvh {
            nodes,
            primitive_indices: triangles.collect(),
            total_aabb: halves[0].total_aabb.union(&halves[1].total_aabb),
            exact_node_aabbs: None,
            uses_spatial_splits: false,
        })
    }
}

/// A node with two nodes as children, which follow it and have these boxes. Also returns whether the child of the second box comes
/// first.
fn root(boxes: [Aabb; 2]) -> (CwBvhNode, bool) {
    let parent = Bvh2Node::new(boxes[0].union(&boxes[1]), 0, 1);
    let leaf = |i: usize| Bvh2Node::new(boxes[i], 1, i as u32);
    let pair = Bvh2 { nodes: vec![parent, leaf(0), leaf(1)], primitive_indices: vec![0, 1], ..Bvh2::default() };
    // One triangle per leaf, so that the two leaves stay apart.
    let pair = wide_with(&pair, 1);
    let mut node = pair.nodes[0];
    let mut children = vec![];
    for slot in 0..8u8 {
        let meta = &mut node.child_meta[usize::from(slot)];
        if *meta != 0 {
            children.push(pair.primitive_indices[node.primitive_base_idx as usize + usize::from(*meta & 31)]);
            *meta = INNER | (24 + slot);
            node.imask |= 1 << slot;
        }
    }
    assert_eq!(children.len(), 2, "the root has two children");
    (CwBvhNode { child_base_idx: 1, primitive_base_idx: 0, ..node }, children[0] == 1)
}
