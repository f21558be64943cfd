// Intersection of rays with the scene by ray queries of the device. Takes the place of `traverse.wgsl` in kernels with HARDWARE_RAYS.
//
// Triangles that stop every ray are opaque, so the device alone finds the nearest one. Triangles that may let rays pass are candidates,
// which the kernel tests itself, because a ray must meet them in the order of `LastHit`.
#import triangle

@group(0) @binding(18) var ray_structure: acceleration_structure;
// A word for each of the three groups of triangles: where its entries begin. Then the entries: indices into `triangles`, in the order of
// the group's primitives. Kernels read them only if some triangles may let rays pass; otherwise primitives are triangles.
@group(0) @binding(19) var<storage, read> ray_triangles: array<u32>;

// Bits in the masks of the groups of triangles. Group 0 is opaque. Null boundaries are a group of their own, so that a ray
// that looks for them alone meets nothing else.
const RAY_GROUP_OPAQUE: u32 = 1u;
const RAY_GROUP_PASSABLE: u32 = 2u;
const RAY_GROUP_BOUNDARY: u32 = 4u;

// Relative amount by which a query begins before the hit after which it continues: the device's distances are rounded otherwise than
// those of `intersect_triangle`. 16 x 2^-24.
const RAY_OVERLAP: f32 = 9.5e-7;

// Index into `triangles` of a primitive of a group.
fn triangle_of(group: u32, primitive: u32) -> u32 {
    if (HAS_ALPHA || HAS_NULL_BOUNDARIES || HAS_SHEETS) {
        return ray_triangles[ray_triangles[group] + primitive];
    }
    return primitive;
}

// As `traverse` of traverse.wgsl. An opaque triangle has the distance and the weights that the device computes.
//
// The device cannot leave out `origin_triangle`, and asking the kernel about each triangle would cost its speed. Rays start off the
// surface that they leave, so only rounding at a needle lets a ray hit its origin. Then a second query begins just behind this hit.
fn traverse(o: vec3<f32>, d: vec3<f32>, last_hit: LastHit, t_max: f32, any_hit: bool, origin_triangle: u32) -> Hit {
    var hit = Hit(t_max, 0.0, 0.0, NONE);
    let axes = ray_axes(d);
    var flags = select(RAY_FLAG_NONE, RAY_FLAG_TERMINATE_ON_FIRST_HIT, any_hit);
    var groups = RAY_GROUP_OPAQUE;
    if (HAS_ALPHA || HAS_NULL_BOUNDARIES || HAS_SHEETS) {
        groups |= RAY_GROUP_PASSABLE | RAY_GROUP_BOUNDARY;
    }
    if (HAS_NULL_BOUNDARIES) {
        groups = select(groups, RAY_GROUP_BOUNDARY, only_boundaries);
    }
    // Not in the loop: WGSL would clear it in each turn, and SPIR-V has no value for that.
    var query: ray_query;
    var t_min = last_hit.t * (1.0 - RAY_OVERLAP);
    for (var attempt = 0u; attempt < 2u; attempt++) {
        rayQueryInitialize(&query, ray_structure, RayDesc(flags, groups, t_min, t_max, o, d));
        while (rayQueryProceed(&query)) {
            if (HAS_ALPHA || HAS_NULL_BOUNDARIES || HAS_SHEETS) {
                let candidate = rayQueryGetCandidateIntersection(&query);
                let index = triangle_of(candidate.instance_custom_data, candidate.primitive_index);
                intersect_triangle(index, o, axes, last_hit, origin_triangle, &hit);
            }
        }
        let found = rayQueryGetCommittedIntersection(&query);
        // Of two surfaces at equal distance, the one that may let the ray pass comes first.
        if (found.kind == RAY_QUERY_INTERSECTION_NONE || found.t >= hit.t) {
            break;
        }
        let index = triangle_of(found.instance_custom_data, found.primitive_index);
        if (index != origin_triangle) {
            hit = Hit(found.t, found.barycentrics.x, found.barycentrics.y, index);
            break;
        }
        t_min = bitcast<f32>(bitcast<u32>(max(found.t, 1e-30)) + 1u);
    }
    return hit;
}
