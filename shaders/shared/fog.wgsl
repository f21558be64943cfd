// Single scattering inside the gate: the event of a sensor subpath in a medium is moved along its segment, to a place from which the
// light of a deterministic vertex arrives inside the gate.
//
// With x the start of the segment, w its direction and D the way from x to the light vertex, the length s + |s w - D| of the way over
// the event at x + s w grows with s. So the gate is one interval of the segment.
#import segment

// Distances s along the segment of q, an event in a medium, at which an event may connect to v inside the gate. Empty (x > y) if there
// are none.
fn gate_interval(q: PathVertex, v: PathVertex) -> vec2<f32> {
    let flown = bitcast<f32>(q.base_color.x);
    let limit = min(bitcast<f32>(q.base_color.y), MAX_LENGTH);
    let w = -q.to_previous;
    let x = q.position - flown * w;
    let to_light = v.position - x;
    let straight = length(to_light);
    let along = dot(w, to_light);
    let elapsed = v.tau + (q.tau - q.eta * flown);
    let lo = (frame.gate_lo - frame.rounding_allowance - elapsed) / q.eta;
    let hi = (frame.gate_hi + frame.rounding_allowance - elapsed) / q.eta;
    let extent = media_extent(x, w);
    let first = max(select(0.0, distance_at(lo, straight, along), lo > straight), extent.x);
    let last = select(select(-1.0, distance_at(hi, straight, along), hi > straight), limit, hi > MAX_LENGTH);
    return vec2<f32>(first, min(min(last, limit), extent.y));
}

// Stands for infinity as a distance; its products do not overflow.
const MAX_LENGTH: f32 = 1e15;

// The distance s at which s + |s w - D| is `path`, for path > |D| = `straight`. `along`: w . D.
fn distance_at(path: f32, straight: f32, along: f32) -> f32 {
    return (path - straight) * (path + straight) / max(2.0 * (path - along), 1e-30);
}

// q at a random place of its `gate_interval`, with the throughput over the density of that place. The density is the mean of two:
// equiangular as seen from v (Kulla and Fajardo 2012), and exponential. The throughput is 0 if the interval is empty.
fn draw_in_gate(q: PathVertex, v: PathVertex, u: vec2<f32>) -> PathVertex {
    let interval = gate_interval(q, v);
    let flown = bitcast<f32>(q.base_color.x);
    let w = -q.to_previous;
    let x = q.position - flown * w;
    var moved = q;
    moved.throughput = vec3<f32>(0.0);
    // No other strategy forms a path whose only event is drawn: see `follows_connected`.
    moved.d_vcm = 0.0;
    if (!(interval.x < interval.y)) {
        return moved;
    }

    // Distances relative to the point of the ray that is nearest to v.
    let along = dot(w, v.position - x);
    let a = interval.x - along;
    let b = interval.y - along;
    let height = max(length(v.position - x - along * w), 1e-6 * max(abs(along), interval.x) + 1e-20);
    let angle = atan2(height * (b - a), height * height + a * b);
    let m = load_medium(q.material);
    let sigma_t = m.sigma_s + m.sigma_a;
    let rate = (sigma_t.x + sigma_t.y + sigma_t.z) / 3.0;
    let reached = one_minus_exp(vec3<f32>(rate * (b - a))).x;
    var offset = 0.0;
    if (u.x < 0.5) {
        let turn = cosine_and_sine(angle * u.y);
        offset = height * (a * turn.x + height * turn.y) / (height * turn.x - a * turn.y);
    } else {
        offset = a + minus_log_rest(u.y * reached) / rate;
    }
    offset = clamp(offset, a, b);
    let equiangular = height / (angle * (height * height + offset * offset));
    let exponential = rate * exp(-rate * (offset - a)) / reached;
    let density = 0.5 * (equiangular + exponential);

    let s = along + offset;
    let stretch = stretch_at(x, w, s);
    if (stretch.medium == NONE) {
        return moved;
    }
    moved.position = x + s * w;
    moved.tau = q.tau + q.eta * (s - flown);
    moved.material = stretch.medium;
    if ((q.flags & VERTEX_DEPTH) > 1u) {
        moved.d_vcm = min(q.d_vcm * mis(square(s / max(flown, 1e-20))), MAX_SUM);
    }
    moved.throughput = q.normal * transmittance(x, w, s) * load_medium(stretch.medium).sigma_s / density;
    return moved;
}
