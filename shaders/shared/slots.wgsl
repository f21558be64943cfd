// The candidate slots of a shade point. Deterministic vertices take the first slots, then comes the sky.
#import candidate
#import random
#import tree
#import fog
#import samples
#import shade_point
#import detour

@group(2) @binding(1) var<storage, read> list: array<u32>;
@group(2) @binding(2) var<storage, read> counters: array<u32>;
@group(2) @binding(3) var<storage, read_write> candidates: array<Candidate>;
// See SLOTS_PER_MARK.
@group(2) @binding(4) var<storage, read_write> marks: array<u32>;
// Counts per path, see gather.wgsl.
@group(2) @binding(6) var<storage, read_write> tallies: array<vec4<u32>>;
// With DRAWS_IN_GATE only: the segments before the shade points.
@group(2) @binding(9) var<storage, read> segments: array<FogSegment>;

// Maximum number of deterministic vertices that are connected one by one. If there are more, this number of them is drawn
// (bdpt, pt), or all of them are in the trees (lcs, lcs-paper).
const DETERMINISTIC_SLOTS: u32 = 8u;
// 2^32 / DETERMINISTIC_SLOTS: width of the strata of the draws.
const DRAW_STRATUM: u32 = 0x20000000u;

// The shade point whose slots are being filled: its position in the list, the number of its present word in `marks`, this word, and how
// many connections were tried.
var<private> slots_rank: u32;
var<private> mark_number: u32 = 0u;
var<private> mark: u32 = 0u;
var<private> tried: u32 = 0u;

// Fills slot number `slot` of the shade point, in ascending order; `vertex` is NONE if it stays empty. A connection was tried if its weight
// is above 0, even if it was ruled out.
fn write_candidate(slot: u32, vertex: u32, weight: f32) {
    write_marks(slot / SLOTS_PER_MARK);
    tried += select(0u, 1u, weight > 0.0);
    if (vertex != NONE) {
        candidates[slots_rank * frame.slots + slot] = Candidate(vertex, weight);
        mark |= 1u << (slot % SLOTS_PER_MARK);
    }
}

// Writes the marks of the shade point up to word number `end`.
fn write_marks(end: u32) {
    if (HAS_MANY_SLOTS) {
        for (; mark_number < end; mark_number++) {
            marks[slots_rank * mark_words() + mark_number] = mark;
            mark = 0u;
        }
    }
}

// 2^-22. Two points whose distance is below this fraction of their largest coordinate count as one point: floats hardly tell
// them apart, and squared densities per area between them overflow.
const COINCIDENCE_TOLERANCE: f32 = 2.3841858e-7;

// Whether a connection of q to v, which lies at the distance `d` along `w`, can contribute if both face each other. Tests
// coincidence, number of segments and gate, and leaves out connections that `draw_in_gate` forms.
fn is_in_reach(q: PathVertex, v: PathVertex, w: vec3<f32>, d: f32) -> bool {
    let segments = (q.flags & VERTEX_DEPTH) + (v.flags & VERTEX_DEPTH) + 1u;
    // Without short circuits: on masked SIMD, a branch costs more than the test that it saves.
    return (d > COINCIDENCE_TOLERANCE * max_component(abs(q.position))) & (segments <= frame.max_depth)
        & (gate_weight_before_delays(connection_time(q, v, w, d)) > 0.0) & !(is_in_medium(q) & is_drawn_in_gate(v));
}

// Whether connecting v to q can contribute. Tests coincidence, number of segments, gate and facing.
fn can_connect(q: PathVertex, v: PathVertex) -> bool {
    let offset = v.position - q.position;
    let d2 = dot(offset, offset);
    let d = sqrt(d2);
    let w = offset / d;
    return is_in_reach(q, v, w, d) && faces(q, w) && faces(v, -w);
}

// `vertex` if connecting it to q can contribute. With the bit ELLIPSOIDAL if only a connection over an auxiliary vertex can contribute.
// Otherwise NONE.
fn connectable_or_none(q: PathVertex, vertex: u32) -> u32 {
    let v = load_light_vertex(vertex);
    let is_direct = can_connect(q, v);
    if (HAS_ELLIPSOIDS && !RESAMPLES_ELLIPSOIDS && !is_direct && can_connect_over_surface(q, v, drawn_travel_time(sensor_sample(q.owner)))) {
        return vertex | ELLIPSOIDAL;
    }
    return select(NONE, vertex, is_direct);
}

