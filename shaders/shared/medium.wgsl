// Participating media: where they are, how far light flies in them, and what they transmit.
//
// A medium fills a box, a density grid, all space, or the inside of a mesh. Outside of solids, boxes and grids may overlap; then the
// last one counts. The inside of a null boundary, a mesh that only bounds a medium, has priority over them. Flights are sampled by
// scattering alone; absorption is a factor of the throughput. In MIS weights, the density of a distance is the mean transmittance only
// (`flight_density`): the coefficient at an event is a factor of every strategy of a path, so it cancels.
#import boundary
#import frame
#import grid
#import math
#import solid

struct Medium {
    // Opposite corners of the box.
    lo: vec3<f32>,
    // PHASE_ constant of phase.wgsl.
    phase: u32,
    hi: vec3<f32>,
    // Phase functions with two lobes, one of which may be a Draine lobe: share of the second lobe, 0 to 1.
    share: f32,
    // Coefficients of scattering and absorption per unit of length of the render space.
    sigma_s: vec3<f32>,
    // Henyey-Greenstein lobes: mean cosines of the first and the second lobe. For a Draine lobe, g2 is its parameter g.
    g: f32,
    sigma_a: vec3<f32>,
    g2: f32,
    // Parameter alpha of the Draine lobe.
    alpha: f32,
    // Mean cosine of the phase function.
    mean_cosine: f32,
    // First node in `phase_tables`, and number of nodes.
    table: u32,
    table_size: u32,
}

// Five texels per medium.
@group(0) @binding(13) var media: texture_1d<u32>;

fn load_medium(index: u32) -> Medium {
    let lo = textureLoad(media, 5u * index, 0);
    let hi = bitcast<vec4<f32>>(textureLoad(media, 5u * index + 1u, 0));
    let s = bitcast<vec4<f32>>(textureLoad(media, 5u * index + 2u, 0));
    let a = bitcast<vec4<f32>>(textureLoad(media, 5u * index + 3u, 0));
    let p = textureLoad(media, 5u * index + 4u, 0);
    return Medium(bitcast<vec3<f32>>(lo.xyz), lo.w, hi.xyz, hi.w, s.xyz, s.w, a.xyz, a.w,
        bitcast<f32>(p.x), bitcast<f32>(p.y), p.z, p.w);
}

// Distances along o + t d at which the ray enters (x) and leaves (y) medium `index`; x > y if it misses the medium.
fn medium_span(index: u32, o: vec3<f32>, d: vec3<f32>) -> vec2<f32> {
    let m = load_medium(index);
    let inverse = 1.0 / select(d, vec3<f32>(1e-30), abs(d) < vec3<f32>(1e-30));
    let a = (m.lo - o) * inverse;
    let b = (m.hi - o) * inverse;
    let span = vec2<f32>(max_component(min(a, b)), -max_component(-max(a, b)));
    if (HAS_GRIDS) {
        let g = load_grid(index);
        if (has_grid(g)) {
            let inner = grid_span(g, o, d);
            return vec2<f32>(max(span.x, inner.x), min(span.y, inner.y));
        }
    }
    return span;
}

// Density of medium `index` at p, a factor on its coefficients.
fn medium_density(index: u32, p: vec3<f32>) -> f32 {
    if (HAS_GRIDS) {
        let g = load_grid(index);
        if (has_grid(g)) {
            return grid_density(g, p);
        }
    }
    return 1.0;
}

// Whether `pass_medium` takes the mean density of a grid instead of following the ray through its cells. This costs
// less, and is good enough to choose among candidates.
var<private> uses_mean_densities: bool = false;
// Maximum optical depth of a stretch with mean densities. The grid may have holes, so no candidate behind it gets a target of 0.
const MAX_MEAN_DEPTH: f32 = 16.0;

