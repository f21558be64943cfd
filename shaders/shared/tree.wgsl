// Light vertices and the two trees over them (Sec. 5.4). Group 1 lives here.
#import frame
#import path
#import math

// One child of an inner node: what a query must know of it before it goes there. 48 bytes; a node is two of them.
struct TreeChild {
    lo: vec3<f32>,
    // N_tau^-: least travel time below the child.
    tau_lo: f32,
    hi: vec3<f32>,
    // N_tau^+.
    tau_hi: f32,
    // Power of the 8 travel-time buckets in units of `power_unit`, rounded up: never 0 for a bucket that holds a vertex.
    buckets_low: u32,
    buckets_high: u32,
    power_unit: f32,
    // Inner node, or LEAF_BIT with count - 1 in bits 27 to 30 and the first vertex below.
    child: u32,
}

struct TreeNode {
    left: TreeChild,
    right: TreeChild,
}

const LEAF_BIT: u32 = 0x80000000u;
const LEAF_FIRST: u32 = 0x07ffffffu;
const BUCKETS: u32 = 8u;

@group(1) @binding(0) var<storage, read> light_vertices: array<PathVertex>;
// 3D tree over emitter points (v_tau = 0) and 4D tree over scattered vertices, in one array.
@group(1) @binding(1) var<storage, read> tree_nodes: array<TreeNode>;
// bdpt: vertices of light path i are light_vertices[path_offsets[i] .. path_offsets[i + 1]].
@group(1) @binding(2) var<storage, read> path_offsets: array<u32>;
