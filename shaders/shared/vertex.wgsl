// A vertex of a subpath: a point on a surface or on an emitter, or a scattering event in a medium. Only this module evaluates and
// samples vertices and computes their densities, cosines and sides. So kernels treat vertices with and without a normal alike. Only
// `leaf` (to find punctual lights) and `auxiliary` also ask whether a vertex has a normal.
#import bsdf_sample
#import emitter
#import phase

// A vertex evaluated for one direction.
struct Evaluation {
    // Factor of this vertex in the measurement contribution, cosine included.
    value: vec3<f32>,
    // Density per solid angle of sampling the direction. For a light vertex, times its `selection_pdf`.
    pdf: f32,
    // The same for a subpath that travels in reverse: it arrives along the direction and samples the previous vertex.
    pdf_reverse: f32,
    // See `vertex_cosine`.
    cosine: f32,
}

// Whether v is on the surface of a transmitting solid.
fn transmits(v: PathVertex) -> bool {
    return HAS_TRANSMISSION && (v.flags & VERTEX_TRANSMITS) != 0u;
}

// Whether v is on thin glass.
fn is_on_sheet(v: PathVertex) -> bool {
    return HAS_SHEETS && (v.flags & VERTEX_SHEET) != 0u;
}

// Whether v is a scattering event in a participating medium.
fn is_in_medium(v: PathVertex) -> bool {
    return HAS_MEDIA && (v.flags & VERTEX_IN_MEDIUM) != 0u;
}

// Whether v is a sun.
fn is_sun(v: PathVertex) -> bool {
    return HAS_PARALLEL && (v.flags & VERTEX_EMITTER) != 0u && v.material == EMIT_SUN;
}

// Whether events in a medium that are connected to v are drawn in the gate. For this, v must be deterministic and no sun: the light
// of a sun has no travel time.
fn is_drawn_in_gate(v: PathVertex) -> bool {
    return DRAWS_IN_GATE && (v.flags & VERTEX_DETERMINISTIC) != 0u && !is_sun(v);
}

// Whether v lies on a surface. Punctual lights and events in a medium have no normal.
fn has_normal(v: PathVertex) -> bool {
    return !is_in_medium(v) && ((v.flags & VERTEX_EMITTER) == 0u || v.material <= EMIT_TWO_SIDED);
}

// Whether v exchanges light with only one side of its surface.
fn is_one_sided(v: PathVertex) -> bool {
    return !transmits(v) && !is_on_sheet(v) && !is_in_medium(v) && ((v.flags & VERTEX_EMITTER) == 0u || v.material == EMIT_ONE_SIDED);
}

// Whether v can exchange light with a point in the direction `w`.
fn faces(v: PathVertex, w: vec3<f32>) -> bool {
    return !is_one_sided(v) || dot(v.geometric, w) > 0.0;
}

// Absolute cosine between `w` and the geometric normal, 1 for a vertex without normal. It turns a density per solid angle
// into a density per area.
fn vertex_cosine(v: PathVertex, w: vec3<f32>) -> f32 {
    return select(1.0, abs(dot(v.geometric, w)), has_normal(v));
}

// Whether the trees contain the punctual lights, because there are too many to connect one by one.
override QUERIED_PUNCTUAL: bool = true;

// Lower limit of `outgoing_light` for an event whose phase function is a table. The direction to the previous vertex is rounded in leaf
// records, so an event may contribute although the table is 0 at the rounded angle.
const MIN_TABLE_LIGHT: f32 = 1e-3;

// Light that v sends along `w` (unit), relative to its throughput. A surface counts as diffuse, with a cosine of at least
// `min_cosine`. For an event in a medium, the result is exact up to the factor 4 pi, but at least MIN_TABLE_LIGHT if the phase function
// is a table. For a punctual light, it is exact: 0 outside the cone of a spot.
fn outgoing_light(v: PathVertex, w: vec3<f32>, min_cosine: f32) -> f32 {
    if (is_in_medium(v)) {
        let m = load_medium(v.material);
        let scattered = 4.0 * PI * phase_value(m, -dot(v.to_previous, w));
        if (HAS_PHASE_TABLES && m.phase == PHASE_TABLE) {
            return max(scattered, MIN_TABLE_LIGHT);
        }
        return scattered;
    }
    if (QUERIED_PUNCTUAL && !has_normal(v)) {
        return emitter_profile(v, w).x;
    }
    return max(vertex_cosine(v, w), min_cosine);
}

