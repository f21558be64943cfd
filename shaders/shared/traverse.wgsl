// Intersection of rays with the scene: a compressed wide BVH (Ylitie et al. 2017, 80-byte nodes) and watertight triangles.
#import boundary
#import scene

struct Hit {
    // Ray parameter: distance over the length of the direction; `t_max` for a miss.
    t: f32,
    // Barycentric weights of corners 1 and 2.
    u: f32,
    v: f32,
    // Index into `triangles`; NONE for a miss.
    triangle: u32,
}

// A position in the order in which a ray meets triangles: by distance, and at equal distance by index. A ray continues
// strictly after this position, so that it also meets a second surface in the plane of a surface that it has passed.
struct LastHit {
    t: f32,
    // Index of the triangle; NONE: continue only at larger distances.
    triangle: u32,
}

// Entries of the traversal stack. The host limits the depth of the BVH (`MAX_LEVELS` in src/bvh/mod.rs), so pushing needs no test.
const STACK_SIZE: u32 = 32u;

// Coordinate axes of a ray. The axis of the largest direction component comes last; the other two are sheared so that the ray
// runs along the last axis.
struct RayAxes {
    // Index of the largest direction component.
    last: u32,
    // The other two components, divided by the largest component.
    shear: vec2<f32>,
    // 1 / largest component: along the scaled last axis the ray advances by 1 per unit of its parameter t.
    scale: f32,
}

fn ray_axes(d: vec3<f32>) -> RayAxes {
    let size = abs(d);
    var last = select(1u, 0u, size.x > size.y);
    last = select(last, 2u, size.z >= max(size.x, size.y));
    let turned = turn_to_last(d, last);
    return RayAxes(last, turned.xy / turned.z, 1.0 / turned.z);
}

// The components of p in cyclic order, so that component `last` comes last.
fn turn_to_last(p: vec3<f32>, last: u32) -> vec3<f32> {
    return select(select(p, p.zxy, last == 1u), p.yzx, last == 0u);
}

// The point p, relative to the ray's origin, in the axes of the ray. z is the ray parameter at which the ray passes p.
fn to_ray(p: vec3<f32>, axes: RayAxes) -> vec3<f32> {
    let turned = turn_to_last(p, axes.last);
    return vec3<f32>(turned.xy - axes.shear * turned.z, axes.scale * turned.z);
}

// Twice the signed area of the triangle that the corners a and b span with the ray, seen along the ray. Products round
// monotonically (the code is built without contraction), so the result has the sign of the exact number, or is 0.
fn edge_area(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Replaces `hit` by triangle `index` if the ray hits it nearer, but after `last_hit`. Watertight (after Woop et al. 2013): a
// corner has the same position across the ray in all triangles that share it, and a ray through an edge (area 0) hits both
// triangles of that edge. So no ray passes between triangles, not even at a corner. The distance is a weighted mean of the
// distances of the corners, with weights >= 0. So it is accurate for slivers too, whose plane is lost in rounding.
fn intersect_triangle(index: u32, o: vec3<f32>, axes: RayAxes, last_hit: LastHit, origin_triangle: u32, hit: ptr<function, Hit>) {
    let triangle = load_triangle(index);
    let a = to_ray(triangle.v0 - o, axes);
    let b = to_ray(triangle.v1 - o, axes);
    let c = to_ray(triangle.v2 - o, axes);
    let u = edge_area(b, c);
    let v = edge_area(c, a);
    let w = edge_area(a, b);
    let sum = u + v + w;
    let inside = (min(u, min(v, w)) >= 0.0 || max(u, max(v, w)) <= 0.0) && sum != 0.0;
    let scale = 1.0 / sum;
    let t = (u * a.z + v * b.z + w * c.z) * scale;
    var beyond = t > last_hit.t;
    var nearer = t < (*hit).t;
    if (HAS_ALPHA || HAS_NULL_BOUNDARIES || HAS_SHEETS) {
        // Only a ray that may pass surfaces needs an order between triangles at equal distance.
        beyond |= (t == last_hit.t) & (index > last_hit.triangle);
        nearer |= (t == (*hit).t) & ((*hit).triangle != NONE) & (index < (*hit).triangle);
    }
    let is_sought = !HAS_NULL_BOUNDARIES || !only_boundaries || (triangle.material & TRIANGLE_NULL) != 0u;
    if (inside && beyond && nearer && is_sought && index != origin_triangle) {
        (*hit).t = t;
        (*hit).u = v * scale;
        (*hit).v = w * scale;
        (*hit).triangle = index;
    }
}

// Recomputes a hit for the ray from `p` itself. The traced ray started beside `p`, off the surface, but directions are
// sampled at `p`. Offsetting the origin changes the density of the hit point by a relative error of about offset / distance.
// The offset grows with the coordinates, so this error matters far from the origin of render space. If the ray from `p` misses
// the triangle, by less than the offset, the hit is unchanged.
fn reintersect(hit: Hit, p: vec3<f32>, d: vec3<f32>) -> Hit {
    var again = hit;
    again.t = 3e38;
    intersect_triangle(hit.triangle, p, ray_axes(d), LastHit(0.0, NONE), NONE, &again);
    again.t = select(hit.t, again.t, again.t < 3e38);
    return again;
}

// Reciprocal of each component; finite for components that are 0.
fn safe_inverse(d: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1e-20);
    let signed_tiny = select(-tiny, tiny, d >= vec3<f32>(0.0));
    return 1.0 / select(d, signed_tiny, abs(d) < tiny);
}

// Byte `b` of the word x, 0 for the lowest.
fn extract_byte(x: u32, b: u32) -> u32 {
    return (x >> (b * 8u)) & 0xffu;
}

