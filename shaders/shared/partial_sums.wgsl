// The partial MIS sums that a subpath carries from vertex to vertex (Georgiev, "Implementing Vertex Connection and Merging",
// 2012), with every term squared for the power heuristic. `weights.wgsl` starts the sums and turns them into weights.
#import auxiliary

// Upper limit of the partial sums, which keeps them finite. The weight of a strategy with so large a sum is 0 in practice.
const MAX_SUM: f32 = 1e30;

// Whether v is the first event of a light subpath after a deterministic vertex. Sensor subpaths form the same event: they draw its
// position in the gate, and connect it to the deterministic vertex. So the event can be formed from both ends of a path. With
// DRAWS_ON_BEAMS, also whether v is the first event after a point on a beam (beam_events.wgsl). The sums of such a v are 0, so its
// connections do not depend on this.
fn follows_connected(v: PathVertex) -> bool {
    return DRAWS_IN_GATE && (v.flags & VERTEX_FOLLOWS_CONNECTED) != 0u;
}

// Estimate of a ratio of two densities per length, both of the same event. The first one: a sensor subpath draws the event in the gate.
// The second one: a flight from the deterministic vertex ends there. The index of refraction is ignored. Only here do MIS weights
// contain a coefficient of the medium; elsewhere it cancels (`flight_density`). `medium`: medium of the event. `back`: unit direction
// from the event to the deterministic vertex. `onwards`: to the other neighbour. Let the event move by dl along the sensor's segment,
// away from the sensor. Then the path becomes (1 + cos(back, onwards)) dl longer. So the density in the gate is 1 + cos(back, onwards)
// over the width of the gate. The result is at least 1, because a wide gate does not limit the flight.
fn density_gain(medium: u32, back: vec3<f32>, onwards: vec3<f32>) -> f32 {
    return max((1.0 + dot(back, onwards)) / ((frame.gate_hi - frame.gate_lo) * mean_extinction(medium)), 1.0);
}

// n(r + 1) / n(r) of `weights.wgsl` for a light subpath that continues from v and has r random vertices up to v.
fn sample_count_ratio(v: PathVertex) -> f32 {
    return select(1.0, frame.query_sample_count, random_vertices(v) < 2u);
}

// Factor of a segment in the densities of the MIS weights: its transmittance, averaged over the channels. `scattering`: optical depth.
// The coefficient at an event cancels, because every strategy contains it. Null boundaries on a segment are known only after its ray
// was traced, so scenes with null boundaries have MIS weights without transmittance.
fn flight_density(scattering: vec3<f32>) -> f32 {
    if (!HAS_MEDIA || HAS_NULL_BOUNDARIES) {
        return 1.0;
    }
    return max(dot(exp(-scattering), vec3<f32>(1.0 / 3.0)), 1e-12);
}

// Updates the partial sums when a subpath continues from the vertex v (Georgiev 2012, Eqs. 35 and 36). Distance and cosine at the next
// vertex are not known yet. `sample_count` is 1 for sensor subpaths. For light subpaths, it is the number of samples that the
// connection strategy takes at the next vertex, relative to v, times `selection_pdf(v)`.
fn mis_scatter(state: ptr<function, PathState>, v: PathVertex, s: Scatter, sample_count: f32) {
    if (s.delta) {
        (*state).d_vcm = 0.0;
        (*state).d_vc = (*state).d_vc * mis(s.cosine / sample_count);
        return;
    }
    let density = s.pdf * sample_count;
    var shorter = (*state).d_vcm;
    if (HAS_ELLIPSOIDS) {
        shorter += auxiliary_sum(v);
    }
    (*state).d_vc = min(mis(s.cosine / density) * (shorter + (*state).d_vc * mis(s.pdf_reverse)), MAX_SUM);
    (*state).d_vcm = min(mis(1.0 / density), MAX_SUM);
}

// Updates the partial sums at the next vertex: densities per solid angle become densities per area. `distance2`: squared length of the
// segment, 1 for parallel rays. `cosine`: at the next vertex, 1 in a medium.
fn mis_arrive(state: ptr<function, PathState>, distance2: f32, cosine: f32) {
    let c = mis(max(cosine, 1e-12));
    (*state).d_vcm = min((*state).d_vcm * mis(distance2) / c, MAX_SUM);
    (*state).d_vc = min((*state).d_vc / c, MAX_SUM);
}
