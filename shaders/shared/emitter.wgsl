// Light subpaths start here: this module chooses an emitter, a point and a direction. It also evaluates the light that an
// emitter point sends along a direction.
#import surface
#import path
#import bsdf
#import random
#import sky
#import solid

// Values of Emitter.kind.
const EMITTER_TRIANGLE: u32 = 0u;
const EMITTER_POINT: u32 = 1u;
const EMITTER_SPOT: u32 = 2u;
const EMITTER_BEAM: u32 = 3u;
const EMITTER_SUN: u32 = 4u;
const EMITTER_SKY: u32 = 5u;

// Emission profiles: how the light of an emitter point depends on the direction. Profiles up to EMIT_TWO_SIDED belong to surfaces.
const EMIT_ONE_SIDED: u32 = 0u;
const EMIT_TWO_SIDED: u32 = 1u;
const EMIT_POINT: u32 = 2u;
const EMIT_SPOT: u32 = 3u;
// A point so far away that its light is parallel in the whole scene. Its subpaths start on a disk beside the scene.
const EMIT_SUN: u32 = 4u;

struct Emission {
    vertex: PathVertex,
    direction: vec3<f32>,
    // Density per solid angle of `direction`; 1 for beams, whose direction is fixed. Suns and the sky: density per area of the
    // point on the disk. Along parallel rays, this density does not change.
    pdf_direction: f32,
    // Initial throughput of the subpath: radiance (or intensity, or power) times cosine over all densities.
    throughput: vec3<f32>,
    // Surfaces: density per area of the point, probability of selecting the emitter included. Sky: density per solid angle of
    // `direction`. Otherwise unused.
    density: f32,
    // The triangle that emits; NONE for all other emitters.
    triangle: u32,
    beam: bool,
    // See PATH_PARALLEL.
    parallel: bool,
    // The light comes from the sky.
    sky: bool,
    // The emitter point is stored in the pool, so that it can be connected. The host stores punctual lights and suns itself.
    stored: bool,
    // All subpaths from this emitter start alike: see PATH_DETERMINISTIC.
    deterministic: bool,
}

// Chooses an emitter with the alias method (Vose 1991): words x and z choose an entry, word y chooses between the entry and
// its alias. A single float instead of x and z has only 24 bits: with a million entries, some entries would be chosen several
// per cent too often.
fn choose_emitter(words: vec4<u32>) -> u32 {
    let i = random_below(words.xz, frame.emitter_count);
    let coin = f32(words.y) * (1.0 / 4294967296.0);
    return select(load_emitter(i).other, i, coin < load_emitter(i).keep);
}

// x: light that the emitter point v sends along `w` (unit), times the cosine at the emitter (1 for punctual lights), relative
// to the throughput of v. y: density per solid angle of sampling `w`.
fn emitter_profile(v: PathVertex, w: vec3<f32>) -> vec2<f32> {
    let cosine = dot(v.geometric, w);
    switch (v.material) {
        case EMIT_ONE_SIDED: {
            return vec2<f32>(max(cosine, 0.0), max(cosine, 0.0) / PI);
        }
        case EMIT_TWO_SIDED: {
            return vec2<f32>(abs(cosine), abs(cosine) / (2.0 * PI));
        }
        case EMIT_POINT: {
            return vec2<f32>(1.0, 1.0 / (4.0 * PI));
        }
        case EMIT_SPOT: {
            let off = cap_height(v.to_previous, w);
            let outer = bitcast<f32>(v.point_words.x);
            return vec2<f32>(spot_falloff(off, outer, bitcast<f32>(v.point_words.y)), select(0.0, 1.0 / (2.0 * PI * outer), off < outer));
        }
        case EMIT_SUN: {
            return vec2<f32>(1.0, bitcast<f32>(v.point_words.y));
        }
        // An unknown profile sends no light.
        default: {
            return vec2<f32>(0.0);
        }
    }
}

// 1 - cosine of the angle between the unit vectors a and b, accurate to float precision for small angles. Cones are stored as
// 1 - cosine, because a cosine near 1 has hardly any digits left in a float.
fn cap_height(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return 0.5 * dot(a - b, a - b);
}

// Falloff of KHR_lights_punctual: 1 inside the inner cone, 0 outside the outer cone. Each argument is 1 - cosine.
fn spot_falloff(off: f32, outer: f32, inner: f32) -> f32 {
    let x = clamp((outer - off) / max(outer - inner, 1e-20), 0.0, 1.0);
    return x * x;
}

// Uniformly distributed unit direction in the cone around `axis`. `outer` is 1 - cosine of the half angle, 0 to 2.
fn uniform_cone(axis: vec3<f32>, outer: f32, u: vec2<f32>) -> vec3<f32> {
    let off = outer * u.x;
    let r = sqrt(max(0.0, off * (2.0 - off)));
    let turn = cosine_and_sine(2.0 * PI * u.y);
    return frame_around(axis) * vec3<f32>(r * turn.x, r * turn.y, 1.0 - off);
}

