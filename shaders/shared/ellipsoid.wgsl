// The ellipsoid of all points x with |x - v| + |x - q| = length, and its curves in the planes of triangles.
//
// An affine map takes the ellipsoid to the unit sphere, and each of these curves to a circle. The edges of the triangle cut the circle
// into arcs. Draw `length` uniformly from a range of width W, and the angle uniformly on the arcs in the triangle, whose total length is
// `arc`. By the coarea formula, the density per area of the resulting point is
//     sqrt(length^2 - |P(q - v)|^2) / (W arc |x - v| |x - q|),
// where P projects onto the plane of the triangle.
#import math

struct Ellipsoid {
    centre: vec3<f32>,
    // Half of the long axis.
    long: f32,
    // Unit vector from the focus v to the focus q.
    axis: vec3<f32>,
    // Half of the two equal short axes.
    short: f32,
}

// The ellipsoid with the foci v and q. `length` must exceed their distance.
fn make_ellipsoid(v: vec3<f32>, q: vec3<f32>, length: f32) -> Ellipsoid {
    let offset = q - v;
    let d = sqrt(dot(offset, offset));
    let axis = select(vec3<f32>(0.0, 0.0, 1.0), offset / d, d > 0.0);
    return Ellipsoid(v + 0.5 * offset, 0.5 * length, axis, 0.5 * sqrt(max((length - d) * (length + d), 0.0)));
}

// The point p in coordinates in which the ellipsoid is the unit sphere.
fn to_sphere(e: Ellipsoid, p: vec3<f32>) -> vec3<f32> {
    let offset = p - e.centre;
    let along = dot(offset, e.axis) * e.axis;
    return along / e.long + (offset - along) / e.short;
}

// Transforms the normal n of a plane to the coordinates of `to_sphere`. Neither n nor the result needs unit length.
fn normal_to_sphere(e: Ellipsoid, n: vec3<f32>) -> vec3<f32> {
    let along = dot(n, e.axis) * e.axis;
    return e.long * along + e.short * (n - along);
}

// sqrt(length^2 - |P(q - v)|^2) / (|x - v| |x - q|) for the point x with unit normal n: see above. w1, r1: unit direction and distance to
// v; w2, r2: to q. The code adds two terms that are not negative, because the difference under the root would lose digits.
fn inverse_stretch(n: vec3<f32>, w1: vec3<f32>, r1: f32, w2: vec3<f32>, r2: f32) -> f32 {
    let c1 = dot(n, w1);
    let c2 = dot(n, w2);
    return sqrt(max(2.0 * (1.0 + dot(w1, w2)) / (r1 * r2) + square(c2 / r1 - c1 / r2), 0.0));
}

