// Rays against the scene: a compressed wide BVH (Ylitie et al. 2017, 80-byte nodes) with watertight triangles.
#import scene

struct Hit {
    t: f32,
    // Barycentric weights of corners 1 and 2.
    u: f32,
    v: f32,
    // Index into `triangles`, NONE for a miss.
    triangle: u32,
}

const STACK_SIZE: u32 = 32u;

// Edge functions in Pluecker form relative to the ray origin: the two triangles at an edge compute the same number with
// opposite signs (the code is built without contraction), so that no ray passes between them.
fn intersect_triangle(index: u32, o: vec3<f32>, d: vec3<f32>, t_min: f32, hit: ptr<function, Hit>) {
    let v0 = triangles[index].v0 - o;
    let v1 = triangles[index].v1 - o;
    let v2 = triangles[index].v2 - o;
    let e0 = v2 - v0;
    let e1 = v0 - v1;
    let e2 = v1 - v2;
    let u = dot(cross(e0, v2 + v0), d);
    let v = dot(cross(e1, v0 + v1), d);
    let w = dot(cross(e2, v1 + v2), d);
    let normal = cross(e1, e0);
    let t = dot(v0, normal) / dot(d, normal);
    let inside = min(u, min(v, w)) >= 0.0 || max(u, max(v, w)) <= 0.0;
    if (inside && t > t_min && t < (*hit).t) {
        let sum = u + v + w;
        let scale = select(1.0 / sum, 0.0, sum == 0.0);
        (*hit).t = t;
        (*hit).u = u * scale;
        (*hit).v = v * scale;
        (*hit).triangle = index;
    }
}

// Reciprocal that keeps zero components finite.
fn safe_inverse(d: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1e-20);
    let signed_tiny = select(-tiny, tiny, d >= vec3<f32>(0.0));
    return 1.0 / select(d, signed_tiny, abs(d) < tiny);
}

fn extract_byte(x: u32, b: u32) -> u32 {
    return (x >> (b * 8u)) & 0xffu;
}

fn bytes_to_floats(v: u32) -> vec4<f32> {
    return vec4<f32>(vec4<u32>(v & 0xffu, (v >> 8u) & 0xffu, (v >> 16u) & 0xffu, v >> 24u));
}

// The slabs carry a few roundings each; a hair of slack keeps hits on the faces of boxes (Ize 2013).
const SLAB_SLACK: f32 = 1.000001;

// Hit mask of four of the eight children: inner children in bits 24-31 by traversal priority, triangles in bits 0-23.
// `meta4`, `x`, `y`, `z` are their words (near planes in .x, far planes in .y), `oct4` the ray's octant in every byte.
fn intersect_four(meta4: u32, x: vec2<u32>, y: vec2<u32>, z: vec2<u32>, scale: vec3<f32>, origin: vec3<f32>, oct4: u32,
    t_min: f32, t_max: f32) -> u32 {
    let inner4 = (meta4 & (meta4 << 1u)) & 0x10101010u;
    let inner_mask4 = (inner4 >> 4u) * 0xffu;
    let bit_index4 = (meta4 ^ (oct4 & inner_mask4)) & 0x1f1f1f1fu;
    let child_bits4 = (meta4 >> 5u) & 0x07070707u;
    let x0 = bytes_to_floats(x.x) * scale.x + origin.x;
    let x1 = bytes_to_floats(x.y) * scale.x + origin.x;
    let y0 = bytes_to_floats(y.x) * scale.y + origin.y;
    let y1 = bytes_to_floats(y.y) * scale.y + origin.y;
    let z0 = bytes_to_floats(z.x) * scale.z + origin.z;
    let z1 = bytes_to_floats(z.y) * scale.z + origin.z;
    let near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), vec4<f32>(t_min)));
    let far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), vec4<f32>(t_max)));
    let touched = near <= far * SLAB_SLACK;
    let a = select(0u, (child_bits4 & 0xffu) << (bit_index4 & 0xffu), touched.x);
    let b = select(0u, ((child_bits4 >> 8u) & 0xffu) << ((bit_index4 >> 8u) & 0xffu), touched.y);
    let c = select(0u, ((child_bits4 >> 16u) & 0xffu) << ((bit_index4 >> 16u) & 0xffu), touched.z);
    let d = select(0u, (child_bits4 >> 24u) << (bit_index4 >> 24u), touched.w);
    return a | b | c | d;
}

// Closest hit (or any hit) of o + t d with t in (t_min, t_max). `d` need not have unit length.
fn traverse(o: vec3<f32>, d: vec3<f32>, t_min: f32, t_max: f32, any_hit: bool) -> Hit {
    var hit = Hit(t_max, 0.0, 0.0, NONE);
    let inverse = safe_inverse(d);
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    let oct = 7u - (select(0u, 4u, d.x < 0.0) | select(0u, 2u, d.y < 0.0) | select(0u, 1u, d.z < 0.0));
    let oct4 = oct * 0x01010101u;
    var nodes = vec2<u32>(0u, 0x80000000u);
    var leaves = vec2<u32>(0u, 0u);
    loop {
        if (nodes.y > 0x00ffffffu) {
            // Nearest child of the current group by octant order; the rest of the group waits on the stack.
            let bit = firstLeadingBit(nodes.y);
            let child_base = nodes.x;
            nodes.y &= ~(1u << bit);
            if (nodes.y > 0x00ffffffu) {
                stack[depth] = nodes;
                depth += 1u;
            }
            let slot = (bit - 24u) ^ oct;
            let rank = countOneBits(nodes.y & ~(0xffffffffu << slot));
            let base = (child_base + rank) * 5u;
            let n0 = bvh_nodes[base];
            let n1 = bvh_nodes[base + 1u];
            let n2 = bvh_nodes[base + 2u];
            let n3 = bvh_nodes[base + 3u];
            let n4 = bvh_nodes[base + 4u];
            let scale = vec3<f32>(
                bitcast<f32>(extract_byte(n0.w, 0u) << 23u),
                bitcast<f32>(extract_byte(n0.w, 1u) << 23u),
                bitcast<f32>(extract_byte(n0.w, 2u) << 23u),
            ) * inverse;
            let origin = (bitcast<vec3<f32>>(n0.xyz) - o) * inverse;
            let mask = intersect_four(n1.z, n2.xz, n3.xz, n4.xz, scale, origin, oct4, t_min, hit.t)
                | intersect_four(n1.w, n2.yw, n3.yw, n4.yw, scale, origin, oct4, t_min, hit.t);
            nodes = vec2<u32>(n1.x, (mask & 0xff000000u) | (n0.w >> 24u));
            leaves = vec2<u32>(n1.y, mask & 0x00ffffffu);
        } else {
            leaves = nodes;
            nodes = vec2<u32>(0u, 0u);
        }
        while (leaves.y != 0u) {
            let bit = firstLeadingBit(leaves.y);
            leaves.y &= ~(1u << bit);
            intersect_triangle(leaves.x + bit, o, d, t_min, &hit);
        }
        if (any_hit && hit.triangle != NONE) {
            break;
        }
        if (nodes.y <= 0x00ffffffu) {
            if (depth == 0u) {
                break;
            }
            depth -= 1u;
            nodes = stack[depth];
        }
    }
    return hit;
}
