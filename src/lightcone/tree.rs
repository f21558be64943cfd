//! The hierarchy over light vertices (Sec. 5.2). Every node splits its vertices into equal halves along the dimension of greatest
//! extent: x, y, z or travel time. The record of a node stores the bounds of its two children, and their power buckets over travel
//! time (Sec. 5.5.2). The 3D tree of emitter points is the same tree with all v_tau = 0.

use rayon::join;

use crate::wgsl::layout::constants::{BUCKETS, LEAF_BIT, LEAF_FIRST};
use crate::wgsl::layout::{NONE, TreeChild, TreeNode};

/// A light vertex, as far as the tree needs it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Item {
    /// Position and travel time in the units of render space; finite.
    pub point: [f32; 4],
    /// Upper bound on every channel of phi; > 0. Any unit, but the same for all items.
    pub power: f32,
    /// Index by which the caller identifies the vertex.
    pub index: u32,
}

/// Parameters of [`Tree::build`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreeOptions {
    /// Maximum number of vertices in a leaf, 1 to 16.
    pub leaf_size: usize,
    /// Number of buckets per node, 1 to 8 (B of the paper).
    pub buckets: u32,
    /// Index of the tree's first node in the array of nodes that trees share.
    pub first_node: u32,
    /// Index of the tree's first vertex in the array of vertices that trees share.
    pub first_vertex: u32,
}

/// A flattened tree over items. Building it reorders the items so that every leaf is a range of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    /// Inner nodes in depth-first order.
    pub nodes: Vec<TreeNode>,
    /// Where a query starts: an inner node, or a leaf reference if one leaf holds all items, or [`NONE`] without items.
    pub root: u32,
}

/// Two halves are built in parallel only if the first has more than this many items.
const MAX_SEQUENTIAL_ITEMS: usize = 4096;

/// Lower bound on an item's power after scaling to a total of 1, so that no vertex gets probability 0 by underflow. Queries
/// divide the power by the square of a large distance and multiply it by the smallest overlap. The result must still be a normal
/// f32, because devices may flush subnormal numbers to 0.
const MIN_POWER: f32 = 1e-20;

impl Tree {
    /// Builds the tree over `items`, reorders them and scales their powers to a total of 1. It takes O(n log n) time and
    /// allocates only the nodes.
    pub fn build(items: &mut [Item], options: TreeOptions) -> Tree {
        Tree::build_with_separate_subtree(items, 0, options)
    }

    /// As [`Tree::build`], but the first `apart` items get a subtree of their own below the root. It is meant for a few items of
    /// large power. Without the subtree they would lie one by one in leaves full of other items, and queries could not choose
    /// among them.
    pub fn build_with_separate_subtree(items: &mut [Item], apart: usize, options: TreeOptions) -> Tree {
        if items.is_empty() {
            return Tree { nodes: vec![], root: NONE };
        }
        let total: f64 = items.iter().map(|i| f64::from(i.power)).sum();
        for item in items.iter_mut() {
            item.power = ((f64::from(item.power) / total) as f32).max(MIN_POWER);
        }
        let (builder, base, first) = (Builder { options }, options.first_node, options.first_vertex);
        let new_nodes = |count: usize| vec![bytemuck::Zeroable::zeroed(); count];
        let nodes_over = |items: &[Item]| inner_nodes(items.len(), options.leaf_size);
        let (apart, others) = items.split_at_mut(apart);
        if apart.is_empty() || others.is_empty() {
            let mut nodes = new_nodes(nodes_over(items));
            let root = builder.subtree(items, first, &mut nodes, base);
            return Tree { nodes, root: root.child };
        }
        let mut nodes: Vec<TreeNode> = new_nodes(1 + nodes_over(apart) + nodes_over(others));
        let (root, below) = nodes.split_at_mut(1);
        let (left_slots, right_slots) = below.split_at_mut(nodes_over(apart));
        let right_base = base + 1 + left_slots.len() as u32;
        root[0] = TreeNode {
            left: builder.subtree(apart, first, left_slots, base + 1),
            right: builder.subtree(others, first + apart.len() as u32, right_slots, right_base),
        };
        Tree { nodes, root: base }
    }
}

struct Builder {
    options: TreeOptions,
}

