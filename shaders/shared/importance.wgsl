// Importance of a light-tree node for a shade point. It estimates the light that its vertices contribute through the
// gate, and is no bound on this light. It is 0 only where no vertex can contribute. Elsewhere any positive value keeps the
// result unbiased, and a tight estimate gives less noise than a conservative bound.
#import lightcone

// Share that is added to the estimate of each live bucket: a bucket whose vertices may meet the gate. Errors of the model in
// `power_through_gate` multiply from level to level: with 0.01, rare vertices became far too bright
// (docs/notebook/importance-floor.md).
const LIVE_BUCKET_SHARE: f32 = 0.3;
// Minimum of the cosine factor, for the same reason.
const MIN_COSINE: f32 = 0.1;
// Minimum of a positive importance: products of small factors must not underflow to 0.
const MIN_IMPORTANCE: f32 = 1e-36;

// Terms of the importance, each of which `--importance` can switch off. The result is unbiased with and without each term.
override BY_CENTRE: bool = true;
override BY_COSINE: bool = true;
override BY_OVERLAP: bool = true;
override BY_GLOSS: bool = true;

// The properties of a shade point that the importance uses.
struct Receiver {
    shell: Shell,
    // Unit geometric normal, on the side that the sensor subpath arrived from.
    normal: vec3<f32>,
    // Whether light may come through the surface.
    transmits: bool,
    // Centre of the glossy lobe: the mirrored unit direction to the sensor, or this direction itself at a retroreflector.
    mirrored: vec3<f32>,
    // Squared width of the glossy lobe, in radians squared.
    spread: f32,
    // Glossy share of the reflected light, 0 to 1.
    gloss: f32,
}

// For four buckets, the share of the power that meets the gate, 0 to 1, plus LIVE_BUCKET_SHARE; 0 where no light can meet the
// gate. The optical lengths of a bucket lie in an interval that begins at its `start` and is `length` long. `density` is the
// maximum density of an optical length in its interval.
fn shares_through_gate(start: vec4<f32>, length: f32, density: f32, shell: Shell) -> vec4<f32> {
    let overlap = min(start + length, vec4<f32>(shell.hi)) - max(start, vec4<f32>(shell.lo));
    if (HAS_GAP) {
        let end = start + length;
        let dark = max(min(end, vec4<f32>(shell.gap_hi)) - max(start, vec4<f32>(shell.gap_lo)), vec4<f32>(0.0));
        let missed = (overlap < vec4<f32>(0.0)) | ((start > vec4<f32>(shell.gap_lo)) & (end < vec4<f32>(shell.gap_hi)));
        let share = clamp((overlap - dark) * density, vec4<f32>(0.0), vec4<f32>(1.0));
        return select(share + LIVE_BUCKET_SHARE, vec4<f32>(0.0), missed);
    }
    return select(vec4<f32>(0.0), min(overlap * density, vec4<f32>(1.0)) + LIVE_BUCKET_SHARE, overlap >= vec4<f32>(0.0));
}

// Power of the node times the probability that its light meets the gate. `d`: range of the optical distance. In the
// model, the travel time in a bucket and the distance are independent and uniform over their intervals, so the
// density of their sum is a trapezium. The height of the trapezium replaces its integral: this ranks nodes equally
// well and costs less (docs/notebook/importance-floor.md).
fn power_through_gate(c: TreeChild, d: vec2<f32>, shell: Shell) -> f32 {
    if (!BY_OVERLAP) {
        // Every live bucket counts with its full power.
        return bucket_power(c, d, shell);
    }
    let bucket_width = (c.tau_hi - c.tau_lo) / BUCKET_COUNT;
    // An interval of zero width becomes a short one with the same start.
    let min_width = 1e-4 * d.y + 1e-12;
    let spread = max(d.y - d.x, min_width);
    let bucket = max(bucket_width, min_width);
    let start = c.tau_lo + d.x + vec4<f32>(0.0, 1.0, 2.0, 3.0) * bucket_width;
    let length = spread + bucket;
    let density = 1.0 / max(spread, bucket);
    return c.power_unit * (dot(bytes_to_floats(c.buckets_low), shares_through_gate(start, length, density, shell))
        + dot(bytes_to_floats(c.buckets_high), shares_through_gate(start + 4.0 * bucket_width, length, density, shell)));
}

// Maximum cosine between the unit normal n of a surface point q and a direction from q into the box [lo, hi]. `d_min` is the
// minimum distance from q to the box. The result is negative if the whole box lies behind the surface.
fn box_cosine(n: vec3<f32>, lo: vec3<f32>, hi: vec3<f32>, q: vec3<f32>, d_min: f32) -> f32 {
    // The corner that is farthest along n. After rounding, no vertex of the box is farther along n than this corner.
    let corner = select(lo, hi, n > vec3<f32>(0.0)) - q;
    let height = dot(n, corner);
    // Bound on the rounding error of the height: a box with a vertex in front of the surface must never be culled.
    let rounding = 1e-6 * dot(abs(corner), vec3<f32>(1.0));
    if (height + rounding < 0.0) {
        return -1.0;
    }
    return clamp((height + rounding) / max(d_min, 1e-20), 0.0, 1.0);
}

// Factor of the importance for the maximum cosine of a node at the receiver.
fn cosine_factor(cosine: f32) -> f32 {
    return select(1.0, max(cosine, MIN_COSINE), BY_COSINE);
}

// pi times the glossy lobe, cosine included, towards a node with its centre at the offset `center` from the receiver. The
// result is 1 / (w (1 + e^2 / w)^2) with the squared width w and the chord e to the mirrored direction: it has the tails of
// GGX, and its integral over the sphere is pi / (1 + w / 4). A node widens the lobe by its squared angular radius `radius2`.
fn gloss_factor(r: Receiver, center: vec3<f32>, radius2: f32) -> f32 {
    let chord2 = max(2.0 - 2.0 * dot(center, r.mirrored) * inverseSqrt(max(dot(center, center), 1e-20)), 0.0);
    let width = r.spread + radius2;
    return width / square(width + chord2);
}

// Squared distance by which a node's power is divided: to the centre of its box, or without BY_CENTRE to the nearest point of
// the box as in `node_bound`. It is at least the squared half diagonal of the box.
fn node_distance2(center: vec3<f32>, half_extent: vec3<f32>, d_min: f32) -> f32 {
    return max(select(d_min * d_min, dot(center, center), BY_CENTRE), dot(half_extent, half_extent));
}

// Importance of the node: power through the gate over squared distance, times the factor of the receiver. It is 0 outside the
// shell and behind the receiver, whatever `--importance` switches off: culling is not one of its terms.
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
    if ((HAS_GLOSSY || HAS_MEDIA) && BY_GLOSS) {
        factor = mix(factor, gloss_factor(r, center, dot(half_extent, half_extent) / distance2), r.gloss);
    }
    return max(power_through_gate(c, d, r.shell) * factor / distance2, MIN_IMPORTANCE);
}
