// Single scattering inside the gate: on each segment of a sensor subpath in fog, one scattering event is drawn per deterministic
// vertex, or several in different parts of the gate (event_strata.wgsl). It is drawn from the positions at which light from this vertex arrives inside the gate. These events are connected in
// addition to the end of the segment.
//
// Let x be the start of the segment, w its direction, and D the vector from x to the light vertex. The path over the event at x + s w
// has the length s + |s w - D|, which grows with s. So the gate corresponds to one interval of the segment.
//
// beam_events.wgsl draws events on beams in the same way. There, the pinhole takes the place of the light vertex.
#import doppler
#import guided_flight
#import partial_sums
#import segment
#import event_strata

// Where the segment before the shade point q starts.
fn segment_start(q: PathVertex, segment: FogSegment) -> vec3<f32> {
    return q.position + segment.length * q.to_previous;
}

// Distances s along the segment before q at which an event may connect to v with a travel time in `gate`. Empty (x >= y) if there are none.
// If q is an event itself, the segment continues beyond q to the next surface.
fn gate_interval(q: PathVertex, segment: FogSegment, v: PathVertex, gate: vec2<f32>) -> vec2<f32> {
    let limit = min(segment.limit, MAX_LENGTH);
    let w = -q.to_previous;
    let x = segment_start(q, segment);
    let to_light = v.position - x;
    let straight = length(to_light);
    let along = dot(w, to_light);
    let elapsed = v.tau + (q.tau - q.eta * segment.length);
    let lo = (gate.x - elapsed) / q.eta;
    let hi = (gate.y - elapsed) / q.eta;
    surrounding_solid = segment.solid;
    let extent = media_extent(x, w);
    let first = max(select(0.0, distance_at(lo, straight, along), lo > straight), extent.x);
    let last = select(select(-1.0, distance_at(hi, straight, along), hi > straight), limit, hi > MAX_LENGTH);
    return vec2<f32>(first, min(min(last, limit), extent.y));
}

// Whether an event for the deterministic vertex v can be drawn on the segment before q. The `gate_interval` must not be empty, v must not
// be a sun, and the path must not be too deep.
fn can_draw_in_gate(q: PathVertex, segment: FogSegment, v: PathVertex, gate: vec2<f32>) -> bool {
    let interval = gate_interval(q, segment, v, gate);
    return interval.x < interval.y && is_drawn_in_gate(v) && (q.flags & VERTEX_DEPTH) + (v.flags & VERTEX_DEPTH) + 1u <= frame.max_depth;
}

// The distribution of events in a `gate_interval`. Distances are relative to the point of the ray that is nearest to v.
struct GateDistribution {
    // Distance from the start of the segment to that point.
    along: f32,
    // Ends of the interval.
    a: f32,
    b: f32,
    // Distance from v to the ray, with a lower limit. Equiangular events lie about as far from v.
    height: f32,
    // Angle under which v sees the interval.
    angle: f32,
    // Exponential events: their rate per length, and the integral of the rate over the interval.
    rate: f32,
    reached: f32,
}

// The distribution on the segment before q. `interval`: its `gate_interval`, which must not be empty.
fn gate_distribution(q: PathVertex, segment: FogSegment, v: PathVertex, interval: vec2<f32>) -> GateDistribution {
    let w = -q.to_previous;
    let x = segment_start(q, segment);
    let along = dot(w, v.position - x);
    let a = interval.x - along;
    let b = interval.y - along;
    // The lower limit keeps the squares of distances from underflowing, for example if v is at the start of the segment.
    let height = max(length(v.position - x - along * w), max(1e-6 * max(abs(along), interval.x), 1e-8));
    let angle = angle_of(vec2<f32>(height * height + a * b, height * (b - a)));
    let rate = max(mean_extinction(stretch_at(x, w, interval.x).medium), 1e-3 / (b - a));
    let reached = one_minus_exp(vec3<f32>(rate * (b - a))).x;
    return GateDistribution(along, a, b, height, angle, rate, reached);
}

