// Flights of sensor subpaths through fog, towards the places from which light can still arrive inside the gate (lcs).
#import medium

// Whether sensor subpaths use `guided_flight` instead of `free_flight` outside of solids, if the gate has an end and culling is on.
override GUIDES_FLIGHTS: bool = false;
// Share of the events on the first segment that are drawn uniformly in the gate. It is small, because light that scatters only once is
// drawn in the gate anyway (fog.wgsl). On later segments, all events are drawn in proportion to scattering, because the factors of
// many events would multiply to a few bright paths.
const GUIDED_SHARE: f32 = 0.1;

// Brightness of the events on the first segment relative to that of the surface behind them, for `guided_end_probability`. In a thin
// gate, most surfaces get little light at the right time. Events see the few surfaces that get much (docs/notebook/fog-sampling.md).
const EVENT_BRIGHTNESS: f32 = 4.0;

// A distance that stands for infinity. Its products do not overflow.
const MAX_LENGTH: f32 = 1e15;

// The distance s at which s + |s w - D| is `path`, for path > |D| = `straight`. `along`: w . D.
fn distance_at(path: f32, straight: f32, along: f32) -> f32 {
    return (path - straight) * (path + straight) / max(2.0 * (path - along), 1e-30);
}

// Range of distances s along o + s d at which light that comes straight from an emitter may scatter and arrive inside the gate.
// `elapsed`: travel time from o to the sensor. Beyond y, every path is too long for the gate. The bounding sphere of the emitters
// stands for all emitters. Empty (x > y) if no path is short enough.
fn guiding_interval(o: vec3<f32>, d: vec3<f32>, elapsed: f32, eta: f32) -> vec2<f32> {
    let to_center = 0.5 * (frame.emitter_lo + frame.emitter_hi) - o;
    let radius = 0.5 * distance(frame.emitter_lo, frame.emitter_hi);
    let straight = length(to_center);
    let along = dot(d, to_center);
    let lo = (frame.gate_lo - frame.rounding_allowance - elapsed) / eta - radius;
    let hi = (frame.gate_hi + frame.rounding_allowance - elapsed) / eta + radius;
    return vec2<f32>(select(0.0, distance_at(lo, straight, along), lo > straight),
        select(-1.0, distance_at(hi, straight, along), hi > straight));
}

// Probability with which a guided flight reaches the end of a segment. `unscattered` and `scattered`: shares of the light, with sum 1. On
// the first segment, in thin fog, it is in proportion to the light that surface and events contribute. In thicker fog, the surface gets
// half of the samples, or the square root of the transmittance if this is less.
fn guided_end_probability(unscattered: f32, scattered: f32) -> f32 {
    if (dispatch.bounce > 0u) {
        return unscattered;
    }
    return max(unscattered / (unscattered + EVENT_BRIGHTNESS * scattered), min(sqrt(unscattered), 0.5));
}

// As `free_flight`, with three differences. The end of the first segment has another probability. No event lies where its light would
// be too late for the gate. A share of the events lies where light that comes straight from an emitter is inside the gate.
// `elapsed`: travel time from o to the sensor.
fn guided_flight(o: vec3<f32>, d: vec3<f32>, limit: f32, elapsed: f32, eta: f32, throughput: vec3<f32>, u: vec3<f32>) -> Flight {
    let interval = guiding_interval(o, d, elapsed, eta);
    let last = clamp(interval.y, 0.0, limit);
    let whole = optical_depths(o, d, last);
    let shares = throughput / max(throughput.x + throughput.y + throughput.z, 1e-37);
    let scattered = dot(shares, one_minus_exp(whole.scattering));
    let unscattered = dot(shares, exp(-whole.scattering));
    // If light from the end of the ray is too late, every flight ends in an event.
    let reaches = select(0.0, guided_end_probability(unscattered, scattered), last >= limit);
    let end_probability = select(reaches, 1.0, scattered <= 0.0);
    let choice = event_choice(u, end_probability);
    if (choice < 0.0) {
        let weight = normalised(whole.scattering, vec3<f32>(1.0), shares) * exp(-whole.absorption);
        return Flight(false, limit, NONE, weight * (unscattered / end_probability), whole.scattering);
    }

    // The position of the event: uniform in the gate, or in proportion to scattering.
    let extent = media_extent(o, d);
    let first = max(interval.x, extent.x);
    let width = min(last, extent.y) - first;
    let share = select(0.0, GUIDED_SHARE, width > 0.0 && dispatch.bounce == 0u);
    var f = Flight(true, first + u.y * width, NONE, vec3<f32>(0.0), vec3<f32>(0.0));
    if (choice < share) {
        f.medium = stretch_at(o, d, f.distance).medium;
    } else {
        f = flight_to_event(o, d, last, shares, whole, vec2<f32>((choice - share) / (1.0 - share), u.y));
    }
    if (f.medium == NONE) {
        // Clear air between two media. The weight is 0, but every event needs a medium that exists.
        f.medium = 0u;
        return f;
    }
    let sigma_s = load_medium(f.medium).sigma_s;
    let depths = optical_depths(o, d, f.distance);
    f.depth = depths.scattering;
    let density = event_density(f.medium, o + f.distance * d, shares, depths.scattering);
    let is_inside = f.distance >= first && f.distance <= first + width;
    let guided = select(0.0, share / (width * max(density, 1e-37)), is_inside && share > 0.0);
    f.weight = normalised(depths.scattering, sigma_s, shares) * exp(-depths.absorption)
        / ((1.0 - end_probability) * ((1.0 - share) / scattered + guided));
    return f;
}
