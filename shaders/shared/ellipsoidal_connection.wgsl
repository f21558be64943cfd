// An ellipsoidal connection joins a shade point q and a light vertex v over an auxiliary vertex x (Pediredla et al. 2019). The travel
// time of the path was drawn before, uniformly in the gate.
#import detour
#import ellipsoid_search
#import surface_vertex
#import weights
#import segment

// Key of the random numbers of the connection in `slot` of the candidates.
fn ellipsoid_key(sensor: SensorSample, bounce: u32, slot: u32) -> vec4<u32> {
    return random_key(STREAM_QUERY, sensor.index, sensor.sample, CONNECTION_BIT | bounce, slot % frame.slots, frame.seed);
}

// Draws a point of the ellipsoid on the chosen triangle, if there is one. `u`: uniform in [0, 1).
fn draw_on_triangle(q: PathVertex, v: PathVertex, tau: f32, choice: TriangleChoice, u: f32) -> EllipsoidPoint {
    if (choice.triangle == NONE) {
        return EllipsoidPoint(NONE, vec2<f32>(0.0), 0.0);
    }
    let t = load_triangle(choice.triangle);
    let arcs = arcs_in_triangle(make_ellipsoid(v.position, q.position, length_over_auxiliary(q, v, tau)), t.v0, t.v1, t.v2);
    return EllipsoidPoint(select(NONE, choice.triangle, arcs.length > 0.0), point_on_arcs(arcs, u), f32(choice.count) * arcs.length);
}

// The auxiliary vertex that was chosen for an ellipsoidal connection.
struct AuxiliaryPoint {
    // NONE if no auxiliary vertex was found.
    triangle: u32,
    // Travel time of the path, in units of the render space.
    tau: f32,
    // Barycentric weights of corners 1 and 2.
    weights: vec2<f32>,
}

// An ellipsoidal connection before the visibility test.
struct EllipsoidalConnection {
    // Whether the auxiliary vertex can contribute. If not, the other fields have no meaning.
    found: bool,
    // Contribution if the density on the arcs is 1 per radian, without visibility, MIS weight, gate and weight of the candidate.
    value: vec3<f32>,
    // MIS weight.
    weight: f32,
    x: PathVertex,
    // Unit directions from x to v and to q.
    to_v: vec3<f32>,
    to_q: vec3<f32>,
}

// Connects q and v over a point of the triangle that lies on the ellipsoid. `weights`: barycentric weights of the point.
fn connect_over(q: PathVertex, v: PathVertex, triangle: u32, weights: vec2<f32>) -> EllipsoidalConnection {
    var c: EllipsoidalConnection;
    let surface = surface_at(triangle, weights.x, weights.y);
    let v_segment = segment_between(surface.position, v.position);
    let q_segment = segment_between(surface.position, q.position);
    c.to_v = v_segment.direction;
    c.to_q = q_segment.direction;
    c.x = surface_vertex(surface, c.to_q);
    c.x.eta = SURROUNDING_GROUP_INDEX;
    let is_outside = eta_towards(v, -c.to_v) == SURROUNDING_GROUP_INDEX && eta_towards(q, -c.to_q) == SURROUNDING_GROUP_INDEX
        && !is_in_solid(c.x, c.to_q);
    c.found = is_outside && dot(c.x.geometric, c.to_v) > 0.0 && is_connectible(c.x) && faces(v, -c.to_v) && faces(q, -c.to_q);
    if (!c.found) {
        return c;
    }
    let at_v = evaluate_light_vertex(v, -c.to_v);
    let at_q = evaluate_shade_point(q, -c.to_q);
    let at_x = evaluate_shade_point(c.x, c.to_v);
    let r1 = sqrt(v_segment.length2);
    let r2 = sqrt(q_segment.length2);
    let depths_v = segment_depths(v, -c.to_v, r1);
    let depths_q = segment_depths(q, -c.to_q, r2);
    let cosine = vertex_cosine(c.x, c.to_q);
    let stretch = inverse_stretch(c.x.geometric, c.to_v, r1, c.to_q, r2);
    // 1 / (density per area of x), if the density on the arcs is 1 per radian.
    let inverse_density = (frame.gate_hi - frame.gate_lo) / SURROUNDING_GROUP_INDEX / stretch;
    var coverage_at_x = 1.0;
    if (HAS_ALPHA) {
        coverage_at_x = coverage(surface);
    }
    c.value = q.throughput * v.throughput * at_q.value * at_x.value * at_v.value * transmitted(depths_v) * transmitted(depths_q)
        * (cosine * coverage_at_x * inverse_density / (v_segment.length2 * q_segment.length2));
    let d2_v = v_segment.length2 / flight_density(depths_v.scattering);
    let d2_q = q_segment.length2 / flight_density(depths_q.scattering);
    c.weight = ellipsoidal_weight(q, v, c.x, at_q, at_v, at_x, vec2<f32>(d2_v, d2_q), c.to_v, r1, c.to_q, r2);
    return c;
}
