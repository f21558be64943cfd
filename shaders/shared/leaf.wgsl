// Leaf records: the data that a query needs to choose a vertex in a leaf. Only the chosen vertex, and punctual lights, are loaded
// whole.
#import tree
#import vertex

struct LeafRecord {
    position: vec3<f32>,
    tau: f32,
    // The largest channel of the throughput.
    power: f32,
    // The geometric normal, or in a medium the direction to the previous vertex: see `unpack_direction`.
    direction: u32,
    // As in PathVertex.
    flags: u32,
    material: u32,
}

// The records of the vertices in `light_vertices`, in the same order: two texels each.
@group(1) @binding(3) var leaf_records: texture_1d<u32>;

// Bound on the error of the dot product of a unit vector and an unpacked direction: sqrt(3) / 1022, rounded up.
const DIRECTION_ERROR: f32 = 0.002;

// A nearly unit vector from three signed fractions of 10 bits, x lowest. Its length is 1 up to DIRECTION_ERROR.
fn unpack_direction(word: u32) -> vec3<f32> {
    let bits = vec3<i32>(vec3<u32>(word << 22u, word << 12u, word << 2u)) >> vec3<u32>(22u);
    return vec3<f32>(bits) * (1.0 / 511.0);
}

// Makes a vertex from its leaf record; only the fields that `vertex_importance` reads are set. A spot light also needs its
// axis and its cone, so punctual lights are loaded whole.
fn load_leaf_vertex(index: u32) -> PathVertex {
    let place = bitcast<vec4<f32>>(textureLoad(leaf_records, 2u * index, 0));
    let rest = textureLoad(leaf_records, 2u * index + 1u, 0);
    var v: PathVertex;
    v.position = place.xyz;
    v.tau = place.w;
    v.throughput = vec3<f32>(bitcast<f32>(rest.x));
    v.geometric = unpack_direction(rest.y);
    v.flags = rest.z;
    v.material = rest.w;
    if (is_in_medium(v)) {
        v.to_previous = normalize(v.geometric);
    } else if (QUERIED_PUNCTUAL && !has_normal(v)) {
        return load_light_vertex(index);
    }
    return v;
}
