//! `shared/importance.wgsl` against f64, and the tree traversal that samples by importance (`shared/resample.wgsl`).

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::render::material::Material;
use taugate::internals::wgsl::layout::constants::LEAF_FIRST;
use taugate::internals::wgsl::layout::{NONE, PathVertex, TreeChild};
use taugate_oracle::lightcone::bucket_interval;

use crate::shader_function::{ShaderFunction, contents};
use crate::statistics::{chi_square, level};
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&IMPORTANCE, &COSINE, &DESCEND, &SWITCHED, &REFILL];

/// The fields of [`Input`] in WGSL.
const INPUT: &str = "c: TreeChild, q: vec3<f32>, lo: f32, normal: vec3<f32>, hi: f32";

const IMPORTANCE: ShaderFunction = ShaderFunction {
    imports: &["importance"],
    input: INPUT,
    result: "power: f32, importance: f32, pruned: u32, pad: u32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, 1.0, 0.0, 0.0);
        let d = box_distances(input.q, input.c.lo, input.c.hi);
        result.power = power_through_gate(input.c, d, shell);
        result.importance = node_importance(input.c, Receiver(shell, input.normal, false, input.normal, 1.0, 0.0));
        result.pruned = u32(is_pruned(input.c.tau_lo, input.c.tau_hi, d, shell));",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    child: TreeChild,
    q: [f32; 3],
    lo: f32,
    normal: [f32; 3],
    hi: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    power: f32,
    importance: f32,
    pruned: u32,
    pad: u32,
}

/// Children of trees over a few vertices, with their vertices and a gate near the travel time through one of them.
fn cases(n: usize) -> Vec<(Input, Vec<Item>)> {
    let mut pcg = Pcg::new(5);
    let mut cases = vec![];
    while cases.len() < n {
        let size = [0.0, 1e-3, 0.3, 3.0][pcg.below(4)];
        let duration = [0.0, 1e-3, 0.5, 6.0][pcg.below(4)];
        let centre = direction(&mut pcg) * pcg.range(0.0, 10.0);
        let mut items: Vec<Item> = (0..2 + pcg.below(20) as u32)
            .map(|index| {
                let p = vec3(centre + size * direction(&mut pcg));
                let tau = (5.0 + duration * pcg.uniform()) as f32;
                Item { point: [p[0], p[1], p[2], tau], power: 10f64.powf(pcg.range(-4.0, 1.0)) as f32, index }
            })
            .collect();
        let tree = Tree::build(&mut items, options(1));
        let half = items.len() / 2;
        let q = direction(&mut pcg) * pcg.range(0.0, 12.0);
        let about = &items[pcg.below(items.len())].point;
        let lo = (dvec(&about[..3]) - q).length() + f64::from(about[3]) - pcg.range(-0.2, 0.6);
        let hi = if pcg.below(6) == 0 { 3e38 } else { lo + [1e-3, 0.1, 2.0][pcg.below(3)] };
        let normal = direction(&mut pcg);
        for (child, items) in [(tree.nodes[0].left, &items[..half]), (tree.nodes[0].right, &items[half..])] {
            let input = Input { child, q: vec3(q), lo: lo as f32, normal: vec3(normal), hi: hi as f32 };
            cases.push((input, items.to_vec()));
        }
    }
    cases
}

fn options(leaf_size: usize) -> TreeOptions {
    TreeOptions { leaf_size, buckets: 8, first_node: 0, first_vertex: 0 }
}

