// Closest hits and shadow rays. Surfaces with alpha may let a ray pass.
#import traverse
#import surface
#import random
#import sheet

// If true, a surface with alpha stops every ray where its coverage is at least one half, and lets every ray pass elsewhere. If false,
// a ray passes with probability 1 - coverage.
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
// A smooth sheet of thin glass lets a shadow ray (`any_hit`) pass always and other rays at random. `transit` then describes all sheets
// that the ray has passed (sheet.wgsl).
//
// The loop contains the only call of `traverse`. A second call would double the driver's time to compile the kernel.
fn trace(o: vec3<f32>, d: vec3<f32>, t_max: f32, any_hit: bool, origin_triangle: u32, key: vec4<u32>) -> Hit {
    var last_hit = LastHit(0.0, NONE);
    var count = 0u;
    var hit: Hit;
    var goes_on = true;
    crossing_count = 0u;
    if (HAS_SHEETS) {
        forget_sheets();
    }
    loop {
        if (EXIT_AT_TOP && !goes_on) {
            break;
        }
        let reach = select(t_max, 3e38, HAS_NULL_BOUNDARIES && only_boundaries);
        // A ray that may pass surfaces needs the nearest hit in every call: once it has passed a farther surface, it cannot hit
        // the nearer ones. So `any_hit` applies only in scenes where no surface lets rays pass.
        let next = traverse(o, d, last_hit, reach, any_hit && !HAS_ALPHA && !HAS_NULL_BOUNDARIES && !HAS_SHEETS, origin_triangle);
        last_hit = LastHit(next.t, next.triangle);
        goes_on = passes_boundary(next, o, d, hit);
        if (!(HAS_NULL_BOUNDARIES && only_boundaries)) {
            hit = next;
            goes_on |= HAS_ALPHA && lets_pass(next, key, count);
            goes_on |= HAS_SHEETS && !goes_on && passes_thin_glass(next, d, any_hit, key, count);
            if (HAS_NULL_BOUNDARIES && !goes_on && HAS_MEDIA && !(any_hit && next.triangle != NONE)) {
                // The medium in front of the hit follows from the boundaries behind it.
                only_boundaries = true;
                goes_on = next.t < 3e38;
            }
        }
        count += 1u;
        continuing {
            break if !EXIT_AT_TOP & !goes_on;
        }
    }
    only_boundaries = false;
    return hit;
}

// Whether the ray passes a null boundary at `next` and goes on. The crossing is noted. Behind `hit`, the ray ends as soon as the
// medium at `hit` is known.
fn passes_boundary(next: Hit, o: vec3<f32>, d: vec3<f32>, hit: Hit) -> bool {
    if (!HAS_NULL_BOUNDARIES || next.triangle == NONE) {
        return false;
    }
    let material = load_triangle(next.triangle).material;
    if ((material & TRIANGLE_NULL) == 0u) {
        return false;
    }
    let surface = surface_at(next.triangle, next.u, next.v);
    let scale = length(d);
    note_crossing(Crossing(next.t * scale, load_material(surface.material).interior, dot(surface.geometric, d) < 0.0));
    return !only_boundaries || enclosing_medium(hit.t * scale).x == NONE;
}

// Whether the surface at the hit lets this ray pass. `count` is the number of surfaces that the ray has passed before.
fn lets_pass(hit: Hit, key: vec4<u32>, count: u32) -> bool {
    if (hit.triangle == NONE) {
        return false;
    }
    let material = load_triangle(hit.triangle).material;
    if ((material & TRIANGLE_ALPHA) == 0u) {
        return false;
    }
    if (HAS_SHEETS && goes_back) {
        // The alpha of thin glass is part of its crossing, see `passes_sheet`.
        return (material & TRIANGLE_SHEET) == 0u;
    }
    if (AT_HALF_COVERAGE) {
        return coverage(surface_at(hit.triangle, hit.u, hit.v)) < 0.5;
    }
    let draw = pcg4d(vec4<u32>(key.xyz, key.w ^ (count * 0x9e3779b9u)));
    return f32(draw.x >> 8u) * (1.0 / 16777216.0) >= coverage(surface_at(hit.triangle, hit.u, hit.v));
}

// Whether the ray passes thin glass at the hit. `is_shadow`: whether the ray is a shadow ray. Other arguments: see `lets_pass`.
fn passes_thin_glass(hit: Hit, d: vec3<f32>, is_shadow: bool, key: vec4<u32>, count: u32) -> bool {
    if (hit.triangle == NONE) {
        return false;
    }
    if ((load_triangle(hit.triangle).material & TRIANGLE_SHEET) == 0u) {
        return false;
    }
    let surface = surface_at(hit.triangle, hit.u, hit.v);
    let scale = length(d);
    if (AT_HALF_COVERAGE) {
        return sheet_at(surface, d / scale).probability >= 0.5;
    }
    // `lets_pass` uses the first of the four words.
    let draw = pcg4d(vec4<u32>(key.xyz, key.w ^ (count * 0x9e3779b9u)));
    return passes_sheet(surface, d / scale, hit.t * scale, is_shadow, f32(draw.y >> 8u) * (1.0 / 16777216.0));
}
