// The candidate slots of a shade point, and the deterministic vertices that come first in them.
#import candidate
#import random
#import tree
#import segment
#import samples
#import shade_point

@group(2) @binding(1) var<storage, read> list: array<u32>;
@group(2) @binding(2) var<storage, read> counters: array<u32>;
@group(2) @binding(3) var<storage, read_write> candidates: array<Candidate>;
@group(2) @binding(4) var<storage, read_write> marks: array<u32>;

// Deterministic vertices evaluated one by one; of more, so many are drawn.
const DETERMINISTIC_SLOTS: u32 = 8u;

fn put(slot: u32, vertex: u32, weight: f32) {
    candidates[slot] = Candidate(vertex, weight);
    marks[slot] = select(1u, 0u, vertex == NONE);
}

// 2^-22: two points nearer than this part of their greatest coordinate are one point, as far as floats tell. Between them
// densities per area have squares beyond all floats.
const SAME_PLACE: f32 = 2.3841858e-7;

// Whether connecting v to q can contribute: gate, depth, facing.
fn can_connect(q: PathVertex, v: PathVertex) -> bool {
    let offset = v.position - q.position;
    let d2 = dot(offset, offset);
    let d = sqrt(d2);
    let w = offset / d;
    let segments = (q.flags & VERTEX_DEPTH) + (v.flags & VERTEX_DEPTH) + 1u;
    return d > SAME_PLACE * max_component(abs(q.position)) && segments <= frame.max_depth
        && gate_weight(connection_time(q, v, w, d)) > 0.0 && faces(q, w) && faces(v, -w);
}

// `vertex` if connecting it to q can contribute, else NONE.
fn checked(q: PathVertex, vertex: u32) -> u32 {
    return select(NONE, vertex, can_connect(q, load_light_vertex(vertex)));
}

fn query_deterministic(q: PathVertex, index: u32, sample: u32, depth: u32, slot: u32) -> u32 {
    let n = frame.deterministic_count;
    if (n <= DETERMINISTIC_SLOTS) {
        for (var i = 0u; i < n; i++) {
            put(slot + i, checked(q, i), 1.0);
        }
        return n;
    }
    let u = random4(STREAM_QUERY, index, sample, depth, 0u, frame.seed).x;
    for (var i = 0u; i < DETERMINISTIC_SLOTS; i++) {
        let x = (f32(i) + u) / f32(DETERMINISTIC_SLOTS) * f32(n);
        put(slot + i, checked(q, min(u32(x), n - 1u)), f32(n) / f32(DETERMINISTIC_SLOTS));
    }
    return DETERMINISTIC_SLOTS;
}

// A shade point that is being asked, and its slots.
struct Asked {
    q: PathVertex,
    // Pixel, number of the sample in it, and segments from the sensor: what random numbers depend on.
    index: u32,
    sample: u32,
    depth: u32,
    // The first slot, and how many are used.
    first: u32,
    used: u32,
}

// The shade point of a rank in the list, with its deterministic vertices in its first slots.
fn begin_slots(rank: u32) -> Asked {
    let q = load_shade_point(list[rank]);
    let sensor = sensor_sample(q.owner);
    let depth = q.flags & VERTEX_DEPTH;
    let first = rank * frame.slots;
    return Asked(q, sensor.index, sensor.sample, depth, first, query_deterministic(q, sensor.index, sensor.sample, depth, first));
}

// Empties the slots that were not used.
fn clear_slots(first: u32, used: u32) {
    for (var i = used; i < frame.slots; i++) {
        put(first + i, NONE, 0.0);
    }
}
