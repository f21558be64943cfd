// MIS weights: the power heuristic (Eq. 27, beta = 2) over exactly the strategies that are kept, by Georgiev's partial sums
// ("Implementing Vertex Connection and Merging", 2012, Eqs. 31 to 40). Weights of all kept strategies of a path sum to 1.
//
// A query chooses among all light subpaths by what they contribute, a sensor subpath takes the vertex it happens to reach. So the
// first two vertices of a connected light subpath that are not deterministic count as g = `query_sample_count` samples each: a
// strategy with r such vertices takes n(r) = g^min(r, 2) samples. (Later vertices do not count more: subpaths of many segments are
// so rare that one pool of them must not carry the image.) No query serves t = 1: it takes m n(r - 1) / g samples, where m is
// `splat_sample_count`. So it takes m / g times the samples of the connection to the vertex before it, or m if that vertex is
// deterministic: nothing chooses it. With g = 1 this is the plain power heuristic.
#import partial_sums
#import camera

// Sums of a light subpath's first segment (Eqs. 31 and 32): d_vcm leads to s = 1, d_vc to s = 0. Not for beams: both are 0.
fn start_light_sums(s: ptr<function, PathState>, e: Emission) {
    if (e.stored) {
        let cosine = vertex_cosine(e.vertex, e.direction);
        (*s).d_vcm = mis(1.0 / (frame.query_sample_count * e.pdf_direction));
        (*s).d_vc = frame.keep_s0 * mis(cosine / (frame.query_sample_count * e.density * e.pdf_direction));
    } else {
        // A punctual light is connected once at every shade point, not with the probability of being chosen.
        (*s).d_vcm = mis(1.0 / (frame.query_sample_count * e.pdf_direction * e.vertex.select_pdf));
        (*s).d_vc = 0.0;
    }
}

// Sums of a sensor subpath's first segment (Eqs. 33 and 34): d_vcm leads to t = 1. `cosine` to the axis.
fn start_sensor_sums(s: ptr<function, PathState>, cosine: f32) {
    (*s).d_vcm = frame.keep_t1 * mis(frame.splat_sample_count / pixel_pdf(cosine));
    (*s).d_vc = 0.0;
}

// n(r + 1) / n(r) and n(r + 2) / n(r) of strategies that trace one vertex more from a light subpath with r random vertices, or more
// than one, for q `depth` segments from the sensor. The last of them is t = 1, which the sums hold
// with splat_sample_count / query_sample_count.
fn sample_count_ratios(r: u32, depth: u32) -> vec2<f32> {
    let g = frame.query_sample_count;
    let next = select(1.0, g, (depth == 1u && r == 0u) || (depth > 1u && r < 2u));
    let more = select(1.0, g, r < 2u) * select(1.0, g, r == 0u && depth > 2u);
    return vec2<f32>(next, more);
}

// Weight of connecting q and v at the squared distance d2 (Eqs. 38 to 40). Strategies that would have traced q from v stand
// in w_sensor, those that would have traced v from q in w_light.
fn connection_weight(q: PathVertex, v: PathVertex, at_q: Evaluation, at_v: Evaluation, d2: f32) -> f32 {
    let q_to_v = at_q.pdf * at_v.cosine / d2;
    let v_to_q = at_v.pdf * at_q.cosine / d2;
    let ratios = sample_count_ratios(random_vertices(v), q.flags & VERTEX_DEPTH);
    let w_light = mis(q_to_v) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse));
    let w_sensor = frame.keep_s2 * (mis(ratios.x * v_to_q) * q.d_vcm + mis(ratios.y * v_to_q) * (q.d_vc * mis(at_q.pdf_reverse)));
    return 1.0 / (1.0 + w_light + w_sensor);
}

// Weight of s = 0 at a subpath's end on an emitter, `depth` segments from the sensor. `direct`: density per area with which
// s = 1 chooses the point; `emitted`: density per solid angle of its light going the subpath's way.
fn emitter_weight(q: PathVertex, depth: u32, direct: f32, emitted: f32) -> f32 {
    if (depth == 1u) {
        // s = 1, t = 1 is not formed.
        return 1.0;
    }
    let ratios = sample_count_ratios(0u, depth);
    let further = frame.keep_s2 * mis(ratios.y * direct) * (mis(emitted) * q.d_vc);
    return 1.0 / (1.0 + mis(ratios.x * direct) * q.d_vcm + further);
}

// Weight of t = 1 at v; `area_density`: with which the sensor's own sample of the pixel reaches v, per area.
fn splat_weight(v: PathVertex, at_v: Evaluation, area_density: f32) -> f32 {
    // n(r) over the number of samples of t = 1.
    let g = frame.query_sample_count;
    let ratio = g * select(1.0, g, random_vertices(v) == 2u) / frame.splat_sample_count;
    return 1.0 / (1.0 + mis(ratio * area_density) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse)));
}
