// MIS weights: the power heuristic (Eq. 27, beta = 2) over exactly the strategies that are switched on, computed with Georgiev's
// partial sums ("Implementing Vertex Connection and Merging", 2012, Eqs. 31 to 40). For each path, the weights of these
// strategies sum to 1.
//
// Punctual lights, and the spots of beams of zero radius, are deterministic vertices. All other vertices of light subpaths
// are random. A query chooses among all light subpaths by their contribution, whereas a sensor subpath takes the vertex that
// it happens to hit. So each of the first two random vertices of a connected light subpath multiplies the number of samples by
// g = `query_sample_count`: a strategy with r random vertices takes n(r) = g^min(r, 2) samples. Later vertices do not raise the
// number: subpaths with many segments are rare, and the few of one iteration must not dominate the image.
//
// The strategy t = 1 uses no query. It takes m n(r - 1) / g samples, where m is `splat_sample_count`. This is m / g times the
// number of samples of the connection to the previous vertex. If the previous vertex is deterministic, t = 1 takes m samples,
// because no query chooses a deterministic vertex. With g = 1, these weights are the plain power heuristic.
//
// Light from the sky: s = 0 (a sensor subpath leaves the scene) and s = 1 (a sampled direction) take one sample each. Strategies
// with s >= 2 take g samples each, or m for t = 1.
#import partial_sums
#import camera

// Partial sums of a light subpath's first segment (Eqs. 31 and 32): d_vcm is the term of s = 1, d_vc that of s = 0. Not called for
// beams, whose sums are 0.
fn start_light_sums(s: ptr<function, PathState>, e: Emission) {
    if (e.stored) {
        let cosine = vertex_cosine(e.vertex, e.direction);
        (*s).d_vcm = mis(1.0 / (frame.query_sample_count * e.pdf_direction));
        (*s).d_vc = frame.keep_s0 * mis(cosine / (frame.query_sample_count * e.density * e.pdf_direction));
    } else {
        // Strategy s = 1 connects to each punctual light, each sun and the sky once. Only longer light subpaths select the light
        // with probability select_pdf.
        (*s).d_vcm = mis(1.0 / (frame.query_sample_count * e.pdf_direction * e.vertex.select_pdf));
        (*s).d_vc = 0.0;
        if (HAS_SKY && e.sky) {
            let density = frame.query_sample_count * e.pdf_direction * e.vertex.select_pdf * e.density;
            (*s).d_vc = keep_escape() * mis(1.0 / density);
        }
    }
}

// Partial sums of a sensor subpath's first segment (Eqs. 33 and 34): d_vcm is the term of t = 1. `cosine` is the cosine of the
// angle between the segment and the camera axis, and `chief` as in `pixel_pdf`. The first segment of an orthographic camera has PATH_PARALLEL, so the density
// per area of its end point does not fall with the distance.
fn start_sensor_sums(s: ptr<function, PathState>, cosine: f32, chief: vec3<f32>) {
    (*s).d_vcm = frame.keep_t1 * mis(frame.splat_sample_count / pixel_pdf(cosine, chief));
    (*s).d_vc = 0.0;
}

// For the connection of q to a light subpath with r random vertices: sample counts of the strategies with longer light subpaths,
// divided by n(r). x: longer by one vertex, y: longer by two or more. `depth` is the number of segments from the sensor to q. The
// strategy t = 1 has the longest light subpath; the partial sums already contain its factor m / g.
fn sample_count_ratios(r: u32, depth: u32) -> vec2<f32> {
    let g = frame.query_sample_count;
    let next = select(1.0, g, (depth == 1u && r == 0u) || (depth > 1u && r < 2u));
    let more = select(1.0, g, r < 2u) * select(1.0, g, r == 0u && depth > 2u);
    return vec2<f32>(next, more);
}

// Weight of connecting q and v (Eqs. 38 to 40). d2: squared length of the segment; in media, divided by its `flight_density`.
// `light_sum`: sum over the strategies with shorter light subpaths, which trace v from q. `sensor_sum`: sum over the strategies with
// shorter sensor subpaths, which trace q from v. Each term is a squared ratio: density times sample count of the
// strategy, over the same product of this connection.
fn connection_weight(q: PathVertex, v: PathVertex, at_q: Evaluation, at_v: Evaluation, d2: f32) -> f32 {
    let q_to_v = at_q.pdf * at_v.cosine / d2;
    let v_to_q = at_v.pdf * at_q.cosine / d2;
    let ratios = sample_count_ratios(random_vertices(v), q.flags & VERTEX_DEPTH);
    var light_sum = mis(q_to_v) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse));
    var sensor_sum = frame.keep_s2
        * (mis(ratios.x * v_to_q) * q.d_vcm + mis(ratios.y * v_to_q) * (q.d_vc * mis(at_q.pdf_reverse)));
    if (HAS_ELLIPSOIDS) {
        let w = normalize(v.position - q.position);
        let r = distance(v.position, q.position);
        light_sum += mis(q_to_v) * auxiliary_sum(v) + sum_over_auxiliary(v, -w, r);
        sensor_sum += mis(ratios.x * v_to_q) * auxiliary_sum(q) + sum_over_sensor_auxiliary(q, w, r);
    }
    // The sums assume that flights place all events. Sensor subpaths draw events next to a deterministic vertex in the gate instead.
    if (is_in_medium(q) && is_drawn_in_gate(v)) {
        sensor_sum /= mis(density_gain(q.material, normalize(v.position - q.position), q.to_previous));
    } else if (follows_connected(v)) {
        light_sum *= mis(density_gain(v.material, v.to_previous, normalize(q.position - v.position)));
    }
    return 1.0 / (1.0 + light_sum + sensor_sum);
}