// Travel time per length of a segment that leaves v along `w`: the index of refraction of a solid, or the group index outside.
fn eta_towards(v: PathVertex, w: vec3<f32>) -> f32 {
    if (!transmits(v) || dot(v.geometric, w) >= 0.0) {
        return v.eta;
    }
    return select(SURROUNDING_GROUP_INDEX, solid_index(v.material), (v.flags & VERTEX_FRONT) != 0u);
}

// Minimum (x) and maximum (y) of `eta_towards` over all directions.
fn eta_range(v: PathVertex) -> vec2<f32> {
    let other = eta_towards(v, -v.geometric);
    return vec2<f32>(min(v.eta, other), max(v.eta, other));
}

// Whether a segment that leaves v, a point on a transmitting surface, along `w` runs inside the solid.
fn is_in_solid(v: PathVertex, w: vec3<f32>) -> bool {
    return transmits(v) && (dot(v.geometric, w) < 0.0) == ((v.flags & VERTEX_FRONT) != 0u);
}

// Code of the solid around a segment that leaves v along `w` (solid.wgsl).
fn solid_towards(v: PathVertex, w: vec3<f32>) -> u32 {
    if (transmits(v)) {
        return select(OUTSIDE_SOLIDS, solid_of(v.material), is_in_solid(v, w));
    }
    return select(OUTSIDE_SOLIDS, v.flags >> VERTEX_SOLID_SHIFT, HAS_INTERIORS);
}

// Offset from v, along the normal, to the origin of a ray that leaves v along `w`. It keeps the ray from hitting the surface again.
fn ray_offset(v: PathVertex, w: vec3<f32>) -> vec3<f32> {
    return offset_origin(vec3<f32>(0.0), v.geometric, v.offset, w);
}

// Point where a ray between v and a point along `w` starts or ends.
fn ray_end(v: PathVertex, w: vec3<f32>) -> vec3<f32> {
    return offset_origin(v.position, v.geometric, v.offset, w);
}

// Whether v can be connected. A point on a surface needs a lobe that is not a delta, and must not lie on the black back of a
// one-sided material.
fn is_connectible(v: PathVertex) -> bool {
    if (is_in_medium(v)) {
        return true;
    }
    let m = load_material(v.material);
    let black = (v.flags & VERTEX_FRONT) == 0u && (m.flags & MATERIAL_DOUBLE_SIDED) == 0u && m.transmission <= 0.0;
    let lobe = metallic_and_alpha(m, v.point_words);
    let diffuse = lobe.x < 1.0 && transmission_at(m, v.point_words) < 1.0;
    let retroreflects = HAS_RETROREFLECTORS && m.retroreflection > 0.0;
    return !black && (lobe.y >= DELTA_ALPHA || diffuse || retroreflects || has_rough_clearcoat(m, v.point_words));
}

// The BSDF at v, a point on a surface.
fn vertex_bsdf(v: PathVertex) -> Bsdf {
    let front = (v.flags & VERTEX_FRONT) != 0u;
    if (HAS_SURFACE_TEXTURES && varies(load_material(v.material))) {
        return make_varying_bsdf(v.material, unpack_point(v.point_words), front);
    }
    return make_bsdf(v.material, bitcast<vec3<f32>>(v.point_words), front);
}

// The direction w in the local frame of `normal` (+z).
fn to_local(normal: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
    return w * frame_around(normal);
}

// Whether `w` is on the same side of the turned normal of v as of its geometric normal.
//
// A normal map may turn the shading normal of v away from the sensor's side of a path, although the surface faces that side.
// Without a rule, such points would be black. The rule: where light leaves v along a direction that the turned normal faces,
// v scatters with the turned normal; elsewhere v scatters as a flat surface. Only the direction `wc` in which light leaves
// matters, so all strategies find the same value for a path. No light is gained: for each `wc`, v scatters with one BSDF.
fn faces_bump(v: PathVertex, w: vec3<f32>) -> bool {
    return dot(v.normal, w) * dot(v.geometric, w) > 0.0;
}

