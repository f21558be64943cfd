// The gate (Eq. 3), half-open: abutting gates partition the travel times exactly.
#import frame

// Travel time of a path: light part, optical length of the connection, sensor part (Eq. 6). Every test of a path adds in this order,
// so that rounding cannot make two of them disagree.
fn travel_time(v_tau: f32, connection: f32, q_tau: f32) -> f32 {
    return v_tau + connection + q_tau;
}

// What a contribution of travel time `tau` counts for: 1 inside the gate, 0 outside.
fn gate_weight(tau: f32) -> f32 {
    return select(0.0, 1.0, tau >= frame.gate_lo && tau < frame.gate_hi);
}
