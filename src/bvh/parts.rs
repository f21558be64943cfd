//! Divides the hierarchy into parts that take a short time to search.

use super::Bvh;
use crate::wgsl::layout::constants::PART_LEAVES;

impl Bvh {
    /// Parts that together cover each triangle once, for `search_part` (`shaders/shared/ellipsoid_search.wgsl`). A part is
    /// the index of a node with at most `max_triangles` triangles below it. Larger nodes are divided. If a divided node has leaves as
    /// children, their triangles form a part: the index of the node with the bit [`PART_LEAVES`]. Without triangles the list is [0],
    /// because the device then has one empty node.
    pub fn parts(&self, max_triangles: u32) -> Vec<u32> {
        let nodes = &self.host.nodes;
        if nodes.is_empty() {
            return vec![0];
        }
        // Children come after their parents, so this order sums children first.
        let mut below: Vec<u32> = nodes.iter().map(|node| own_triangles(&node.child_meta)).collect();
        for (i, node) in nodes.iter().enumerate().rev() {
            below[i] += children(node.child_base_idx, node.imask).map(|child| below[child as usize]).sum::<u32>();
        }
        let (mut parts, mut open) = (vec![], vec![0]);
        while let Some(i) = open.pop() {
            let node = &nodes[i as usize];
            if below[i as usize] <= max_triangles {
                parts.push(i);
                continue;
            }
            if own_triangles(&node.child_meta) > 0 {
                parts.push(i | PART_LEAVES);
            }
            open.extend(children(node.child_base_idx, node.imask));
        }
        parts
    }
}

fn children(first: u32, imask: u8) -> std::ops::Range<u32> {
    first..first + imask.count_ones()
}

/// Number of triangles in the leaves among a node's children: the upper three bits of a leaf's byte count its triangles in unary.
fn own_triangles(child_meta: &[u8; 8]) -> u32 {
    let is_inner = |meta: u8| meta & 0x18 == 0x18;
    child_meta.iter().filter(|&&meta| !is_inner(meta)).map(|&meta| (meta >> 5).count_ones()).sum()
}
