// Scattering at vertices in world space: connections, and the next segment of a subpath.
#import emitter

struct Connection {
    // Factor of the measurement contribution at this end, its cosine included.
    value: vec3<f32>,
    // Density per solid angle of sampling the connecting direction, and of sampling the direction to the previous vertex
    // when coming along the connection.
    pdf: f32,
    pdf_reverse: f32,
    // Geometric cosine that turns a density arriving here into one per area; 1 for points.
    cosine: f32,
}

// A shade point looking along `w` (unit) for light. Shading normals enter as cos(normal, light): Veach 1997, Eq. 5.18.
fn connect_shade_point(q: PathVertex, w: vec3<f32>) -> Connection {
    let b = make_bsdf(q.material, q.base_color, (q.flags & VERTEX_FRONT) != 0u);
    let wc = to_local(q.normal, q.to_previous);
    let wl = to_local(q.normal, w);
    let value = bsdf_eval(b, wl, wc);
    let consistent = dot(q.geometric, w) * wl.z > 0.0 && wc.z > 0.0;
    var c: Connection;
    c.value = select(vec3<f32>(0.0), value.f * abs(wl.z), consistent);
    c.pdf = value.pdf_to_light;
    c.pdf_reverse = value.pdf_to_sensor;
    c.cosine = abs(dot(q.geometric, w));
    return c;
}

// A light vertex sending light along `w` (unit).
fn connect_light_vertex(v: PathVertex, w: vec3<f32>) -> Connection {
    var c: Connection;
    if ((v.flags & VERTEX_EMITTER) != 0u) {
        let profile = emitter_profile(v, w);
        c.value = vec3<f32>(profile.x);
        c.pdf = profile.y * v.select_pdf;
        c.pdf_reverse = 0.0;
        c.cosine = select(1.0, abs(dot(v.geometric, w)), v.material <= EMIT_TWO_SIDED);
        return c;
    }
    let b = make_bsdf(v.material, v.base_color, (v.flags & VERTEX_FRONT) != 0u);
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

fn to_local(normal: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
    return w * frame_around(normal);
}

// Refractive index of the medium that a segment leaving the vertex along `w` travels in.
fn medium_towards(v: PathVertex, w: vec3<f32>) -> f32 {
    if (!transmits(v) || dot(v.geometric, w) >= 0.0) {
        return v.eta;
    }
    return select(1.0, load_material(v.material).ior, (v.flags & VERTEX_FRONT) != 0u);
}

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
fn scatter(v: PathVertex, to_light: bool, u: vec4<f32>) -> Scatter {
    let b = make_bsdf(v.material, v.base_color, (v.flags & VERTEX_FRONT) != 0u);
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

// Partial MIS sums stay finite: a strategy that lags behind by so much takes no part.
const LARGEST_SUM: f32 = 1e30;

// n(r + 1) / n(r) of `weights.wgsl` for a light subpath that goes on from v.
fn gain_after(v: PathVertex) -> f32 {
    return select(1.0, frame.gain, random_vertices(v) < 2u);
}

// One step of the partial MIS sums when the subpath goes on from a vertex (Georgiev 2012, Eqs. 35 and 36), before the
// distance and cosine at the next vertex are known. `samples`: for how many the next vertex of a light subpath stands, times the
// probability of its emitter after deterministic vertices; else 1.
fn mis_scatter(state: ptr<function, PathState>, s: Scatter, samples: f32) {
    if (s.delta) {
        (*state).d_vcm = 0.0;
        (*state).d_vc = (*state).d_vc * mis(s.cosine / samples);
        return;
    }
    let density = s.pdf * samples;
    (*state).d_vc = min(mis(s.cosine / density) * ((*state).d_vcm + (*state).d_vc * mis(s.pdf_reverse)), LARGEST_SUM);
    (*state).d_vcm = min(mis(1.0 / density), LARGEST_SUM);
}

// The same sums on arrival: densities per solid angle become densities per area.
fn mis_arrive(state: ptr<function, PathState>, distance2: f32, cosine: f32) {
    let c = mis(max(cosine, 1e-12));
    (*state).d_vcm = min((*state).d_vcm * mis(distance2) / c, LARGEST_SUM);
    (*state).d_vc = min((*state).d_vc / c, LARGEST_SUM);
}
