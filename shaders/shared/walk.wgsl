// One step of a random walk, for light and sensor subpaths alike: trace to the next surface or to a scattering event in a
// medium, then choose the next direction.
#import doppler
#import guided_flight
#import visibility
#import partial_sums
#import surface_vertex

// The vertex at which a subpath arrived.
struct Arrival {
    // False if the ray left the scene; the other fields then have no meaning.
    found: bool,
    // The hit; without meaning if the subpath arrived in a medium.
    surface: Surface,
    vertex: PathVertex,
    // Factor by which the flight through media changed the throughput, in the channel where it is largest; 1 without media.
    carried: f32,
    // The sheets of thin glass that the subpath has passed on this segment (sheet.wgsl).
    transit: Transit,
    // The segment that was traced, also if the ray left the scene. Its `limit` is 0 if the scene has no media, or if
    // the ray runs in a solid without a medium.
    segment: FogSegment,
}

// Traces the ray of `state` to the nearest surface, or to a scattering event before it, and moves the subpath there. With
// `is_direct` the subpath never scatters: the throughput falls by the transmittance instead. `key`: see `trace`. `u`: samples the
// flight.
fn advance(state: ptr<function, PathState>, is_direct: bool, is_sensor_subpath: bool, key: vec4<u32>, u: vec3<f32>) -> Arrival {
    var a: Arrival;
    a.carried = 1.0;
    let hit = trace((*state).position + (*state).shift, (*state).direction, 3e38, false, (*state).triangle, key);
    a.found = hit.triangle != NONE;
    if (a.found) {
        let exact = reintersect(hit, (*state).position, (*state).direction);
        a.surface = surface_at(exact.triangle, exact.u, exact.v);
    }
    var solid = path_solid(*state);
    if (a.found) {
        solid = find_solid(state, a.surface);
    }
    if (HAS_MEDIA && solid != CLEAR_SOLID) {
        let limit = select(3e38, distance(a.surface.position, (*state).position), a.found);
        surrounding_solid = solid;
        let flight = fly(state, limit, is_direct, is_sensor_subpath, u);
        let to_shade_point = select(0.0, flight.distance, a.found || flight.scattered);
        a.segment = FogSegment((*state).throughput, limit, (*state).d_vcm, (*state).d_vc, to_shade_point, solid);
        (*state).throughput *= flight.weight;
        a.carried = max_component(flight.weight);
        let is_parallel = HAS_PARALLEL && ((*state).flags & PATH_PARALLEL) != 0u;
        if ((a.found || flight.scattered) && !is_parallel) {
            (*state).d_vcm = min((*state).d_vcm / mis(flight_density(flight.depth)), MAX_SUM);
        }
        if (flight.scattered) {
            a.found = true;
            if (HAS_SHEETS) {
                a.transit = transit_before(flight.distance);
                pass_sheets(state, &a);
            }
            a.vertex = arrive_in_medium(state, flight);
            return a;
        }
    }
    if (HAS_SHEETS) {
        a.transit = transit;
        a.transit.weight *= sheet_stop;
        pass_sheets(state, &a);
    }
    if (a.found) {
        a.vertex = arrive(state, a.surface);
    }
    return a;
}

// Applies the sheets of thin glass on the segment to the subpath.
fn pass_sheets(state: ptr<function, PathState>, a: ptr<function, Arrival>) {
    (*state).throughput *= (*a).transit.weight;
    (*state).tau += (*a).transit.delay;
    (*a).carried *= max_component((*a).transit.weight);
}

// Sets eta and the solid of the ray of `state` if the `surface` that it hits transmits light; otherwise both stay. The side that was
// hit determines both, so subpaths from either end of a segment find the same values. Returns the code of the solid.
fn find_solid(state: ptr<function, PathState>, surface: Surface) -> u32 {
    if (!bounds_solid(load_material(surface.material))) {
        return path_solid(*state);
    }
    let is_front = dot(surface.geometric, -(*state).direction) >= 0.0;
    let solid = select(solid_of(surface.material), OUTSIDE_SOLIDS, is_front);
    (*state).eta = select(solid_index(surface.material), SURROUNDING_GROUP_INDEX, is_front);
    (*state).flags = with_solid((*state).flags, solid);
    return solid;
}