// The deterministic vertex whose interval of the cumulative distribution contains `u`, in units of 2^-32, and 1 / P. Integers
// make P exact.
fn draw_deterministic(u: u32) -> Candidate {
    var lo = 0u;
    var hi = frame.deterministic_count - 1u;
    while (lo < hi) {
        let middle = (lo + hi + 1u) / 2u;
        let above = load_light_vertex(middle).selection_cdf > u;
        lo = select(middle, lo, above);
        hi = select(hi, middle - 1u, above);
    }
    // The interval of the last vertex ends at 2^32. This wraps to 0, the start of the first interval.
    let next = (lo + 1u) % frame.deterministic_count;
    let draws = load_light_vertex(next).selection_cdf - load_light_vertex(lo).selection_cdf;
    return Candidate(lo, 4294967296.0 / f32(draws));
}

// Writes the deterministic vertices to the first slots, each `event_count` times, for connections that are drawn in the gate (fog.wgsl).
// Returns the number of slots used.
fn query_segment(q: PathVertex, sensor: SensorSample) -> u32 {
    let segment = segments[q.owner];
    let events = event_count();
    for (var i = 0u; i < frame.deterministic_count; i++) {
        let v = load_light_vertex(i);
        for (var number = 0u; number < events; number++) {
            let can_draw = can_draw_in_gate(q, segment, v, event_gate(q, number, sensor));
            write_candidate(i * events + number, select(NONE, i, can_draw), f32(event_cycle(q)));
        }
    }
    return frame.deterministic_count * events;
}

// Writes deterministic vertices to the slots from `slot` on. Returns the number of slots used.
fn query_deterministic(q: PathVertex, index: u32, sample: u32, depth: u32, slot: u32) -> u32 {
    let n = frame.deterministic_count;
    if (n <= DETERMINISTIC_SLOTS) {
        for (var i = 0u; i < n; i++) {
            write_candidate(slot + i, connectable_or_none(q, i), 1.0);
        }
        return n;
    }
    let u = random_words(STREAM_QUERY, index, sample, depth, 0u, frame.seed).x / DETERMINISTIC_SLOTS;
    for (var i = 0u; i < DETERMINISTIC_SLOTS; i++) {
        let drawn = draw_deterministic(i * DRAW_STRATUM + u);
        write_candidate(slot + i, connectable_or_none(q, drawn.vertex), drawn.weight / f32(DETERMINISTIC_SLOTS));
    }
    return DETERMINISTIC_SLOTS;
}

// Work item of a query kernel: a shade point and its candidate slots.
struct WorkItem {
    q: PathVertex,
    // Keys of the random numbers: pixel, number of the sample (counted over the whole render), and segments from the sensor.
    index: u32,
    sample: u32,
    depth: u32,
    // Number of slots used.
    used: u32,
    // Whether light vertices may be connected to q itself.
    is_open: bool,
}

// The shade point at a position in the list. Deterministic vertices are written to its first slots: first for connections to its
// segment, then for connections to q itself. Then comes the sky.
fn begin_work_item(rank: u32) -> WorkItem {
    let q = load_shade_point(list[rank]);
    let sensor = sensor_sample(q.owner);
    let depth = q.flags & VERTEX_DEPTH;
    slots_rank = rank;
    var used = 0u;
    if (DRAWS_IN_GATE) {
        used = query_segment(q, sensor);
        if ((q.flags & VERTEX_SEGMENT_ONLY) != 0u) {
            return WorkItem(q, sensor.index, sensor.sample, depth, used, false);
        }
    }
    used += query_deterministic(q, sensor.index, sensor.sample, depth, used);
    if (HAS_SKY) {
        write_candidate(used, SKY_VERTEX, 1.0);
        used += 1u;
    }
    return WorkItem(q, sensor.index, sensor.sample, depth, used, true);
}

// Ends a work item: writes what compaction and `gather` need to know about the slots. `path`: the sensor subpath of the shade point.
fn end_work_item(path: u32) {
    if (HAS_MANY_SLOTS) {
        write_marks(mark_words());
    } else {
        marks[slots_rank] = mark;
    }
    tallies[path].w += tried;
}