/// `power_through_gate` in f64, and the part of the power that rounding of the times may change.
fn expected_power(g: &Input) -> (f64, f64) {
    let (c, q) = (&g.child, dvec(&g.q));
    let (lo, hi) = (dvec(&c.lo), dvec(&c.hi));
    let near = (lo - q).max(q - hi).max(DVec3::ZERO).length();
    let far = (lo - q).abs().max((hi - q).abs()).length();
    let least = 1e-4 * far + 1e-12;
    let tau = [c.tau_lo, c.tau_hi].map(f64::from);
    let (spread, bucket) = ((far - near).max(least), ((tau[1] - tau[0]) / 8.0).max(least));
    let bytes = [c.buckets_low.to_le_bytes(), c.buckets_high.to_le_bytes()].concat();
    let mut sum = 0.0;
    for (b, &byte) in bytes.iter().enumerate() {
        let start = near + bucket_interval(tau, 8, b)[0];
        let overlap = f64::from(g.hi).min(start + spread + bucket) - f64::from(g.lo).max(start);
        if overlap >= 0.0 {
            sum += f64::from(byte) * f64::from(c.power_unit) * ((overlap / spread.max(bucket)).min(1.0) + 0.3);
        }
    }
    // A time of 20 m has a rounding error of 2e-6 m. The slope of the distribution is at most 1 / the longer interval.
    let shift = 1e-5 / spread.max(bucket).max(1e-9);
    (sum, shift)
}

#[test]
fn power_through_the_gate_is_that_of_overlapping_intervals() {
    let cases = cases(20_000);
    let inputs: Vec<Input> = cases.iter().map(|c| c.0).collect();
    let results: Vec<Got> = IMPORTANCE.run(&inputs, &[]);
    let (mut compared, mut live) = (0, 0);
    for (g, r) in inputs.iter().zip(&results) {
        let (expected, shift) = expected_power(g);
        assert!(r.power.is_finite() && r.power >= 0.0, "{g:?} {r:?}");
        let total = f64::from(g.child.power_unit) * 8.0 * 255.0;
        // Rounding decides whether a bucket at the edge of the gate is live, so a few cases may differ.
        if (f64::from(r.power) - expected).abs() <= (shift + 1e-3) * total {
            compared += 1;
        }
        live += usize::from(expected > 0.0);
    }
    assert!(compared as f64 > 0.98 * inputs.len() as f64, "{compared} of {}", inputs.len());
    assert!(live > inputs.len() / 3);
}

/// Travel times that differ only by rounding fill all buckets. A past bug: the intervals of such short buckets were
/// lengthened, which moved the later buckets out of a thin gate.
#[test]
fn a_node_of_one_time_counts_as_a_whole() {
    let mut pcg = Pcg::new(7);
    let inputs: Vec<Input> = (0..2_000)
        .map(|_| {
            let centre = direction(&mut pcg) * 10.0;
            let mut items: Vec<Item> = (0..40)
                .map(|index| {
                    let p = vec3(centre + 1e-5 * direction(&mut pcg));
                    Item { point: [p[0], p[1], p[2], 5.0 + 1e-5 * pcg.uniform() as f32], power: 1.0, index }
                })
                .collect();
            let child = Tree::build(&mut items, options(1)).nodes[0].left;
            Input { child, q: [0.0; 3], lo: 15.0 - 5e-5, normal: [0.0; 3], hi: 15.0 + 1e-4 }
        })
        .collect();
    let results: Vec<Got> = IMPORTANCE.run(&inputs, &[]);
    for (g, r) in inputs.iter().zip(&results) {
        let bytes = [g.child.buckets_low.to_le_bytes(), g.child.buckets_high.to_le_bytes()].concat();
        // Every bucket with power is live.
        let live = bytes.iter().map(|&byte| f32::from(byte)).sum::<f32>() * g.child.power_unit * 0.3;
        assert!(bytes.iter().filter(|&&byte| byte > 0).count() > 3 && r.power >= live, "{g:?} {r:?}");
    }
}

