// A connection between a shade point and a light vertex, before its visibility.
//
// For q = q^(t) and v = v^(s) the contribution is (Eq. 25)
//     w_{s,t} omega_t phi_j f_j(q) / (K P(j | q)),   f_j = f(q) cos f(v) cos V(q, v) / d^2,
// inside the gate. w_{s,t} is the power heuristic (Eq. 27) over all strategies that are kept, by Georgiev's partial sums:
// those that would have traced q from v stand in w_sensor, those that would have traced v from q in w_light.
#import scatter

// The contribution of the connection without V and without the factor 1 / (K P(j | q)) of how v was chosen.
fn unshadowed(q: PathVertex, v: PathVertex) -> vec3<f32> {
    let offset = v.position - q.position;
    let d2 = dot(offset, offset);
    let w = offset * inverseSqrt(d2);
    let at_q = connect_shade_point(q, w);
    let at_v = connect_light_vertex(v, -w);
    let weight = mis_weight(q, v, at_q, at_v, d2);
    return q.throughput * v.throughput * at_q.value * at_v.value * (weight / d2);
}

// Eq. 27 with beta = 2 (Georgiev 2012, Eqs. 38 to 40).
fn mis_weight(q: PathVertex, v: PathVertex, at_q: Connection, at_v: Connection, d2: f32) -> f32 {
    let q_to_v = at_q.pdf * at_v.cosine / d2;
    let v_to_q = at_v.pdf * at_q.cosine / d2;
    let w_light = mis(q_to_v) * (v.d_vcm + v.d_vc * mis(at_v.pdf_reverse));
    let w_sensor = frame.keep_s2 * mis(v_to_q) * (q.d_vcm + q.d_vc * mis(at_q.pdf_reverse));
    // Deterministic vertices are not chosen: one sample each.
    let others = select(1.0, mis(frame.gain), (v.flags & VERTEX_DETERMINISTIC) != 0u);
    return 1.0 / (1.0 + others * (w_light + w_sensor));
}
