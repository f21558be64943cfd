// lcs in thin gates: draws ellipsoidal connections for a shade point, and chooses one of them by its unshadowed contribution (Talbot et
// al. 2005). All drawn connections together cost two shadow rays. Bindings: shared/slots.wgsl.
#import ellipsoidal_connection
#import ellipsoid_descent
#import leaf
#import slots

// For each entry of `list`: the auxiliary vertex of the chosen connection.
@group(2) @binding(5) var<storage, read_write> auxiliary_points: array<AuxiliaryPoint>;

// Stream of the random numbers. The trees in shell_resample.wgsl have other streams.
const ELLIPSOID_STREAM: u32 = 24u;

// Candidates per shade point, and light vertices drawn per candidate (docs/notebook/ellipsoids-by-importance.md).
const CANDIDATES: u32 = 8u;
const VERTEX_DRAWS: u32 = 8u;

// Draws a light vertex for an ellipsoidal connection to q with the travel time `tau`, among `count` vertices from `first` on. The weight
// is an unbiased estimate of 1 / probability of the vertex (Talbot et al. 2005). NONE if no drawn vertex can be connected.
fn draw_vertex(q: PathVertex, tau: f32, first: u32, count: u32, rng: ptr<function, u32>) -> Candidate {
    var chosen = Candidate(NONE, 0.0);
    var chosen_importance = 0.0;
    var sum = 0.0;
    for (var i = 0u; i < VERTEX_DRAWS; i++) {
        let vertex = first + multiply_wide(next_word(rng), count).x;
        let v = load_leaf_vertex(vertex);
        let importance = select(0.0, max_component(v.throughput), can_connect_over_surface(q, v, tau));
        sum += importance;
        if (next_uniform(rng) * sum < importance) {
            chosen.vertex = vertex;
            chosen_importance = importance;
        }
    }
    chosen.weight = f32(count) / f32(VERTEX_DRAWS) * (sum / chosen_importance);
    return chosen;
}

// One thread serves one shade point. The connection takes the last slot.
@compute @workgroup_size(WORKGROUP)
fn ellipsoid_resample(@builtin(global_invocation_id) id: vec3<u32>) {
    let rank = dispatch.rank + id.x;
    if (rank >= counters[dispatch.counter]) {
        return;
    }
    let q = load_shade_point(list[rank]);
    let sensor = sensor_sample(q.owner);
    var rng = random_words(STREAM_QUERY, sensor.index, sensor.sample, q.flags & VERTEX_DEPTH, ELLIPSOID_STREAM, frame.seed).x;
    // With a single tree, the 3D tree holds only punctual lights, if queries choose them. Its vertices come before those of the 4D tree.
    let lamps = frame.deterministic_count + select(0u, frame.emitter_vertex_count, QUERIED_PUNCTUAL);
    let others = frame.vertex_count - lamps;
    // Half of the candidates begin at a lamp, or at another deterministic vertex, if there are vertices of both kinds.
    let of_lamps = select(select(CANDIDATES / 2u, CANDIDATES, others == 0u), 0u, lamps == 0u);
    let to_q = focus_at(q);
    var chosen = AuxiliaryPoint(NONE, 0.0, vec2<f32>(0.0));
    var chosen_vertex = NONE;
    var chosen_target = 0.0;
    var sum = 0.0;
    for (var k = 0u; k < CANDIDATES; k++) {
        let is_lamp = k < of_lamps;
        let n = select(others, lamps, is_lamp);
        let draws = select(CANDIDATES - of_lamps, of_lamps, is_lamp);
        // Travel times are stratified.
        let number = select(k - of_lamps, k, is_lamp);
        let tau = travel_time_at((f32(number) + next_uniform(&rng)) / f32(draws));
        if (n == 0u || gate_weight_before_delays(tau) == 0.0) {
            continue;
        }
        let drawn = draw_vertex(q, tau, select(lamps, 0u, is_lamp), n, &rng);
        if (drawn.vertex == NONE) {
            continue;
        }
        let v = load_light_vertex(drawn.vertex);
        let search = make_search(v.position, q.position, length_over_auxiliary(q, v, tau));
        let x = draw_on_ellipsoid(search, focus_at(v), to_q, &rng);
        if (x.triangle == NONE) {
            continue;
        }
        let c = connect_over(q, v, x.triangle, x.weights);
        let value = select(0.0, (c.value.x + c.value.y + c.value.z) * c.weight, c.found);
        let weight = value * x.inverse_density * (drawn.weight / f32(draws));
        sum += weight;
        // A connection whose weight is not a number or not finite stays, so that it is counted as dropped.
        if (next_uniform(&rng) * sum < weight || !(sum < 3e38)) {
            chosen = AuxiliaryPoint(x.triangle, tau, x.weights);
            chosen_vertex = drawn.vertex;
            chosen_target = value;
        }
    }
    auxiliary_points[rank] = chosen;
    if (chosen_vertex != NONE) {
        let slot = frame.slots - 1u;
        let weight = sum / chosen_target;
        candidates[rank * frame.slots + slot] = Candidate(chosen_vertex | ELLIPSOIDAL, weight);
        marks[rank * mark_words() + slot / SLOTS_PER_MARK] |= 1u << (slot % SLOTS_PER_MARK);
        tallies[q.owner].w += select(0u, 1u, weight > 0.0);
    }
}