// Passes medium `index` from t = `first` to `last`, or until the integral of the density is `needed`. A medium without a grid has
// density 1. With `uses_mean_densities`, `needed` has no effect on grids.
fn pass_medium(index: u32, o: vec3<f32>, d: vec3<f32>, first: f32, last: f32, needed: f32) -> Passage {
    if (HAS_GRIDS) {
        let g = load_grid(index);
        if (has_grid(g) && uses_mean_densities) {
            let m = load_medium(index);
            let most = MAX_MEAN_DEPTH / max(max_component(m.sigma_s + m.sigma_a), 1e-37);
            return Passage(last - first, min(g.mean * (last - first), most));
        }
        if (has_grid(g)) {
            return pass_grid(g, o, d, first, last, needed);
        }
    }
    let flown = min(last - first, needed);
    return Passage(flown, flown);
}

// Code of the solid around the ray (solid.wgsl). Callers of the functions below set it.
var<private> surrounding_solid: u32 = OUTSIDE_SOLIDS;

// A part of a ray inside one medium.
struct Stretch {
    // Index of the medium, or NONE.
    medium: u32,
    // Distance along the ray at which the medium may change. It is greater than the start of the stretch.
    end: f32,
}

// The medium of the ray o + t d just behind t, and where it may end. `d` is a unit vector.
fn stretch_at(o: vec3<f32>, d: vec3<f32>, t: f32) -> Stretch {
    var s = Stretch(NONE, 3e38);
    if (HAS_INTERIORS && surrounding_solid != OUTSIDE_SOLIDS) {
        s.medium = select(surrounding_solid - FIRST_INTERIOR, NONE, surrounding_solid == CLEAR_SOLID);
        return s;
    }
    if (HAS_NULL_BOUNDARIES) {
        let enclosing = enclosing_medium(t);
        s = Stretch(enclosing.x, bitcast<f32>(enclosing.y));
        if (s.medium != NONE) {
            return s;
        }
    }
    for (var i = 0u; i < frame.media_count; i++) {
        let span = medium_span(i, o, d);
        let enter = span.x;
        let leave = span.y;
        let inside = enter <= t && t < leave;
        s.medium = select(s.medium, i, inside);
        s.end = min(s.end, select(select(3e38, enter, t < enter && enter < leave), leave, inside));
    }
    return s;
}

// Maximum number of stretches of a ray, minus 1.
fn last_stretch() -> u32 {
    return 2u * frame.media_count + select(0u, crossing_count, HAS_NULL_BOUNDARIES);
}

// Optical depths of scattering and of absorption along a part of a ray, per channel.
struct Depths {
    scattering: vec3<f32>,
    absorption: vec3<f32>,
}

// Depths from o to o + length d. `d` is a unit vector.
fn optical_depths(o: vec3<f32>, d: vec3<f32>, length: f32) -> Depths {
    var depths = Depths(vec3<f32>(0.0), vec3<f32>(0.0));
    var t = 0.0;
    for (var i = 0u; i <= last_stretch() && t < length; i++) {
        let stretch = stretch_at(o, d, t);
        let end = min(stretch.end, length);
        if (stretch.medium != NONE) {
            let m = load_medium(stretch.medium);
            let passed = pass_medium(stretch.medium, o, d, t, end, 3e38).integral;
            depths.scattering += m.sigma_s * passed;
            depths.absorption += m.sigma_a * passed;
        }
        t = end;
    }
    return depths;
}

// Mean of sigma_t over the channels, and over a grid, in the medium `index`; 0 for NONE.
fn mean_extinction(index: u32) -> f32 {
    if (index == NONE) {
        return 0.0;
    }
    let m = load_medium(index);
    let sigma_t = m.sigma_s + m.sigma_a;
    let mean = (sigma_t.x + sigma_t.y + sigma_t.z) * (1.0 / 3.0);
    if (HAS_GRIDS) {
        let g = load_grid(index);
        return mean * select(1.0, g.mean, has_grid(g));
    }
    return mean;
}

