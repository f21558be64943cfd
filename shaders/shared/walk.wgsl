// The two halves of a random walk's step, the same for light and sensor subpaths: arriving at a surface and leaving it.
#import scatter

// Moves `state` to the hit: travel time, partial MIS sums, and the vertex that stands there.
fn arrive(state: ptr<function, PathState>, surface: Surface) -> PathVertex {
    let segment = surface.position - (*state).position;
    let distance2 = dot(segment, segment);
    let towards = -(*state).direction;
    let side = dot(surface.geometric, towards);
    let flip = select(1.0, -1.0, side < 0.0);
    let passes = HAS_TRANSMISSION && load_material(surface.material).transmission > 0.0;
    mis_arrive(state, distance2, abs(side));
    if (passes) {
        // The side that was hit says what the segment ran through, the same for subpaths from either end.
        (*state).eta = select(load_material(surface.material).ior, 1.0, side >= 0.0);
    }
    (*state).tau += (*state).eta * sqrt(distance2);
    (*state).position = surface.position;
    (*state).triangle = surface.triangle;

    var v: PathVertex;
    v.position = surface.position;
    v.tau = (*state).tau;
    v.throughput = (*state).throughput;
    v.material = surface.material;
    v.normal = surface.normal * flip;
    v.d_vcm = (*state).d_vcm;
    v.geometric = surface.geometric * flip;
    v.d_vc = (*state).d_vc;
    v.to_previous = towards;
    v.flags = select(0u, VERTEX_FRONT, side >= 0.0) | select(0u, VERTEX_TRANSMITS, passes);
    v.base_color = base_color(surface).xyz;
    v.eta = (*state).eta;
    v.offset = surface.offset;
    v.select_pdf = 1.0;
    return v;
}

// Sends `state` on from `v`; false if the subpath ends here. `u`: direction and lobe, `survival`: Russian roulette on the
// throughput this bounce takes away, off for `survival` < 0.
fn depart(state: ptr<function, PathState>, v: PathVertex, to_light: bool, u: vec4<f32>, survival: f32) -> bool {
    let s = scatter(v, to_light, u);
    if (!s.valid) {
        return false;
    }
    let carried = max_component(s.weight);
    let keep = select(clamp(carried, 0.05, 1.0), 1.0, survival < 0.0);
    if (!(carried > 0.0) || survival >= keep) {
        return false;
    }
    (*state).throughput *= s.weight / keep;
    (*state).direction = s.direction;
    (*state).eta = medium_towards(v, s.direction);
    (*state).shift = leave(vec3<f32>(0.0), v.geometric, v.offset, s.direction);
    mis_scatter(state, s, select(gain_after(v) * v.select_pdf, 1.0, to_light));
    if (!(s.delta && load_material(v.material).metallic >= 1.0)) {
        (*state).flags &= ~PATH_DETERMINISTIC;
    }
    return true;
}

// Can the vertex be connected: has its side of the material a lobe that is not a delta?
fn is_connectible(v: PathVertex) -> bool {
    let m = load_material(v.material);
    let black = (v.flags & VERTEX_FRONT) == 0u && (m.flags & MATERIAL_DOUBLE_SIDED) == 0u && m.transmission <= 0.0;
    return !black && (m.alpha >= DELTA_ALPHA || (m.metallic < 1.0 && m.transmission < 1.0));
}
