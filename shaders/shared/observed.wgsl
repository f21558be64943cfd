// What sensor subpaths contribute, for a host that observes it (OBSERVE). Each traced path and each live candidate has an entry, with or
// without light. So an entry's place is known from the lengths of lists: bounce by bounce, first the traced paths, then the candidates.
#import frame

// One entry.
struct SensorContribution {
    // Contribution to the radiance of the sensor subpath. OBSERVE_STRATEGIES: without the MIS weight.
    red: f32,
    green: f32,
    blue: f32,
    // OBSERVE_STRATEGIES: the MIS weight. Otherwise the travel time; 0 for light from the sky, NOT_TRACED if no shadow ray was traced.
    detail: f32,
    // Index of the sensor subpath in its tile (low PATH_BITS bits), and the bounce.
    path: u32,
    // `Candidate.vertex`. NONE if the subpath itself hit an emitter or left the scene (s = 0).
    vertex: u32,
}

@group(2) @binding(10) var<storage, read_write> observed: array<SensorContribution>;

// A tile has fewer than 2^24 paths, and a path at most 254 bounces.
const PATH_BITS: u32 = 24u;

// Lists of sensor subpaths: the living paths of even bounces (those of odd bounces have the next number), and the live candidates.
const LIVING_LIST: u32 = 0u;
const CANDIDATE_LIST: u32 = 3u;

// Writes an entry. `light`: radiance, and the detail.
fn observe(at: u32, light: vec4<f32>, path: u32, vertex: u32) {
    observed[at] = SensorContribution(light.x, light.y, light.z, light.w, (dispatch.bounce << PATH_BITS) | path, vertex);
}
