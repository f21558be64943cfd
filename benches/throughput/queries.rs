//! Light-cone shell queries: the tree kernel compared with a scalar version in Rust.

use glam::Vec3;
use rayon::prelude::*;
use taugate::internals::gpu::{Buffer, Device, Kernel, Recorder};
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::wgsl::layout::constants::{LEAF_BIT, LEAF_FIRST};
use taugate::internals::wgsl::layout::{Dispatch, Frame, NONE, PathVertex, TreeChild, TreeNode};

use super::Sizes;
use super::points::{GATE, Point, fine_uniform, hash32, uniform};

/// Queries per shade point.
const QUERIES: u32 = 4;

const KERNEL: &str = "
#import query
@group(2) @binding(0) var<storage, read> shade_points: array<vec4<f32>>;
@group(2) @binding(1) var<storage, read_write> found: array<vec2<f32>>;
@compute @workgroup_size(WORKGROUP)
fn bench_queries(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) {
        return;
    }
    let q = shade_points[id.x];
    let shell = Shell(q.xyz, frame.gate_lo - q.w, frame.gate_hi - q.w, 1.0, 1.0, 0.0, 0.0);
    var sum = 0.0;
    var alive = 0.0;
    var rng = hash32(id.x);
    for (var k = 0u; k < frame.queries; k++) {
        let c = descend(frame.tree4_root, shell, false, &rng);
        sum += select(0.0, c.weight, c.vertex != NONE);
        alive += select(0.0, 1.0, c.vertex != NONE);
    }
    found[id.x] = vec2<f32>(sum, alive);
}
";

/// Light-cone shell of a shade point: its position, and the ends of the gate minus q_tau.
struct Shell {
    q: Vec3,
    lo: f32,
    hi: f32,
}

fn node_bound(c: &TreeChild, shell: &Shell) -> f32 {
    let (lo, hi) = (Vec3::from(c.lo), Vec3::from(c.hi));
    let near = (lo - shell.q).max(shell.q - hi).max(Vec3::ZERO).length();
    let far = (lo - shell.q).abs().max((hi - shell.q).abs()).length();
    if c.tau_hi + far < shell.lo || c.tau_lo + near > shell.hi {
        return 0.0;
    }
    let scale = 8.0 / (c.tau_hi - c.tau_lo).max(1e-30);
    let first = ((shell.lo - far - c.tau_lo) * scale).floor().clamp(0.0, 7.0) as usize;
    let last = ((shell.hi - near - c.tau_lo) * scale).floor().clamp(-1.0, 7.0) as i32;
    let bytes = (u64::from(c.buckets_low) | u64::from(c.buckets_high) << 32).to_le_bytes();
    let mut sum = 0u32;
    for (b, &value) in bytes.iter().enumerate() {
        sum += if b >= first && b as i32 <= last { u32::from(value) } else { 0 };
    }
    let diagonal = hi - lo;
    c.power_unit * sum as f32 / (near * near).max(0.25 * diagonal.dot(diagonal)).max(1e-20)
}

fn descend(nodes: &[TreeNode], root: u32, shell: &Shell, rng: &mut u32) -> Option<(u32, f32)> {
    let (mut current, mut weight) = (root, 1.0);
    while current & LEAF_BIT == 0 {
        let node = &nodes[current as usize];
        let (left, right) = (node_bound(&node.left, shell), node_bound(&node.right, shell));
        let sum = left + right;
        let take_lesser = fine_uniform(rng) * sum < left.min(right);
        let take_left = take_lesser == (left < right);
        if sum <= 0.0 {
            return None;
        }
        weight *= sum / if take_left { left } else { right };
        current = if take_left { node.left.child } else { node.right.child };
    }
    let count = ((current >> 27) & 15) + 1;
    let pick = ((uniform(rng) * count as f32) as u32).min(count - 1);
    Some(((current & LEAF_FIRST) + pick, weight * count as f32))
}

pub fn compare(device: &Device, light: &[Point], shade: &[Point], leaf_size: usize, sizes: Sizes) {
    let mut items: Vec<Item> = light.iter().zip(0..).map(|(point, index)| point.item(index)).collect();
    let build = std::time::Instant::now();
    let tree = Tree::build(&mut items, TreeOptions { leaf_size, buckets: 8, first_node: 0, first_vertex: 0 });
    let built = build.elapsed();
    let points: Vec<[f32; 4]> = shade.iter().map(|s| [s.p.x, s.p.y, s.p.z, s.tau]).collect();
    let frame = Frame {
        gate_lo: GATE[0],
        gate_hi: GATE[1],
        queries: QUERIES,
        tree4_root: tree.root,
        tree3_root: NONE,
        ..bytemuck::Zeroable::zeroed()
    };
    let kernel = Kernel::from_source(device, "bench", KERNEL, "bench_queries", &[]).expect("kernel");
    let upload = |name, bytes: &[u8]| Buffer::from_slice(device, name, bytes, "").expect("upload");
    let frame_buffer = upload("frame", bytemuck::bytes_of(&frame));
    let nodes = upload("nodes", bytemuck::cast_slice(&tree.nodes));
    let vertices = Buffer::new::<PathVertex>(device, "vertices", 1, "").expect("vertices");
    let points_buffer = upload("points", bytemuck::cast_slice(&points));
    let found = Buffer::new::<[f32; 2]>(device, "found", points.len(), "").expect("found");
    let bound = kernel
        .bind(&[
            ("frame", &frame_buffer),
            ("tree_nodes", &nodes),
            ("light_vertices", &vertices),
            ("shade_points", &points_buffer),
            ("found", &found),
        ])
        .expect("binding");
    let mut recorder = Recorder::new(device).expect("recorder");
    let mut on_device = || {
        let d = Dispatch { count: points.len() as u32, ..bytemuck::Zeroable::zeroed() };
        recorder.dispatch("queries", &kernel, &bound, &d, kernel.groups(points.len())).expect("dispatch");
        recorder.submit().expect("submit");
    };
    let on_host = || {
        let query = |(i, q): (usize, &[f32; 4])| {
            let shell = Shell { q: Vec3::new(q[0], q[1], q[2]), lo: GATE[0] - q[3], hi: GATE[1] - q[3] };
            let mut rng = hash32(i as u32);
            let mut sums = [0.0f64; 2];
            for _ in 0..QUERIES {
                if let Some((_, weight)) = descend(&tree.nodes, tree.root, &shell, &mut rng) {
                    sums[0] += f64::from(weight);
                    sums[1] += 1.0;
                }
            }
            sums
        };
        points
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .map(query)
            .reduce(|| [0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    on_device();
    let there = found.to_vec::<[f32; 2]>(points.len()).expect("found");
    let [_, alive] = on_host();
    let device_alive: f64 = there.iter().map(|f| f64::from(f[1])).sum();
    let all = points.len() * QUERIES as usize;
    println!(
        "leaf {leaf_size:<2}   {} vertices in {:.0} ms; alive {:.2} % on the device, {:.2} % on the host",
        light.len(),
        built.as_secs_f64() * 1e3,
        100.0 * device_alive / all as f64,
        100.0 * alive / all as f64,
    );
    super::assert_close("queries", device_alive / all as f64, alive / all as f64);
    super::report(&format!("queries, leaf {leaf_size}"), all, sizes.rounds, on_device, || {
        on_host();
    });
}
