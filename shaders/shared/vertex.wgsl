// A vertex of a subpath, whatever it is: a point on a surface or a point on an emitter. Evaluation, sampling, densities, cosines
// and sides are asked for here alone, so that nothing else has to know whether a vertex has a normal.
#import emitter

// A vertex evaluated for one direction.
struct Evaluation {
    // Factor of the measurement contribution at this vertex, its cosine included.
    value: vec3<f32>,
    // Density per solid angle of sampling the direction, and of sampling the direction to the previous vertex for a subpath that
    // arrives along the direction.
    pdf: f32,
    pdf_reverse: f32,
    // See `vertex_cosine`.
    cosine: f32,
}

// Whether light passes through the surface at v.
fn transmits(v: PathVertex) -> bool {
    return HAS_TRANSMISSION && (v.flags & VERTEX_TRANSMITS) != 0u;
}

// Whether v lies on a surface. Punctual lights have no normal.
fn has_normal(v: PathVertex) -> bool {
    return (v.flags & VERTEX_EMITTER) == 0u || v.material <= EMIT_TWO_SIDED;
}

// Whether v exchanges light with one side of its surface only.
fn is_one_sided(v: PathVertex) -> bool {
    return !transmits(v) && ((v.flags & VERTEX_EMITTER) == 0u || v.material == EMIT_ONE_SIDED);
}

// Whether v can exchange light with what lies along `w`.
fn faces(v: PathVertex, w: vec3<f32>) -> bool {
    return !is_one_sided(v) || dot(v.geometric, w) > 0.0;
}

// Cosine that turns a density per solid angle which arrives at v along `w` (either sign) into one per area; 1 without a normal.
fn vertex_cosine(v: PathVertex, w: vec3<f32>) -> f32 {
    return select(1.0, abs(dot(v.geometric, w)), has_normal(v));
}

// Punctual lights are too many to be connected one by one: queries meet them in the trees.
override QUERIED_PUNCTUAL: bool = true;

// Light that v sends along `w` (unit), relative to its throughput: of a surface as if it were diffuse, `min_cosine` at least; of a
// punctual light exactly, and so 0 outside the cone of a spot.
fn outgoing_light(v: PathVertex, w: vec3<f32>, min_cosine: f32) -> f32 {
    if (QUERIED_PUNCTUAL && !has_normal(v)) {
        return emitter_profile(v, w).x;
    }
    return max(vertex_cosine(v, w), min_cosine);
}

// Refractive index of the medium that a segment leaving v along `w` travels in.
fn eta_towards(v: PathVertex, w: vec3<f32>) -> f32 {
    if (!transmits(v) || dot(v.geometric, w) >= 0.0) {
        return v.eta;
    }
    return select(1.0, load_material(v.material).ior, (v.flags & VERTEX_FRONT) != 0u);
}

// Least and greatest refractive index of the media that segments leaving v travel in.
fn eta_range(v: PathVertex) -> vec2<f32> {
    let other = eta_towards(v, -v.geometric);
    return vec2<f32>(min(v.eta, other), max(v.eta, other));
}

// Offset from v to the origin of a ray that leaves it along `w`: off the surface, so that the ray does not meet it again.
fn ray_offset(v: PathVertex, w: vec3<f32>) -> vec3<f32> {
    return offset_origin(vec3<f32>(0.0), v.geometric, v.offset, w);
}

// Where a ray between v and a point along `w` starts or ends.
fn ray_end(v: PathVertex, w: vec3<f32>) -> vec3<f32> {
    return offset_origin(v.position, v.geometric, v.offset, w);
}

// Can the vertex be connected: has its side of the material a lobe that is not a delta?
fn is_connectible(v: PathVertex) -> bool {
    let m = load_material(v.material);
    let black = (v.flags & VERTEX_FRONT) == 0u && (m.flags & MATERIAL_DOUBLE_SIDED) == 0u && m.transmission <= 0.0;
    return !black && (m.alpha >= DELTA_ALPHA || (m.metallic < 1.0 && m.transmission < 1.0));
}

