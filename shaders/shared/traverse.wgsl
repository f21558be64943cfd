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

// Spelled out: the builtin could be contracted, one way here and another way there.
fn cross_exact(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Edge functions in Pluecker form relative to the ray origin: the two triangles at an edge compute the same number with
// opposite signs (the code is built without contraction), so that no ray passes between them.
fn intersect_triangle(index: u32, o: vec3<f32>, d: vec3<f32>, t_min: f32, hit: ptr<function, Hit>) {
    let triangle = load_triangle(index);
    let v0 = triangle.v0 - o;
    let v1 = triangle.v1 - o;
    let v2 = triangle.v2 - o;
    let e0 = v2 - v0;
    let e1 = v0 - v1;
    let e2 = v1 - v2;
    let u = dot(cross_exact(e0, v2 + v0), d);
    let v = dot(cross_exact(e1, v0 + v1), d);
    let w = dot(cross_exact(e2, v1 + v2), d);
    let normal = cross_exact(e1, e0);
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

// A plane's parameter is a sum whose terms may cancel: far planes are moved outwards by what rounding can do to the terms, so
// that flat boxes keep their hits (after Ize 2013). 6 x 2^-24.
const SLAB_SLACK: f32 = 3.6e-7;

// A node's quantised planes in the ray's parameter: byte times scale plus origin, for near and far planes.
struct Slabs {
    near_scale: vec3<f32>,
    near_origin: vec3<f32>,
    far_scale: vec3<f32>,
    far_origin: vec3<f32>,
    t_min: f32,
    t_max: f32,
}

// Hit mask of four of the eight children: inner children in bits 24-31 by traversal priority, triangles in bits 0-23.
// `near` and `far` hold the bytes of their planes an axis, `oct4` the ray's octant in every byte.
fn intersect_four(meta4: u32, near: vec3<u32>, far: vec3<u32>, slabs: Slabs, oct4: u32) -> u32 {
    let inner4 = (meta4 & (meta4 << 1u)) & 0x10101010u;
    let inner_mask4 = (inner4 >> 4u) * 0xffu;
    let bit_index4 = (meta4 ^ (oct4 & inner_mask4)) & 0x1f1f1f1fu;
    let child_bits4 = (meta4 >> 5u) & 0x07070707u;
    let near_x = bytes_to_floats(near.x) * slabs.near_scale.x + slabs.near_origin.x;
    let near_y = bytes_to_floats(near.y) * slabs.near_scale.y + slabs.near_origin.y;
    let near_z = bytes_to_floats(near.z) * slabs.near_scale.z + slabs.near_origin.z;
    let far_x = bytes_to_floats(far.x) * slabs.far_scale.x + slabs.far_origin.x;
    let far_y = bytes_to_floats(far.y) * slabs.far_scale.y + slabs.far_origin.y;
    let far_z = bytes_to_floats(far.z) * slabs.far_scale.z + slabs.far_origin.z;
    let enter = max(max(near_x, near_y), max(near_z, vec4<f32>(slabs.t_min)));
    let leave_at = min(min(far_x, far_y), min(far_z, vec4<f32>(slabs.t_max)));
    let touched = enter <= leave_at;
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
    let backwards = inverse < vec3<f32>(0.0);
    let oct = 7u - (select(0u, 4u, backwards.x) | select(0u, 2u, backwards.y) | select(0u, 1u, backwards.z));
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
            let n0 = textureLoad(bvh_nodes, base, 0);
            let n1 = textureLoad(bvh_nodes, base + 1u, 0);
            let n2 = textureLoad(bvh_nodes, base + 2u, 0);
            let n3 = textureLoad(bvh_nodes, base + 3u, 0);
            let n4 = textureLoad(bvh_nodes, base + 4u, 0);
            let scale = vec3<f32>(
                bitcast<f32>(extract_byte(n0.w, 0u) << 23u),
                bitcast<f32>(extract_byte(n0.w, 1u) << 23u),
                bitcast<f32>(extract_byte(n0.w, 2u) << 23u),
            ) * inverse;
            let origin = (bitcast<vec3<f32>>(n0.xyz) - o) * inverse;
            let slabs = Slabs(scale, origin, scale + SLAB_SLACK * abs(scale), origin + SLAB_SLACK * abs(origin), t_min, hit.t);
            // Words of a plane: four low children, four high ones; minima first. The sign of the ray says which are near.
            let x = select(n2, n2.zwxy, backwards.x);
            let y = select(n3, n3.zwxy, backwards.y);
            let z = select(n4, n4.zwxy, backwards.z);
            let mask = intersect_four(n1.z, vec3<u32>(x.x, y.x, z.x), vec3<u32>(x.z, y.z, z.z), slabs, oct4)
                | intersect_four(n1.w, vec3<u32>(x.y, y.y, z.y), vec3<u32>(x.w, y.w, z.w), slabs, oct4);
            nodes = vec2<u32>(n1.x, (mask & 0xff000000u) | (n0.w >> 24u));
            leaves = vec2<u32>(n1.y, mask & 0x00ffffffu);
        } else {
            leaves = nodes;
            nodes = vec2<u32>(0u, 0u);
        }
        // Tested at the end: masked SIMD runs a loop's body once more for a condition at its top.
        loop {
            if (leaves.y != 0u) {
                let bit = firstLeadingBit(leaves.y);
                leaves.y &= ~(1u << bit);
                intersect_triangle(leaves.x + bit, o, d, t_min, &hit);
            }
            continuing {
                break if leaves.y == 0u;
            }
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
