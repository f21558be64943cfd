use std::time::{Duration, Instant};

use glam::Vec3A;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;

use super::dense::MAX_GROUP_FOR_OBVHS;
use super::*;

type Corners = [[f32; 3]; 3];

const ONE: Corners = [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.5]];

/// Pseudo-random numbers in [0, 1).
fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// `n` small triangles scattered through a room; they surround the triangles under test.
fn scattered(n: usize) -> Vec<Corners> {
    let mut next = random(1);
    let mut triangle = || {
        let at = [0; 3].map(|_| 8.0 * next() - 4.0);
        [(); 3].map(|_| at.map(|x| x + 0.05 * next()))
    };
    (0..n).map(|_| triangle()).collect()
}

/// `n` triangles of equal size, each rotated about the vertical axis by a random angle. Their centres lie within `apart` of each
/// other.
fn cards(n: usize, apart: f32) -> Vec<Corners> {
    let mut next = random(2);
    let mut card = || {
        let (sin, cos) = (6.3 * next()).sin_cos();
        let at = [0; 3].map(|_| apart * (next() - 0.5) - 0.3);
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]].map(|[x, y]| [at[0] + x * cos, at[1] + y, at[2] + x * sin])
    };
    (0..n).map(|_| card()).collect()
}

/// Checks that every triangle is in exactly one leaf, that every box contains the triangles below it, and that the hierarchy fits
/// the kernels' stacks.
fn check(name: &str, corners: &[Corners]) {
    let start = Instant::now();
    let bvh = build(corners);
    let seconds = start.elapsed().as_secs_f64();
    println!("{name}: {} triangles, {} levels, {seconds:.3} s", corners.len(), bvh.levels());
    assert!(bvh.levels() <= MAX_LEVELS, "{name}: {} levels", bvh.levels());
    // A build of 100,000 triangles takes less than 1 s. Quadratic time would take many minutes.
    assert!(seconds < 60.0, "{name}: {seconds} s");
    let mut order = bvh.order.clone();
    order.sort_unstable();
    assert!(order.iter().copied().eq(0..corners.len() as u32), "{name}: not every triangle once");
    check_boxes(&bvh, 0, corners, name);
}

/// Returns the bounds of the triangles below a node, after checking that the box of each child contains the triangles below that
/// child.
fn check_boxes(bvh: &Bvh, node: usize, corners: &[Corners], name: &str) -> Aabb {
    let mut all = Aabb::empty();
    let node = &bvh.host.nodes[node];
    for child in (0..8).filter(|&c| !node.is_child_empty(c)) {
        let below = if node.is_leaf(child) {
            let (first, count) = node.child_primitives(child);
            let members = &bvh.order[first as usize..(first + count) as usize];
            let points = members.iter().flat_map(|&i| corners[i as usize]);
            points.fold(Aabb::empty(), |mut b, p| *b.extend(Vec3A::from(p)))
        } else {
            check_boxes(bvh, node.child_node_index(child) as usize, corners, name)
        };
        let outer = node.child_aabb(child);
        // Tolerance for the rounding of the quantised planes; the kernels widen the planes by more than this.
        let slack = 4.0 * f32::EPSILON * outer.min.abs().max(outer.max.abs());
        let outer = Aabb::new(outer.min - slack, outer.max + slack);
        assert!(outer.min.cmple(below.min).all() && outer.max.cmpge(below.max).all(), "{name}: {outer:?} {below:?}");
        all = all.union(&below);
    }
    all
}

#[test]
fn what_lies_in_one_place_is_built_soon_and_flat() {
    let room = scattered(1000);
    let within = |shift: fn(&mut dyn FnMut() -> f32, f32) -> f32, n| {
        let mut next = random(3);
        (0..n).map(|_| ONE.map(|p| p.map(|x| shift(&mut next, x)))).collect::<Vec<Corners>>()
    };
    let cases: [(&str, Vec<Corners>); 10] = [
        ("copies", vec![ONE; 30_000]),
        ("points", vec![[[0.3, 0.3, -1.0]; 3]; 30_000]),
        ("needles", vec![[[0.3, 0.3, -1.0], [0.3, 0.8, -1.0], [0.3, 0.5, -1.0]]; 5000]),
        ("copies within an ulp", within(|next, x| if next() < 0.5 { x } else { x.next_up() }, 30_000)),
        ("copies within 1e-6", within(|next, x| x + 1e-6 * next(), 30_000)),
        ("copies within 1e-4", within(|next, x| x + 1e-4 * next(), 30_000)),
        ("cards with one centre", cards(100_000, 0.0)),
        ("cards with centres 1e-5 apart", cards(30_000, 1e-5)),
        ("cards with centres 1e-3 apart", cards(30_000, 1e-3)),
        ("a hundred and fifteen", vec![ONE; 115]),
    ];
    for (name, dense) in cases {
        check(name, &dense);
        check(&format!("{name} in a room"), &[room.clone(), dense].concat());
    }
    // The builder of obvhs alone makes a chain of these boxes.
    let copy = Triangle { v0: ONE[0].into(), v1: ONE[1].into(), v2: ONE[2].into() }.aabb();
    assert!(Bvh::new(wide(&clustered(&[copy; 500]))).levels() > MAX_LEVELS);
}

