// What is constant during one iteration. Positions are in the render space of `render/space.rs`: its origin is a sensor, that of
// this frame or one nearby. Lengths, travel times among them, count in its unit, a power of two of a metre; areas and fluxes follow it,
// radiance does not.

struct Frame {
    // Camera axes in world space, unit length; the camera looks along `forward`.
    right: vec3<f32>,
    width: u32,
    up: vec3<f32>,
    height: u32,
    forward: vec3<f32>,
    seed: u32,
    // Half extents of the image plane at distance 1.
    extent: vec2<f32>,
    // Area of a pixel on that plane.
    pixel_area: f32,
    // Light subpaths, stored or not, for each sensor sample of a pixel on average, or a part of that: the sample count of the t = 1
    // strategies in the MIS weights.
    splat_sample_count: f32,
    // The gate [lo, hi) of optical path; hi is 3e38 for an open gate.
    gate_lo: f32,
    gate_hi: f32,
    // Subpaths whose travel time cannot stay below this stop: what follows only makes them longer. 3e38 switches it off.
    cull_hi: f32,
    // Rounding allowance of a travel time: bounds are widened by it so that no valid vertex is pruned.
    rounding_allowance: f32,
    // Box around everything that emits.
    emitter_lo: vec3<f32>,
    iteration: u32,
    emitter_hi: vec3<f32>,
    light_paths: u32,
    max_depth: u32,
    queries: u32,
    deterministic_count: u32,
    emitter_count: u32,
    // Roots of the two trees: a node, a leaf reference, or NONE.
    tree3_root: u32,
    tree4_root: u32,
    // 0 if the strategies do not take part in the MIS weights; else 1 / query_sample_count^2 for s = 0 and t = 1, which no query
    // serves, and 1 for s >= 2.
    keep_s0: f32,
    keep_t1: f32,
    keep_s2: f32,
    crop_x: u32,
    crop_y: u32,
    crop_width: u32,
    crop_height: u32,
    // Number of a pixel's first sample in this iteration, over the whole render.
    first_sample: u32,
    // Emitter points in the pool; they follow the deterministic vertices.
    emitter_points: u32,
    // Candidate slots a shade point.
    slots: u32,
    // The pinhole.
    sensor: vec3<f32>,
    // Samples that a vertex chosen by a query stands for in the MIS weights (`weights.wgsl`).
    query_sample_count: f32,
    // Of all light subpaths, the share whose vertices are stored: their throughput is that of the stored ones alone.
    splat_share: f32,
}

// What changes from dispatch to dispatch.
struct Dispatch {
    // First path of the batch, counted over the light paths.
    first: u32,
    // Threads that have work, where the host knows it.
    count: u32,
    bounce: u32,
    // Index into `counters` of the length of the list the kernel works through.
    counter: u32,
    // Compaction: counters of the lists it makes; `list_b` NONE for one list of the entries' own numbers.
    list_a: u32,
    list_b: u32,
    // First entry of the list that the dispatch works on.
    rank: u32,
    // Light subpaths: NONE where each path samples its emitter. Otherwise the host fixes the emitters, this one for the first path,
    // and the paths yield their deterministic vertices alone.
    emitter: u32,
}

// From here on `counters` holds the lengths of lists added up since the host last wrote them.
const COUNTER_TOTALS: u32 = 8u;

@group(0) @binding(0) var<storage, read> frame: Frame;
var<immediate> dispatch: Dispatch;

// Threads a workgroup; the image does not depend on it.
override WORKGROUP: u32 = 64u;
// What the host is shown of every contribution beside the image: nothing, its travel time, or its strategy and weight.
override OBSERVE: u32 = 0u;
const OBSERVE_TIMES: u32 = 1u;
const OBSERVE_STRATEGIES: u32 = 2u;
// Switches that remove code the scene does not need.
override HAS_TEXTURES: bool = true;
override HAS_ALPHA: bool = true;
override HAS_GLOSSY: bool = true;
override HAS_TRANSMISSION: bool = true;
// Loops are left at their top: for drivers that lose what the last iteration of a loop has found (src/gpu/quirks.rs).
override EXIT_AT_TOP: bool = false;