// Weight of s = 0 for a sensor subpath that ends at q on an emitter, `depth` segments from the sensor. `direct`:
// density per area with which s = 1 chooses this point. `emitted`: density per solid angle with which the emitter
// sends light along the last segment.
fn emitter_weight(q: PathVertex, depth: u32, direct: f32, emitted: f32) -> f32 {
    if (depth == 1u) {
        // The strategy s = 1, t = 1 is not formed.
        return 1.0;
    }
    let ratios = sample_count_ratios(0u, depth);
    let further = frame.keep_s2 * mis(ratios.y * direct) * (mis(emitted) * q.d_vc);
    return 1.0 / (1.0 + mis(ratios.x * direct) * (q.d_vcm + auxiliary_sum(q)) + further);
}

// Weight of t = 1 at v. `area_density`: density per area with which a sensor sample of the pixel reaches v.
fn splat_weight(v: PathVertex, at_v: Evaluation, area_density: f32) -> f32 {
    // n(r) divided by the number of samples of t = 1.
    let g = frame.query_sample_count;
    let ratio = g * select(1.0, g, random_vertices(v) == 2u) / frame.splat_sample_count;
    return 1.0 / (1.0 + mis(ratio * area_density) * (v.d_vcm + auxiliary_sum(v) + v.d_vc * mis(at_v.pdf_reverse)));
}

// `sum_over_auxiliary` for a shade point. The first surface is no auxiliary vertex: its neighbour on the sensor's side is the
// sensor.
fn sum_over_sensor_auxiliary(q: PathVertex, w: vec3<f32>, r: f32) -> f32 {
    if ((q.flags & VERTEX_DEPTH) < 2u) {
        return 0.0;
    }
    return sum_over_auxiliary(q, w, r);
}

// Weight of the ellipsoidal connection of q and v over the auxiliary vertex x. to_v, r1, to_q, r2: unit directions and distances
// from x. d2: squares of r1 and r2; in media, each divided by the `flight_density` of its segment.
fn ellipsoidal_weight(
    q: PathVertex, v: PathVertex, x: PathVertex, at_q: Evaluation, at_v: Evaluation, at_x: Evaluation,
    d2: vec2<f32>, to_v: vec3<f32>, r1: f32, to_q: vec3<f32>, r2: f32,
) -> f32 {
    let squared = auxiliary_density2(x.geometric, to_v, r1, to_q, r2);
    let cosine_v = vertex_cosine(x, to_v);
    let cosine_q = vertex_cosine(x, to_q);
    // Strategies that trace x from q: they connect x to v, or also trace v from x.
    let x_to_v = mis(at_x.pdf * at_v.cosine / d2.x);
    let before = x_to_v * (v.d_vcm + auxiliary_sum(v) + v.d_vc * mis(at_v.pdf_reverse));
    let light_sum = mis(at_q.pdf * cosine_q / d2.y) * (1.0 + before + sum_over_auxiliary(v, -to_v, r1));
    // Strategies that trace x from v.
    let x_to_q = mis(at_x.pdf_reverse * at_q.cosine / d2.y);
    let ratios = sample_count_ratios(random_vertices(v) + 1u, q.flags & VERTEX_DEPTH);
    let after = x_to_q * (mis(ratios.x) * (q.d_vcm + auxiliary_sum(q)) + mis(ratios.y) * (q.d_vc * mis(at_q.pdf_reverse)));
    let sensor_sum = mis(sample_count_ratio(v) * at_v.pdf * cosine_v / d2.x) * (1.0 + after + sum_over_sensor_auxiliary(q, -to_q, r2));
    return squared / (squared + light_sum + sensor_sum);
}

// Factor of the strategy s = 0 for light from the sky in the MIS sums: 0 if it is switched off, otherwise 1.
fn keep_escape() -> f32 {
    return select(0.0, 1.0, frame.keep_s0 > 0.0);
}

// Weight of connecting q to the sky (s = 1). `pdf`: density per solid angle of sampling the direction.
fn sky_connection_weight(q: PathVertex, at_q: Evaluation, pdf: f32) -> f32 {
    let header = load_sky();
    // Light subpaths sample the direction with the same density `pdf`, so `pdf` cancels.
    let longer = frame.query_sample_count * header.select_pdf * header.disk_pdf * at_q.cosine;
    let light_sum = keep_escape() * mis(at_q.pdf / pdf);
    let sensor_sum = frame.keep_s2 * mis(longer) * (q.d_vcm + q.d_vc * mis(at_q.pdf_reverse));
    return 1.0 / (1.0 + light_sum + sensor_sum);
}

// Weight of s = 0 for a sensor subpath that leaves the scene with its segment `depth`. `pdf`: see `sky_connection_weight`.
fn sky_escape_weight(s: PathState, depth: u32, pdf: f32) -> f32 {
    if (depth == 1u) {
        return 1.0;
    }
    let header = load_sky();
    let longer = frame.query_sample_count * header.select_pdf * header.disk_pdf * pdf;
    return 1.0 / (1.0 + mis(pdf) * s.d_vcm + frame.keep_s2 * mis(longer) * s.d_vc);
}
