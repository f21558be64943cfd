// Which pairs of a shade point and a light vertex are connected over an auxiliary vertex, and for which travel time
// (ellipsoidal_connection.wgsl).
#import samples
#import vertex
#import random

// Bit of `Candidate.vertex` that marks an ellipsoidal connection.
const ELLIPSOIDAL: u32 = 0x40000000u;

// The travel time at the fraction `u`, in [0, 1), of the gate. The end of the gate does not belong to the gate, so a time that
// rounds to the end goes to the start instead. In a gate of 16 f32 steps, this concerns 3 % of the light.
fn travel_time_at(u: f32) -> f32 {
    let tau = frame.gate_lo + (frame.gate_hi - frame.gate_lo) * u;
    return select(frame.gate_lo, tau, tau < frame.gate_hi);
}

// epc: the travel time of all ellipsoidal connections of a sensor sample, uniform in the gate.
fn drawn_travel_time(sensor: SensorSample) -> f32 {
    let word = random_words(STREAM_QUERY, sensor.index, sensor.sample, 0u, 3u, frame.seed).x;
    return travel_time_at(f32(word >> 8u) * (1.0 / 16777216.0));
}

// Length from v over the auxiliary vertex to q: both segments of an ellipsoidal connection.
fn length_over_auxiliary(q: PathVertex, v: PathVertex, tau: f32) -> f32 {
    return (tau - v.tau - q.tau) / SURROUNDING_GROUP_INDEX;
}

// Whether q and v can be connected over an auxiliary vertex. The two segments must be longer than the straight connection by at
// least the length of the gate. Then the straight connection is too short for the gate.
fn can_connect_over_surface(q: PathVertex, v: PathVertex, tau: f32) -> bool {
    let segments = (q.flags & VERTEX_DEPTH) + (v.flags & VERTEX_DEPTH) + 2u;
    let detour = length_over_auxiliary(q, v, tau) - distance(q.position, v.position);
    return segments <= frame.max_depth && detour >= frame.min_detour && !is_sun(v);
}
