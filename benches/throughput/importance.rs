//! Queries by importance, as in `lcs`: stratified traversals from a frontier to leaves of 16 vertices, and the choice of one vertex
//! per leaf. Both sides leave out the rest of shell_resample: the BSDFs and the MIS weight of one candidate per query.

use std::collections::VecDeque;

use glam::Vec3;
use rayon::prelude::*;
use taugate::internals::gpu::{Buffer, Device, Kernel, Recorder};
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::render::leaf_record;
use taugate::internals::render::material::{Features, Material};
use taugate::internals::wgsl::layout::constants::{LEAF_BIT, LEAF_FIRST, MAX_SUBTREES};
use taugate::internals::wgsl::layout::{Dispatch, Frame, Medium, NONE, PathVertex, TreeChild, TreeNode};

use super::Sizes;
use super::points::{GATE, Point, fine_uniform, hash32};

/// Queries per shade point.
const QUERIES: u32 = 16;
/// Maximum number of vertices per leaf.
const LEAF_SIZE: usize = 16;
const MAX_DEPTH: u32 = 24;

/// Constants of `shared/importance.wgsl`, `shared/frontier.wgsl` and `shared/leaf.wgsl`.
const LIVE_BUCKET_SHARE: f32 = 0.3;
const MIN_COSINE: f32 = 0.1;
const POWER_PROBABILITY: f32 = 1.0 / 16.0;
const MIN_IMPORTANCE: f32 = 1e-36;
const UNIFORM_STEP: f32 = 1.0 / 16_777_216.0;
const MAX_VISITS: usize = 64;
const MIN_SHARE: f32 = 1.0 / 1024.0;
const DIRECTION_ERROR: f32 = 0.002;

const KERNEL: &str = "
#import resample
@group(2) @binding(7) var<storage, read_write> found: array<u32>;
@compute @workgroup_size(WORKGROUP)
fn bench_importance(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) {
        return;
    }
    let q = load_shade_point(id.x);
    let receiver = Receiver(make_shell(q), q.geometric, false, q.normal, 1.0, 0.0);
    var rng = hash32(id.x);
    let jitter = min(next_fine_uniform(&rng), 1.0 - UNIFORM_STEP);
    var alive = 0u;
    var frontier: Frontier;
    grow_frontier(&frontier, frame.tree4_root, receiver);
    if (frontier.count == 0u) {
        found[id.x] = 0u;
        return;
    }
    for (var k = 0u; k < frame.queries; k++) {
        let u = (f32(k) + jitter) / f32(frame.queries);
        let leaf = descend_by_importance(sample_frontier(&frontier, u, &rng), receiver, &rng);
        if (leaf.vertex != NONE) {
            alive += select(0u, 1u, choose_in_leaf(q, leaf, &rng).vertex != NONE);
        }
    }
    found[id.x] = alive;
}
";

/// A shade point: position, normal, and the ends of the gate minus q_tau.
struct Receiver {
    q: Vec3,
    n: Vec3,
    lo: f32,
    hi: f32,
}

fn power_through_gate(c: &TreeChild, near: f32, far: f32, r: &Receiver) -> f32 {
    let least = 1e-4 * far + 1e-12;
    let spread = (far - near).max(least);
    let bucket_width = (c.tau_hi - c.tau_lo) / 8.0;
    let bucket = bucket_width.max(least);
    let (length, density) = (spread + bucket, 1.0 / spread.max(bucket));
    let bytes = (u64::from(c.buckets_low) | u64::from(c.buckets_high) << 32).to_le_bytes();
    let mut sum = 0.0;
    for (b, &value) in bytes.iter().enumerate() {
        let start = c.tau_lo + near + b as f32 * bucket_width;
        let overlap = r.hi.min(start + length) - r.lo.max(start);
        sum += if overlap >= 0.0 { f32::from(value) * ((overlap * density).min(1.0) + LIVE_BUCKET_SHARE) } else { 0.0 };
    }
    c.power_unit * sum
}

