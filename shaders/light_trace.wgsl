// Traces one segment of every living light subpath: finds the next surface, stores the vertex, samples the next direction.
#import walk
#import camera
#import fog

@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
// The vertex that each path has just reached. VERTEX_VALID is set if the vertex can be connected.
@group(2) @binding(1) var<storage, read_write> vertices: array<PathVertex>;
// Living paths of the batch; `counters` holds their number.
@group(2) @binding(2) var<storage, read> list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;

// One thread traces one light subpath.
@compute @workgroup_size(WORKGROUP)
fn light_trace(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = list[id.x];
    let path = dispatch.first + slot;
    var s = states[slot];
    var before: PathVertex;
    if (HAS_ELLIPSOIDS) {
        before = vertices[slot];
    }
    states[slot].flags = 0u;
    vertices[slot].flags = 0u;

    // Nearest surface along the ray.
    let key = random_key(STREAM_ALPHA, path, frame.iteration, LIGHT_BIT | dispatch.bounce, 0u, frame.seed);
    var was_deterministic = (s.flags & PATH_DETERMINISTIC) != 0u;
    let fixed_emitter = dispatch.emitter != NONE;
    // The subpath of a fixed emitter goes straight to the first surface. Other subpaths of the beam find the events before it.
    if (HAS_SHEETS) {
        follows_beam = fixed_emitter;
    }
    let arrival = advance(&s, fixed_emitter, false, key, flight_uniforms(key));
    // Stop if the light arrives after the gate even on the shortest line to the sensor.
    if (!arrival.found || is_too_late(arrival.vertex, nearest_sensor_point(arrival.vertex.position))) {
        return;
    }
    var v = arrival.vertex;
    if (HAS_SHEETS && was_deterministic && arrival.transit.scatters) {
        // Such a sheet has been hit by a part of the paths, so the paths behind it are random, and each carries its share of the power.
        let share = 1.0 / (emitter_probability(s) * f32(frame.light_paths));
        s.throughput *= share;
        v.throughput *= share;
        was_deterministic = false;
        s.flags &= ~PATH_DETERMINISTIC;
    }
    let depth = dispatch.bounce + 1u;
    v.flags |= depth;
    if (HAS_ELLIPSOIDS && depth >= 2u) {
        add_auxiliary_sum(&v, before);
    }
    v.owner = s.emitter;
    var random = min(((s.flags >> PATH_RANDOM_SHIFT) & 3u) + 1u, 3u);
    if (was_deterministic && is_in_medium(v)) {
        // Where the light scatters first is random, so each path of the beam carries its share of the power.
        v.throughput *= 1.0 / (emitter_probability(s) * f32(frame.light_paths));
    } else if (was_deterministic) {
        v.flags |= VERTEX_DETERMINISTIC;
        if (!HAS_DOPPLER) {
            v.select_pdf = s.select_pdf;
        }
        random = 0u;
    }
    v.flags |= random << VERTEX_RANDOM_SHIFT;
    if (DRAWS_IN_GATE && is_in_medium(v) && (s.flags & PATH_LEAVES_CONNECTED) != 0u) {
        v.flags |= VERTEX_FOLLOWS_CONNECTED;
        if (DRAWS_ON_BEAMS && load_emitter(s.emitter).kind == EMITTER_BEAM && dispatch.bounce == 0u) {
            v.normal.x = flight_share(v, arrival.segment, sensor_vertex());
        }
    }
    // A deterministic vertex is the same in all subpaths, so it is stored only once: by the subpath whose emitter the host chose.
    let is_deterministic_vertex = (v.flags & VERTEX_DETERMINISTIC) != 0u;
    if (is_connectible(v) && is_deterministic_vertex == fixed_emitter) {
        v.flags |= VERTEX_VALID;
    }
    vertices[slot] = v;

    // Next direction. A vertex of depth d belongs to paths of at least d + 1 segments.
    if (depth + 1u >= frame.max_depth) {
        return;
    }
    if (was_deterministic) {
        // From here on the paths of a beam differ, so each path carries its share of the power. If a mirror reflects the beam, they do
        // not differ yet: the throughput is restored below.
        s.throughput *= 1.0 / (emitter_probability(s) * f32(frame.light_paths));
    }
    let u = random4(STREAM_LIGHT, path, frame.iteration, depth, 0u, frame.seed);
    let roulette = random4(STREAM_LIGHT, path, frame.iteration, depth, 1u, frame.seed);
    if (!scatter(&s, v, arrival.carried, false, u, select(roulette.x, -1.0, was_deterministic))) {
        return;
    }
    let is_deterministic = (s.flags & PATH_DETERMINISTIC) != 0u;
    if (fixed_emitter && !is_deterministic) {
        return;
    }
    if (is_deterministic) {
        s.throughput *= emitter_probability(s) * f32(frame.light_paths);
    }
    // A delta lobe sets d_vcm to 0: no connection forms these paths.
    let leaves_connected = DRAWS_IN_GATE && (v.flags & VERTEX_DETERMINISTIC) != 0u && is_connectible(v) && s.d_vcm > 0.0;
    s.flags = with_solid(0u, path_solid(s)) | PATH_ALIVE | select(0u, PATH_DETERMINISTIC, is_deterministic) | (random << PATH_RANDOM_SHIFT)
        | select(0u, PATH_LEAVES_CONNECTED, leaves_connected);
    states[slot] = s;
}
