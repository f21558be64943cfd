// Null boundaries: closed meshes that bound a medium and change nothing else (`Material::is_null_boundary` on the host). Rays pass
// through them, and `trace` records the crossings. The medium at each point of the ray follows from the crossings: a ray that leaves
// a mesh without entering it first has started inside. Therefore `trace` also looks for boundaries behind the surface that it hits.
#import math

struct Crossing {
    // Distance along the ray.
    t: f32,
    // Index into `media` of the medium inside of the mesh.
    medium: u32,
    enters: bool,
}

// Maximum number of crossings recorded per ray. Further crossings are ignored.
const MAX_CROSSINGS: u32 = 16u;

// Crossings of the ray that `trace` followed last, ordered by distance.
var<private> crossings: array<Crossing, MAX_CROSSINGS>;
var<private> crossing_count: u32 = 0u;
// Whether rays hit null boundaries only.
var<private> only_boundaries: bool = false;

fn note_crossing(crossing: Crossing) {
    if (crossing_count < MAX_CROSSINGS) {
        crossings[crossing_count] = crossing;
        crossing_count += 1u;
    }
}

// x: the medium just behind the distance t, or NONE. Inside several meshes, it is the medium of the mesh that the ray leaves first.
// y: distance of the next crossing (bits of a float).
fn enclosing_medium(t: f32) -> vec2<u32> {
    var medium = NONE;
    var next = 3e38;
    for (var i = 0u; i < crossing_count; i++) {
        let crossing = crossings[i];
        if (crossing.t > t) {
            next = min(next, crossing.t);
            var is_first = true;
            for (var j = 0u; j < i; j++) {
                is_first &= crossings[j].t <= t || crossings[j].medium != crossing.medium;
            }
            medium = select(medium, crossing.medium, medium == NONE && is_first && !crossing.enters);
        }
    }
    return vec2<u32>(medium, bitcast<u32>(next));
}