// The flight of a subpath along its ray, at most as far as `limit`. Other arguments: see `advance`.
fn fly(state: ptr<function, PathState>, limit: f32, is_direct: bool, is_sensor_subpath: bool, u: vec3<f32>) -> Flight {
    if (is_direct) {
        let depths = optical_depths((*state).position, (*state).direction, limit);
        return Flight(false, limit, NONE, transmitted(depths), depths.scattering);
    }
    // Guided flights assume that light comes straight from the emitters, so rays inside solids do not use them.
    if (GUIDES_FLIGHTS && is_sensor_subpath && frame.cull_hi < 3e38 && surrounding_solid == OUTSIDE_SOLIDS) {
        let s = *state;
        return guided_flight(s.position, s.direction, limit, s.tau, s.eta, s.throughput, u);
    }
    return free_flight((*state).position, (*state).direction, limit, (*state).throughput, is_sensor_subpath, u);
}

// Whether every path that continues from v to `point`, or to any point at least as far from v, is too long for the gate. The
// test uses a lower bound of the travel time, so no path inside the gate is lost.
fn is_too_late(v: PathVertex, point: vec3<f32>) -> bool {
    return v.tau + distance(v.position, point) >= frame.cull_hi;
}

// Moves `state` to the hit at `surface`: updates travel time and partial MIS sums. Returns the vertex at the hit. `find_solid` must
// have been called before, because the travel time counts the index of refraction of the solid that the ray crossed.
fn arrive(state: ptr<function, PathState>, surface: Surface) -> PathVertex {
    let segment = surface.position - (*state).position;
    let distance2 = dot(segment, segment);
    let towards = -(*state).direction;
    let side = dot(surface.geometric, towards);
    let is_parallel = HAS_PARALLEL && ((*state).flags & PATH_PARALLEL) != 0u;
    mis_arrive(state, select(distance2, 1.0, is_parallel), abs(side));
    if (HAS_PARALLEL) {
        (*state).flags &= ~PATH_PARALLEL;
    }
    (*state).tau += (*state).eta * sqrt(distance2);
    (*state).position = surface.position;
    (*state).triangle = surface.triangle;
    var instance = 0u;
    if (HAS_DOPPLER) {
        instance = load_triangle(surface.triangle).instance;
        (*state).select_pdf += (*state).eta * dot((*state).direction, instance_velocity(instance, surface.position));
    }

    var v = surface_vertex(surface, towards);
    v.tau = (*state).tau;
    v.throughput = (*state).throughput;
    v.d_vcm = (*state).d_vcm;
    v.d_vc = (*state).d_vc;
    v.flags |= path_solid(*state) << VERTEX_SOLID_SHIFT;
    v.eta = (*state).eta;
    if (HAS_ELLIPSOIDS) {
        v.select_pdf = sqrt(distance2);
    }
    if (HAS_DOPPLER) {
        v.select_pdf = (*state).select_pdf;
        v.selection_cdf = instance;
    }
    return v;
}

// Stores in v the sum that `auxiliary_sum` reads: the MIS sum of the ellipsoidal connections over `before`. `before` is the vertex before
// v on its subpath, and the auxiliary vertex of these connections.
fn add_auxiliary_sum(v: ptr<function, PathVertex>, before: PathVertex) {
    let sum = sum_over_auxiliary(before, -(*v).to_previous, previous_distance(*v));
    (*v).selection_cdf = bitcast<u32>(min(min(sum, MAX_SUM) * (*v).d_vcm, MAX_SUM));
}

