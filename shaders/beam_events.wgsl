// Events on the lines of beams, for t = 1: light that a beam sends into fog, and that scatters once before it reaches the sensor. Each
// light subpath of a beam gets one such event on its first segment. It is drawn from the positions from which light arrives at the
// sensor inside the gate. light_splat.wgsl then connects it to the sensor.
//
// Flights along the beam end in such events as well, and follow density grids. Each of the two kinds of events counts for its share
// (`flight_share`). No other strategy forms these paths, because a beam cannot be connected.
#import camera
#import fog
#import walk

@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
@group(2) @binding(1) var<storage, read_write> vertices: array<PathVertex>;
@group(2) @binding(2) var<storage, read_write> list: array<u32>;

// One thread draws the event of one light subpath.
@compute @workgroup_size(WORKGROUP)
fn beam_events(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= dispatch.count) {
        return;
    }
    list[slot] = slot;
    states[slot].flags = 0u;
    vertices[slot].flags = 0u;

    // Emitter and point as in light_start.wgsl; nothing depends on equal choices.
    let path = dispatch.first + slot;
    let emitter = choose_emitter(random_words(STREAM_LIGHT, path, frame.iteration, 0u, 0u, frame.seed));
    if (load_emitter(emitter).kind != EMITTER_BEAM) {
        return;
    }
    let e = sample_emission(emitter, random4(STREAM_LIGHT, path, frame.iteration, 0u, 1u, frame.seed));
    var s: PathState;
    s.position = e.vertex.position;
    s.direction = e.direction;
    s.eta = e.vertex.eta;
    s.flags = with_solid(0u, e.vertex.flags >> VERTEX_SOLID_SHIFT);
    s.triangle = NONE;
    s.throughput = e.throughput * (1.0 / f32(frame.light_paths));

    // The start of the segment: `draw_in_gate` measures distances from here. With depth 1 (`flags`), it leaves d_vcm at 0. The other
    // sum, d_vc, is that of `s`, which is 0 as well.
    var start: PathVertex;
    start.position = s.position;
    start.to_previous = -s.direction;
    start.flags = 1u;
    start.owner = emitter;
    if (HAS_DOPPLER) {
        start.selection_cdf = NONE;
        start.select_pdf = -s.eta * dot(s.direction, emitter_velocity(emitter));
    }
    let key = random_key(STREAM_ALPHA, path, frame.iteration, LIGHT_BIT, 2u, frame.seed);
    var segment = advance(&s, true, false, key, vec3<f32>(0.0)).segment;
    segment.length = 0.0;
    start.eta = s.eta;
    if (segment.limit <= 0.0) {
        return;
    }
    let sensor = sensor_vertex();
    let interval = gate_interval(start, segment, sensor, whole_gate());
    if (!(interval.x < interval.y)) {
        return;
    }
    var event = draw_in_gate(start, segment, sensor, whole_gate(), flight_uniforms(key).xy);
    // Not a number if rounding has closed the interval.
    if (!(max_component(event.throughput) > 0.0)) {
        return;
    }
    segment.length = distance(event.position, start.position);
    if (HAS_SHEETS) {
        event.throughput *= transit_before(segment.length).weight;
    }
    event.throughput *= 1.0 - flight_share(event, segment, sensor);
    event.flags |= VERTEX_VALID | (1u << VERTEX_RANDOM_SHIFT);
    vertices[slot] = event;
}