fn node_importance(c: &TreeChild, r: &Receiver) -> f32 {
    let (lo, hi) = (Vec3::from(c.lo), Vec3::from(c.hi));
    let near = (lo - r.q).max(r.q - hi).max(Vec3::ZERO).length();
    let far = (lo - r.q).abs().max((hi - r.q).abs()).length();
    if c.tau_hi + far < r.lo || c.tau_lo + near > r.hi {
        return 0.0;
    }
    let (half, centre) = (0.5 * (hi - lo), 0.5 * (hi + lo) - r.q);
    let corner = Vec3::select(r.n.cmpgt(Vec3::ZERO), hi, lo) - r.q;
    let height = r.n.dot(corner) + 1e-6 * corner.abs().element_sum();
    if height < 0.0 {
        return 0.0;
    }
    let cosine = (height / near.max(1e-20)).clamp(0.0, 1.0);
    let power = power_through_gate(c, near, far, r) * cosine.max(MIN_COSINE);
    (power / centre.length_squared().max(half.length_squared()).max(1e-20)).max(MIN_IMPORTANCE)
}

fn total_power(c: &TreeChild) -> f32 {
    let bytes = [c.buckets_low.to_le_bytes(), c.buckets_high.to_le_bytes()];
    let sum: u32 = bytes.iter().flatten().map(|&byte| u32::from(byte)).sum();
    (c.power_unit * sum as f32).max(1e-36)
}

fn fine_uniform_below_1(rng: &mut u32) -> f32 {
    fine_uniform(rng).min(1.0 - UNIFORM_STEP)
}

fn remap_uniform(u: f32, start: f32, part: f32, rng: &mut u32) -> f32 {
    let fresh = fine_uniform_below_1(rng);
    let last_digit = f32::from_bits(u.to_bits() & 0x7f80_0000) * f32::EPSILON;
    if part < 1.0 / 256.0 {
        return fresh;
    }
    (((u - start).max(0.0) + last_digit * fresh) / part).clamp(0.0, 1.0 - UNIFORM_STEP)
}

/// `value` without the lower half of its digits, as the frontier stores it.
fn packed(value: f32) -> f32 {
    f32::from_bits(value.to_bits() & 0xffff_0000)
}

/// The subtrees of the frontier, each with the cumulative sums of power and importance.
fn grow_frontier(nodes: &[TreeNode], root: u32, r: &Receiver) -> Vec<(u32, [f32; 2])> {
    let mut frontier = VecDeque::from([(root, [1.0f32; 2])]);
    let mut closed = 0;
    for _ in 0..MAX_VISITS {
        if closed >= frontier.len() || frontier.len() >= MAX_SUBTREES as usize {
            break;
        }
        let (current, weights) = frontier.pop_front().expect("the frontier is not empty");
        if current & LEAF_BIT != 0 {
            frontier.push_back((current, weights));
            closed += 1;
            continue;
        }
        closed = 0;
        for child in [&nodes[current as usize].left, &nodes[current as usize].right] {
            let importance = node_importance(child, r);
            if importance > 0.0 {
                frontier.push_back((child.child, [total_power(child), importance].map(packed)));
            }
        }
    }
    let power: f32 = frontier.iter().map(|(_, weights)| weights[0]).sum();
    let mut sums = [0.0f32; 2];
    let summed = |(node, weights): (u32, [f32; 2])| {
        sums = [sums[0] + weights[0] + MIN_SHARE * power, sums[1] + weights[1]];
        (node, sums)
    };
    frontier.into_iter().map(summed).collect()
}

