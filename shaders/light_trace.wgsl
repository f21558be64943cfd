// Traces one segment of every living light subpath: finds the next surface, stores the vertex, samples the next direction.
#import walk
#import camera

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
    states[slot].flags = 0u;
    vertices[slot].flags = 0u;

    // Nearest surface along the ray.
    let dimension = (STREAM_ALPHA << 28u) | (STREAM_LIGHT << 26u) | (dispatch.bounce << 14u);
    let key = vec4<u32>(path, frame.iteration, dimension, frame.seed);
    let arrival = advance(&s, key);
    // Stop if the light arrives after the gate even on the shortest line to the sensor.
    if (!arrival.found || is_too_late(arrival.vertex, nearest_sensor_point(arrival.vertex.position))) {
        return;
    }
    var v = arrival.vertex;
    let depth = dispatch.bounce + 1u;
    v.flags |= depth;
    v.owner = s.emitter;
    var random = min((s.flags >> PATH_RANDOM_SHIFT) + 1u, 3u);
    let was_deterministic = (s.flags & PATH_DETERMINISTIC) != 0u;
    if (was_deterministic) {
        v.flags |= VERTEX_DETERMINISTIC;
        v.select_pdf = s.select_pdf;
        random = 0u;
    }
    v.flags |= random << VERTEX_RANDOM_SHIFT;
    // A deterministic vertex is the same in all subpaths, so it is stored only once: by the subpath whose emitter the host chose.
    let fixed_emitter = dispatch.emitter != NONE;
    if (is_connectible(v) && was_deterministic == fixed_emitter) {
        v.flags |= VERTEX_VALID;
    }
    vertices[slot] = v;

    // Next direction. A vertex of depth d belongs to paths of at least d + 1 segments.
    if (depth + 1u >= frame.max_depth) {
        return;
    }
    if (was_deterministic) {
        // From here on the paths of a beam differ, so each path carries its share of the power.
        s.throughput *= 1.0 / (s.select_pdf * f32(frame.light_paths));
    }
    let u = random4(STREAM_LIGHT, path, frame.iteration, depth, 0u, frame.seed);
    let roulette = random4(STREAM_LIGHT, path, frame.iteration, depth, 1u, frame.seed);
    if (!scatter(&s, v, false, u, select(roulette.x, -1.0, was_deterministic))) {
        return;
    }
    let is_deterministic = (s.flags & PATH_DETERMINISTIC) != 0u;
    if (fixed_emitter && !is_deterministic) {
        return;
    }
    if (is_deterministic) {
        s.throughput *= s.select_pdf * f32(frame.light_paths);
    }
    s.flags = PATH_ALIVE | select(0u, PATH_DETERMINISTIC, is_deterministic) | (random << PATH_RANDOM_SHIFT);
    states[slot] = s;
}
