// The gate (Eq. 3), half-open: abutting gates partition the travel times exactly.
#import frame

// Does the path with sensor part `q_tau`, light part `v_tau` and an optical connection length between them count? (Eq. 6)
fn in_gate(v_tau: f32, connection: f32, q_tau: f32) -> bool {
    let tau = v_tau + connection + q_tau;
    return tau >= frame.gate_lo && tau < frame.gate_hi;
}
