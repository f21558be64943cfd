// Importance of a light-tree node to a shade point: an estimate of what its vertices contribute through the gate, not a bound.
// It is 0 only where no vertex can contribute; elsewhere any positive value is unbiased, and a tight
// estimate leaves less noise than a conservative bound.
#import lightcone

// Weight of a live bucket beyond its estimate. Errors of the uniform model multiply from level to level: with 0.01 rare vertices
// shone far too bright (docs/notebook/importance-floor.md).
const LIVE_BUCKET_SHARE: f32 = 0.3;
// The same for the cosine.
const MIN_COSINE: f32 = 0.1;
// Keeps products of small factors from becoming 0.
const MIN_IMPORTANCE: f32 = 1e-36;

// Ideas that a render may do without (`--importance`): any of them is unbiased on and off.
override BY_CENTRE: bool = true;
override BY_COSINE: bool = true;
override BY_OVERLAP: bool = true;
override BY_GLOSS: bool = true;

// A shade point as the importance sees it.
struct Receiver {
    shell: Shell,
    // Geometric normal on the side it was reached from.
    normal: vec3<f32>,
    // Light may come through the surface.
    transmits: bool,
    // Unit direction that the way to the sensor is mirrored into, and the squared width (radians) of the gloss around it.
    mirrored: vec3<f32>,
    spread: f32,
    // Part of what it reflects that is gloss, 0 to 1.
    gloss: f32,
}

// Share of the power of four buckets whose optical lengths lie in intervals of `length` from `start` on that meets the gate, 0 to 1,
// and LIVE_BUCKET_SHARE more; 0 where none can. `density`: that of a length in its interval, at most.
fn shares_through_gate(start: vec4<f32>, length: f32, density: f32, shell: Shell) -> vec4<f32> {
    let overlap = min(start + length, vec4<f32>(shell.hi)) - max(start, vec4<f32>(shell.lo));
    return select(vec4<f32>(0.0), min(overlap * density, vec4<f32>(1.0)) + LIVE_BUCKET_SHARE, overlap >= vec4<f32>(0.0));
}

// Power of the node times the probability that its light meets the gate: each bucket's travel time and the distance taken as
// independent and uniform over their intervals. The density of their sum is a trapezium; its height stands for all of it, which
// tells candidates apart as well as its integral does and costs less (docs/notebook/importance-floor.md).
fn power_through_gate(c: TreeChild, d: vec2<f32>, shell: Shell) -> f32 {
    if (!BY_OVERLAP) {
        // Live buckets count fully.
        return bucket_power(c, d, shell);
    }
    let bucket_width = (c.tau_hi - c.tau_lo) / BUCKET_COUNT;
    // Intervals of no width become short ones; they begin where they began.
    let min_width = 1e-4 * d.y + 1e-12;
    let spread = max(d.y - d.x, min_width);
    let bucket = max(bucket_width, min_width);
    let start = c.tau_lo + d.x + vec4<f32>(0.0, 1.0, 2.0, 3.0) * bucket_width;
    let length = spread + bucket;
    let density = 1.0 / max(spread, bucket);
    return c.power_unit * (dot(bytes_to_floats(c.buckets_low), shares_through_gate(start, length, density, shell))
        + dot(bytes_to_floats(c.buckets_high), shares_through_gate(start + 4.0 * bucket_width, length, density, shell)));
}

// Greatest cosine at a surface point q with unit normal n towards the box [lo, hi], d_min from q at least; negative where the whole
// box lies behind the surface.
fn box_cosine(n: vec3<f32>, lo: vec3<f32>, hi: vec3<f32>, q: vec3<f32>, d_min: f32) -> f32 {
    // The corner that is furthest in front. No offset of a vertex can round to more than that of the corner.
    let corner = select(lo, hi, n > vec3<f32>(0.0)) - q;
    let height = dot(n, corner);
    // What rounding may do to the height: a vertex in front must never be lost.
    let rounding = 1e-6 * dot(abs(corner), vec3<f32>(1.0));
    if (height + rounding < 0.0) {
        return -1.0;
    }
    return clamp((height + rounding) / max(d_min, 1e-20), 0.0, 1.0);
}

// What a node's greatest cosine at the receiver makes of its power.
fn cosine_factor(cosine: f32) -> f32 {
    return select(1.0, max(cosine, MIN_COSINE), BY_COSINE);
}

// pi times the lobe of gloss, its cosine included, towards a node at `center` from the receiver: 1 / (w (1 + e^2 / w)^2) for a squared width
// w and a chord e to the mirrored direction, the tails of GGX; over the sphere its integral is pi / (1 + w / 4). A node widens it by
// its squared angular radius `radius2`.
fn gloss_factor(r: Receiver, center: vec3<f32>, radius2: f32) -> f32 {
    let chord2 = max(2.0 - 2.0 * dot(center, r.mirrored) * inverseSqrt(max(dot(center, center), 1e-20)), 0.0);
    let width = r.spread + radius2;
    return width / square(width + chord2);
}

// The squared distance a node's power is divided by: of its box's centre, or of the nearest point as `node_bound` has it, and
// never below the box's half diagonal.
fn node_distance2(center: vec3<f32>, half_extent: vec3<f32>, d_min: f32) -> f32 {
    return max(select(d_min * d_min, dot(center, center), BY_CENTRE), dot(half_extent, half_extent));
}

// Importance of the node: power through the gate over its squared distance, times what the receiver makes of it. 0
// behind the receiver whatever is switched off: culling is not importance.
fn node_importance(c: TreeChild, r: Receiver) -> f32 {
    let distances = box_distances(r.shell.q, c.lo, c.hi);
    let d = vec2<f32>(distances.x * r.shell.eta_lo, distances.y * r.shell.eta_hi);
    let half_extent = 0.5 * (c.hi - c.lo);
    let center = 0.5 * (c.hi + c.lo) - r.shell.q;
    let cosine = select(box_cosine(r.normal, c.lo, c.hi, r.shell.q, distances.x), 1.0, r.transmits);
    if (is_pruned(c.tau_lo, c.tau_hi, d, r.shell) || cosine < 0.0) {
        return 0.0;
    }
    let distance2 = max(node_distance2(center, half_extent, distances.x), 1e-20);
    var factor = cosine_factor(cosine);
    if (HAS_GLOSSY && BY_GLOSS) {
        factor = mix(factor, gloss_factor(r, center, dot(half_extent, half_extent) / distance2), r.gloss);
    }
    return max(power_through_gate(c, d, r.shell) * factor / distance2, MIN_IMPORTANCE);
}
