// The straight segment that a connection adds between two vertices, or between a vertex and the pinhole.
#import visibility
#import vertex
#import gate

struct Segment {
    // Unit, from the first end to the second.
    direction: vec3<f32>,
    length2: f32,
}

fn segment_between(a: vec3<f32>, b: vec3<f32>) -> Segment {
    let offset = b - a;
    let length2 = dot(offset, offset);
    return Segment(offset * inverseSqrt(length2), length2);
}

// Optical length of a segment of geometric length `distance` that leaves v along `w`.
fn optical_length(v: PathVertex, w: vec3<f32>, distance: f32) -> f32 {
    return eta_towards(v, w) * distance;
}

// Travel time of the path that connects q along `w` to v at `distance`.
fn connection_time(q: PathVertex, v: PathVertex, w: vec3<f32>, distance: f32) -> f32 {
    return travel_time(v.tau, optical_length(q, w, distance), q.tau);
}

// Whether nothing stands between two points, which `ray_end` has taken off their surfaces. `key`: see `trace`.
fn is_unoccluded(a: vec3<f32>, b: vec3<f32>, key: vec4<u32>) -> bool {
    return trace(a, b - a, 1.0, true, NONE, key).triangle == NONE;
}