// Slack of the slab test, 24 x 2^-24 of each term. The ray parameter of a plane is a sum whose terms may cancel. So planes
// are moved outwards by the possible rounding error of the terms, and flat boxes keep their hits (after Ize 2013). The terms contain
// the inverse of the direction, and Vulkan allows a division an error of 2.5 ulp (5 x 2^-24). The slack is more than doubled, because
// `to_ray` also rounds the corners of the triangles. Near planes are moved as well: on an axis along which the
// ray hardly moves, the error of the near plane may exceed the slack of the far plane.
const SLAB_SLACK: f32 = 1.43e-6;

// The quantised planes of a node as ray parameters: byte times scale plus origin, for near and far planes.
struct Slabs {
    near_scale: vec3<f32>,
    near_origin: vec3<f32>,
    far_scale: vec3<f32>,
    far_origin: vec3<f32>,
    t_min: f32,
    t_max: f32,
}

// A node of the BVH, unpacked from its five texels (Ylitie et al. 2017, Sec. 4).
struct BvhNode {
    // First inner child (x), first triangle (y), and the meta bytes of children 0 to 3 (z) and 4 to 7 (w).
    children: vec4<u32>,
    // Bytes of the planes of each axis: lower planes of children 0 to 3 and 4 to 7, then their upper planes.
    x: vec4<u32>,
    y: vec4<u32>,
    z: vec4<u32>,
    // A plane lies at its byte times `scale` plus `origin`.
    origin: vec3<f32>,
    scale: vec3<f32>,
    // Bit i: child i is an inner node.
    inner: u32,
}

fn unpack_bvh_node(index: u32) -> BvhNode {
    let base = index * 5u;
    let n0 = textureLoad(bvh_nodes, base, 0);
    let scale = vec3<f32>(
        bitcast<f32>(extract_byte(n0.w, 0u) << 23u),
        bitcast<f32>(extract_byte(n0.w, 1u) << 23u),
        bitcast<f32>(extract_byte(n0.w, 2u) << 23u),
    );
    return BvhNode(textureLoad(bvh_nodes, base + 1u, 0), textureLoad(bvh_nodes, base + 2u, 0), textureLoad(bvh_nodes, base + 3u, 0),
        textureLoad(bvh_nodes, base + 4u, 0), bitcast<vec3<f32>>(n0.xyz), scale, n0.w >> 24u);
}

// Hit mask of four of a node's eight children: inner children in bits 24 to 31 by traversal priority, triangles in
// bits 0 to 23. `near` and `far` hold, for each axis, the bytes of the four near and far planes. `oct4` holds the
// octant of the ray in every byte.
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

// Closest hit of the ray o + t d after `last_hit` and before t_max, or some hit if `any_hit` is set. `d` need not have unit
// length. `origin_triangle`: see `trace`.
fn traverse(o: vec3<f32>, d: vec3<f32>, last_hit: LastHit, t_max: f32, any_hit: bool, origin_triangle: u32) -> Hit {
    var hit = Hit(t_max, 0.0, 0.0, NONE);
    let inverse = safe_inverse(d);
    let axes = ray_axes(d);
    var stack: array<vec2<u32>, STACK_SIZE>;
    var depth = 0u;
    let backwards = inverse < vec3<f32>(0.0);
    let oct = 7u - (select(0u, 4u, backwards.x) | select(0u, 2u, backwards.y) | select(0u, 1u, backwards.z));
    let oct4 = oct * 0x01010101u;
    var nodes = vec2<u32>(0u, 0x80000000u);
    var leaves = vec2<u32>(0u, 0u);
    loop {
        if (nodes.y > 0x00ffffffu) {
            // The nearest child of the current group by octant order. The rest of the group waits on the stack.
            let bit = firstLeadingBit(nodes.y);
            let child_base = nodes.x;
            nodes.y &= ~(1u << bit);
            if (nodes.y > 0x00ffffffu) {
                stack[depth] = nodes;
                depth += 1u;
            }
            let slot = (bit - 24u) ^ oct;
            let rank = countOneBits(nodes.y & ~(0xffffffffu << slot));
            let node = unpack_bvh_node(child_base + rank);
            let scale = node.scale * inverse;
            let origin = (node.origin - o) * inverse;
            let wider_scale = SLAB_SLACK * abs(scale);
            let wider_origin = SLAB_SLACK * abs(origin);
            let slabs = Slabs(scale - wider_scale, origin - wider_origin, scale + wider_scale, origin + wider_origin, last_hit.t,
                hit.t);
            // The sign of the direction decides which planes are near.
            let x = select(node.x, node.x.zwxy, backwards.x);
            let y = select(node.y, node.y.zwxy, backwards.y);
            let z = select(node.z, node.z.zwxy, backwards.z);
            let mask = intersect_four(node.children.z, vec3<u32>(x.x, y.x, z.x), vec3<u32>(x.z, y.z, z.z), slabs, oct4)
                | intersect_four(node.children.w, vec3<u32>(x.y, y.y, z.y), vec3<u32>(x.w, y.w, z.w), slabs, oct4);
            nodes = vec2<u32>(node.children.x, (mask & 0xff000000u) | node.inner);
            leaves = vec2<u32>(node.children.y, mask & 0x00ffffffu);
        } else {
            leaves = nodes;
            nodes = vec2<u32>(0u, 0u);
        }
        // The loop exits at its end: with a condition at the top, masked SIMD would run the body once more.
        loop {
            if (leaves.y != 0u) {
                let bit = firstLeadingBit(leaves.y);
                leaves.y &= ~(1u << bit);
                intersect_triangle(leaves.x + bit, o, axes, last_hit, origin_triangle, &hit);
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