impl Builder {
    /// Builds the subtree over `items` into exactly `slots`. `first` is the index of its first vertex, `base` the index of its
    /// first slot. Returns the record by which its parent refers to it.
    fn subtree(&self, items: &mut [Item], first: u32, slots: &mut [TreeNode], base: u32) -> TreeChild {
        let (lo, hi) = bounds(items);
        let mut summary = self.summary(items, lo, hi);
        if items.len() <= self.options.leaf_size {
            summary.child = leaf_reference(first, items.len());
            return summary;
        }
        // Balanced split along the dimension of greatest extent among all four (Sec. 5.2); ties by index, so that the order of
        // the input does not matter.
        let axis = (0..4).max_by(|&a, &b| (hi[a] - lo[a]).total_cmp(&(hi[b] - lo[b]))).unwrap_or(0);
        let half = items.len() / 2;
        items.select_nth_unstable_by(half, |a, b| a.point[axis].total_cmp(&b.point[axis]).then(a.index.cmp(&b.index)));
        let (left_items, right_items) = items.split_at_mut(half);
        let (own, children) = slots.split_at_mut(1);
        let left_count = inner_nodes(half, self.options.leaf_size);
        let (left_slots, right_slots) = children.split_at_mut(left_count);
        let right_base = base + 1 + left_count as u32;
        let build_left = || self.subtree(left_items, first, left_slots, base + 1);
        let build_right = || self.subtree(right_items, first + half as u32, right_slots, right_base);
        let (left, right) =
            if half > MAX_SEQUENTIAL_ITEMS { join(build_left, build_right) } else { run_both(build_left, build_right) };
        own[0] = TreeNode { left, right };
        summary.child = base;
        summary
    }

    /// Bounds and bucket powers of a node; the caller sets `child`.
    fn summary(&self, items: &[Item], lo: [f32; 4], hi: [f32; 4]) -> TreeChild {
        let mut powers = [0.0f32; BUCKETS as usize];
        let scale = bucket_scale(lo[3], hi[3], self.options.buckets);
        let last = self.options.buckets as usize - 1;
        for item in items {
            powers[(((item.point[3] - lo[3]) * scale) as usize).min(last)] += item.power;
        }
        let (quantised, power_unit) = quantise(powers);
        TreeChild {
            lo: [lo[0], lo[1], lo[2]],
            tau_lo: lo[3],
            hi: [hi[0], hi[1], hi[2]],
            tau_hi: hi[3],
            buckets_low: u32::from_le_bytes([quantised[0], quantised[1], quantised[2], quantised[3]]),
            buckets_high: u32::from_le_bytes([quantised[4], quantised[5], quantised[6], quantised[7]]),
            power_unit,
            child: 0,
        }
    }
}

fn run_both<A, B>(a: impl FnOnce() -> A, b: impl FnOnce() -> B) -> (A, B) {
    (a(), b())
}

/// Buckets per unit of travel time. If the range is empty, every item falls into bucket 0.
pub fn bucket_scale(tau_lo: f32, tau_hi: f32, buckets: u32) -> f32 {
    buckets as f32 / (tau_hi - tau_lo).max(1e-30)
}

/// Returns eight powers in units of 1/255 of the largest, and that unit. Powers are rounded up, so that no bucket with a vertex
/// reads 0.
fn quantise(powers: [f32; 8]) -> ([u8; 8], f32) {
    let greatest = powers.iter().copied().fold(0.0f32, f32::max);
    let unit = (greatest / 255.0).max(f32::MIN_POSITIVE);
    (powers.map(|p| if p > 0.0 { (p / unit).ceil().clamp(1.0, 255.0) as u8 } else { 0 }), unit)
}

/// The smallest and the largest coordinates; infinite without items.
pub fn bounds(items: &[Item]) -> ([f32; 4], [f32; 4]) {
    let (mut lo, mut hi) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
    for item in items {
        for k in 0..4 {
            lo[k] = lo[k].min(item.point[k]);
            hi[k] = hi[k].max(item.point[k]);
        }
    }
    (lo, hi)
}

fn leaf_reference(first: u32, count: usize) -> u32 {
    assert!((1..=16).contains(&count) && first <= LEAF_FIRST, "leaf of {count} vertices from {first}");
    LEAF_BIT | ((count as u32 - 1) << 27) | first
}