// The normal with which v scatters light that leaves along `wc`.
fn scattering_normal(v: PathVertex, wc: vec3<f32>) -> vec3<f32> {
    let flat = HAS_NORMAL_MAPS && (v.flags & VERTEX_BUMPED) != 0u && !faces_bump(v, wc);
    return select(v.normal, v.geometric, flat);
}

// Probability that a light subpath, which arrives from `wl` and does not know wc yet, samples wc with the turned normal. Let
// a be the angle between the normals. A Lambert surface scatters (1 + cos a) / 2 of its light with the turned normal. A sample with
// the flat normal hits the remaining directions with probability (1 - cos a) / 2. The result, 1 / (1 + tan(a / 2)), minimises the
// variance of the sum of both.
fn bump_probability(v: PathVertex, wl: vec3<f32>) -> f32 {
    if (!HAS_NORMAL_MAPS || (v.flags & VERTEX_BUMPED) == 0u) {
        return 1.0;
    }
    if (!faces_bump(v, wl)) {
        return 0.0;
    }
    let cosine = clamp(dot(v.normal, v.geometric), 0.0, 1.0);
    return 1.0 / (1.0 + sqrt((1.0 - cosine) / (1.0 + cosine)));
}

// Probability that a light subpath which arrives from `wl` samples with the normal that `wc` needs.
fn normal_probability(v: PathVertex, wl: vec3<f32>, wc: vec3<f32>) -> f32 {
    if (!HAS_NORMAL_MAPS || (v.flags & VERTEX_BUMPED) == 0u) {
        return 1.0;
    }
    let bump = bump_probability(v, wl);
    return select(1.0 - bump, bump, faces_bump(v, wc));
}

// The phase function at v, an event in a medium, for scattering between `w` and the direction to the previous vertex. It is the
// same for light and sensor subpaths.
fn evaluate_medium_vertex(v: PathVertex, w: vec3<f32>) -> Evaluation {
    let phase = phase_value(load_medium(v.material), -dot(v.to_previous, w));
    return Evaluation(vec3<f32>(phase), phase, phase, 1.0);
}

// Evaluates the shade point q for light from the direction `w` (unit). The cosine in `value` is that of the shading normal
// (Veach 1997, Eq. 5.18).
fn evaluate_shade_point(q: PathVertex, w: vec3<f32>) -> Evaluation {
    if (is_in_medium(q)) {
        return evaluate_medium_vertex(q, w);
    }
    let b = vertex_bsdf(q);
    let normal = scattering_normal(q, q.to_previous);
    let wc = to_local(normal, q.to_previous);
    let wl = to_local(normal, w);
    let value = bsdf_eval(b, wl, wc);
    let consistent = dot(q.geometric, w) * wl.z > 0.0 && wc.z > 0.0;
    var c: Evaluation;
    c.value = select(vec3<f32>(0.0), value.f * abs(wl.z), consistent);
    c.pdf = value.pdf_to_light;
    c.pdf_reverse = value.pdf_to_sensor * normal_probability(q, w, q.to_previous);
    c.cosine = vertex_cosine(q, w);
    return c;
}

// Evaluates the light vertex v for light that it sends along `w` (unit).
fn evaluate_light_vertex(v: PathVertex, w: vec3<f32>) -> Evaluation {
    var c: Evaluation;
    if ((v.flags & VERTEX_EMITTER) != 0u) {
        let profile = emitter_profile(v, w);
        c.value = vec3<f32>(profile.x);
        c.pdf = profile.y * selection_pdf(v);
        c.pdf_reverse = 0.0;
        c.cosine = vertex_cosine(v, w);
        return c;
    }
    if (is_in_medium(v)) {
        c = evaluate_medium_vertex(v, w);
        c.pdf *= selection_pdf(v);
        return c;
    }
    let b = vertex_bsdf(v);
    let normal = scattering_normal(v, w);
    let wl = to_local(normal, v.to_previous);
    let wc = to_local(normal, w);
    let value = bsdf_eval(b, wl, wc);
    let side = dot(v.geometric, w);
    let consistent = side * wc.z > 0.0 && wl.z > 0.0;
    // Correction for shading normals (Veach 1997, Eq. 5.19): light arrives with the geometric cosine and is scattered with
    // the shading cosine.
    let correction = abs(wl.z) / max(abs(dot(v.geometric, v.to_previous)), 1e-9);
    c.value = select(vec3<f32>(0.0), value.f * (abs(side) * correction), consistent);
    c.pdf = value.pdf_to_sensor * normal_probability(v, v.to_previous, w) * selection_pdf(v);
    c.pdf_reverse = value.pdf_to_light;
    c.cosine = abs(side);
    return c;
}

