// Bounds on a tree node with respect to the light-cone shell of a shade point (Secs. 5.3 and 5.5).
#import tree

// The light-cone shell of q: a connection to v counts if its optical length is in [lo - v_tau, hi - v_tau) (Eq. 7).
struct Shell {
    q: vec3<f32>,
    // Ends of the gate minus q_tau, widened by the rounding allowance.
    lo: f32,
    hi: f32,
    // Minimum and maximum travel time per length along a connection: see `eta_range`.
    eta_lo: f32,
    eta_hi: f32,
    // If HAS_GAP: ends of the gap minus q_tau, narrowed by the rounding allowance. A connection whose optical length is strictly between
    // gap_lo - v_tau and gap_hi - v_tau counts for no response.
    gap_lo: f32,
    gap_hi: f32,
}

// Minimum (x) and maximum (y) distance from q to the box [lo, hi].
fn box_distances(q: vec3<f32>, lo: vec3<f32>, hi: vec3<f32>) -> vec2<f32> {
    let near = max(max(lo - q, q - hi), vec3<f32>(0.0));
    let far = max(abs(lo - q), abs(hi - q));
    return vec2<f32>(length(near), length(far));
}

// True if no vertex with a travel time in [tau_lo, tau_hi] and an optical distance in [d.x, d.y] can meet the gate (Eq. 19).
fn is_pruned(tau_lo: f32, tau_hi: f32, d: vec2<f32>, shell: Shell) -> bool {
    if (HAS_GAP && tau_lo + d.x > shell.gap_lo && tau_hi + d.y < shell.gap_hi) {
        return true;
    }
    return tau_hi + d.y < shell.lo || tau_lo + d.x > shell.hi;
}

// Share of the optical distances [d.x, d.y] that lies in the shell at v_tau = 0 (Eqs. 21 and 22, without the power). If d.x
// and d.y are equal, the formula is 0 / 0. The share is then 1, because nodes outside the shell are already pruned.
fn spatial_overlap(d: vec2<f32>, shell: Shell) -> f32 {
    let extent = d.y - d.x;
    let overlap = min(d.y, shell.hi) - max(d.x, shell.lo);
    // The floor keeps nodes that the shell touches at a single distance: a share of 0 would cause bias.
    return select(max(overlap / extent, 1e-3), 1.0, extent <= 0.0);
}

// First (x) and last (y) bucket that can hold time-valid vertices, which are vertices in the shell (Eqs. 23 and 24). Buckets in this
// range are live. If all travel times of the node are equal, the formula divides by 0, and bucket 0 holds all power. The minimum of 1e-30
// then makes bucket 0 live, which is right, because the node was not pruned.
fn live_buckets(c: TreeChild, d: vec2<f32>, shell: Shell) -> vec2<f32> {
    let scale = BUCKET_COUNT / max(c.tau_hi - c.tau_lo, 1e-30);
    let first = clamp(floor((shell.lo - d.y - c.tau_lo) * scale), 0.0, 7.0);
    let last = clamp(floor((shell.hi - d.x - c.tau_lo) * scale), -1.0, 7.0);
    return vec2<f32>(first, last);
}

// Quantised powers of four buckets, the first of which has the number `base`; 0 for buckets that are not live.
fn live_powers(buckets: u32, base: f32, live: vec2<f32>) -> vec4<f32> {
    let k = vec4<f32>(0.0, 1.0, 2.0, 3.0) + base;
    let inside = (k >= vec4<f32>(live.x)) & (k <= vec4<f32>(live.y));
    return select(vec4<f32>(0.0), bytes_to_floats(buckets), inside);
}

// Power of the buckets that can hold time-valid vertices (Phi_N^eff of Eqs. 23 and 24).
fn bucket_power(c: TreeChild, d: vec2<f32>, shell: Shell) -> f32 {
    let live = live_buckets(c, d, shell);
    let sum = live_powers(c.buckets_low, 0.0, live) + live_powers(c.buckets_high, 4.0, live);
    return c.power_unit * (sum.x + sum.y + sum.z + sum.w);
}

// Power of all buckets, always positive.
fn total_power(c: TreeChild) -> f32 {
    let sum = bytes_to_floats(c.buckets_low) + bytes_to_floats(c.buckets_high);
    return max(c.power_unit * (sum.x + sum.y + sum.z + sum.w), 1e-36);
}

// B(N, q) of the paper: effective power over the squared minimum distance; 0 if the node is pruned. `spatial`: the node
// belongs to the 3D tree. The distance is never taken below the half diagonal of the box: 1 / d_min^2 is infinite inside the
// box and far too large just outside it. With this floor, `lcs-paper` has less noise than with the paper's formula.
fn node_bound(c: TreeChild, shell: Shell, spatial: bool) -> f32 {
    let distances = box_distances(shell.q, c.lo, c.hi);
    let d = vec2<f32>(distances.x * shell.eta_lo, distances.y * shell.eta_hi);
    if (is_pruned(c.tau_lo, c.tau_hi, d, shell)) {
        return 0.0;
    }
    // In the 3D tree all power is in bucket 0, so one expression serves both trees. A branch would execute both sides
    // on masked SIMD.
    let power = bucket_power(c, d, shell) * select(1.0, spatial_overlap(d, shell), spatial);
    let diagonal = c.hi - c.lo;
    return power / max(max(distances.x * distances.x, 0.25 * dot(diagonal, diagonal)), 1e-20);
}
