// Light vertices and the two trees over them (Sec. 5.4). Group 1 is declared here and in leaf.wgsl.
#import frame
#import path
#import math

// One child of an inner node: the data by which a query decides whether to visit it. 48 bytes; a node is two children.
struct TreeChild {
    lo: vec3<f32>,
    // N_tau^-: minimum travel time of the vertices below the child.
    tau_lo: f32,
    hi: vec3<f32>,
    // N_tau^+: maximum travel time of the vertices below the child.
    tau_hi: f32,
    // Power of the 8 travel-time buckets, one byte each, in units of `power_unit`. Powers are rounded up, so that a bucket
    // with a vertex is never 0.
    buckets_low: u32,
    buckets_high: u32,
    power_unit: f32,
    // Index of an inner node, or a leaf reference: LEAF_BIT, count - 1 in bits 27 to 30, and the index of the first vertex.
    child: u32,
}

struct TreeNode {
    left: TreeChild,
    right: TreeChild,
}

const LEAF_BIT: u32 = 0x80000000u;
const LEAF_FIRST: u32 = 0x07ffffffu;
// Number of buckets that a node has room for.
const BUCKETS: u32 = 8u;
// Number of buckets in use (B in the paper). They divide the travel times of a node into equal intervals.
override BUCKET_COUNT: f32 = f32(BUCKETS);

// The vertices of the pool: seven texels per PathVertex.
@group(1) @binding(0) var light_vertices: texture_1d<u32>;
// 3D tree over emitter points (v_tau = 0) and 4D tree over scattered vertices, in one array: six texels per TreeNode. With a
// single tree, emitter points are in the 4D tree. Punctual lights, if too many to connect one by one, are always in the 3D tree.
@group(1) @binding(1) var tree_nodes: texture_1d<u32>;
// bdpt and epc: the vertices of light path i are light_vertices[path_offsets[i] .. path_offsets[i + 1]].
@group(1) @binding(2) var<storage, read> path_offsets: array<u32>;

fn load_light_vertex(index: u32) -> PathVertex {
    let first = 7u * index;
    return unpack_vertex(array<vec4<u32>, 7>(
        textureLoad(light_vertices, first, 0),
        textureLoad(light_vertices, first + 1u, 0),
        textureLoad(light_vertices, first + 2u, 0),
        textureLoad(light_vertices, first + 3u, 0),
        textureLoad(light_vertices, first + 4u, 0),
        textureLoad(light_vertices, first + 5u, 0),
        textureLoad(light_vertices, first + 6u, 0),
    ));
}

// The travel time of a light vertex.
fn light_vertex_tau(index: u32) -> f32 {
    return bitcast<f32>(textureLoad(light_vertices, 7u * index, 0).w);
}

fn load_tree_child(node: u32, side: u32) -> TreeChild {
    let lo = bitcast<vec4<f32>>(textureLoad(tree_nodes, 6u * node + 3u * side, 0));
    let hi = bitcast<vec4<f32>>(textureLoad(tree_nodes, 6u * node + 3u * side + 1u, 0));
    let rest = textureLoad(tree_nodes, 6u * node + 3u * side + 2u, 0);
    return TreeChild(lo.xyz, lo.w, hi.xyz, hi.w, rest.x, rest.y, bitcast<f32>(rest.z), rest.w);
}

fn load_tree_node(index: u32) -> TreeNode {
    return TreeNode(load_tree_child(index, 0u), load_tree_child(index, 1u));
}
