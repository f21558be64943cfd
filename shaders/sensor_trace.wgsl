// Traces one segment of every living sensor subpath: finds the next surface, adds its emission, writes a shade point, and
// samples the next direction.
#import walk
#import weights
#import gate
#import sobol
#import samples
#import observed

@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
@group(2) @binding(1) var<storage, read_write> shade_points: array<PathVertex>;
@group(2) @binding(2) var<storage, read> list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
// For each entry of `list`: MARK_ALIVE and MARK_SHADE.
@group(2) @binding(4) var<storage, read_write> marks: array<u32>;
@group(2) @binding(5) var<storage, read_write> radiance: array<vec4<f32>>;
@group(2) @binding(6) var<storage, read_write> tallies: array<vec4<u32>>;
// With DRAWS_IN_GATE only: the segments before the shade points.
@group(2) @binding(9) var<storage, read_write> segments: array<FogSegment>;

const MARK_ALIVE: u32 = 1u;
const MARK_SHADE: u32 = 2u;

// One thread traces one sensor subpath.
@compute @workgroup_size(WORKGROUP)
fn sensor_trace(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = list[id.x];
    var s = states[slot];
    marks[id.x] = 0u;
    if (OBSERVE != 0u) {
        observe(first_entry() + id.x, vec4<f32>(0.0), slot, NONE);
    }

    // Nearest surface along the ray.
    let sensor = sensor_sample(slot);
    let key = random_key(STREAM_ALPHA, sensor.index, sensor.sample, dispatch.bounce, 0u, sensor.seed);
    let depth = dispatch.bounce + 1u;
    var flight = flight_uniforms(key);
    if (HAS_MEDIA && depth == 1u) {
        flight = vec3<f32>(stratified2(sensor.index, frame.iteration, sensor.number, PAIR_FLIGHT, sensor.seed), flight.z);
    }
    if (HAS_SHEETS && depth == 1u) {
        sheet_numbers = stratified2(sensor.index, frame.iteration, sensor.number, PAIR_SHEET, sensor.seed);
    }
    let stops = SPLITS_AT_SHEETS && depth == 1u && sensor.stops;
    if (SPLITS_AT_SHEETS && depth == 1u) {
        split = select(SPLIT_PASSES, SPLIT_STOPS, stops);
    }
    // Events on the way to the surface are drawn in the gate, and a LiDAR has no use for further ones.
    var arrival = advance(&s, HAS_OWN_LASERS && DRAWS_IN_GATE, true, key, flight);
    if (stops) {
        // The other samples of the pixel carry the light of rays that end before a clear sheet, and of events on the way to it.
        if (split != SPLIT_NONE || is_in_medium(arrival.vertex)) {
            return;
        }
        arrival.segment.limit = 0.0;
    }
    split = SPLIT_NONE;
    // Whether light vertices may be connected to events on the segment.
    let has_segment = DRAWS_IN_GATE && arrival.segment.limit > 0.0 && depth < frame.max_depth;
    if (DRAWS_IN_GATE) {
        segments[slot] = arrival.segment;
    }
    if (!arrival.found) {
        if (HAS_SKY && frame.keep_s0 > 0.0) {
            escape(s, slot, id.x);
        }
        if (has_segment) {
            shade_points[slot] = end_of_segment(s, slot, depth);
            marks[id.x] = MARK_SHADE;
        }
        return;
    }
    var q = arrival.vertex;
    q.owner = slot;
    q.flags |= depth;
    if (HAS_ELLIPSOIDS && depth >= 3u) {
        // The vertex before q can be an auxiliary vertex, unless it is the first surface (weights.wgsl).
        add_auxiliary_sum(&q, shade_points[slot]);
    }

    // Strategy s = 0: the subpath has hit an emitter.
    if (frame.keep_s0 > 0.0 && !is_in_medium(q)) {
        var light = emitter_hit(s, arrival.surface, q, depth) * vec4<f32>(vec3<f32>(gate_weight(q.tau)), 1.0);
        var arrival_time = q.tau;
        if (HAS_DOPPLER) {
            light = vec4<f32>(recorded(light.xyz, growth_to(q)), light.w);
            arrival_time = apparent_time(q.tau, growth_to(q));
        }
        if (max_component(light.xyz) > 0.0) {
            radiance[slot] += vec4<f32>(light.xyz * light.w, 0.0);
            tallies[slot].z += 1u;
            // The probe (render/probe.rs) reports scattered light only: that is what the user wants to gate.
            if (OBSERVE == OBSERVE_RESPONSES || (OBSERVE == OBSERVE_TIMES && depth > 1u)) {
                observe(first_entry() + id.x, vec4<f32>(light.xyz * light.w, arrival_time), slot, NONE);
            }
            if (OBSERVE == OBSERVE_STRATEGIES) {
                observe(first_entry() + id.x, light, slot, NONE);
            }
        }
    }

    // The path still has to reach an emitter. It is late if even the nearest point of the emitters' box is too far for the gate.
    let nearest = clamp(q.position, frame.emitter_lo, frame.emitter_hi);
    let is_late = is_too_late(q, nearest);
    if (depth >= frame.max_depth || (is_late && !has_segment)) {
        return;
    }
    // Guided flights may end in clear air, with a throughput of 0.
    let carries_light = !GUIDES_FLIGHTS || max_component(q.throughput) > 0.0;
    let can_shade = is_connectible(q) && !is_late && carries_light;
    q.flags |= select(VERTEX_SEGMENT_ONLY, 0u, can_shade);
    // The first event that is not smooth gathers photons. If light subpaths connect to the sensor, they form the paths of its first hit.
    if (MERGES && (s.flags & PATH_ONLY_SMOOTH) != 0u && can_shade && (depth > 1u || frame.keep_t1 == 0.0)) {
        q.flags |= VERTEX_MERGES;
    }
    var mark = select(0u, MARK_SHADE, can_shade || has_segment);
    shade_points[slot] = q;

    // The light that comes straight back to a LiDAR has two segments, and the connection of q to the laser is the second one.
    if (HAS_OWN_LASERS) {
        marks[id.x] = mark;
        return;
    }

    // Next direction. The first two bounces skip Russian roulette, because they carry most of the image.
    var u = random4(STREAM_SENSOR, sensor.index, sensor.sample, depth, 0u, sensor.seed);
    if (depth == 1u) {
        u = vec4<f32>(stratified2(sensor.index, frame.iteration, sensor.number, PAIR_DIRECTION, sensor.seed),
            stratified2(sensor.index, frame.iteration, sensor.number, PAIR_LOBE, sensor.seed));
    }
    let roulette = random4(STREAM_SENSOR, sensor.index, sensor.sample, depth, 1u, sensor.seed);
    if (!is_late && scatter(&s, q, arrival.carried, true, u, select(roulette.x, -1.0, depth < 3u))) {
        states[slot] = s;
        mark |= MARK_ALIVE;
    }
    marks[id.x] = mark;
}

