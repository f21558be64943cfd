// Connects shade points to the light vertices chosen for them: measurement contribution, MIS weight, visibility.
#import candidate
#import connection
#import doppler
#import ellipsoidal_connection
#import fog
#import shade_point
#import tree
#import samples
#import observed

// `shade_list`: the sensor subpath of each shade point that was queried. `slot_list`: the indices of candidates that can
// contribute.
@group(2) @binding(1) var<storage, read> shade_list: array<u32>;
@group(2) @binding(2) var<storage, read> slot_list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
@group(2) @binding(4) var<storage, read> candidates: array<Candidate>;
// xyz: contribution of a candidate to its pixel. w: travel time; 0 for light from the sky. With OBSERVE_STRATEGIES, w is the MIS
// weight, and xyz is not multiplied by it. In both cases w is NOT_TRACED if no ray was traced.
@group(2) @binding(5) var<storage, read_write> contributions: array<vec4<f32>>;
// epc only: the triangle chosen for each entry of `slot_list` (ellipsoid_triangles.wgsl).
@group(2) @binding(6) var<storage, read> choices: array<TriangleChoice>;
// With RESAMPLES_ELLIPSOIDS only: the auxiliary vertex of each shade point (ellipsoid_resample.wgsl).
@group(2) @binding(7) var<storage, read> auxiliary_points: array<AuxiliaryPoint>;
// With DRAWS_IN_GATE only: the segments before the shade points.
@group(2) @binding(9) var<storage, read> segments: array<FogSegment>;

// One thread connects one candidate.
@compute @workgroup_size(WORKGROUP)
fn connect(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = slot_list[id.x];
    let path = shade_list[slot / frame.slots];
    let contribution = connected(load_shade_point(path), id.x, slot);
    contributions[slot] = contribution;
    if (OBSERVE != 0u) {
        observe(first_entry() + id.x, contribution, path, candidates[slot].vertex);
    }
}

// The entry in `observed` of the first candidate in `slot_list`: it comes after the paths that this bounce and earlier ones have traced,
// and after the candidates and shade points of earlier bounces. The list of the next bounce's paths is complete, but they are not traced
// yet.
fn first_entry() -> u32 {
    let next = counters[LIVING_LIST + (dispatch.bounce + 1u) % 2u];
    let traced = dispatch.count + counters[COUNTER_TOTALS + LIVING_LIST] + counters[COUNTER_TOTALS + LIVING_LIST + 1u] - next;
    let candidates = counters[COUNTER_TOTALS + CANDIDATE_LIST] - counters[dispatch.counter];
    return entry_after(traced, candidates, counters[COUNTER_TOTALS + SHADE_LIST] - counters[SHADE_LIST]);
}

// The entry in `contributions` of the candidate in `slot`, for the shade point `at`. `rank`: place of the candidate in `slot_list`.
fn connected(at: PathVertex, rank: u32, slot: u32) -> vec4<f32> {
    var q = at;
    let candidate = candidates[slot];
    if (HAS_SKY && candidate.vertex == SKY_VERTEX) {
        return connect_to_sky(q, slot);
    }
    let sensor = sensor_sample(q.owner);
    if (HAS_ELLIPSOIDS && (candidate.vertex & ELLIPSOIDAL) != 0u) {
        let v = load_light_vertex(candidate.vertex & ~ELLIPSOIDAL);
        if (RESAMPLES_ELLIPSOIDS) {
            return connect_by_ellipsoid(q, v, sensor, auxiliary_points[slot / frame.slots], 1.0, slot);
        }
        let tau = drawn_travel_time(sensor);
        let choice = choices[rank];
        let words = pcg4d(ellipsoid_key(sensor, dispatch.bounce, slot) ^ vec4<u32>(0u, 0u, 0u, choice.triangle));
        let point = draw_on_triangle(q, v, tau, choice, f32(words.x >> 8u) * (1.0 / 16777216.0));
        return connect_by_ellipsoid(q, v, sensor, AuxiliaryPoint(point.triangle, tau, point.weights), point.inverse_density, slot);
    }
    var v = load_light_vertex(candidate.vertex);
    if (HAS_OWN_LASERS) {
        v.to_previous = load_aim(sensor.pixel).xyz;
    }
    let key = random_key(STREAM_ALPHA, sensor.index, sensor.sample, CONNECTION_BIT | dispatch.bounce, slot % frame.slots, sensor.seed);
    // The first slots serve the segment before q (slots.wgsl).
    var is_visible = false;
    if (DRAWS_IN_GATE && slot % frame.slots < frame.deterministic_count * event_count()) {
        let start = segment_start(q, segments[q.owner]);
        let number = slot % frame.slots % event_count();
        let u = event_uniforms(q, number, sensor, flight_uniforms(key).xy);
        q = draw_in_gate(q, segments[q.owner], v, event_gate(q, number, sensor), u);
        // The subpath has come from the place of its laser.
        is_visible = HAS_OWN_LASERS && (q.flags & VERTEX_DEPTH) == 1u && !HAS_ALPHA && !HAS_SHEETS;
        if (HAS_SHEETS) {
            pass_sheets_before(&q, start, dispatch.bounce == 0u);
        }
    }

    let segment = segment_between(q.position, v.position);
    let w = segment.direction;
    let tau = connection_time(q, v, w, sqrt(segment.length2));
    let in_gate = gate_weight_before_delays(tau);
    if (in_gate == 0.0) {
        return vec4<f32>(0.0, 0.0, 0.0, NOT_TRACED);
    }
    let contribution = unshadowed(q, v);
    let counted = select(contribution.w, 1.0, OBSERVE == OBSERVE_STRATEGIES);
    let value = contribution.xyz * (candidate.weight * counted * in_gate);
    if (!(max_component(abs(value)) > 0.0)) {
        // The value is zero or not a number, so no ray is needed. `gather` counts the second case as dropped.
        return vec4<f32>(value, NOT_TRACED);
    }

    // Visibility between the two points, both moved off their surfaces by the rounding offset.
    let lit = is_visible || is_unoccluded(ray_end(q, w), ray_end(v, -w), key);
    var passed = traced_transmittance(q, w, sqrt(segment.length2));
    let delayed = tau + traced_delay();
    if (HAS_DELAYS) {
        passed *= gate_weight(delayed);
    }
    var arrival = delayed;
    var light = value * passed;
    if (HAS_DOPPLER) {
        let growth = connected_growth(q, v, w, eta_towards(q, w));
        light = recorded(light, growth);
        arrival = apparent_time(delayed, growth);
    }
    let last = select(arrival, contribution.w, OBSERVE == OBSERVE_STRATEGIES);
    return vec4<f32>(select(vec3<f32>(0.0), light, lit), last);
}