/// The importance of a node is 0 only if none of its vertices can contribute.
#[test]
fn a_node_that_can_contribute_is_important() {
    let cases = cases(20_000);
    let inputs: Vec<Input> = cases.iter().map(|c| c.0).collect();
    let results: Vec<Got> = IMPORTANCE.compile(&[("HAS_TRANSMISSION", 0.0)]).run(&inputs, &[]);
    let (mut valid, mut dropped) = (0, 0);
    for ((g, items), r) in cases.iter().zip(&results) {
        let q = dvec(&g.q);
        let contributes = items.iter().any(|i| {
            let offset = dvec(&i.point[..3]) - q;
            let tau = offset.length() + f64::from(i.point[3]);
            // The renderer widens the shell for rounding. These shells are not widened, so the test ignores vertices within
            // 1e-5 m of the gate's ends.
            offset.dot(dvec(&g.normal)) > 0.0 && tau > f64::from(g.lo) + 1e-5 && tau < f64::from(g.hi) - 1e-5
        });
        assert!(!contributes || (r.importance > 0.0 && r.pruned == 0), "{g:?} {r:?}");
        assert!(r.importance.is_finite(), "{g:?} {r:?}");
        valid += usize::from(contributes);
        dropped += usize::from(r.importance == 0.0);
    }
    assert!(valid > 2000 && dropped > 2000, "{valid} valid, {dropped} dropped");
}

const COSINE: ShaderFunction = ShaderFunction {
    imports: &["importance"],
    input: "normal: vec3<f32>, d_min: f32, lo: vec3<f32>, pad0: f32, hi: vec3<f32>, pad1: f32, q: vec3<f32>, pad2: f32",
    result: "cosine: f32",
    body: "result.cosine = box_cosine(input.normal, input.lo, input.hi, input.q, input.d_min);",
};

#[test]
fn the_cosine_of_a_box_bounds_that_of_its_points() {
    let mut pcg = Pcg::new(6);
    let inputs: Vec<[f32; 16]> = (0..20_000)
        .map(|_| {
            let n = direction(&mut pcg);
            let center = direction(&mut pcg) * pcg.range(0.0, 5.0);
            let extent = DVec3::new(pcg.uniform(), pcg.uniform(), pcg.uniform()) * [0.0, 0.1, 2.0][pcg.below(3)];
            let near = (center.abs() - extent).max(DVec3::ZERO).length();
            let [n, a, b] = [n, center - extent, center + extent].map(vec3);
            [n[0], n[1], n[2], near as f32, a[0], a[1], a[2], 0.0, b[0], b[1], b[2], 0.0, 0.0, 0.0, 0.0, 0.0]
        })
        .collect();
    let results: Vec<f32> = COSINE.run(&inputs, &[]);
    let mut behind = 0;
    for (g, &cosine) in inputs.iter().zip(&results) {
        let (n, lo, hi) = (dvec(&g[..3]), dvec(&g[4..7]), dvec(&g[8..11]));
        let (c, e) = (0.5 * (lo + hi), 0.5 * (hi - lo));
        let mut largest: f64 = -1.0;
        for _ in 0..20 {
            let inside = DVec3::new(pcg.range(-1.0, 1.0), pcg.range(-1.0, 1.0), pcg.range(-1.0, 1.0));
            largest = largest.max((c + inside * e).normalize_or_zero().dot(n));
        }
        assert!(cosine <= 1.0, "{g:?}: {cosine}");
        assert!(largest <= 0.0 || f64::from(cosine) >= largest - 1e-5, "{g:?}: bound {cosine}, cosine {largest}");
        behind += usize::from(cosine < 0.0);
    }
    assert!(behind > 2000, "only {behind} boxes behind the surface");
}