// Samples the first vertex and the first direction of a light subpath from emitter `number`.
fn sample_emission(number: u32, a: vec4<f32>) -> Emission {
    let e = load_emitter(number);
    var r: Emission;
    r.vertex.owner = number;
    r.vertex.select_pdf = e.select_pdf;
    r.vertex.eta = eta_around(e.solid);
    r.vertex.flags = VERTEX_EMITTER | VERTEX_VALID | (solid_around(e.solid) << VERTEX_SOLID_SHIFT);
    r.triangle = NONE;
    switch (e.kind) {
        case EMITTER_TRIANGLE: {
            sample_triangle(e, a, &r);
        }
        case EMITTER_BEAM, EMITTER_SUN: {
            sample_beam(e, a, &r);
        }
        case EMITTER_POINT, EMITTER_SPOT: {
            sample_punctual(e, a, &r);
        }
        // An unknown kind sends no light. Light from the sky needs more random numbers: see `emit_from_sky`.
        default: {}
    }
    return r;
}

// Initial partial sum d_vcm of a point on an emitting surface. The only strategy shorter than s = 1 is s = 0, where the
// sensor subpath hits this point. `density`: density per area of choosing the point.
fn emitter_point_sum(density: f32) -> f32 {
    return frame.keep_s0 * mis(1.0 / density);
}

fn sample_triangle(e: Emitter, a: vec4<f32>, r: ptr<function, Emission>) {
    let b = uniform_triangle(a.xy);
    let s = surface_at(e.triangle, b.x, b.y);
    let m = load_material(s.material);
    var radiance = emission(s);
    if (HAS_ALPHA) {
        radiance *= coverage(s);
    }
    let two_sided = (m.flags & MATERIAL_DOUBLE_SIDED) != 0u;
    let density = m.emission_density;
    (*r).vertex.position = s.position;
    (*r).vertex.offset = s.offset;
    (*r).triangle = s.triangle;
    (*r).vertex.geometric = s.geometric;
    (*r).vertex.normal = s.geometric;
    (*r).vertex.material = select(EMIT_ONE_SIDED, EMIT_TWO_SIDED, two_sided);
    (*r).vertex.throughput = radiance / density;
    (*r).vertex.d_vcm = emitter_point_sum(density);
    let up = select(1.0, -1.0, two_sided && a.z >= 0.5);
    let stretched = select(a.z, select(2.0 * a.z, 2.0 * a.z - 1.0, a.z >= 0.5), two_sided);
    (*r).direction = frame_around(up * s.geometric) * cosine_hemisphere(vec2<f32>(stretched, a.w));
    let cosine = abs(dot((*r).direction, s.geometric));
    (*r).pdf_direction = cosine / select(PI, 2.0 * PI, two_sided);
    (*r).throughput = radiance * select(PI, 2.0 * PI, two_sided) / density;
    (*r).density = density;
    (*r).stored = true;
}

fn sample_punctual(e: Emitter, a: vec4<f32>, r: ptr<function, Emission>) {
    let spot = e.kind == EMITTER_SPOT;
    let outer = select(2.0, e.outer, spot);
    (*r).vertex.position = e.position;
    (*r).direction = uniform_cone(e.direction, outer, a.xy);
    (*r).pdf_direction = 1.0 / (2.0 * PI * outer);
    let falloff = select(1.0, spot_falloff(outer * a.x, e.outer, e.inner), spot);
    (*r).throughput = e.strength * (falloff / ((*r).pdf_direction * e.select_pdf));
}

// Samples a point on the disk of a beam or a sun, whose direction is fixed.
fn sample_beam(e: Emitter, a: vec4<f32>, r: ptr<function, Emission>) {
    let radius = e.outer * sqrt(a.x);
    let turn = cosine_and_sine(2.0 * PI * a.y);
    let disk = frame_around(e.direction) * vec3<f32>(radius * turn.x, radius * turn.y, 0.0);
    (*r).vertex.position = e.position + disk;
    (*r).direction = e.direction;
    let sun = HAS_PARALLEL && e.kind == EMITTER_SUN;
    (*r).pdf_direction = select(1.0, 1.0 / (PI * e.outer * e.outer), sun);
    (*r).throughput = e.strength / e.select_pdf;
    (*r).beam = !sun;
    (*r).parallel = sun;
    // Surfaces with alpha let rays pass at random, so the first hit is then random.
    (*r).deterministic = e.outer == 0.0 && !HAS_ALPHA;
}

// Samples the direction of a light subpath from the sky, and the point where it starts: on a disk beside the scene.
fn emit_from_sky(number: u32, a: vec4<f32>, words: vec4<u32>) -> Emission {
    let e = load_emitter(number);
    let header = load_sky();
    let seen = sample_sky(words);
    let radius = e.outer * sqrt(a.x);
    let turn = cosine_and_sine(2.0 * PI * a.y);
    let disk = frame_around(seen.direction) * vec3<f32>(radius * turn.x, radius * turn.y, e.outer);
    var r: Emission;
    r.vertex.owner = number;
    r.vertex.select_pdf = e.select_pdf;
    r.vertex.eta = SURROUNDING_GROUP_INDEX;
    r.vertex.position = e.position + disk;
    r.triangle = NONE;
    r.direction = -seen.direction;
    r.pdf_direction = header.disk_pdf;
    r.density = seen.pdf;
    if (seen.pdf > 0.0) {
        r.throughput = seen.radiance / (seen.pdf * header.disk_pdf * e.select_pdf);
    }
    r.parallel = true;
    r.sky = true;
    return r;
}
