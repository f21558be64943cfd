// Importance of a light-tree node to a shade point: an estimate of what its vertices contribute through the gate, not a bound.
// It is 0 only where no vertex can contribute; elsewhere any positive value is unbiased, and tight beats conservative (DESIGN 3.3).
#import lightcone

// Weight of a live bucket beyond its estimate. Errors of the uniform model multiply from level to level: with 0.01 rare vertices
// shone far too bright (docs/PERFORMANCE.md, lcs).
const LIVE_SHARE: f32 = 0.3;
// The same for the cosine.
const LEAST_COSINE: f32 = 0.1;
// Keeps products of small factors from becoming 0.
const LEAST_IMPORTANCE: f32 = 1e-36;

// Ideas that a render may do without (`--importance`): any of them is unbiased on and off.
override BY_CENTRE: bool = true;
override BY_COSINE: bool = true;
override BY_OVERLAP: bool = true;

// A shade point as the importance sees it.
struct Receiver {
    shell: Shell,
    // Geometric normal on the side it was reached from.
    normal: vec3<f32>,
}

// Integral over t from 0 to x of clamp(t / width, 0, 1).
fn ramp(x: vec4<f32>, width: f32) -> vec4<f32> {
    let inside = clamp(x, vec4<f32>(0.0), vec4<f32>(width));
    return inside * inside * (0.5 / width) + (max(x, vec4<f32>(0.0)) - inside);
}

// Power of the node times the probability that its light meets the gate: each bucket's travel time and the distance taken as
// independent and uniform over their intervals, whose sum has a piecewise quadratic distribution function.
fn power_through_gate(c: TreeChild, d: vec2<f32>, shell: Shell) -> f32 {
    if (!BY_OVERLAP) {
        // Live buckets count fully.
        return bucket_power(c, d, shell);
    }
    // Intervals of no width become short ones.
    let least = 1e-4 * d.y + 1e-12;
    let spread = max(d.y - d.x, least);
    let bucket = max((c.tau_hi - c.tau_lo) / BUCKET_COUNT, least);
    let start = c.tau_lo + d.x;
    let whole = spread + 8.0 * bucket;
    let lo = clamp(shell.lo - start, 0.0, whole);
    let hi = clamp(shell.hi - start, 0.0, whole);
    // Integrals of the distribution functions between the gate's edges, at the nine ends of the buckets.
    let k = vec4<f32>(0.0, 1.0, 2.0, 3.0) * bucket;
    let a = ramp(hi - k, spread) - ramp(lo - k, spread);
    let b = ramp(hi - 4.0 * bucket - k, spread) - ramp(lo - 4.0 * bucket - k, spread);
    let last = ramp(vec4<f32>(hi - 8.0 * bucket), spread).x - ramp(vec4<f32>(lo - 8.0 * bucket), spread).x;
    let share_low = max((a - vec4<f32>(a.yzw, b.x)) / bucket, vec4<f32>(0.0)) + LIVE_SHARE;
    let share_high = max((b - vec4<f32>(b.yzw, last)) / bucket, vec4<f32>(0.0)) + LIVE_SHARE;
    let live = live_buckets(c, d, shell);
    return c.power_unit * (dot(live_powers(c.buckets_low, 0.0, live), share_low)
        + dot(live_powers(c.buckets_high, 4.0, live), share_high));
}

// Greatest cosine at a surface point q with unit normal n towards a box, given by its centre relative to q, its half extents
// and its least distance to q; negative where the whole box lies behind the surface.
fn box_cosine(n: vec3<f32>, center: vec3<f32>, half_extent: vec3<f32>, d_min: f32) -> f32 {
    let height = dot(n, center) + dot(abs(n), half_extent);
    // What rounding may do to the height: a vertex in front must never be lost.
    let rounding = 1e-6 * (dot(abs(center), vec3<f32>(1.0)) + dot(half_extent, vec3<f32>(1.0)));
    if (height + rounding < 0.0) {
        return -1.0;
    }
    return clamp((height + rounding) / max(d_min, 1e-20), 0.0, 1.0);
}

// What a node's greatest cosine at the receiver makes of its power.
fn cosine_factor(cosine: f32) -> f32 {
    return select(1.0, max(cosine, LEAST_COSINE), BY_COSINE);
}

// The squared distance a node's power is divided by: of its box's centre, or of the nearest point as `node_bound` has it, and
// never below the box's half diagonal.
fn node_distance2(center: vec3<f32>, half_extent: vec3<f32>, d_min: f32) -> f32 {
    return max(select(d_min * d_min, dot(center, center), BY_CENTRE), dot(half_extent, half_extent));
}

// Importance of the node: power through the gate over its squared distance, times the greatest cosine at the receiver. 0
// behind the receiver whatever is switched off: culling is not importance.
fn node_importance(c: TreeChild, r: Receiver) -> f32 {
    let distances = box_distances(r.shell.q, c.lo, c.hi);
    let d = vec2<f32>(distances.x * r.shell.eta_lo, distances.y * r.shell.eta_hi);
    let half_extent = 0.5 * (c.hi - c.lo);
    let center = 0.5 * (c.hi + c.lo) - r.shell.q;
    var cosine = box_cosine(r.normal, center, half_extent, distances.x);
    if (HAS_TRANSMISSION) {
        // Light may come through the surface.
        cosine = 1.0;
    }
    if (is_pruned(c.tau_lo, c.tau_hi, d, r.shell) || cosine < 0.0) {
        return 0.0;
    }
    let power = power_through_gate(c, d, r.shell) * cosine_factor(cosine);
    return max(power / max(node_distance2(center, half_extent, distances.x), 1e-20), LEAST_IMPORTANCE);
}
