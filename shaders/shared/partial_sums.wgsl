// The partial MIS sums that a subpath carries from vertex to vertex (Georgiev, "Implementing Vertex Connection and Merging",
// 2012), with every term squared for the power heuristic. `weights.wgsl` starts the sums and turns them into weights.
#import vertex

// Upper limit of the partial sums, which keeps them finite. The weight of a strategy with so large a sum is 0 in practice.
const MAX_SUM: f32 = 1e30;

// n(r + 1) / n(r) of `weights.wgsl` for a light subpath that continues from v and has r random vertices up to v.
fn sample_count_ratio(v: PathVertex) -> f32 {
    return select(1.0, frame.query_sample_count, random_vertices(v) < 2u);
}

// Updates the partial sums when a subpath continues from a vertex (Georgiev 2012, Eqs. 35 and 36). Distance and cosine at the next
// vertex are not known yet. `sample_count`: number of samples that the connection strategy takes at the next vertex of a light
// subpath, relative to this vertex, times the probability of the emitter after deterministic vertices; 1 for sensor subpaths.
fn mis_scatter(state: ptr<function, PathState>, s: Scatter, sample_count: f32) {
    if (s.delta) {
        (*state).d_vcm = 0.0;
        (*state).d_vc = (*state).d_vc * mis(s.cosine / sample_count);
        return;
    }
    let density = s.pdf * sample_count;
    (*state).d_vc = min(mis(s.cosine / density) * ((*state).d_vcm + (*state).d_vc * mis(s.pdf_reverse)), MAX_SUM);
    (*state).d_vcm = min(mis(1.0 / density), MAX_SUM);
}

// Updates the partial sums at the next vertex: densities per solid angle become densities per area.
fn mis_arrive(state: ptr<function, PathState>, distance2: f32, cosine: f32) {
    let c = mis(max(cosine, 1e-12));
    (*state).d_vcm = min((*state).d_vcm * mis(distance2) / c, MAX_SUM);
    (*state).d_vc = min((*state).d_vc / c, MAX_SUM);
}
