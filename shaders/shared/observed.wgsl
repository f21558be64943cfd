// What sensor subpaths contribute, for a host that observes it (OBSERVE). Each traced path and each live candidate has an entry, with or
// without light. Each shade point has MERGED_ENTRIES more for the light of photons. So an entry's place is known from the lengths of lists:
// bounce by bounce, first the traced paths, then the candidates, then the shade points.
#import frame
#import math

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
    // `Candidate.vertex`. NONE if the subpath itself hit an emitter or left the scene (s = 0), and for the light of photons.
    vertex: u32,
}

@group(2) @binding(10) var<storage, read_write> observed: array<SensorContribution>;

// A tile has fewer than 2^24 paths, and a path at most 254 bounces.
const PATH_BITS: u32 = 24u;

// Lists of sensor subpaths: the living paths of even bounces (those of odd bounces have the next number), the shade points, and the live
// candidates.
const LIVING_LIST: u32 = 0u;
const SHADE_LIST: u32 = 2u;
const CANDIDATE_LIST: u32 = 3u;

// Number of entries of each shade point for the light of photons: 0 if none are gathered (MERGES), or if OBSERVE is not
// OBSERVE_RESPONSES.
override MERGED_ENTRIES: u32 = 0u;

// The entry after those of so many traced paths, candidates and shade points. If `dispatch.first` is NONE, the device itself uses the
// entries of each list before the next list is written (add_arrivals.wgsl), so each list begins at 0.
fn entry_after(traced: u32, candidates: u32, shade_points: u32) -> u32 {
    return select(traced + candidates + MERGED_ENTRIES * shade_points - dispatch.first, 0u, dispatch.first == NONE);
}

// Writes an entry. `light`: radiance, and the detail.
fn observe(at: u32, light: vec4<f32>, path: u32, vertex: u32) {
    observed[at] = SensorContribution(light.x, light.y, light.z, light.w, (dispatch.bounce << PATH_BITS) | path, vertex);
}
