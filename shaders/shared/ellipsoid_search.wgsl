// Enumeration of the triangles that may meet an ellipsoid, and a uniform choice among them.
#import ellipsoid
#import triangle
#import bvh
#import random

// Relative slack of the tests, so that rounding never loses a triangle.
const ELLIPSOID_SLACK: f32 = 4e-6;

// A part of the BVH is a node with everything below it. With the bit PART_LEAVES, it is only the triangles of the node itself.
const PART_LEAVES: u32 = 0x80000000u;

// The ellipsoid that a search looks for: its foci, and its range of |x - v| + |x - q|, widened by the slack.
struct EllipsoidSearch {
    ellipsoid: Ellipsoid,
    v: vec3<f32>,
    lo: f32,
    q: vec3<f32>,
    hi: f32,
}

// A triangle chosen uniformly among `count`; NONE if `count` is 0.
struct TriangleChoice {
    triangle: u32,
    count: u32,
}

// A point of the ellipsoid on a triangle. `triangle` is NONE if no point was found.
struct EllipsoidPoint {
    triangle: u32,
    // Barycentric weights of corners 1 and 2.
    weights: vec2<f32>,
    // 1 / density of the point per radian on the arcs of its triangle.
    inverse_density: f32,
}

fn make_search(v: vec3<f32>, q: vec3<f32>, length: f32) -> EllipsoidSearch {
    let slack = ELLIPSOID_SLACK * (length + max_component(abs(v)) + max_component(abs(q)));
    return EllipsoidSearch(make_ellipsoid(v, q, length), v, length - slack, q, length + slack);
}

// A normal of the triangle, with a largest component from 1 to 2. The cross product of the edges of a small triangle is so short that
// its products with lengths may underflow. The factor between the two is a power of two, so it changes no bit of a mantissa.
fn scaled_normal(t: Triangle) -> vec3<f32> {
    let n = cross(t.v1 - t.v0, t.v2 - t.v0);
    let exponent = bitcast<u32>(max_component(abs(n))) & 0x7f800000u;
    return n * bitcast<f32>(0x7f000000u - exponent);
}

// Whether the ellipsoid may meet the triangle: it cuts the plane, some corner lies outside, and both foci are on the same side.
fn may_meet(s: EllipsoidSearch, index: u32) -> bool {
    let t = load_triangle(index);
    let n = scaled_normal(t);
    let side_v = dot(n, s.v - t.v0);
    let side_q = dot(n, s.q - t.v0);
    // |n| times the distance of the plane from the centre. If the plane cuts the ellipsoid, it is at most the length of `reach`.
    let height = 0.5 * abs(side_v + side_q);
    let reach = normal_to_sphere(s.ellipsoid, n);
    let farthest = max(max(focal_sum(s, t.v0), focal_sum(s, t.v1)), focal_sum(s, t.v2));
    let is_null = HAS_NULL_BOUNDARIES && (t.material & TRIANGLE_NULL) != 0u;
    // A product of the two sides may underflow.
    let same_side = min(side_v, side_q) > 0.0 || max(side_v, side_q) < 0.0;
    return same_side && height * height <= dot(reach, reach) * (1.0 + ELLIPSOID_SLACK) && farthest >= s.lo && !is_null;
}

// |p - v| + |p - q|.
fn focal_sum(s: EllipsoidSearch, p: vec3<f32>) -> f32 {
    return distance(p, s.v) + distance(p, s.q);
}

// Distance from `p` to the nearest point of an interval of an axis, for four intervals.
fn nearest_four(lo: vec4<f32>, hi: vec4<f32>, p: f32) -> vec4<f32> {
    return max(max(lo - p, p - hi), vec4<f32>(0.0));
}

// Distance from `p` to the farthest point of each interval.
fn farthest_four(lo: vec4<f32>, hi: vec4<f32>, p: f32) -> vec4<f32> {
    return max(abs(lo - p), abs(hi - p));
}

