// Closest hits and shadow rays, with surfaces that are only partly there.
#import traverse
#import surface
#import random

// Closest surface along o + t d. Surfaces with alpha let the ray pass with probability 1 - coverage; `key` makes the
// choice of this ray independent of others, and a count the choice at each surface; not their numbers, which follow from the
// rounding of the hierarchy. `d` need not have unit length. `origin_triangle` is the triangle that the ray leaves for good, NONE for
// none: a plane is not hit from itself, whatever rounding makes of the distance of a needle that is seen along its face. Shadow
// rays must meet the triangles of their ends: between the two sides of a wall, rounding may find a way along it.
// The loop is the one place that traverses: a second call site would double the time that the driver takes to compile the kernel.
fn trace(o: vec3<f32>, d: vec3<f32>, t_max: f32, any_hit: bool, origin_triangle: u32, key: vec4<u32>) -> Hit {
    var last_hit = LastHit(0.0, NONE);
    var count = 0u;
    var hit: Hit;
    var goes_on = true;
    loop {
        if (EXIT_AT_TOP && !goes_on) {
            break;
        }
        // Any hit is not the nearest one: what an alpha surface lets pass must still meet what stands before it.
        hit = traverse(o, d, last_hit, t_max, any_hit && !HAS_ALPHA, origin_triangle);
        goes_on = HAS_ALPHA && lets_pass(hit, key, count);
        last_hit = LastHit(hit.t, hit.triangle);
        count += 1u;
        continuing {
            break if !EXIT_AT_TOP & !goes_on;
        }
    }
    return hit;
}

// Whether the surface at the hit lets this ray pass, which has passed `count` surfaces before.
fn lets_pass(hit: Hit, key: vec4<u32>, count: u32) -> bool {
    if (hit.triangle == NONE) {
        return false;
    }
    if ((load_triangle(hit.triangle).material & TRIANGLE_ALPHA) == 0u) {
        return false;
    }
    let draw = pcg4d(vec4<u32>(key.xyz, key.w ^ (count * 0x9e3779b9u)));
    return f32(draw.x >> 8u) * (1.0 / 16777216.0) >= coverage(surface_at(hit.triangle, hit.u, hit.v));
}
