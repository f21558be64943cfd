// A connection between a shade point and a light vertex, before the visibility test.
//
// For q = q^(t) and v = v^(s) the contribution is (Eq. 25)
//     w_{s,t} omega_t phi_j f_j(q) / (K P(j | q)),   f_j = f(q) cos f(v) cos V(q, v) / d^2,
// if the travel time is inside the gate. In media, the transmittance T of the segment is a further factor of f_j. w_{s,t} is the
// power heuristic (Eq. 27) over all strategies that are kept: see `weights.wgsl`.
#import weights
#import segment

// xyz: contribution of the connection of q and v. The caller multiplies it by the gate, the visibility V, the MIS weight and
// 1 / (K P(j | q)). w: the MIS weight w_{s,t}.
fn unshadowed(q: PathVertex, v: PathVertex) -> vec4<f32> {
    let segment = segment_between(q.position, v.position);
    let at_q = evaluate_shade_point(q, segment.direction);
    let at_v = evaluate_light_vertex(v, -segment.direction);
    let depths = segment_depths(q, segment.direction, sqrt(segment.length2));
    let value = q.throughput * v.throughput * at_q.value * at_v.value * transmitted(depths) / segment.length2;
    let reached = select(flight_density(depths.scattering), 1.0, is_sun(v));
    return vec4<f32>(value, connection_weight(q, v, at_q, at_v, segment.length2 / reached));
}