fn descend(
    nodes: &[TreeNode],
    frontier: &[(u32, [f32; 2])],
    r: &Receiver,
    u: f32,
    rng: &mut u32,
) -> Option<(u32, f32)> {
    let by_power = u < POWER_PROBABILITY;
    let (from, part) = if by_power { (0.0, POWER_PROBABILITY) } else { (POWER_PROBABILITY, 1.0 - POWER_PROBABILITY) };
    let (u, mode) = (remap_uniform(u, from, part, rng), usize::from(!by_power));
    let all = frontier.last()?.1;
    let at = frontier.partition_point(|(_, sums)| sums[mode] <= u * all[mode]).min(frontier.len() - 1);
    let before = if at > 0 { frontier[at - 1].1 } else { [0.0; 2] };
    let mut p = [0, 1].map(|i| frontier[at].1[i] / all[i] - before[i] / all[i]);
    let mut u = remap_uniform(u, before[mode] / all[mode], p[mode], rng);
    let mut current = frontier[at].0;
    while current & LEAF_BIT == 0 {
        let node = &nodes[current as usize];
        let (left, right) = (node_importance(&node.left, r), node_importance(&node.right, r));
        if left + right <= 0.0 {
            // The device draws a number before it looks.
            fine_uniform(rng);
            return None;
        }
        let power = |c: &TreeChild, live: bool| if live { total_power(c) } else { 0.0 };
        let modes = [[power(&node.left, left > 0.0), power(&node.right, right > 0.0)], [left, right]];
        let [left, right] = modes[mode];
        let lesser = left.min(right) / (left + right);
        let take_lesser = u < lesser;
        let (from, part) = if take_lesser { (0.0, lesser) } else { (lesser, 1.0 - lesser) };
        u = remap_uniform(u, from, part, rng);
        let take_left = take_lesser == (left < right);
        for (p, [left, right]) in p.iter_mut().zip(modes) {
            *p *= if take_left { left } else { right } / (left + right);
        }
        current = if take_left { node.left.child } else { node.right.child };
    }
    Some((current, 1.0 / (POWER_PROBABILITY * p[0] + (1.0 - POWER_PROBABILITY) * p[1])))
}

fn vertex_importance(r: &Receiver, depth: u32, v: &PathVertex) -> f32 {
    let offset = Vec3::from(v.position) - r.q;
    let d2 = offset.length_squared();
    let (d, n) = (d2.sqrt(), Vec3::from(v.geometric));
    let w = offset / d;
    let tau = v.tau + d;
    let open = d2 > 0.0 && depth + (v.flags & 0xff) < MAX_DEPTH && tau >= r.lo && tau < r.hi;
    if !open || r.n.dot(w) <= 0.0 || n.dot(w) >= DIRECTION_ERROR {
        return 0.0;
    }
    let cosines = r.n.dot(w).max(1e-4) * n.dot(w).abs().max(1e-4);
    (Vec3::from(v.throughput).max_element() * cosines / d2).max(MIN_IMPORTANCE)
}

fn choose(vertices: &[PathVertex], leaf: u32, weight: f32, r: &Receiver, depth: u32, rng: &mut u32) -> Option<f32> {
    let (count, first) = (((leaf >> 27) & 15) + 1, leaf & LEAF_FIRST);
    let (mut chosen, mut sum) = (None, 0.0);
    for vertex in &vertices[first as usize..(first + count) as usize] {
        let importance = vertex_importance(r, depth, vertex);
        sum += importance;
        if fine_uniform_below_1(rng) * sum < importance {
            chosen = Some(importance);
        }
    }
    chosen.map(|importance| weight * sum / importance)
}