// Moves `state` to the scattering event of `flight`. Returns the vertex there.
fn arrive_in_medium(state: ptr<function, PathState>, flight: Flight) -> PathVertex {
    let is_parallel = HAS_PARALLEL && ((*state).flags & PATH_PARALLEL) != 0u;
    mis_arrive(state, select(flight.distance * flight.distance, 1.0, is_parallel), 1.0);
    if (HAS_PARALLEL) {
        (*state).flags &= ~PATH_PARALLEL;
    }
    (*state).tau += (*state).eta * flight.distance;
    (*state).position += flight.distance * (*state).direction;
    (*state).triangle = NONE;

    var v: PathVertex;
    v.position = (*state).position;
    v.tau = (*state).tau;
    v.throughput = (*state).throughput;
    v.material = flight.medium;
    v.d_vcm = (*state).d_vcm;
    v.geometric = -(*state).direction;
    v.d_vc = (*state).d_vc;
    v.to_previous = -(*state).direction;
    v.flags = VERTEX_IN_MEDIUM | (path_solid(*state) << VERTEX_SOLID_SHIFT);
    v.eta = (*state).eta;
    v.select_pdf = select(1.0, flight.distance, HAS_ELLIPSOIDS);
    if (HAS_DOPPLER) {
        v.select_pdf = (*state).select_pdf;
    }
    return v;
}

// Sends `state` on from v along a sampled direction. Returns false if the subpath ends here. `u` samples direction and lobe.
// `survival` is the uniform of Russian roulette; a negative value switches roulette off. The probability of survival is the
// throughput factor of this bounce and of the flight before it (`carried_before`), clamped to [0.05, 1]. With several responses,
// it is the square root of this factor, clamped likewise.
fn scatter(
    state: ptr<function, PathState>, v: PathVertex, carried_before: f32, is_sensor_subpath: bool, u: vec4<f32>, survival: f32,
) -> bool {
    let s = sample_vertex(v, is_sensor_subpath, u);
    if (!s.valid) {
        return false;
    }
    let carried = max_component(s.weight) * carried_before;
    // Late gates only see long subpaths, which are worth keeping although they carry little (docs/notebook/histograms.md).
    let wanted = select(carried, sqrt(carried), OBSERVE == OBSERVE_RESPONSES);
    let keep = select(clamp(wanted, 0.05, 1.0), 1.0, survival < 0.0);
    if (!(carried > 0.0) || survival >= keep) {
        return false;
    }
    (*state).throughput *= s.weight / keep;
    (*state).direction = s.direction;
    (*state).eta = eta_towards(v, s.direction);
    (*state).flags = with_solid((*state).flags, solid_towards(v, s.direction));
    (*state).shift = ray_offset(v, s.direction);
    if (HAS_DOPPLER) {
        (*state).select_pdf -= (*state).eta * dot(s.direction, vertex_velocity(v));
    }
    if (follows_connected(v)) {
        (*state).d_vcm = min((*state).d_vcm * mis(density_gain(v.material, v.to_previous, s.direction)), MAX_SUM);
    }
    mis_scatter(state, v, s, select(sample_count_ratio(v) * selection_pdf(v), 1.0, is_sensor_subpath));
    if (MERGES) {
        let forgotten = select(PATH_SMOOTH | PATH_ONLY_SMOOTH, 0u, s.delta);
        (*state).flags = ((*state).flags & ~forgotten) | select(0u, PATH_SMOOTH, s.delta);
    }
    if (is_in_medium(v)) {
        (*state).flags &= ~PATH_DETERMINISTIC;
        return true;
    }
    let m = load_material(v.material);
    // A vertex with several lobes, or with a normal map, chooses at random.
    let has_more_lobes = (HAS_CLEARCOAT && m.clearcoat > 0.0) || (HAS_RETROREFLECTORS && m.retroreflection > 0.0);
    let is_bumped = HAS_NORMAL_MAPS && (v.flags & VERTEX_BUMPED) != 0u;
    let is_mirror = metallic_and_alpha(m, v.point_words).x >= 1.0 && !has_more_lobes && !is_bumped;
    if (!(s.delta && is_mirror)) {
        (*state).flags &= ~PATH_DETERMINISTIC;
    }
    return true;
}
