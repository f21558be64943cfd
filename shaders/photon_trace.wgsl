// Traces one segment of every living photon, and stores the vertex at its end if a sensor subpath may gather light there. A photon ends
// where another strategy forms the rest of its path.
#import walk
#import photon
#import camera
#import random
#import medium

// The host writes the first states: `select_pdf` holds the bits of the triangle that the photon is aimed at, or NONE.
@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
// The vertex that each photon has just reached. VERTEX_VALID is set if light can be gathered there.
@group(2) @binding(1) var<storage, read_write> vertices: array<PathVertex>;
// Living photons of the batch; `counters` holds their number.
@group(2) @binding(2) var<storage, read> list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;

// One thread traces one photon.
@compute @workgroup_size(WORKGROUP)
fn photon_trace(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= counters[dispatch.counter]) {
        return;
    }
    let slot = list[id.x];
    let path = dispatch.first + slot;
    var s = states[slot];
    states[slot].flags = 0u;
    vertices[slot].flags = 0u;
    let key = random_key(STREAM_ALPHA, path, frame.iteration, PHOTON_BITS | dispatch.bounce, 0u, frame.seed);
    let arrival = advance(&s, false, false, key, flight_uniforms(key));
    let v = arrival.vertex;
    if (!arrival.found || is_much_too_late(v)) {
        return;
    }
    // Each direction has one place where it first meets a smooth object, and only photons aimed at this place stand for it.
    let aimed = bitcast<u32>(s.select_pdf);
    if (dispatch.bounce == 0u && aimed != NONE && (is_in_medium(v) || arrival.surface.triangle != aimed)) {
        return;
    }
    let depth = dispatch.bounce + 1u;
    let was_smooth = (s.flags & PATH_SMOOTH) != 0u;
    // Without connections to light subpaths, only a D next to the lamp forms the path.
    let is_open = was_smooth || (frame.keep_s2 == 0.0 && depth > 1u);
    if (is_open && is_connectible(v)) {
        var stored = v;
        stored.flags |= VERTEX_VALID | depth;
        if (is_in_medium(v)) {
            // Events in a medium are as dense as the light that it scatters; photons as the light that arrives.
            let scattering = load_medium(v.material).sigma_s * medium_density(v.material, v.position);
            stored.throughput /= max(scattering, vec3<f32>(1e-30));
        }
        vertices[slot] = stored;
    }
    if (depth + 1u >= frame.max_depth) {
        return;
    }
    let u = random4(STREAM_PHOTON, path, frame.iteration, depth, 0u, frame.seed);
    let roulette = random4(STREAM_PHOTON, path, frame.iteration, depth, 1u, frame.seed);
    if (!scatter(&s, v, arrival.carried, false, u, roulette.x)) {
        return;
    }
    if (!is_open && (s.flags & PATH_SMOOTH) == 0u) {
        return;
    }
    s.select_pdf = bitcast<f32>(NONE);
    s.flags |= PATH_ALIVE;
    states[slot] = s;
}

// Whether light at v arrives after the gate even on the shortest line to the sensor, and so does all light within the radius.
fn is_much_too_late(v: PathVertex) -> bool {
    let nearest = distance(v.position, nearest_sensor_point(v.position));
    // The radius of a point within its radius from v: see merge_radius.
    let rate = radius_per_length(HAS_MEDIA);
    let radius = select(min(4.0 * rate, 1.0) * distance(v.position, frame.sensor), rate, HAS_ORTHOGRAPHIC);
    return v.tau + nearest - 2.0 * v.eta * radius >= frame.cull_hi;
}