// A sampled direction in which a subpath continues.
struct Scatter {
    direction: vec3<f32>,
    // Factor on the throughput of the subpath, cosines included.
    weight: vec3<f32>,
    // Densities per solid angle, as in `Evaluation`.
    pdf: f32,
    pdf_reverse: f32,
    // Geometric cosine of the new direction.
    cosine: f32,
    delta: bool,
    valid: bool,
}

// Samples the next direction of a subpath at v, an event in a medium.
fn sample_medium_vertex(v: PathVertex, u: vec4<f32>) -> Scatter {
    let m = load_medium(v.material);
    let cosine = sample_phase_cosine(m, u.xz);
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let turn = cosine_and_sine(2.0 * PI * u.y);
    let direction = normalize(frame_around(-v.to_previous) * vec3<f32>(sine * turn.x, sine * turn.y, cosine));
    let pdf = phase_value(m, cosine);
    return Scatter(direction, vec3<f32>(1.0), pdf, pdf, 1.0, false, true);
}

// Samples the next direction of a subpath at v, which is no emitter.
fn sample_vertex(v: PathVertex, is_sensor_subpath: bool, u: vec4<f32>) -> Scatter {
    if (is_in_medium(v)) {
        return sample_medium_vertex(v, u);
    }
    let b = vertex_bsdf(v);
    var normal = scattering_normal(v, v.to_previous);
    var numbers = u;
    var probability = 1.0;
    if (HAS_NORMAL_MAPS && !is_sensor_subpath && (v.flags & VERTEX_BUMPED) != 0u) {
        // Chooses a normal. The rest of the number then chooses the lobe.
        let bump = bump_probability(v, v.to_previous);
        let turned = u.w < bump;
        normal = select(v.geometric, v.normal, turned);
        probability = select(1.0 - bump, bump, turned);
        numbers.w = min(select(u.w - bump, u.w, turned) / probability, 0.99999994);
    }
    let known = to_local(normal, v.to_previous);
    let sample = bsdf_sample(b, known, is_sensor_subpath, numbers);
    var s: Scatter;
    s.valid = false;
    if (!sample.valid) {
        return s;
    }
    s.direction = normalize(frame_around(normal) * sample.direction);
    let side = dot(v.geometric, s.direction);
    s.valid = side * sample.direction.z > 0.0;
    s.cosine = abs(side);
    s.pdf = sample.pdf;
    s.pdf_reverse = sample.pdf_reverse;
    s.delta = sample.delta;
    if (HAS_NORMAL_MAPS && (v.flags & VERTEX_BUMPED) != 0u) {
        if (is_sensor_subpath) {
            s.pdf_reverse *= normal_probability(v, s.direction, v.to_previous);
        } else {
            // If light in this direction scatters with the other normal, the sample is lost.
            s.valid = s.valid && all(normal == scattering_normal(v, s.direction));
            s.pdf *= probability;
        }
    }
    // The BSDF of a delta lobe contains 1 / cosine, which cancels with the cosine of the new direction. So the weight of the lobe is
    // reflectance / probability, and only the correction for shading normals remains: see `evaluate_light_vertex`.
    let known_ratio = known.z / max(abs(dot(v.geometric, v.to_previous)), 1e-9);
    let new_cosine = abs(sample.direction.z);
    let smooth_factor = select(known_ratio * s.cosine, new_cosine, is_sensor_subpath);
    let delta_factor = select(known_ratio * s.cosine / new_cosine, 1.0, is_sensor_subpath);
    s.weight = sample.weight * (select(smooth_factor, delta_factor, s.delta) / probability);
    return s;
}