/// A corner of the box is 10 cm from q, and q is 10 m from the sensor. The corner is above the surface of q, but by less than
/// 1e-6 m: about one step of f32 coordinates.
#[test]
fn a_box_with_a_point_in_front_is_not_behind() {
    let mut pcg = Pcg::new(8);
    let mut inputs: Vec<[f32; 16]> = vec![];
    while inputs.len() < 20_000 {
        let (q, n) = (Vec3::from(vec3(direction(&mut pcg) * 10.0)), Vec3::from(vec3(direction(&mut pcg))));
        let along = n.any_orthonormal_vector();
        let corner = q + along * 0.1 + n * (1e-6 * pcg.range(-1.0, 1.0) as f32);
        let behind = corner - n.signum() * (1e-3 * pcg.uniform() as f32);
        if n.dot(corner - q) > 0.0 {
            let (lo, hi) = (corner.min(behind), corner.max(behind));
            let near = (lo - q).max(q - hi).max(Vec3::ZERO).length();
            inputs.push([n.x, n.y, n.z, near, lo.x, lo.y, lo.z, 0.0, hi.x, hi.y, hi.z, 0.0, q.x, q.y, q.z, 0.0]);
        }
    }
    let results: Vec<f32> = COSINE.run(&inputs, &[]);
    for (g, cosine) in inputs.iter().zip(results) {
        assert!(cosine >= 0.0, "{g:?}: the bound of the cosine is {cosine}");
    }
}

