// Closest hits and shadow rays. Surfaces with alpha may let a ray pass.
#import traverse
#import surface
#import random

// Whether a surface with alpha stops a ray if it covers at least half of the point, instead of by chance.
override AT_HALF_COVERAGE: bool = false;

// Closest surface that the ray o + t d hits for 0 < t < t_max, or some surface if `any_hit` is set. `d` may have any length.
//
// A surface with alpha lets the ray pass with probability 1 - coverage. `key` makes the random choices of this ray
// independent of those of other rays. At each surface, the choice also depends on how many surfaces the ray has passed. It
// does not depend on triangle indices, because rounding in the construction of the BVH may change these.
//
// `origin_triangle` is the triangle that the ray leaves and must not hit again, or NONE. Rounding could otherwise let the ray
// hit this triangle: if it is a needle seen along its face, its distance may round to any value. Shadow rays pass NONE,
// because they must be able to hit the triangles at their ends: otherwise rounding may let a ray slip through between the two
// sides of a wall.
//
// The loop contains the only call of `traverse`. A second call would double the driver's time to compile the kernel.
fn trace(o: vec3<f32>, d: vec3<f32>, t_max: f32, any_hit: bool, origin_triangle: u32, key: vec4<u32>) -> Hit {
    var last_hit = LastHit(0.0, NONE);
    var count = 0u;
    var hit: Hit;
    var goes_on = true;
    loop {
        if (EXIT_AT_TOP && !goes_on) {
            break;
        }
        // With alpha, every call needs the nearest hit: once the ray has passed a farther surface, it cannot hit the nearer ones.
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

// Whether the surface at the hit lets this ray pass. `count` is the number of surfaces that the ray has passed before.
fn lets_pass(hit: Hit, key: vec4<u32>, count: u32) -> bool {
    if (hit.triangle == NONE) {
        return false;
    }
    if ((load_triangle(hit.triangle).material & TRIANGLE_ALPHA) == 0u) {
        return false;
    }
    if (AT_HALF_COVERAGE) {
        return coverage(surface_at(hit.triangle, hit.u, hit.v)) < 0.5;
    }
    let draw = pcg4d(vec4<u32>(key.xyz, key.w ^ (count * 0x9e3779b9u)));
    return f32(draw.x >> 8u) * (1.0 / 16777216.0) >= coverage(surface_at(hit.triangle, hit.u, hit.v));
}