/// Number of inner nodes of a balanced tree over `n` items: 0 up to the leaf size, otherwise 1 + the numbers of both halves.
fn inner_nodes(n: usize, leaf_size: usize) -> usize {
    // The sizes of all nodes on one level differ by at most 1, so the counts for n and n + 1 suffice.
    fn pair(n: usize, leaf_size: usize) -> (usize, usize) {
        if n < leaf_size {
            return (0, 0);
        }
        let (a, b) = pair(n / 2, leaf_size);
        let (even, odd, even_next) = (1 + 2 * a, 1 + a + b, 1 + 2 * b);
        let (this, next) = if n.is_multiple_of(2) { (even, odd) } else { (odd, even_next) };
        (if n <= leaf_size { 0 } else { this }, next)
    }
    pair(n, leaf_size).0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random_items(n: usize, seed: u64) -> Vec<Item> {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        (0..n as u32)
            .map(|index| Item { point: [next(), next(), next(), 4.0 * next()], power: next() + 1e-6, index })
            .collect()
    }

    fn options(leaf_size: usize) -> TreeOptions {
        TreeOptions { leaf_size, buckets: 8, first_node: 0, first_vertex: 0 }
    }

    /// Walks the tree and checks that every vertex is in exactly one leaf and inside the bounds of all its ancestors.
    fn validate(tree: &Tree, items: &[Item], leaf_size: usize) {
        let mut seen = vec![false; items.len()];
        let mut stack: Vec<(u32, Vec<TreeChild>)> = vec![(tree.root, vec![])];
        while let Some((reference, ancestors)) = stack.pop() {
            if reference & LEAF_BIT != 0 {
                let first = (reference & LEAF_FIRST) as usize;
                let count = ((reference >> 27) & 15) as usize + 1;
                assert!(count <= leaf_size);
                for i in first..first + count {
                    assert!(!seen[i]);
                    seen[i] = true;
                    for a in &ancestors {
                        let p = items[i].point;
                        assert!((0..3).all(|k| a.lo[k] <= p[k] && p[k] <= a.hi[k]));
                        assert!(a.tau_lo <= p[3] && p[3] <= a.tau_hi);
                        let b = (((p[3] - a.tau_lo) * bucket_scale(a.tau_lo, a.tau_hi, 8)) as usize).min(7);
                        let word = if b < 4 { a.buckets_low } else { a.buckets_high };
                        assert!(word.to_le_bytes()[b % 4] > 0, "a bucket that holds a vertex reads 0");
                    }
                }
                continue;
            }
            let node = tree.nodes[reference as usize];
            for child in [node.left, node.right] {
                let mut path = ancestors.clone();
                path.push(child);
                stack.push((child.child, path));
            }
        }
        assert!(seen.iter().all(|&s| s));
    }

    #[test]
    fn empty_and_single() {
        assert_eq!(Tree::build(&mut [], options(1)).root, NONE);
        let mut one = random_items(1, 1);
        let tree = Tree::build(&mut one, options(1));
        assert!(tree.nodes.is_empty());
        assert_eq!(tree.root, LEAF_BIT);
    }

    #[test]
    fn inner_node_counts_match_the_recursion() {
        fn slow(n: usize, leaf: usize) -> usize {
            if n <= leaf { 0 } else { 1 + slow(n / 2, leaf) + slow(n - n / 2, leaf) }
        }
        for leaf in [1, 2, 3, 8, 16] {
            for n in 0..300 {
                assert_eq!(inner_nodes(n, leaf), slow(n, leaf), "{n} items, leaf {leaf}");
            }
        }
    }

    #[test]
    fn every_vertex_is_in_one_leaf_and_inside_its_ancestors() {
        for (n, leaf) in [(2, 1), (3, 1), (17, 4), (1000, 1), (1000, 16), (20_000, 8)] {
            let mut items = random_items(n, n as u64);
            let tree = Tree::build(&mut items, options(leaf));
            validate(&tree, &items, leaf);
        }
    }

    #[test]
    fn items_that_stand_apart_have_a_subtree_of_their_own() {
        for (n, apart, leaf) in [(2, 1, 16), (17, 1, 16), (17, 16, 1), (1000, 100, 16), (1000, 999, 16)] {
            let mut items = random_items(n, n as u64);
            let tree = Tree::build_with_separate_subtree(&mut items, apart, options(leaf));
            validate(&tree, &items, leaf);
            assert!(items[..apart].iter().all(|item| (item.index as usize) < apart), "{apart} of {n}");
            let [left, right] =
                [&items[..apart], &items[apart..]].map(|part| part.iter().map(|i| i.power).sum::<f32>());
            let root = &tree.nodes[tree.root as usize];
            for (child, power) in [(root.left, left), (root.right, right)] {
                let words = [child.buckets_low, child.buckets_high].map(u32::to_le_bytes);
                let sum = words.as_flattened().iter().map(|&b| f32::from(b)).sum::<f32>() * child.power_unit;
                assert!(sum >= power * 0.999 && sum <= power * 1.2, "{apart} of {n}: {sum} for {power}");
            }
        }
        for apart in [0, 5] {
            let (mut items, mut same) = (random_items(5, 1), random_items(5, 1));
            assert_eq!(
                Tree::build_with_separate_subtree(&mut items, apart, options(1)),
                Tree::build(&mut same, options(1))
            );
        }
    }

    #[test]
    fn degenerate_input() {
        let mut same = vec![Item { point: [1.0, 2.0, 3.0, 4.0], power: 1.0, index: 0 }; 100];
        for (i, item) in same.iter_mut().enumerate() {
            item.index = i as u32;
        }
        validate(&Tree::build(&mut same, options(1)), &same, 1);
        let mut uneven = random_items(1000, 3);
        for (i, item) in uneven.iter_mut().enumerate() {
            item.power = 10f32.powi((i % 60) as i32 - 37);
        }
        validate(&Tree::build(&mut uneven, options(4)), &uneven, 4);
    }

    #[test]
    fn the_order_of_the_input_does_not_matter() {
        let mut a = random_items(5000, 9);
        let mut b = a.clone();
        b.reverse();
        let (ta, tb) = (Tree::build(&mut a, options(1)), Tree::build(&mut b, options(1)));
        assert_eq!(a.iter().map(|i| i.index).collect::<Vec<_>>(), b.iter().map(|i| i.index).collect::<Vec<_>>());
        assert_eq!(ta.root, tb.root);
    }
}