#[test]
fn triangles_nested_over_many_orders_of_magnitude_fit_the_stacks() {
    for (name, centre) in [("a corner", [0.0; 3]), ("a centre", [0.5, 0.5, -1.25])] {
        let nested = |k: i32| ONE.map(|p| [0, 1, 2].map(|i| (p[i] - centre[i]) * 1.05f32.powi(k - 900)));
        let corners: Vec<Corners> = (0..1600).map(nested).collect();
        check(&format!("nested about {name}"), &corners);
        // Without `halved` the hierarchy does not fit.
        let boxes: Vec<Aabb> = corners.iter().map(|c| Aabb::from_points(&c.map(Vec3A::from))).collect();
        assert!(Bvh::new(wide(&clustered(&boxes))).levels() > MAX_LEVELS, "{name}");
    }
}

/// With PLOC alone, the largest of these cases take minutes.
#[test]
fn many_triangles_that_contain_each_other_are_built_soon() {
    let shrunk = |x: f32, depth: f32| [[0.0; 3], [x, 0.0, 0.0], [0.0, x, depth * x]];
    let by_ratio = |n, ratio: f32, depth| (0..n).map(move |k: i32| shrunk(ratio.powi(-k), depth));
    let steps = |n: usize| (1..=n).map(move |k| [[0.0; 3], [k as f32 / n as f32, 0.0, 0.0], [0.0, 1e-3, 0.0]]);
    let cases: [(&str, Vec<Corners>); 5] = [
        ("few", steps(8000).collect()),
        ("a ratio of 1.0005", by_ratio(40_000, 1.0005, 0.0).collect()),
        ("a ratio of 1.0002", by_ratio(100_000, 1.0002, 0.3).collect()),
        ("a ratio of 1.002", by_ratio(100_000, 1.002, 0.1).collect()),
        ("equal steps", steps(100_000).collect()),
    ];
    for (name, nested) in cases {
        check(name, &nested);
        check(&format!("{name} in a room"), &[scattered(20_000), nested].concat());
    }
}

#[test]
fn a_scene_without_crowds_is_left_to_the_builder() {
    let corners = [scattered(3000), vec![ONE; MAX_GROUP_FOR_OBVHS]].concat();
    let triangles: Vec<Triangle> =
        corners.iter().map(|c| Triangle { v0: c[0].into(), v1: c[1].into(), v2: c[2].into() }).collect();
    let mut elapsed = Duration::ZERO;
    let usual = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut elapsed);
    let own = build(&corners);
    assert_eq!(own.order, usual.primitive_indices);
    assert_eq!(own.nodes, Bvh::new(usual).nodes);
}

/// Rays meet the same triangles in two hierarchies that are joined as in one over all triangles.
#[test]
fn joined_hierarchies_have_all_triangles() {
    let triangle = |x: f32, y: f32| [[x, y, 0.0], [x + 0.9, y, 0.1 * y], [x, y + 0.9, 0.3]];
    let grid = |from: i32, to: i32| -> Vec<[[f32; 3]; 3]> {
        (from..to).flat_map(|x| (0..10).map(move |y| triangle(x as f32, y as f32))).collect()
    };
    for [left, right] in
        [[grid(0, 8), grid(8, 11)], [grid(8, 11), grid(0, 8)], [grid(0, 3), vec![]], [vec![], grid(0, 3)]]
    {
        let joined = Bvh::joined(&build(&left), &build(&right));
        let all = [&left[..], &right].concat();
        let mut order = joined.order.clone();
        order.sort_unstable();
        assert!(order.iter().copied().eq(0..all.len() as u32));
        // Every triangle lies in the boxes on its way from the root.
        let slots = slots(&joined);
        assert_eq!(slots.len(), all.len());
        for (slot, [lo, hi]) in slots {
            for corner in all[joined.order[slot] as usize] {
                for k in 0..3 {
                    assert!(lo[k] <= corner[k] && corner[k] <= hi[k], "{corner:?} {lo:?} {hi:?}");
                }
            }
        }
        assert!(joined.levels() <= 1 + build(&left).levels().max(build(&right).levels()));
    }
}

/// Leaf slot of each triangle, and the intersection of the boxes on the way from the root to it.
fn slots(bvh: &Bvh) -> Vec<(usize, [[f32; 3]; 2])> {
    let mut found = vec![];
    let mut open = vec![(0usize, [[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]])];
    while let Some((index, [lo, hi])) = open.pop() {
        let node = &bvh.host.nodes[index];
        let mut child = node.child_base_idx as usize;
        for slot in 0..8 {
            let meta = node.child_meta[slot];
            if meta == 0 {
                continue;
            }
            let cell = [0, 1, 2].map(|k| f32::from_bits(u32::from(node.e[k]) << 23));
            let mins = [node.child_min_x, node.child_min_y, node.child_min_z];
            let maxs = [node.child_max_x, node.child_max_y, node.child_max_z];
            let at = |k: usize, q: [u8; 8]| node.p[k] + cell[k] * f32::from(q[slot]);
            let lo = [0, 1, 2].map(|k| lo[k].max(at(k, mins[k])));
            let hi = [0, 1, 2].map(|k| hi[k].min(at(k, maxs[k])));
            if node.imask >> slot & 1 == 1 {
                open.push((child, [lo, hi]));
                child += 1;
            } else {
                let first = node.primitive_base_idx as usize + usize::from(meta & 31);
                found.extend((0..(meta >> 5).count_ones() as usize).map(|i| (first + i, [lo, hi])));
            }
        }
    }
    found
}
