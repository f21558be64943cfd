// The auxiliary vertex of an ellipsoidal connection (Pediredla et al. 2019) is a surface point x between a light vertex v and a shade
// point q. The path through x has the travel time that was drawn. This module computes the density of x for the MIS weights.
//
// The density per area of x is that of `ellipsoid.wgsl`, but with MEAN_ARC in place of arc / P(triangle). The arc and P depend on
// all triangles that the ellipsoid meets, so the other strategies of a path could not compute them. The weights still sum to 1,
// because all strategies use the same estimate.
#import vertex
#import ellipsoid

// Mean of arc / P(triangle) over the connections of simple rooms, in radians (docs/notebook/ellipsoids.md).
const MEAN_ARC: f32 = 25.0;

// Squared density per area of the auxiliary vertex x; 0 if the detour over x is too short. w1, r1: unit direction and distance from x
// to one neighbour. w2, r2: to the other. `n`: unit normal at x.
fn auxiliary_density2(n: vec3<f32>, w1: vec3<f32>, r1: f32, w2: vec3<f32>, r2: f32) -> f32 {
    let along = 1.0 + dot(w1, w2);
    let direct = sqrt(max(square(r1 + r2) - 2.0 * r1 * r2 * along, 0.0));
    let detour = 2.0 * r1 * r2 * along / (r1 + r2 + direct);
    let density = frame.auxiliary_density * inverse_stretch(n, w1, r1, w2, r2);
    return select(0.0, mis(density), detour >= frame.min_detour);
}

// MIS sum of the ellipsoidal connections with x as the auxiliary vertex. Here x is a vertex of a subpath, and the next vertex is
// at the distance `r` in the unit direction `w`. Like `d_vcm`, the sum is divided by the squared density of the strategy that traces
// x. It is 0 if no ellipsoidal connection forms this path: both neighbours of x must be on the side of `to_previous`, outside of
// solids, and connectible.
fn sum_over_auxiliary(x: PathVertex, w: vec3<f32>, r: f32) -> f32 {
    let is_reached = has_normal(x) && (x.flags & VERTEX_EMITTER) == 0u && dot(x.geometric, w) > 0.0
        && x.eta == SURROUNDING_GROUP_INDEX && !is_in_solid(x, x.to_previous);
    if (!is_reached) {
        return 0.0;
    }
    return auxiliary_density2(x.geometric, x.to_previous, previous_distance(x), w, r) * x.d_vcm;
}
