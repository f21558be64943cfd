// Single scattering inside the gate: on each segment of a sensor subpath in fog, one scattering event is drawn per deterministic
// vertex. It is drawn from the positions at which light from this vertex arrives inside the gate. These events are connected in
// addition to the end of the segment.
//
// Let x be the start of the segment, w its direction, and D the vector from x to the light vertex. The path over the event at x + s w
// has the length s + |s w - D|, which grows with s. So the gate corresponds to one interval of the segment.
#import guided_flight
#import partial_sums
#import segment

// Where the segment before the shade point q starts.
fn segment_start(q: PathVertex, segment: FogSegment) -> vec3<f32> {
    return q.position + segment.length * q.to_previous;
}

// Distances s along the segment before q at which an event may connect to v inside the gate. Empty (x >= y) if there are none. If q is
// an event itself, the segment continues beyond q to the next surface.
fn gate_interval(q: PathVertex, segment: FogSegment, v: PathVertex) -> vec2<f32> {
    let limit = min(segment.limit, MAX_LENGTH);
    let w = -q.to_previous;
    let x = segment_start(q, segment);
    let to_light = v.position - x;
    let straight = length(to_light);
    let along = dot(w, to_light);
    let elapsed = v.tau + (q.tau - q.eta * segment.length);
    let lo = (frame.gate_lo - frame.rounding_allowance - elapsed) / q.eta;
    let hi = (frame.gate_hi + frame.rounding_allowance - elapsed) / q.eta;
    surrounding_solid = segment.solid;
    let extent = media_extent(x, w);
    let first = max(select(0.0, distance_at(lo, straight, along), lo > straight), extent.x);
    let last = select(select(-1.0, distance_at(hi, straight, along), hi > straight), limit, hi > MAX_LENGTH);
    return vec2<f32>(first, min(min(last, limit), extent.y));
}

// Whether an event for the deterministic vertex v can be drawn on the segment before q. The `gate_interval` must not be empty, v must not
// be a sun, and the path must not be too deep.
fn can_draw_in_gate(q: PathVertex, segment: FogSegment, v: PathVertex) -> bool {
    let interval = gate_interval(q, segment, v);
    return interval.x < interval.y && is_drawn_in_gate(v) && (q.flags & VERTEX_DEPTH) + (v.flags & VERTEX_DEPTH) + 1u <= frame.max_depth;
}

// Draws an event in the `gate_interval`. Its throughput is divided by the density of its position. This density is the mean of
// two: equiangular as seen from v (Kulla and Fajardo 2012), and exponential. The throughput is 0 outside of media.
fn draw_in_gate(q: PathVertex, segment: FogSegment, v: PathVertex, u: vec2<f32>) -> PathVertex {
    let interval = gate_interval(q, segment, v);
    let w = -q.to_previous;
    let x = segment_start(q, segment);

    // Distances relative to the point of the ray that is nearest to v.
    let along = dot(w, v.position - x);
    let a = interval.x - along;
    let b = interval.y - along;
    // Distance from v to the ray. Equiangular events lie about as far from v. The lower limit keeps the squares of these distances from
    // underflowing, for example if v is at the start of the segment.
    let height = max(length(v.position - x - along * w), max(1e-6 * max(abs(along), interval.x), 1e-8));
    let angle = angle_of(vec2<f32>(height * height + a * b, height * (b - a)));
    let rate = max(mean_extinction(stretch_at(x, w, interval.x).medium), 1e-3 / (b - a));
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
    var event: PathVertex;
    event.position = x + s * w;
    event.tau = q.tau + q.eta * (s - segment.length);
    event.to_previous = q.to_previous;
    event.geometric = q.to_previous;
    event.flags = VERTEX_IN_MEDIUM | (q.flags & VERTEX_DEPTH) | (segment.solid << VERTEX_SOLID_SHIFT);
    event.eta = q.eta;
    event.select_pdf = 1.0;
    event.owner = q.owner;
    event.d_vc = segment.d_vc;
    let depths = optical_depths(x, w, s);
    // At depth 1, no other strategy forms the path, so d_vcm stays 0: light_splat.wgsl skips vertices that `follows_connected`.
    if ((q.flags & VERTEX_DEPTH) > 1u) {
        event.d_vcm = min(segment.d_vcm * mis(s * s / flight_density(depths.scattering)), MAX_SUM);
    }
    let stretch = stretch_at(x, w, s);
    if (stretch.medium == NONE) {
        return event;
    }
    event.material = stretch.medium;
    let sigma_s = load_medium(stretch.medium).sigma_s * medium_density(stretch.medium, event.position);
    event.throughput = segment.throughput * transmitted(depths) * sigma_s / density;
    return event;
}