// Corners of the triangle in its plane: coordinates relative to the centre of the circle, in units of its radius.
struct PlaneTriangle {
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// The unit vector with an angle in [-pi, pi].
fn at_angle(angle: f32) -> vec2<f32> {
    let turn = cosine_and_sine(abs(angle));
    return vec2<f32>(turn.x, select(turn.y, -turn.y, angle < 0.0));
}

// The arc of the unit circle in the half plane on the left of a line: the whole circle, a part of it, or nothing.
struct HalfPlaneArc {
    // The angles in [-pi, pi] at which the circle crosses the line, in ascending order; both are -pi without a crossing.
    ends: vec2<f32>,
    // Whether the arc is between the two ends. If not, it is the rest of the circle.
    is_between: bool,
}

// The arc of the unit circle on the left of the line from a to b.
fn arc_in_half_plane(a: vec2<f32>, b: vec2<f32>) -> HalfPlaneArc {
    let along = b - a;
    let length2 = dot(along, along);
    // Distance of the line from the centre, times |b - a|; positive if the centre is on the left.
    let offset = cross2(a, b);
    let reach2 = length2 - offset * offset;
    if (!(reach2 > 0.0)) {
        return HalfPlaneArc(vec2<f32>(-PI), offset <= 0.0);
    }
    let foot = vec2<f32>(along.y, -along.x) * offset;
    let half = along * sqrt(reach2);
    let first = angle_of(foot - half);
    let second = angle_of(foot + half);
    // The part on the left runs counterclockwise from `second` to `first`.
    return HalfPlaneArc(in_order(vec2<f32>(first, second)), second < first);
}

// Whether the point of the circle at this angle is on the arc.
fn is_on_arc(arc: HalfPlaneArc, angle: f32) -> bool {
    return (angle > arc.ends.x && angle < arc.ends.y) == arc.is_between;
}

// Barycentric weights of b and c at the point p of the plane.
fn plane_weights(t: PlaneTriangle, p: vec2<f32>) -> vec2<f32> {
    let area = cross2(t.b - t.a, t.c - t.a);
    return vec2<f32>(cross2(p - t.a, t.c - t.a), cross2(t.b - t.a, p - t.a)) / area;
}

fn in_order(x: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(min(x.x, x.y), max(x.x, x.y));
}

// The ends of the arcs in ascending order: -pi, the six crossings of the edges, and pi. Arc i runs from end i to end i + 1.
fn arc_ends(ab: vec2<f32>, bc: vec2<f32>, ca: vec2<f32>) -> array<f32, 8> {
    // Merges ab and bc, then inserts both ends of ca.
    let low = in_order(vec2<f32>(ab.x, bc.x));
    let high = in_order(vec2<f32>(ab.y, bc.y));
    let mid = in_order(vec2<f32>(low.y, high.x));
    let four = vec4<f32>(low.x, mid.x, mid.y, high.y);
    let p = four_and(four, ca.x);
    let p4 = max(four.w, ca.x);
    // Inserts ca.y into the five values p.x, p.y, p.z, p.w and p4.
    let q0 = min(p.x, ca.y);
    let r0 = max(p.x, ca.y);
    let q1 = min(p.y, r0);
    let r1 = max(p.y, r0);
    let q2 = min(p.z, r1);
    let r2 = max(p.z, r1);
    let q3 = min(p.w, r2);
    let r3 = max(p.w, r2);
    return array<f32, 8>(-PI, q0, q1, q2, q3, min(p4, r3), max(p4, r3), PI);
}

// The four smallest values, in ascending order, of y and the components of x. The components of x must be in ascending order.
fn four_and(x: vec4<f32>, y: f32) -> vec4<f32> {
    let r0 = max(x.x, y);
    let r1 = max(x.y, r0);
    let r2 = max(x.z, r1);
    return vec4<f32>(min(x.x, y), min(x.y, r0), min(x.z, r1), min(x.w, r2));
}

// The arcs of the unit circle in a triangle: the part of an ellipsoid in the triangle.
struct Arcs {
    triangle: PlaneTriangle,
    // Angles in ascending order: see `arc_ends`.
    ends: array<f32, 8>,
    // Bit i: the arc from end i to end i + 1 lies in the triangle.
    inside: u32,
    // Total length in radians; 0 if the ellipsoid misses the triangle.
    length: f32,
}

// The part of the ellipsoid in the triangle with these corners.
fn arcs_in_triangle(e: Ellipsoid, v0: vec3<f32>, v1: vec3<f32>, v2: vec3<f32>) -> Arcs {
    var arcs: Arcs;
    let a = to_sphere(e, v0);
    let b = to_sphere(e, v1);
    let c = to_sphere(e, v2);
    let across = cross(b - a, c - a);
    let length2 = dot(across, across);
    if (!(length2 > 0.0)) {
        return arcs;
    }
    let normal = across * inverseSqrt(length2);
    let height = dot(normal, a);
    let radius2 = 1.0 - height * height;
    if (!(radius2 > 0.0)) {
        return arcs;
    }
    // The first axis points to the middle of the triangle, so that the angles of a small triangle are small and precise.
    let centre = height * normal;
    let middle = (a + b + c) / 3.0 - centre;
    let middle2 = dot(middle, middle);
    let other = frame_around(normal)[0];
    let x_axis = select(other, middle * inverseSqrt(max(middle2, 1e-30)), middle2 > 1e-12);
    let y_axis = cross(normal, x_axis);
    let scale = inverseSqrt(radius2);
    arcs.triangle = PlaneTriangle(
        scale * vec2<f32>(dot(a - centre, x_axis), dot(a - centre, y_axis)),
        scale * vec2<f32>(dot(b - centre, x_axis), dot(b - centre, y_axis)),
        scale * vec2<f32>(dot(c - centre, x_axis), dot(c - centre, y_axis)),
    );
    let ab = arc_in_half_plane(arcs.triangle.a, arcs.triangle.b);
    let bc = arc_in_half_plane(arcs.triangle.b, arcs.triangle.c);
    let ca = arc_in_half_plane(arcs.triangle.c, arcs.triangle.a);
    arcs.ends = arc_ends(ab.ends, bc.ends, ca.ends);
    for (var i = 0u; i < 7u; i++) {
        let middle = 0.5 * (arcs.ends[i] + arcs.ends[i + 1u]);
        let is_inside = arcs.ends[i + 1u] > arcs.ends[i] && is_on_arc(ab, middle) && is_on_arc(bc, middle) && is_on_arc(ca, middle);
        arcs.length += select(0.0, arcs.ends[i + 1u] - arcs.ends[i], is_inside);
        arcs.inside |= select(0u, 1u << i, is_inside);
    }
    return arcs;
}

// Barycentric weights of corners 1 and 2 at a point of the arcs: the point after the fraction `u` of their total length.
fn point_on_arcs(arcs: Arcs, u: f32) -> vec2<f32> {
    var left = u * arcs.length;
    var angle = 0.0;
    var found = false;
    for (var i = 0u; i < 7u; i++) {
        if ((arcs.inside & (1u << i)) != 0u) {
            let part = arcs.ends[i + 1u] - arcs.ends[i];
            // If rounding leaves a rest after all arcs, the point is the end of the last arc.
            angle = select(arcs.ends[i] + min(left, part), angle, found);
            found |= left < part;
            left -= part;
        }
    }
    let w = clamp(plane_weights(arcs.triangle, at_angle(angle)), vec2<f32>(0.0), vec2<f32>(1.0));
    return w / max(w.x + w.y, 1.0);
}