// Fraction of light, per channel, that media of these depths transmit.
fn transmitted(depths: Depths) -> vec3<f32> {
    if (!HAS_MEDIA) {
        return vec3<f32>(1.0);
    }
    return exp(-depths.scattering - depths.absorption);
}

// 1 - exp(-x) for x >= 0, accurate for small x.
fn one_minus_exp(x: vec3<f32>) -> vec3<f32> {
    return select(1.0 - exp(-x), x * (1.0 - x * (0.5 - x * (1.0 / 6.0))), x < vec3<f32>(0.02));
}

// -log(1 - x) for 0 <= x < 1, accurate for small x.
fn minus_log_rest(x: f32) -> f32 {
    return select(-log(1.0 - x), x * (1.0 + x * (0.5 + x * (1.0 / 3.0))), x < 0.01);
}

// event * exp(-depth), divided by its mean over the channels. `event`: sigma_s at an event, 1 at the end of a ray. `shares`: weights
// of the channels in this mean.
fn normalised(depth: vec3<f32>, event: vec3<f32>, shares: vec3<f32>) -> vec3<f32> {
    // Relative to the clearest channel, so that the exponentials of a thick medium do not all underflow.
    let clearest = min(depth.x, min(depth.y, depth.z));
    let x = event * exp(clearest - depth);
    return x / max(dot(shares, x), 1e-37);
}

// Density per length with which a `free_flight` of a light subpath ends in an event at p, in the medium `index`. `shares`: weights of the
// channels. `depth`: optical depth of scattering from the start of the flight to p.
fn event_density(index: u32, p: vec3<f32>, shares: vec3<f32>, depth: vec3<f32>) -> f32 {
    return dot(shares, load_medium(index).sigma_s * exp(-depth)) * medium_density(index, p);
}

// A flight to the next scattering event, or to the end of the ray.
struct Flight {
    scattered: bool,
    // Distance and medium of the event, if there is one.
    distance: f32,
    medium: u32,
    // Transmittance (times sigma_s, at an event) over the density of this outcome.
    weight: vec3<f32>,
    // Optical depth of scattering up to the end of the flight.
    depth: vec3<f32>,
}

// Probability p with which a sensor subpath reaches the end of a segment. `unscattered`: its transmittance T without absorption. On the
// first segment, p = sqrt(T), so surfaces behind fog get more samples. The weights of both outcomes stay small: T / p <= 1 and
// (1 - T) / (1 - p) <= 2. On later segments p = T, and the weights are 1. Other weights would multiply over many segments to a few
// bright paths.
fn end_probability_of(unscattered: f32) -> f32 {
    return select(unscattered, sqrt(unscattered), dispatch.bounce == 0u);
}

// Chooses the outcome of a flight. A value below 0: the flight reaches its end, with the given probability. Other values are uniform in
// [0, 1), and serve the other choices of the flight. u.x has steps of 2^-24, and in thin fog only a few of them choose an event. So
// u.z refines them. `u.x - end_probability` is exact where this matters; adding u.z to u.x first would round it away.
fn event_choice(u: vec3<f32>, end_probability: f32) -> f32 {
    let beyond = (u.x - end_probability) + u.z * (1.0 / 16777216.0);
    return min(beyond / max(1.0 - end_probability, 1.0 / 16777216.0), 0.99999994);
}