fn vertex(point: &Point) -> PathVertex {
    PathVertex {
        position: point.p.into(),
        tau: point.tau,
        throughput: [point.power; 3],
        normal: point.n.into(),
        geometric: point.n.into(),
        flags: point.depth,
        eta: 1.0,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// Runs all queries on the host. Returns the number of queries that find a vertex, which should match the device.
fn on_host(tree: &Tree, vertices: &[PathVertex], shade: &[Point]) -> u64 {
    let query = |(i, s): (usize, &Point)| {
        let r = Receiver { q: s.p, n: s.n, lo: GATE[0] - s.tau, hi: GATE[1] - s.tau };
        let mut rng = hash32(i as u32);
        let jitter = fine_uniform_below_1(&mut rng);
        let mut alive = 0;
        let frontier = grow_frontier(&tree.nodes, tree.root, &r);
        for k in 0..QUERIES {
            let u = (k as f32 + jitter) / QUERIES as f32;
            if let Some((leaf, weight)) = descend(&tree.nodes, &frontier, &r, u, &mut rng) {
                alive += u64::from(choose(vertices, leaf, weight, &r, s.depth, &mut rng).is_some());
            }
        }
        alive
    };
    shade.par_iter().enumerate().with_min_len(256).map(query).sum()
}

pub fn compare(device: &Device, light: &[Point], shade: &[Point], sizes: Sizes) {
    let mut items: Vec<Item> = light.iter().zip(0..).map(|(point, index)| point.item(index)).collect();
    let options = TreeOptions { leaf_size: LEAF_SIZE, buckets: 8, first_node: 0, first_vertex: 0 };
    let tree = Tree::build(&mut items, options);
    let vertices: Vec<PathVertex> = items.iter().map(|item| vertex(&light[item.index as usize])).collect();
    let frame = Frame {
        gate_lo: GATE[0],
        gate_hi: GATE[1],
        queries: QUERIES,
        max_depth: MAX_DEPTH,
        tree4_root: tree.root,
        tree3_root: NONE,
        ..bytemuck::Zeroable::zeroed()
    };
    let others =
        ["HAS_PARALLEL", "HAS_SKY", "HAS_MEDIA", "HAS_INTERIORS", "HAS_GRIDS", "DRAWS_IN_GATE", "QUERIED_PUNCTUAL"];
    let plain = [&Features::default().constants()[..], &others.map(|name| (name, 0.0))].concat();
    let kernel = Kernel::from_source(device, "bench", KERNEL, "bench_importance", &plain).expect("kernel");
    let upload = |name, bytes: &[u8]| Buffer::from_slice(device, name, bytes, "").expect("upload");
    let points: Vec<PathVertex> = shade.iter().map(vertex).collect();
    let buffers = [
        ("frame", upload("frame", bytemuck::bytes_of(&frame))),
        ("tree_nodes", upload("nodes", bytemuck::cast_slice(&tree.nodes))),
        ("light_vertices", upload("vertices", bytemuck::cast_slice(&vertices))),
        (
            "leaf_records",
            upload("leaf records", bytemuck::cast_slice(&vertices.iter().map(leaf_record).collect::<Vec<_>>())),
        ),
        ("shade_points", upload("points", bytemuck::cast_slice(&points))),
        ("media", Buffer::new::<Medium>(device, "media", 1, "").expect("media")),
        ("materials", Buffer::new::<Material>(device, "materials", 1, "").expect("materials")),
    ];
    let found = Buffer::new::<u32>(device, "found", shade.len(), "").expect("found");
    let named: Vec<(&str, &Buffer)> =
        buffers.iter().map(|(name, buffer)| (*name, buffer)).chain([("found", &found)]).collect();
    let bound = kernel.bind(&named).expect("binding");
    let mut recorder = Recorder::new(device).expect("recorder");
    let mut on_device = || {
        let d = Dispatch { count: shade.len() as u32, ..bytemuck::Zeroable::zeroed() };
        recorder.dispatch("importance", &kernel, &bound, &d, kernel.groups(shade.len())).expect("dispatch");
        recorder.submit().expect("submit");
    };
    on_device();
    let there: u64 = found.to_vec::<u32>(shade.len()).expect("found").iter().map(|&n| u64::from(n)).sum();
    let all = shade.len() * QUERIES as usize;
    let [device, host] = [there, on_host(&tree, &vertices, shade)].map(|found| found as f64 / all as f64);
    println!(
        "lcs       leaf {LEAF_SIZE}; found {:.2} % on the device, {:.2} % on the host",
        100.0 * device,
        100.0 * host
    );
    super::assert_close("queries by importance", device, host);
    super::report("queries by importance", all, sizes.rounds, on_device, || {
        on_host(&tree, &vertices, shade);
    });
}
