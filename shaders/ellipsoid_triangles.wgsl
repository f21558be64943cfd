// epc: chooses uniformly one of the triangles that the ellipsoid of a candidate may meet. Each dispatch searches only some parts of the
// BVH, so that no submission takes long. The next dispatch continues the choice.
#import candidate
#import ellipsoidal_connection
#import shade_point
#import tree

@group(2) @binding(1) var<storage, read> shade_list: array<u32>;
@group(2) @binding(2) var<storage, read> slot_list: array<u32>;
@group(2) @binding(3) var<storage, read> counters: array<u32>;
@group(2) @binding(4) var<storage, read> candidates: array<Candidate>;
// Parts that cover the BVH; see `search_part`.
@group(2) @binding(5) var<storage, read> bvh_parts: array<u32>;
// The triangle chosen so far for each entry of `slot_list`.
@group(2) @binding(6) var<storage, read_write> choices: array<TriangleChoice>;

// One thread searches for one candidate. dispatch.first, dispatch.count: range of the parts in `bvh_parts`.
@compute @workgroup_size(WORKGROUP)
fn ellipsoid_triangles(@builtin(global_invocation_id) id: vec3<u32>) {
    let rank = dispatch.rank + id.x;
    if (rank >= counters[dispatch.counter]) {
        return;
    }
    let slot = slot_list[rank];
    let vertex = candidates[slot].vertex;
    if (vertex >= SKY_VERTEX || (vertex & ELLIPSOIDAL) == 0u) {
        return;
    }
    let q = load_shade_point(shade_list[slot / frame.slots]);
    let v = load_light_vertex(vertex & ~ELLIPSOIDAL);
    let sensor = sensor_sample(q.owner);
    let search = make_search(v.position, q.position, length_over_auxiliary(q, v, drawn_travel_time(sensor)));
    var choice = TriangleChoice(NONE, 0u);
    if (dispatch.first > 0u) {
        choice = choices[rank];
    }
    for (var i = 0u; i < dispatch.count; i++) {
        search_part(bvh_parts[dispatch.first + i], search, ellipsoid_key(sensor, dispatch.bounce, slot), &choice);
    }
    choices[rank] = choice;
}