// Samples a flight along o + t d for 0 < t < limit. `throughput`: throughput of the subpath so far. One channel is chosen with a
// probability in proportion to its throughput, and the distance is drawn for this channel. The density is the sum over all channels,
// so that no channel gets a large weight. Sensor subpaths reach the end with `end_probability_of`.
fn free_flight(o: vec3<f32>, d: vec3<f32>, limit: f32, throughput: vec3<f32>, is_sensor_subpath: bool, u: vec3<f32>) -> Flight {
    let whole = optical_depths(o, d, limit);
    let shares = throughput / max(throughput.x + throughput.y + throughput.z, 1e-37);
    let scattered = dot(shares, one_minus_exp(whole.scattering));
    let unscattered = dot(shares, exp(-whole.scattering));
    let end_probability = select(select(unscattered, end_probability_of(unscattered), is_sensor_subpath), 1.0, scattered <= 0.0);
    let choice = event_choice(u, end_probability);
    if (choice < 0.0) {
        let weight = normalised(whole.scattering, vec3<f32>(1.0), shares) * exp(-whole.absorption);
        return Flight(false, limit, NONE, weight * (unscattered / end_probability), whole.scattering);
    }

    var f = flight_to_event(o, d, limit, shares, whole, vec2<f32>(choice, u.y));
    f.weight *= scattered / (1.0 - end_probability);
    return f;
}

// Samples a flight along o + t d that ends in an event with 0 < t <= limit. `whole`: depths up to `limit`. The weight is that of a flight
// that scatters with its natural probability P(event), which is `scattered` in `free_flight`. A caller that chooses events with
// probability p multiplies the weight by P(event) / p. `guided_flight` replaces the weight.
fn flight_to_event(o: vec3<f32>, d: vec3<f32>, limit: f32, shares: vec3<f32>, whole: Depths, u: vec2<f32>) -> Flight {
    // The channel that chooses the optical depth of the event.
    let events = shares * one_minus_exp(whole.scattering);
    let choice = u.x * (events.x + events.y + events.z);
    let channel = select(select(vec3<f32>(0.0, 0.0, 1.0), vec3<f32>(0.0, 1.0, 0.0), choice < events.x + events.y),
        vec3<f32>(1.0, 0.0, 0.0), choice < events.x);
    let drawn = minus_log_rest(u.y * dot(one_minus_exp(whole.scattering), channel));

    var f = Flight(false, limit, NONE, vec3<f32>(0.0), vec3<f32>(0.0));
    var depths = Depths(vec3<f32>(0.0), vec3<f32>(0.0));
    var t = 0.0;
    for (var i = 0u; i <= last_stretch(); i++) {
        if (t < limit && !f.scattered) {
            let stretch = stretch_at(o, d, t);
            let end = min(stretch.end, limit);
            if (stretch.medium != NONE) {
                let m = load_medium(stretch.medium);
                let needed = max(drawn - dot(depths.scattering, channel), 0.0) / max(dot(m.sigma_s, channel), 1e-37);
                let passed = pass_medium(stretch.medium, o, d, t, end, needed);
                depths.scattering += m.sigma_s * passed.integral;
                depths.absorption += m.sigma_a * passed.integral;
                f.scattered = passed.length < end - t;
                f.distance = t + passed.length;
                f.medium = stretch.medium;
                // The density of a grid is a factor of the density of the flight as well, so it cancels.
                f.weight = m.sigma_s;
            }
            t = end;
        }
    }
    // Rounding may carry the event a little beyond the last medium. It then stays at the end of that medium.
    f.scattered = f.medium != NONE;
    f.depth = depths.scattering;
    f.weight = normalised(depths.scattering, f.weight, shares) * exp(-depths.absorption);
    return f;
}

// Distances along o + t d, t >= 0, between which all boxes and grids lie. Empty (x > y) if the ray meets none. In a solid with a
// medium: the whole ray. Media inside null boundaries are not included.
fn media_extent(o: vec3<f32>, d: vec3<f32>) -> vec2<f32> {
    if (HAS_INTERIORS && surrounding_solid >= FIRST_INTERIOR) {
        return vec2<f32>(0.0, 3e38);
    }
    var extent = vec2<f32>(3e38, -1.0);
    for (var i = 0u; i < frame.media_count; i++) {
        let span = medium_span(i, o, d);
        let enter = max(span.x, 0.0);
        let leave = span.y;
        if (enter < leave) {
            extent = vec2<f32>(min(extent.x, enter), max(extent.y, leave));
        }
    }
    return extent;
}
