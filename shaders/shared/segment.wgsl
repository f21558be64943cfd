// The straight segment that a connection adds between two vertices, or between a vertex and the sensor.
#import visibility
#import vertex
#import gate

struct Segment {
    // Unit direction from the first end to the second.
    direction: vec3<f32>,
    // Squared length.
    length2: f32,
}

// The segment from a to b, which must be different points.
fn segment_between(a: vec3<f32>, b: vec3<f32>) -> Segment {
    let offset = b - a;
    let length2 = dot(offset, offset);
    return Segment(offset * inverseSqrt(length2), length2);
}

// Optical length of the segment that leaves v along `w` and has the geometric length `distance`.
fn optical_length(v: PathVertex, w: vec3<f32>, distance: f32) -> f32 {
    return eta_towards(v, w) * distance;
}

// Optical depths of the media on the segment that leaves v along `w` and has the length `distance`. With null boundaries they are 0:
// `traced_transmittance` takes their place.
fn segment_depths(v: PathVertex, w: vec3<f32>, distance: f32) -> Depths {
    if (!HAS_MEDIA || HAS_NULL_BOUNDARIES) {
        return Depths(vec3<f32>(0.0), vec3<f32>(0.0));
    }
    return depths_towards(v, w, distance);
}

// Fraction of light that thin glass on the segment transmits, and the media in scenes with null boundaries; 1 if there are neither. The
// ray of the segment must have been traced: `trace` finds the glass and the boundaries.
fn traced_transmittance(v: PathVertex, w: vec3<f32>, distance: f32) -> vec3<f32> {
    var passed = vec3<f32>(1.0);
    if (HAS_SHEETS) {
        passed = transit.weight;
    }
    if (!HAS_MEDIA || !HAS_NULL_BOUNDARIES) {
        return passed;
    }
    return passed * transmitted(depths_towards(v, w, distance));
}

// Delay of the light by thin glass on the segment that was traced last.
fn traced_delay() -> f32 {
    return select(0.0, transit.delay, HAS_DELAYS);
}

fn depths_towards(v: PathVertex, w: vec3<f32>, distance: f32) -> Depths {
    surrounding_solid = solid_towards(v, w);
    if (surrounding_solid == CLEAR_SOLID) {
        return Depths(vec3<f32>(0.0), vec3<f32>(0.0));
    }
    return optical_depths(v.position, w, distance);
}

// Travel time of the path that connects q to v, which lies at `distance` from q along `w`.
fn connection_time(q: PathVertex, v: PathVertex, w: vec3<f32>, distance: f32) -> f32 {
    return travel_time(v.tau, optical_length(q, w, distance), q.tau);
}

// Whether no surface blocks the segment between two points, which `ray_end` has moved off their surfaces. `key`: see `trace`.
fn is_unoccluded(a: vec3<f32>, b: vec3<f32>, key: vec4<u32>) -> bool {
    return trace(a, b - a, 1.0, true, NONE, key).triangle == NONE;
}
