// Starts the light subpaths of an iteration: samples an emitter, a point on it, and a direction. A separate dispatch starts
// one subpath for each thin beam (a beam of zero radius). All subpaths of a thin beam have the same first vertices. The separate
// dispatch keeps these vertices once, however rarely the other subpaths draw the beam.
#import doppler
#import weights
#import random

// One entry per path of the batch. `list` names all of them.
@group(2) @binding(0) var<storage, read_write> states: array<PathState>;
@group(2) @binding(1) var<storage, read_write> vertices: array<PathVertex>;
@group(2) @binding(2) var<storage, read_write> list: array<u32>;

// One thread starts one light subpath.
@compute @workgroup_size(WORKGROUP)
fn light_start(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= dispatch.count) {
        return;
    }
    let path = dispatch.first + slot;
    let choice = random_words(STREAM_LIGHT, path, frame.iteration, 0u, 0u, frame.seed);
    let place = random4(STREAM_LIGHT, path, frame.iteration, 0u, 1u, frame.seed);
    let fixed_emitter = dispatch.emitter != NONE;
    let emitter = select(choose_emitter(choice), dispatch.emitter + slot, fixed_emitter);
    var e = sample_emission(emitter, place);
    if (HAS_SKY && load_emitter(emitter).kind == EMITTER_SKY) {
        e = emit_from_sky(emitter, place, random_words(STREAM_LIGHT, path, frame.iteration, 0u, 2u, frame.seed));
    }
    let per_path = 1.0 / f32(frame.light_paths);

    var s: PathState;
    s.position = e.vertex.position;
    s.tau = 0.0;
    s.direction = e.direction;
    s.eta = e.vertex.eta;
    s.select_pdf = e.vertex.select_pdf;
    var instance = NONE;
    if (HAS_DOPPLER) {
        var velocity = emitter_velocity(emitter);
        if (e.triangle != NONE) {
            instance = load_triangle(e.triangle).instance;
            velocity = instance_velocity(instance, e.vertex.position);
        }
        s.select_pdf = -s.eta * dot(s.direction, velocity);
    }
    s.emitter = e.vertex.owner;
    s.triangle = e.triangle;
    s.throughput = e.throughput * per_path;
    // Light subpaths from the sky start with 2 random vertices, so that all their connections take equally many samples (weights.wgsl).
    let random = select(select(0u, 1u, e.stored), 2u, HAS_SKY && e.sky);
    let lives = max_component(s.throughput) > 0.0 && (e.deterministic || !fixed_emitter);
    s.flags = with_solid((random << PATH_RANDOM_SHIFT) | select(0u, PATH_ALIVE, lives), e.vertex.flags >> VERTEX_SOLID_SHIFT);
    if (e.deterministic) {
        // The vertices that all paths of this emitter share are kept once, with the whole power.
        s.throughput = e.throughput * e.vertex.select_pdf;
        s.flags |= PATH_DETERMINISTIC;
    }
    if (HAS_PARALLEL && e.parallel) {
        s.flags |= PATH_PARALLEL;
    }
    if (DRAWS_IN_GATE && !e.stored && !e.parallel && (DRAWS_ON_BEAMS || !e.beam)) {
        s.flags |= PATH_LEAVES_CONNECTED;
    }
    if (!e.beam) {
        s.shift = ray_offset(e.vertex, e.direction);
        start_light_sums(&s, e);
    }
    e.vertex.throughput *= per_path;
    e.vertex.select_pdf = 1.0;
    if (HAS_DOPPLER) {
        e.vertex.selection_cdf = instance;
    }
    e.vertex.flags = select(0u, e.vertex.flags | (random << VERTEX_RANDOM_SHIFT), e.stored);
    states[slot] = s;
    vertices[slot] = e.vertex;
    list[slot] = slot;
}