// Density per length of an event at `offset`: the mean of two densities, equiangular as seen from v (Kulla and Fajardo 2012), and
// exponential.
fn gate_density(g: GateDistribution, offset: f32) -> f32 {
    let equiangular = g.height / (g.angle * (g.height * g.height + offset * offset));
    let exponential = g.rate * exp(-g.rate * (offset - g.a)) / g.reached;
    return 0.5 * (equiangular + exponential);
}

// Draws an event in the `gate_interval`. Its throughput is divided by the `gate_density` of its position. The throughput is 0 outside
// of media.
fn draw_in_gate(q: PathVertex, segment: FogSegment, v: PathVertex, gate: vec2<f32>, u: vec2<f32>) -> PathVertex {
    let g = gate_distribution(q, segment, v, gate_interval(q, segment, v, gate));
    let w = -q.to_previous;
    let x = segment_start(q, segment);
    var offset = 0.0;
    if (u.x < 0.5) {
        let turn = cosine_and_sine(g.angle * u.y);
        offset = g.height * (g.a * turn.x + g.height * turn.y) / (g.height * turn.x - g.a * turn.y);
    } else {
        offset = g.a + minus_log_rest(u.y * g.reached) / g.rate;
    }
    offset = clamp(offset, g.a, g.b);
    let density = gate_density(g, offset);

    let s = g.along + offset;
    var event: PathVertex;
    event.position = x + s * w;
    event.tau = q.tau + q.eta * (s - segment.length);
    event.to_previous = q.to_previous;
    event.geometric = q.to_previous;
    event.flags = VERTEX_IN_MEDIUM | (q.flags & VERTEX_DEPTH) | (segment.solid << VERTEX_SOLID_SHIFT);
    event.eta = q.eta;
    event.select_pdf = 1.0;
    if (HAS_DOPPLER) {
        event.select_pdf = growth_before(q);
    }
    event.owner = q.owner;
    event.d_vc = segment.d_vc;
    let depths = optical_depths(x, w, s);
    // At depth 1, no other strategy forms the path, so d_vcm stays 0 (light_splat.wgsl leaves out the events of flights).
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

// Multiplies the throughput of an event that was drawn on the segment of a sensor subpath by the transmittance of the thin glass between
// the start of the segment and the event. The subpath has passed this glass at random, but `draw_in_gate` does not know where.
// `is_first`: whether it is the first segment, on which the subpath has passed the first clear sheet for sure.
fn pass_sheets_before(event: ptr<function, PathVertex>, start: vec3<f32>, is_first: bool) {
    let way = start - (*event).position;
    goes_back = true;
    last_clear = 1.0;
    // The ray ends before the surface at the start.
    trace((*event).position, way, 1.0 - 1e-5, true, NONE, vec4<u32>(0u));
    goes_back = false;
    (*event).throughput *= transit.weight * select(1.0, last_clear, SPLITS_AT_SHEETS && is_first);
}

// The share for which the splat of v counts, if a flight along a beam has ended in the event v. If beam_events.wgsl has drawn v, its splat
// counts for the rest. The shares follow the power heuristic (Eq. 27, beta = 2). `segment`: the segment of the beam up to v. `sensor`:
// see `sensor_vertex`.
fn flight_share(v: PathVertex, segment: FogSegment, sensor: PathVertex) -> f32 {
    let interval = gate_interval(v, segment, sensor, whole_gate());
    if (!(interval.x < interval.y && segment.length >= interval.x && segment.length <= interval.y)) {
        return 1.0;
    }
    let g = gate_distribution(v, segment, sensor, interval);
    if (g.a >= g.b) {
        // Rounding has closed the interval, because the sensor is very far away.
        return 1.0;
    }
    let drawn = mis(gate_density(g, segment.length - g.along));
    let shares = segment.throughput / max(segment.throughput.x + segment.throughput.y + segment.throughput.z, 1e-37);
    let depths = optical_depths(segment_start(v, segment), -v.to_previous, segment.length);
    let flown = mis(event_density(v.material, v.position, shares, depths.scattering));
    return flown / max(flown + drawn, 1e-37);
}

// The pinhole in the place of a light vertex, for events that are drawn on the segment of a beam.
fn sensor_vertex() -> PathVertex {
    var sensor: PathVertex;
    sensor.position = frame.sensor;
    return sensor;
}
