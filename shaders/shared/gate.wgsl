// The gate (Eq. 3). It is half-open, so that adjacent gates partition the travel times exactly.
#import frame

// Travel time of a path: light subpath, optical length of the connection, sensor subpath (Eq. 6). Every test of a path calls
// this function: the same order of additions rounds in the same way, so two tests never disagree.
fn travel_time(v_tau: f32, connection: f32, q_tau: f32) -> f32 {
    return v_tau + connection + q_tau;
}

// Factor of a contribution with travel time `tau`: 1 inside the gate, 0 outside and between distant responses.
fn gate_weight(tau: f32) -> f32 {
    if (HAS_GAP && tau >= frame.gap_lo && tau < frame.gap_hi) {
        return 0.0;
    }
    let lo = select(frame.gate_lo, frame.undelayed_lo, HAS_DELAYS);
    return select(0.0, 1.0, tau >= lo && tau < frame.gate_hi);
}

// As `gate_weight`, before a segment of the path is traced. Thin glass on this segment may delay the light. 0 only if the path misses
// the gate with any delay.
fn gate_weight_before_delays(tau: f32) -> f32 {
    if (!HAS_DELAYS) {
        return gate_weight(tau);
    }
    return select(0.0, 1.0, tau >= frame.gate_lo && tau < frame.gate_hi);
}