// Bounds on |x - v| + |x - q| over four boxes decide which of them the ellipsoid may meet. Returns a mask as `intersect_four` does.
// x, y, z: the bytes of the four lower and of the four upper planes of each axis.
fn search_four(meta4: u32, x: vec2<u32>, y: vec2<u32>, z: vec2<u32>, origin: vec3<f32>, scale: vec3<f32>, s: EllipsoidSearch) -> u32 {
    let lo_x = bytes_to_floats(x.x) * scale.x + origin.x;
    let hi_x = bytes_to_floats(x.y) * scale.x + origin.x;
    let lo_y = bytes_to_floats(y.x) * scale.y + origin.y;
    let hi_y = bytes_to_floats(y.y) * scale.y + origin.y;
    let lo_z = bytes_to_floats(z.x) * scale.z + origin.z;
    let hi_z = bytes_to_floats(z.y) * scale.z + origin.z;
    var least = vec4<f32>(0.0);
    var most = vec4<f32>(0.0);
    for (var i = 0u; i < 2u; i++) {
        let focus = select(s.v, s.q, i == 1u);
        let near_x = nearest_four(lo_x, hi_x, focus.x);
        let near_y = nearest_four(lo_y, hi_y, focus.y);
        let near_z = nearest_four(lo_z, hi_z, focus.z);
        least += sqrt(near_x * near_x + near_y * near_y + near_z * near_z);
        let far_x = farthest_four(lo_x, hi_x, focus.x);
        let far_y = farthest_four(lo_y, hi_y, focus.y);
        let far_z = farthest_four(lo_z, hi_z, focus.z);
        most += sqrt(far_x * far_x + far_y * far_y + far_z * far_z);
    }
    let touched = (least <= vec4<f32>(s.hi)) & (most >= vec4<f32>(s.lo));
    let bit_index4 = meta4 & 0x1f1f1f1fu;
    let child_bits4 = (meta4 >> 5u) & 0x07070707u;
    let a = select(0u, (child_bits4 & 0xffu) << (bit_index4 & 0xffu), touched.x);
    let b = select(0u, ((child_bits4 >> 8u) & 0xffu) << ((bit_index4 >> 8u) & 0xffu), touched.y);
    let c = select(0u, ((child_bits4 >> 16u) & 0xffu) << ((bit_index4 >> 16u) & 0xffu), touched.z);
    let d = select(0u, (child_bits4 >> 24u) << (bit_index4 >> 24u), touched.w);
    return a | b | c | d;
}

// Counts the triangles that the ellipsoid may meet in a part of the BVH. Each of them replaces `choice` with probability 1 / count
// (reservoir sampling), so the final choice is uniform over these triangles in all parts that were searched. `key`: key of the random
// numbers for this choice.
fn search_part(part: u32, s: EllipsoidSearch, key: vec4<u32>, choice: ptr<function, TriangleChoice>) {
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    let leaves_only = (part & PART_LEAVES) != 0u;
    var nodes = vec2<u32>(part & ~PART_LEAVES, 0x80000000u);
    var leaves = vec2<u32>(0u, 0u);
    loop {
        if (nodes.y > 0x00ffffffu) {
            let bit = firstLeadingBit(nodes.y);
            let child_base = nodes.x;
            nodes.y &= ~(1u << bit);
            if (nodes.y > 0x00ffffffu) {
                stack[depth] = nodes;
                depth += 1u;
            }
            let rank = countOneBits(nodes.y & ~(0xffffffffu << (bit - 24u)));
            let node = unpack_bvh_node(child_base + rank);
            let mask = search_four(node.children.z, node.x.xz, node.y.xz, node.z.xz, node.origin, node.scale, s)
                | search_four(node.children.w, node.x.yw, node.y.yw, node.z.yw, node.origin, node.scale, s);
            let inner = select(mask & 0xff000000u, 0u, leaves_only);
            nodes = vec2<u32>(node.children.x, inner | node.inner);
            leaves = vec2<u32>(node.children.y, mask & 0x00ffffffu);
        }
        // The loop exits at its end: with a condition at the top, masked SIMD would run the body once more.
        loop {
            if (leaves.y != 0u) {
                let bit = firstLeadingBit(leaves.y);
                leaves.y &= ~(1u << bit);
                if (may_meet(s, leaves.x + bit)) {
                    (*choice).count += 1u;
                    let draw = pcg4d(vec4<u32>(key.xyz, key.w ^ ((*choice).count * 0x9e3779b9u))).x;
                    if (multiply_wide(draw, (*choice).count).x == 0u) {
                        (*choice).triangle = leaves.x + bit;
                    }
                }
            }
            continuing {
                break if leaves.y == 0u;
            }
        }
        if (nodes.y <= 0x00ffffffu) {
            if (depth == 0u) {
                break;
            }
            depth -= 1u;
            nodes = stack[depth];
        }
    }
}
