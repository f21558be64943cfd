// Intersection of rays with the scene by its BVH. `ray_query.wgsl` takes the place of this module where the device traces rays itself.
#import triangle
#import bvh

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
