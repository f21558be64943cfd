// MIS weights: the power heuristic (Eq. 27, beta = 2) over exactly the strategies that are kept, by Georgiev's partial sums
// ("Implementing Vertex Connection and Merging", 2012, Eqs. 31 to 40). Weights of all kept strategies of a path sum to 1.
#import scatter
#import camera

// Sums of a light subpath's first segment (Eqs. 31 and 32): d_vcm leads to s = 1, d_vc to s = 0. Not for beams: both are 0.
fn start_light_sums(s: ptr<function, PathState>, e: Emission) {
    if (e.stored) {
        let cosine = abs(dot(e.vertex.geometric, e.direction));
        (*s).d_vcm = mis(1.0 / e.pdf_direction);
        (*s).d_vc = frame.keep_s0 * mis(cosine / (e.density * e.pdf_direction));
    } else {
        // A punctual light is connected once at every shade point, not with the probability of being chosen.
        (*s).d_vcm = mis(1.0 / (frame.gain * e.pdf_direction * e.vertex.select_pdf));
        (*s).d_vc = 0.0;
    }
}

// Sums of a sensor subpath's first segment (Eqs. 33 and 34): d_vcm leads to t = 1. `cosine` to the axis.
fn start_sensor_sums(s: ptr<function, PathState>, cosine: f32) {
    (*s).d_vcm = frame.keep_t1 * mis(frame.light_count / pixel_pdf(cosine));
    (*s).d_vc = 0.0;
}

// Weight of connecting q and v at the squared distance d2 (Eqs. 38 to 40). Strategies that would have traced q from v stand
// in w_sensor, those that would have traced v from q in w_light.
fn connection_weight(q: PathVertex, v: PathVertex, at_q: Connection, at_v: Connection, d2: f32) -> f32 {
    let q_to_v = at_q.pdf * at_v.cosine / d2;
    let v_to_q = at_v.pdf * at_q.cosine / d2;
    let w_light = mis(q_to_v) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse));
    let w_sensor = frame.keep_s2 * mis(v_to_q) * (q.d_vcm + q.d_vc * mis(at_q.pdf_reverse));
    return 1.0 / (1.0 + mis(once(v)) * (w_light + w_sensor));
}

// Weight of s = 0 at a subpath's end on an emitter, `depth` segments from the sensor. `direct`: density per area with which
// s = 1 chooses the point; `emitted`: density per solid angle of its light going the subpath's way.
fn emitter_weight(q: PathVertex, depth: u32, direct: f32, emitted: f32) -> f32 {
    if (depth == 1u) {
        // s = 1, t = 1 is not formed.
        return 1.0;
    }
    return 1.0 / (1.0 + mis(frame.gain * direct) * (q.d_vcm + frame.keep_s2 * mis(emitted) * q.d_vc));
}

// Weight of t = 1 at v; `area_density`: with which the sensor's own sample of the pixel reaches v, per area.
fn splat_weight(v: PathVertex, at_v: Connection, area_density: f32) -> f32 {
    return 1.0 / (1.0 + mis(frame.gain * area_density / frame.light_count) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse)));
}
