// Doppler: how fast paths get longer because their vertices move, the colours that record this speed, and what an FMCW sensor makes of it. All
// of it needs HAS_DOPPLER.
//
// The optical length of a path grows by the sum over its segments of n k . (v_b - v_a). Here k is the direction of the segment from a to b,
// n its group index, and v_a and v_b are the velocities of its ends. At a mirror or a refracting surface, the law of reflection or
// refraction cancels the motion along the surface. Velocities are in units of the speed that saturates the colours, or in m/s. Media are at rest.
//
// Subpaths and vertices keep this sum where others keep `select_pdf`, and `selection_cdf` is the instance of the vertex.
#import path
#import scene

// Velocity of the sensor.
fn sensor_velocity() -> vec3<f32> {
    return bitcast<vec4<f32>>(textureLoad(velocities, 0u, 0)).xyz;
}

// Velocity of an emitter that has no surface.
fn emitter_velocity(emitter: u32) -> vec3<f32> {
    return bitcast<vec4<f32>>(textureLoad(velocities, 1u + emitter, 0)).xyz;
}

// Velocity of the point `p` of an instance; 0 for NONE.
fn instance_velocity(instance: u32, p: vec3<f32>) -> vec3<f32> {
    if (instance == NONE) {
        return vec3<f32>(0.0);
    }
    let at = vec4<f32>(p, 1.0);
    let first = 1u + frame.emitter_count + 3u * instance;
    return vec3<f32>(
        dot(bitcast<vec4<f32>>(textureLoad(velocities, first, 0)), at),
        dot(bitcast<vec4<f32>>(textureLoad(velocities, first + 1u, 0)), at),
        dot(bitcast<vec4<f32>>(textureLoad(velocities, first + 2u, 0)), at),
    );
}

// Velocity of v.
fn vertex_velocity(v: PathVertex) -> vec3<f32> {
    if ((v.flags & VERTEX_IN_MEDIUM) != 0u) {
        return vec3<f32>(0.0);
    }
    if ((v.flags & VERTEX_EMITTER) != 0u && (v.flags & VERTEX_DETERMINISTIC) != 0u) {
        return emitter_velocity(v.owner);
    }
    return instance_velocity(v.selection_cdf, v.position);
}

// How fast the subpath of v gets longer, up to v.
fn growth_to(v: PathVertex) -> f32 {
    return select(v.select_pdf, 0.0, (v.flags & VERTEX_EMITTER) != 0u);
}

// How fast the subpath of v gets longer, without the motion of v itself: as if v were at rest.
fn growth_before(v: PathVertex) -> f32 {
    return growth_to(v) + v.eta * dot(v.to_previous, vertex_velocity(v));
}

// How fast a path gets longer that connects q and v along the unit direction `w` from q to v, with the travel time `eta` per length.
fn connected_growth(q: PathVertex, v: PathVertex, w: vec3<f32>, eta: f32) -> f32 {
    return growth_to(q) + growth_to(v) + eta * dot(w, vertex_velocity(v) - vertex_velocity(q));
}

// The light of a path in the colours that record its speed, with RECORDS_DOPPLER: white if the path keeps its length, red if it gets longer, blue
// if it gets shorter. `growth` is twice the radial velocity u of a sensor beside the lamp. The sums over many paths of the light, of the light times
// u, and of the light times u squared are (R + 2 G + B) / 4, (R - B) / 4 and (R - 2 G + B) / 4. Light is the mean of its channels, as in a scan.
fn recorded(light: vec3<f32>, growth: f32) -> vec3<f32> {
    if (!RECORDS_DOPPLER) {
        return light;
    }
    let u = 0.5 * growth;
    return (light.x + light.y + light.z) / 3.0 * vec3<f32>((1.0 + u) * (1.0 + u), 1.0 - u * u, (1.0 - u) * (1.0 - u));
}

// The travel time of a path at rest that has the same beat frequency as a path with the travel time `tau`, which grows. The mixer of an FMCW
// sensor does not tell negative frequencies from positive ones.
fn apparent_time(tau: f32, growth: f32) -> f32 {
    if (RANGE_COUPLING == 0.0) {
        return tau;
    }
    return abs(tau + RANGE_COUPLING * growth);
}