// The scattering at v, a point on a surface.
fn vertex_bsdf(v: PathVertex) -> Bsdf {
    return make_bsdf(v.material, v.base_color, (v.flags & VERTEX_FRONT) != 0u);
}

fn to_local(normal: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
    return w * frame_around(normal);
}

// A shade point looking along `w` (unit) for light. Shading normals enter as cos(normal, light): Veach 1997, Eq. 5.18.
fn evaluate_shade_point(q: PathVertex, w: vec3<f32>) -> Evaluation {
    let b = vertex_bsdf(q);
    let wc = to_local(q.normal, q.to_previous);
    let wl = to_local(q.normal, w);
    let value = bsdf_eval(b, wl, wc);
    let consistent = dot(q.geometric, w) * wl.z > 0.0 && wc.z > 0.0;
    var c: Evaluation;
    c.value = select(vec3<f32>(0.0), value.f * abs(wl.z), consistent);
    c.pdf = value.pdf_to_light;
    c.pdf_reverse = value.pdf_to_sensor;
    c.cosine = vertex_cosine(q, w);
    return c;
}

// A light vertex sending light along `w` (unit).
fn evaluate_light_vertex(v: PathVertex, w: vec3<f32>) -> Evaluation {
    var c: Evaluation;
    if ((v.flags & VERTEX_EMITTER) != 0u) {
        let profile = emitter_profile(v, w);
        c.value = vec3<f32>(profile.x);
        c.pdf = profile.y * v.select_pdf;
        c.pdf_reverse = 0.0;
        c.cosine = vertex_cosine(v, w);
        return c;
    }
    let b = vertex_bsdf(v);
    let wl = to_local(v.normal, v.to_previous);
    let wc = to_local(v.normal, w);
    let value = bsdf_eval(b, wl, wc);
    let side = dot(v.geometric, w);
    let consistent = side * wc.z > 0.0 && wl.z > 0.0;
    // Veach 1997, Eq. 5.19: light is received over the geometric cosine and scattered over the shading one.
    let correction = abs(wl.z) / max(abs(dot(v.geometric, v.to_previous)), 1e-9);
    c.value = select(vec3<f32>(0.0), value.f * (abs(side) * correction), consistent);
    c.pdf = value.pdf_to_sensor * v.select_pdf;
    c.pdf_reverse = value.pdf_to_light;
    c.cosine = abs(side);
    return c;
}

// A direction in which a subpath goes on from a vertex.
struct Scatter {
    direction: vec3<f32>,
    weight: vec3<f32>,
    pdf: f32,
    pdf_reverse: f32,
    // Geometric cosine of the new direction.
    cosine: f32,
    delta: bool,
    valid: bool,
}

// Next direction of a subpath at vertex v; `to_light` for sensor subpaths.
fn sample_vertex(v: PathVertex, to_light: bool, u: vec4<f32>) -> Scatter {
    let b = vertex_bsdf(v);
    let known = to_local(v.normal, v.to_previous);
    let sample = bsdf_sample(b, known, to_light, u);
    var s: Scatter;
    s.valid = false;
    if (!sample.valid) {
        return s;
    }
    s.direction = normalize(frame_around(v.normal) * sample.direction);
    let side = dot(v.geometric, s.direction);
    s.valid = side * sample.direction.z > 0.0;
    s.cosine = abs(side);
    s.pdf = sample.pdf;
    s.pdf_reverse = sample.pdf_reverse;
    s.delta = sample.delta;
    // Delta lobes keep reflectance / probability: their cosines cancel with those of the measure, up to the same
    // shading-normal correction as smooth ones.
    let known_ratio = known.z / max(abs(dot(v.geometric, v.to_previous)), 1e-9);
    let new_cosine = abs(sample.direction.z);
    let smooth_factor = select(known_ratio * s.cosine, new_cosine, to_light);
    let delta_factor = select(known_ratio * s.cosine / new_cosine, 1.0, to_light);
    s.weight = sample.weight * select(smooth_factor, delta_factor, s.delta);
    return s;
}
