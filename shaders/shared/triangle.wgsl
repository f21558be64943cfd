// Intersection of a ray with a triangle, watertight. What a ray hits.
#import boundary
#import scene

struct Hit {
    // Ray parameter: distance over the length of the direction; `t_max` for a miss.
    t: f32,
    // Barycentric weights of corners 1 and 2.
    u: f32,
    v: f32,
    // Index into `triangles`; NONE for a miss.
    triangle: u32,
}

// A position in the order in which a ray meets triangles: by distance, and at equal distance by index. A ray continues
// strictly after this position, so that it also meets a second surface in the plane of a surface that it has passed.
struct LastHit {
    t: f32,
    // Index of the triangle; NONE: continue only at larger distances.
    triangle: u32,
}

// Coordinate axes of a ray. The axis of the largest direction component comes last; the other two are sheared so that the ray
// runs along the last axis.
struct RayAxes {
    // Index of the largest direction component.
    last: u32,
    // The other two components, divided by the largest component.
    shear: vec2<f32>,
    // 1 / largest component: along the scaled last axis the ray advances by 1 per unit of its parameter t.
    scale: f32,
}

fn ray_axes(d: vec3<f32>) -> RayAxes {
    let size = abs(d);
    var last = select(1u, 0u, size.x > size.y);
    last = select(last, 2u, size.z >= max(size.x, size.y));
    let turned = turn_to_last(d, last);
    return RayAxes(last, turned.xy / turned.z, 1.0 / turned.z);
}

// The components of p in cyclic order, so that component `last` comes last.
fn turn_to_last(p: vec3<f32>, last: u32) -> vec3<f32> {
    return select(select(p, p.zxy, last == 1u), p.yzx, last == 0u);
}

// The point p, relative to the ray's origin, in the axes of the ray. z is the ray parameter at which the ray passes p.
fn to_ray(p: vec3<f32>, axes: RayAxes) -> vec3<f32> {
    let turned = turn_to_last(p, axes.last);
    return vec3<f32>(turned.xy - axes.shear * turned.z, axes.scale * turned.z);
}

// Twice the signed area of the triangle that the corners a and b span with the ray, seen along the ray. Products round
// monotonically (the code is built without contraction), so the result has the sign of the exact number, or is 0.
fn edge_area(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Replaces `hit` by triangle `index` if the ray hits it nearer, but after `last_hit`. Watertight (after Woop et al. 2013): a
// corner has the same position across the ray in all triangles that share it, and a ray through an edge (area 0) hits both
// triangles of that edge. So no ray passes between triangles, not even at a corner. The distance is a weighted mean of the
// distances of the corners, with weights >= 0. So it is accurate for slivers too, whose plane is lost in rounding.
fn intersect_triangle(index: u32, o: vec3<f32>, axes: RayAxes, last_hit: LastHit, origin_triangle: u32, hit: ptr<function, Hit>) {
    let triangle = load_triangle(index);
    let a = to_ray(triangle.v0 - o, axes);
    let b = to_ray(triangle.v1 - o, axes);
    let c = to_ray(triangle.v2 - o, axes);
    let u = edge_area(b, c);
    let v = edge_area(c, a);
    let w = edge_area(a, b);
    let sum = u + v + w;
    let inside = (min(u, min(v, w)) >= 0.0 || max(u, max(v, w)) <= 0.0) && sum != 0.0;
    let scale = 1.0 / sum;
    let t = (u * a.z + v * b.z + w * c.z) * scale;
    var beyond = t > last_hit.t;
    var nearer = t < (*hit).t;
    if (HAS_ALPHA || HAS_NULL_BOUNDARIES || HAS_SHEETS) {
        // Only a ray that may pass surfaces needs an order between triangles at equal distance.
        beyond |= (t == last_hit.t) & (index > last_hit.triangle);
        nearer |= (t == (*hit).t) & ((*hit).triangle != NONE) & (index < (*hit).triangle);
    }
    let is_sought = !HAS_NULL_BOUNDARIES || !only_boundaries || (triangle.material & TRIANGLE_NULL) != 0u;
    if (inside && beyond && nearer && is_sought && index != origin_triangle) {
        (*hit).t = t;
        (*hit).u = v * scale;
        (*hit).v = w * scale;
        (*hit).triangle = index;
    }
}

// Recomputes a hit for the ray from `p` itself. The traced ray started beside `p`, off the surface, but directions are
// sampled at `p`. Offsetting the origin changes the density of the hit point by a relative error of about offset / distance.
// The offset grows with the coordinates, so this error matters far from the origin of render space. If the ray from `p` misses
// the triangle, by less than the offset, the hit is unchanged.
fn reintersect(hit: Hit, p: vec3<f32>, d: vec3<f32>) -> Hit {
    var again = hit;
    again.t = 3e38;
    intersect_triangle(hit.triangle, p, ray_axes(d), LastHit(0.0, NONE), NONE, &again);
    again.t = select(hit.t, again.t, again.t < 3e38);
    return again;
}
