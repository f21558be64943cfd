//! A hierarchy for scenes with many triangles in one place. The builder of obvhs (PLOC) merges the two neighbours with the
//! smallest union. If all boxes share a centre, all unions are equally large. PLOC then merges only one pair per pass: it takes
//! quadratic time and returns a chain of nodes. This module replaces such groups of triangles with balanced subtrees. Boxes that
//! contain each other, each a little larger than the one before, have the same effect; [`are_nested`] finds them.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

use super::hash::hash;
use super::merged;

/// Groups of at most this many triangles with a common centre are left to obvhs: its chain over them is only a few levels long.
pub const MAX_GROUP_FOR_OBVHS: usize = 16;
/// Side of the grid cells that define a common centre, relative to the diagonal of the triangle's box.
const CELL: f64 = 1.0 / 65536.0;
/// Lower bound on the side of the cells, relative to the largest coordinate of the centre: a few units in the last place.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;
/// Maximum number of boxes that [`are_nested`] looks at. PLOC takes up to 0.2 s for nested boxes, and less than 1 ms in the scenes of the
/// benches.
const SAMPLE: usize = 2048;
/// Maximum number of passes over the sample. The scenes of the benches take less than 100.
const MAX_PASSES: usize = 200;

/// Boxes for obvhs: one box per single triangle, and one box per group of triangles with a common centre.
pub struct Groups {
    pub boxes: Vec<Aabb>,
    /// Indices of the triangles in each of `boxes`.
    members: Vec<Vec<u32>>,
}

impl Groups {
    /// Groups the triangles with these boxes. `None` if no more than [`MAX_GROUP_FOR_OBVHS`] triangles share a centre.
    pub fn find(boxes: &[Aabb]) -> Option<Groups> {
        let mut keys: Vec<(u64, u32)> = boxes.par_iter().enumerate().map(|(i, b)| (cell_key(b), i as u32)).collect();
        keys.par_sort_unstable();
        if keys.windows(MAX_GROUP_FOR_OBVHS + 1).all(|run| run[0].0 != run[MAX_GROUP_FOR_OBVHS].0) {
            return None;
        }
        let mut groups = Groups { boxes: vec![], members: vec![] };
        for run in keys.chunk_by(|a, b| a.0 == b.0) {
            let members: Vec<u32> = run.iter().map(|&(_, i)| i).collect();
            match members.len() > MAX_GROUP_FOR_OBVHS {
                true => groups.members.push(members),
                false => groups.members.extend(members.into_iter().map(|i| vec![i])),
            }
        }
        // Keep the order of the scene: obvhs would see the triangles in this order without groups.
        groups.members.sort_unstable_by_key(|members| members[0]);
        groups.boxes = groups.members.iter().map(|members| union_of(boxes, members)).collect();
        Some(groups)
    }

    /// Turns the hierarchy `outer` over `self.boxes` into one over the triangles: a balanced subtree replaces the leaf of each
    /// group.
    pub fn expand(&self, outer: Bvh2, boxes: &[Aabb]) -> Bvh2 {
        let mut bvh = Bvh2 { nodes: outer.nodes, ..Bvh2::default() };
        for at in 0..bvh.nodes.len() {
            let node = bvh.nodes[at];
            if node.is_leaf() {
                let group = outer.primitive_indices[node.first_index as usize] as usize;
                balanced(&mut bvh, at, &mut self.members[group].clone(), boxes);
            }
        }
        bvh
    }
}

/// Whether so many boxes contain each other that PLOC would take quadratic time. Each of them prefers the next smaller one, so a pass
/// merges one pair of such a chain. Counts the passes over a sample. False for at most [`SAMPLE`] boxes.
pub fn are_nested(boxes: &[Aabb]) -> bool {
    if boxes.len() <= SAMPLE {
        return false;
    }
    let sample: Vec<Aabb> = boxes.iter().step_by(boxes.len().div_ceil(SAMPLE)).copied().collect();
    merged(&sample).max_depth > MAX_PASSES
}

/// A hierarchy over all triangles that halves their number on every level, wherever they lie. Its depth is log2 of their number,
/// rounded up.
pub fn halved(boxes: &[Aabb]) -> Bvh2 {
    let mut bvh = Bvh2 { nodes: vec![Bvh2Node::default()], ..Bvh2::default() };
    balanced(&mut bvh, 0, &mut (0..boxes.len() as u32).collect::<Vec<_>>(), boxes);
    bvh
}

/// Makes the node `at` the root of a balanced hierarchy over `members`, which is not empty.
fn balanced(bvh: &mut Bvh2, at: usize, members: &mut [u32], boxes: &[Aabb]) {
    let bounds = union_of(boxes, members);
    if let [only] = members {
        bvh.nodes[at] = Bvh2Node::new(bounds, 1, bvh.primitive_indices.len() as u32);
        bvh.primitive_indices.push(*only);
        return;
    }
    // Split along the axis with the largest extent of the centres; equal centres are ordered by their triangle index.
    let centre = |i: u32| boxes[i as usize].min + boxes[i as usize].max;
    let ends = members
        .iter()
        .fold([Vec3A::INFINITY, Vec3A::NEG_INFINITY], |[lo, hi], &i| [lo.min(centre(i)), hi.max(centre(i))]);
    let extent = ends[1] - ends[0];
    let axis = if extent.x >= extent.y.max(extent.z) {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    let middle = members.len() / 2;
    members.select_nth_unstable_by(middle, |&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.cmp(&b)));
    let first = bvh.nodes.len();
    bvh.nodes.extend([Bvh2Node::default(); 2]);
    bvh.nodes[at] = Bvh2Node::new(bounds, 0, first as u32);
    let (low, high) = members.split_at_mut(middle);
    balanced(bvh, first, low, boxes);
    balanced(bvh, first + 1, high, boxes);
}

fn union_of(boxes: &[Aabb], members: &[u32]) -> Aabb {
    members.iter().map(|&i| boxes[i as usize]).reduce(|a, b| a.union(&b)).unwrap_or_else(Aabb::empty)
}

/// A hash of the grid cell of the box's centre. Boxes of similar size with nearly the same centre have equal keys; other boxes
/// seldom do.
fn cell_key(b: &Aabb) -> u64 {
    let [lo, hi] = [b.min.as_dvec3(), b.max.as_dvec3()];
    let centre = 0.5 * (lo + hi);
    let cell = (CELL * (hi - lo).length()).max(ROUNDING * centre.abs().max_element()).max(f64::from(f32::MIN_POSITIVE));
    let exponent = cell.log2().ceil();
    // The offset keeps round coordinates, which are frequent, far from the borders of the cells.
    let cells = centre / exponent.exp2() + 0.37;
    hash([exponent, cells.x.floor(), cells.y.floor(), cells.z.floor()].map(|x| x as i64 as u64))
}