// The entry in `observed` of the first path in `list`: it comes after the paths that earlier bounces have traced, and after their
// candidates and shade points. The totals of the lists of paths leave out the first list, which the host makes, but include the present one.
fn first_entry() -> u32 {
    let traced = dispatch.count + counters[COUNTER_TOTALS + LIVING_LIST] + counters[COUNTER_TOTALS + LIVING_LIST + 1u]
        - counters[dispatch.counter];
    return entry_after(traced, counters[COUNTER_TOTALS + CANDIDATE_LIST], counters[COUNTER_TOTALS + SHADE_LIST]);
}

// A shade point for the segment of a subpath that has left the scene.
fn end_of_segment(s: PathState, slot: u32, depth: u32) -> PathVertex {
    var q: PathVertex;
    q.position = s.position;
    q.tau = s.tau;
    q.to_previous = -s.direction;
    q.flags = VERTEX_IN_MEDIUM | VERTEX_SEGMENT_ONLY | depth;
    q.eta = s.eta;
    q.owner = slot;
    if (HAS_DOPPLER) {
        q.select_pdf = s.select_pdf;
    }
    return q;
}

// Strategy s = 0: the subpath has left the scene, and adds the light of the sky. There is no gate, because this light has no
// travel time. `rank`: place of the subpath in `list`.
fn escape(s: PathState, slot: u32, rank: u32) {
    let seen = sky_towards(s.direction);
    var value = s.throughput * seen.radiance;
    if (max_component(value) <= 0.0) {
        return;
    }
    if (HAS_DOPPLER) {
        value = recorded(value, s.select_pdf);
    }
    let weight = sky_escape_weight(s, dispatch.bounce + 1u, seen.pdf);
    radiance[slot] += vec4<f32>(value * weight, 0.0);
    tallies[slot].z += 1u;
    if (OBSERVE == OBSERVE_STRATEGIES) {
        observe(first_entry() + rank, vec4<f32>(value, weight), slot, NONE);
    }
    if (OBSERVE == OBSERVE_RESPONSES) {
        observe(first_entry() + rank, vec4<f32>(value * weight, 0.0), slot, NONE);
    }
}

// xyz: light of the emitter at q towards the sensor, times the throughput; 0 if q does not emit there. w: MIS weight of s = 0
// against s >= 1 (Eq. 27).
fn emitter_hit(s: PathState, surface: Surface, q: PathVertex, depth: u32) -> vec4<f32> {
    let m = load_material(surface.material);
    let two_sided = (m.flags & MATERIAL_DOUBLE_SIDED) != 0u;
    if (m.emission_density <= 0.0 || !(two_sided || (q.flags & VERTEX_FRONT) != 0u)) {
        return vec4<f32>(0.0);
    }
    let emitted_density = vertex_cosine(q, q.to_previous) / select(PI, 2.0 * PI, two_sided);
    return vec4<f32>(s.throughput * emission(surface), emitter_weight(q, depth, m.emission_density, emitted_density));
}