// The entry in `contributions` for an ellipsoidal connection of q and v over the point `x`. `inverse_density`: see `EllipsoidPoint`.
fn connect_by_ellipsoid(
    q: PathVertex, v: PathVertex, sensor: SensorSample, x: AuxiliaryPoint, inverse_density: f32, slot: u32,
) -> vec4<f32> {
    let nothing = vec4<f32>(0.0, 0.0, 0.0, NOT_TRACED);
    if (x.triangle == NONE || gate_weight_before_delays(x.tau) == 0.0) {
        return nothing;
    }
    let c = connect_over(q, v, x.triangle, x.weights);
    if (!c.found) {
        return nothing;
    }
    let value = c.value * (inverse_density * candidates[slot].weight * select(c.weight, 1.0, OBSERVE == OBSERVE_STRATEGIES));
    if (!(max_component(abs(value)) > 0.0)) {
        return vec4<f32>(value, NOT_TRACED);
    }
    let words = pcg4d(ellipsoid_key(sensor, dispatch.bounce, slot) ^ vec4<u32>(0u, 0u, 0u, x.triangle));
    let lit_q = is_unoccluded(ray_end(q, -c.to_q), ray_end(c.x, c.to_q), words);
    var passed = traced_transmittance(q, -c.to_q, distance(q.position, c.x.position));
    var tau = x.tau + traced_delay();
    let lit = lit_q && is_unoccluded(ray_end(v, -c.to_v), ray_end(c.x, c.to_v), words.yzwx);
    passed *= traced_transmittance(v, -c.to_v, distance(v.position, c.x.position));
    tau += traced_delay();
    if (HAS_DELAYS) {
        passed *= gate_weight(tau);
    }
    let last = select(tau, c.weight, OBSERVE == OBSERVE_STRATEGIES);
    return vec4<f32>(select(vec3<f32>(0.0), value * passed, lit), last);
}

// The entry in `contributions` for a connection of q to the sky, in a direction sampled in proportion to luminance (s = 1).
fn connect_to_sky(q: PathVertex, slot: u32) -> vec4<f32> {
    let sensor = sensor_sample(q.owner);
    let seen = sample_sky(random_words(STREAM_QUERY, sensor.index, sensor.sample, q.flags & VERTEX_DEPTH, 2u, frame.seed));
    let w = seen.direction;
    if (!(seen.pdf > 0.0 && faces(q, w))) {
        return vec4<f32>(0.0, 0.0, 0.0, NOT_TRACED);
    }
    let at_q = evaluate_shade_point(q, w);
    let weight = sky_connection_weight(q, at_q, seen.pdf);
    let counted = select(weight, 1.0, OBSERVE == OBSERVE_STRATEGIES);
    let value = q.throughput * at_q.value * transmitted(segment_depths(q, w, 3e38)) * seen.radiance * (counted / seen.pdf);
    if (!(max_component(abs(value)) > 0.0)) {
        return vec4<f32>(value, NOT_TRACED);
    }
    let key = random_key(STREAM_ALPHA, sensor.index, sensor.sample, CONNECTION_BIT | dispatch.bounce, slot % frame.slots, frame.seed);
    let lit = trace(ray_end(q, w), w, 3e38, true, NONE, key).triangle == NONE;
    var light = value * traced_transmittance(q, w, 3e38);
    if (HAS_DOPPLER) {
        light = recorded(light, growth_to(q) - eta_towards(q, w) * dot(w, vertex_velocity(q)));
    }
    return vec4<f32>(select(vec3<f32>(0.0), light, lit), select(0.0, weight, OBSERVE == OBSERVE_STRATEGIES));
}