const SWITCHED: ShaderFunction = ShaderFunction {
    imports: &["importance"],
    input: INPUT,
    result: "importance: f32, power: f32, bucket_power: f32, distance2: f32, factor: f32, cosine: f32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, 1.0, 0.0, 0.0);
        let d = box_distances(input.q, input.c.lo, input.c.hi);
        let extent = 0.5 * (input.c.hi - input.c.lo);
        let center = 0.5 * (input.c.hi + input.c.lo) - input.q;
        result.importance = node_importance(input.c, Receiver(shell, input.normal, false, input.normal, 0.2, 0.6));
        result.power = power_through_gate(input.c, d, shell);
        result.bucket_power = bucket_power(input.c, d, shell);
        result.distance2 = node_distance2(center, extent, d.x);
        result.cosine = box_cosine(input.normal, input.c.lo, input.c.hi, input.q, d.x);
        result.factor = cosine_factor(result.cosine);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Switched {
    importance: f32,
    power: f32,
    bucket_power: f32,
    distance2: f32,
    factor: f32,
    cosine: f32,
}

/// Each factor of the importance can be switched off by itself. The documented value then replaces it.
#[test]
fn what_is_switched_off_takes_no_part() {
    let inputs: Vec<Input> = cases(2_000).into_iter().map(|c| c.0).collect();
    for position in 0..16 {
        let [centre, cosine, overlap, gloss] = [0, 1, 2, 3].map(|k| position >> k & 1 == 1);
        let switch = |on: bool| f64::from(u8::from(on));
        let kernel = SWITCHED.compile(&[
            ("HAS_TRANSMISSION", 0.0),
            ("BY_CENTRE", switch(centre)),
            ("BY_COSINE", switch(cosine)),
            ("BY_OVERLAP", switch(overlap)),
            ("BY_GLOSS", switch(gloss)),
        ]);
        let results: Vec<Switched> = kernel.run(&inputs, &[]);
        let (mut differ, mut behind) = (0, 0);
        for (g, r) in inputs.iter().zip(&results) {
            let (lo, hi, q) = (dvec(&g.child.lo), dvec(&g.child.hi), dvec(&g.q));
            let near = if centre { 0.5 * (lo + hi) - q } else { (lo - q).max(q - hi).max(DVec3::ZERO) };
            let distance2 = near.length_squared().max(0.25 * (hi - lo).length_squared());
            assert!((f64::from(r.distance2) / distance2 - 1.0).abs() < 1e-4, "{position} {g:?} {r:?} {distance2}");
            let factor = if cosine { f64::from(r.cosine).max(0.1) } else { 1.0 };
            assert!((f64::from(r.factor) - factor).abs() < 1e-6, "{position} {g:?} {r:?}");
            assert!(overlap || r.power == r.bucket_power, "{position} {g:?} {r:?}");
            differ += usize::from(r.power != r.bucket_power);
            if r.cosine < 0.0 {
                assert_eq!(r.importance, 0.0, "{position} {g:?} {r:?}");
                behind += 1;
            } else if r.importance > 0.0 {
                let center = 0.5 * (lo + hi) - q;
                let chord2 = (center.normalize() - dvec(&g.normal)).length_squared();
                let width = 0.2 + 0.25 * (hi - lo).length_squared() / distance2;
                let factor = if gloss { 0.4 * factor + 0.6 * width / (width + chord2).powi(2) } else { factor };
                let expected = (f64::from(r.power) * factor / distance2).max(1e-36);
                assert!((f64::from(r.importance) / expected - 1.0).abs() < 1e-3, "{position} {g:?} {r:?} {expected}");
            }
        }
        assert!(behind > 200 && (differ > 200) == overlap, "{position}: {behind} behind, {differ} differ");
    }
}

const REFILL: ShaderFunction = ShaderFunction {
    imports: &["frontier"],
    input: "u: f32, start: f32, part: f32, seed: u32",
    result: "rest: f32",
    body: "var rng = input.seed; result.rest = remap_uniform(input.u, input.start, input.part, &rng);",
};

/// `remap_uniform` stretches u from [start, start + part) to [0, 1), and draws the digits that u lacks.
///
/// Near 0, u has all digits of a float and the result is uniform. Elsewhere u has a step of up to 2^-24, and the result must
/// also be uniform within a step.
#[test]
fn what_is_refilled_is_uniform() {
    const N: usize = 200_000;
    let mut pcg = Pcg::new(9);
    for (start, part, range) in [(0.0f32, 0.008f32, 4e-5), (0.0, 0.3, 1e-6), (0.9, 0.02, 0.01), (0.25, 0.01, 0.02)] {
        let inputs: Vec<[u32; 4]> = (0..N)
            .map(|_| {
                let u = (f64::from(start) + f64::from(part) * range * pcg.uniform()) as f32;
                [u.to_bits(), start.to_bits(), part.to_bits(), pcg.next_u32()]
            })
            .collect();
        let results: Vec<f32> = REFILL.run(&inputs, &[]);
        let fits = |of: &dyn Fn(f64) -> f64| {
            let mut counts = vec![0.0; 16];
            results.iter().for_each(|&r| counts[(of(f64::from(r)) * 16.0).clamp(0.0, 15.5) as usize] += 1.0);
            chi_square(&counts, &[N as f64 / 16.0; 16])
        };
        let p = fits(&|r| r / range);
        assert!(p > level(8), "from {start} on {part}, {range}: {p:e}");
        // The result within a step of u, which is 2^-24 in [0.5, 1).
        let p = fits(&|r| (r * f64::from(part) * 2f64.powi(24)).fract());
        assert!(start == 0.0 || p > level(8), "steps from {start} on {part}, {range}: {p:e}");
    }
}

const DESCEND: ShaderFunction = ShaderFunction {
    imports: &["resample"],
    input: "q: vec3<f32>, root: u32, normal: vec3<f32>, lo: f32, hi: f32, u: f32, seed: u32, pad: u32",
    result: "leaf: u32, weight: f32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, 1.0, 0.0, 0.0);
        var rng = input.seed;
        let receiver = Receiver(shell, input.normal, false, input.normal, 1.0, 0.0);
        var frontier: Frontier;
        grow_frontier(&frontier, input.root, receiver);
        result.leaf = NONE;
        if (frontier.count > 0u) {
            let found = descend_by_importance(sample_frontier(&frontier, input.u, &rng), receiver, &rng);
            result.leaf = found.vertex; result.weight = found.weight;
        }",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Descent {
    q: [f32; 3],
    root: u32,
    normal: [f32; 3],
    lo: f32,
    hi: f32,
    u: f32,
    seed: u32,
    pad: u32,
}

/// With stratified random numbers, every leaf is drawn with the probability 1 / weight that the traversal returns. Every leaf
/// with a vertex that can contribute is drawn.
#[test]
fn leaves_come_up_with_the_probability_they_report() {
    const N: usize = 200_000;
    let mut pcg = Pcg::new(12);
    let (mut compared, mut contributing, mut worst, mut off): (usize, usize, f64, usize) = (0, 0, 0.0, 0);
    for (vertices, frontier) in [1u32, 2, 100, 3000].into_iter().flat_map(|n| [(n, 32.0), (n, 5.0), (n, 1.0)]) {
        let kernel = DESCEND.compile(&[("HAS_TRANSMISSION", 0.0), ("FRONTIER", frontier)]);
        let mut items: Vec<Item> = (0..vertices)
            .map(|index| {
                let p = vec3(direction(&mut pcg) * pcg.range(1.0, 4.0));
                Item { point: [p[0], p[1], p[2], pcg.range(3.0, 9.0) as f32], power: pcg.range(0.1, 2.0) as f32, index }
            })
            .collect();
        let tree = Tree::build(&mut items, options(8));
        let (q, normal) = (vec3(direction(&mut pcg)), vec3(direction(&mut pcg)));
        let inputs: Vec<Descent> = (0..N)
            .map(|i| {
                let u = ((i as f64 + pcg.uniform()) / N as f64).min(1.0 - 1e-7) as f32;
                Descent { q, root: tree.root, normal, lo: 6.0, hi: 8.0, u, seed: pcg.next_u32(), pad: 0 }
            })
            .collect();
        let no_vertex: [PathVertex; 1] = Zeroable::zeroed();
        let no_material: [Material; 1] = Zeroable::zeroed();
        let buffers = [
            contents("tree_nodes", &[tree.nodes.clone(), vec![Zeroable::zeroed()]].concat()),
            contents("light_vertices", &no_vertex),
            contents("materials", &no_material),
        ];
        let found: Vec<[u32; 2]> = kernel.run(&inputs, &buffers);
        let mut leaves = std::collections::BTreeMap::<u32, (usize, f64)>::new();
        for [leaf, weight] in found.into_iter().filter(|f| f[0] != NONE) {
            let weight = f64::from(f32::from_bits(weight));
            let entry = leaves.entry(leaf).or_insert((0, weight));
            entry.0 += 1;
            assert!((entry.1 / weight - 1.0).abs() < 1e-3, "{leaf:x}: {} and {weight}", entry.1);
        }
        let offset = |item: &Item| dvec(&item.point[..3]) - dvec(&q);
        let contributes = |item: &Item| {
            let tau = offset(item).length() + f64::from(item.point[3]);
            offset(item).dot(dvec(&normal)) > 1e-5 && tau > 6.0 + 1e-5 && tau < 8.0 - 1e-5
        };
        let covered = |index: usize| {
            let of = |&leaf: &u32| ((leaf & LEAF_FIRST) as usize, (leaf >> 27 & 15) as usize);
            leaves.keys().map(of).any(|(first, more)| (first..=first + more).contains(&index))
        };
        for (index, item) in items.iter().enumerate().filter(|(_, item)| contributes(item)) {
            contributing += 1;
            assert!(covered(index), "{item:?} of {vertices} was never drawn");
        }
        for (leaf, (count, weight)) in leaves {
            let expected = N as f64 / weight;
            if expected >= 100.0 {
                let z = (count as f64 - expected) / expected.sqrt();
                assert!(z.abs() < 5.0, "leaf {leaf:x} of {vertices} vertices: {count} draws, {expected:.1} expected");
                worst = worst.max(z.abs());
                compared += 1;
                // The test would detect probabilities that are 3 % wrong.
                let z = (count as f64 - 1.03 * expected) / expected.sqrt();
                off += usize::from(z.abs() >= 5.0);
            }
        }
    }
    assert!(compared > 50 && contributing > 500, "{compared} leaves, {contributing} vertices, worst {worst}");
    assert!(off > 5, "only {off} leaves detect an error of 3 %");
}
