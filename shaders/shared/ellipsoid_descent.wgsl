// Draws a point of the ellipsoid on the surfaces of the scene. A descent of the BVH chooses a child of each node by importance, until
// it arrives at a few triangles. So the time hardly grows with the number of triangles.
#import ellipsoid_search
#import query

// One of the two neighbours of an auxiliary vertex, which are the foci of the ellipsoid.
struct Focus {
    position: vec3<f32>,
    // Unit normal of a vertex that exchanges light with one side only; otherwise 0.
    normal: vec3<f32>,
}

// Minimum of the cosine factor of a focus, because the box of a node says little about the directions from the focus to its surfaces.
const MIN_FOCUS_COSINE: f32 = 0.1;
// Minimum of a positive cosine when a point is chosen by its estimated contribution. At grazing angles, glossy surfaces reflect more
// than this estimate, which assumes diffuse vertices. Without the minimum, such points would be rare and bright.
const MIN_POINT_COSINE: f32 = 0.05;
// Each child that the ellipsoid may meet also gets EVEN_SHARE / 8 of the sum of all importances. The importance is an estimate, and
// its errors multiply from level to level.
const EVEN_SHARE: f32 = 0.1;

fn focus_at(v: PathVertex) -> Focus {
    return Focus(v.position, select(vec3<f32>(0.0), v.geometric, is_one_sided(v)));
}

// Importance of four children of a node. It estimates the light that v sends to q over the surfaces in the box, with the travel time of
// the ellipsoid. 0 if the ellipsoid does not meet the box, or the box lies behind a focus. A plane lies at byte * `scale` + `origin`.
// `x.x`: bytes of the four lower planes; `x.y`: of the four upper ones. `y`, `z`: the same for the other axes.
fn ellipsoid_importance(
    x: vec2<u32>, y: vec2<u32>, z: vec2<u32>, origin: vec3<f32>, scale: vec3<f32>, s: EllipsoidSearch, v: Focus, q: Focus,
) -> vec4<f32> {
    let lo_x = bytes_to_floats(x.x) * scale.x + origin.x;
    let hi_x = bytes_to_floats(x.y) * scale.x + origin.x;
    let lo_y = bytes_to_floats(y.x) * scale.y + origin.y;
    let hi_y = bytes_to_floats(y.y) * scale.y + origin.y;
    let lo_z = bytes_to_floats(z.x) * scale.z + origin.z;
    let hi_z = bytes_to_floats(z.y) * scale.z + origin.z;
    let half_x = 0.5 * (hi_x - lo_x);
    let half_y = 0.5 * (hi_y - lo_y);
    let half_z = 0.5 * (hi_z - lo_z);
    let radius2 = half_x * half_x + half_y * half_y + half_z * half_z;
    var factor = half_x * half_y + half_y * half_z + half_z * half_x;
    var least = vec4<f32>(0.0);
    var most = vec4<f32>(0.0);
    var is_alive = vec4<bool>(true);
    for (var i = 0u; i < 2u; i++) {
        let focus = select(v.position, q.position, i == 1u);
        let n = select(v.normal, q.normal, i == 1u);
        let from_x = 0.5 * (hi_x + lo_x) - focus.x;
        let from_y = 0.5 * (hi_y + lo_y) - focus.y;
        let from_z = 0.5 * (hi_z + lo_z) - focus.z;
        // These distances use the planes of the box. Centre minus half extent would round: in a box of 1 km, it misses the plane by 60
        // micrometres.
        let near_x = max(max(lo_x - focus.x, focus.x - hi_x), vec4<f32>(0.0));
        let near_y = max(max(lo_y - focus.y, focus.y - hi_y), vec4<f32>(0.0));
        let near_z = max(max(lo_z - focus.z, focus.z - hi_z), vec4<f32>(0.0));
        least += sqrt(near_x * near_x + near_y * near_y + near_z * near_z);
        let far_x = abs(from_x) + half_x;
        let far_y = abs(from_y) + half_y;
        let far_z = abs(from_z) + half_z;
        most += sqrt(far_x * far_x + far_y * far_y + far_z * far_z);
        // Height of the highest corner above the surface of the focus.
        let height = n.x * from_x + n.y * from_y + n.z * from_z + abs(n.x) * half_x + abs(n.y) * half_y + abs(n.z) * half_z;
        let d2 = max(from_x * from_x + from_y * from_y + from_z * from_z, radius2);
        is_alive &= height >= -ELLIPSOID_SLACK * (far_x + far_y + far_z);
        factor *= max(height * inverseSqrt(d2), vec4<f32>(MIN_FOCUS_COSINE)) / d2;
    }
    is_alive &= (least <= vec4<f32>(s.hi)) & (most >= vec4<f32>(s.lo));
    // Path lengths over points of the box range from `least` to `most`. In a wide range, few paths have the wanted length.
    let importance = factor / max(most - least, vec4<f32>(ELLIPSOID_SLACK * s.hi));
    return select(vec4<f32>(0.0), max(importance, vec4<f32>(1e-36)), is_alive);
}

// Sums of the components before each component.
fn sums_before(x: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(0.0, x.x, x.x + x.y, x.x + x.y + x.z);
}

// The choice of one of eight children.
struct ChildChoice {
    // 0 to 7.
    slot: u32,
    // 0 if no child can be chosen.
    probability: f32,
}

// Chooses a child by the weights of children 0 to 3 and 4 to 7. `u`: uniform in [0, 1].
fn choose_child(first: vec4<f32>, second: vec4<f32>, u: f32) -> ChildChoice {
    let first_sum = dot(first, vec4<f32>(1.0));
    let all = first_sum + dot(second, vec4<f32>(1.0));
    let wanted = u * all;
    let is_second = wanted >= first_sum;
    let weights = select(first, second, is_second);
    let before = sums_before(weights) + select(0.0, first_sum, is_second);
    // The last child with a positive weight whose interval begins at `wanted` or before.
    let begun = (before <= vec4<f32>(wanted)) & (weights > vec4<f32>(0.0));
    var chosen = select(0u, 1u, begun.y);
    chosen = select(chosen, 2u, begun.z);
    chosen = select(chosen, 3u, begun.w);
    let weight = select(select(select(weights.x, weights.y, begun.y), weights.z, begun.z), weights.w, begun.w);
    return ChildChoice(chosen + select(0u, 4u, is_second), select(weight / all, 0.0, !(all > 0.0)));
}

// The weights with the even share added.
fn with_even_share(weights: vec4<f32>, share: f32) -> vec4<f32> {
    return select(vec4<f32>(0.0), weights + share, weights > vec4<f32>(0.0));
}

// Number of descents per pair of foci, and number of points per triangle. One of all these points is chosen.
const DESCENTS: u32 = 4u;
const POINT_DRAWS: u32 = 2u;

// Contribution of a connection of v and q over a point with this unit normal, up to a factor, as if all three were diffuse. It is per
// radian on the arcs and per unit of the length of the detour, hence the division by `inverse_stretch`. 0 if the point lies behind v or q.
fn contribution_estimate(position: vec3<f32>, normal: vec3<f32>, v: Focus, q: Focus) -> f32 {
    let from_v = position - v.position;
    let from_q = position - q.position;
    let r1 = length(from_v);
    let r2 = length(from_q);
    let w1 = -from_v / r1;
    let w2 = -from_q / r2;
    let cosines = focus_cosine(v, w1) * focus_cosine(q, w2) * abs(dot(normal, w1) * dot(normal, w2));
    return cosines / (square(r1 * r2) * inverse_stretch(normal, w1, r1, w2, r2));
}

// Cosine between the normal of a focus and its direction to the point. If positive, it is at least MIN_POINT_COSINE; otherwise 0. It is
// 1 for a focus without normal. `w`: unit direction from the point to the focus.
fn focus_cosine(f: Focus, w: vec3<f32>) -> f32 {
    let cosine = -dot(f.normal, w);
    return select(select(0.0, max(cosine, MIN_POINT_COSINE), cosine > 0.0), 1.0, all(f.normal == vec3<f32>(0.0)));
}

// A few triangles, chosen by a descent.
struct TriangleGroup {
    first: u32,
    count: u32,
    // 0 if no triangle was found.
    probability: f32,
}

// Chooses triangles that the ellipsoid of `s` may meet, with a descent of the BVH.
fn descend_bvh(s: EllipsoidSearch, v: Focus, q: Focus, rng: ptr<function, u32>) -> TriangleGroup {
    var index = 0u;
    var is_inner = true;
    var group = TriangleGroup(0u, 0u, 1.0);
    // Unless EXIT_AT_TOP is set, the loop exits at its end: with a condition at the top, masked SIMD would run the body once more.
    loop {
        if (EXIT_AT_TOP && (!is_inner || !(group.probability > 0.0))) {
            break;
        }
        let node = unpack_bvh_node(index);
        let meta4 = node.children.zw;
        // The meta byte of an empty child is 0.
        let first = select(vec4<f32>(0.0), ellipsoid_importance(node.x.xz, node.y.xz, node.z.xz, node.origin, node.scale, s, v, q),
            bytes_to_floats(meta4.x) > vec4<f32>(0.0));
        let second = select(vec4<f32>(0.0), ellipsoid_importance(node.x.yw, node.y.yw, node.z.yw, node.origin, node.scale, s, v, q),
            bytes_to_floats(meta4.y) > vec4<f32>(0.0));
        let share = EVEN_SHARE / 8.0 * (dot(first, vec4<f32>(1.0)) + dot(second, vec4<f32>(1.0)));
        let choice = choose_child(with_even_share(first, share), with_even_share(second, share), next_fine_uniform(rng));
        let child_meta = extract_byte(select(meta4.x, meta4.y, choice.slot >= 4u), choice.slot & 3u);
        is_inner = ((node.inner >> choice.slot) & 1u) != 0u;
        group.probability *= choice.probability;
        index = node.children.x + countOneBits(node.inner & ~(0xffffffffu << choice.slot));
        group.first = node.children.y + (child_meta & 0x1fu);
        group.count = countOneBits(child_meta >> 5u);
        continuing {
            break if !EXIT_AT_TOP & (!is_inner || !(group.probability > 0.0));
        }
    }
    return group;
}

// Draws a point of the ellipsoid of `s` with the foci v and q. If none is found, `triangle` is NONE and `inverse_density` is undefined.
fn draw_on_ellipsoid(s: EllipsoidSearch, v: Focus, q: Focus, rng: ptr<function, u32>) -> EllipsoidPoint {
    var point = EllipsoidPoint(NONE, vec2<f32>(0.0), 0.0);
    // Chooses one of several points by an estimate of their contribution.
    var chosen_estimate = 0.0;
    var sum = 0.0;
    for (var j = 0u; j < DESCENTS; j++) {
        let group = descend_bvh(s, v, q, rng);
        let count = select(0u, group.count, group.probability > 0.0);
        for (var i = 0u; i < count; i++) {
            if (may_meet(s, group.first + i)) {
                let t = load_triangle(group.first + i);
                let arcs = arcs_in_triangle(s.ellipsoid, t.v0, t.v1, t.v2);
                let normal = normalize(scaled_normal(t));
                let jitter = next_uniform(rng);
                for (var k = 0u; k < POINT_DRAWS && arcs.length > 0.0; k++) {
                    let weights = point_on_arcs(arcs, (f32(k) + jitter) * (1.0 / f32(POINT_DRAWS)));
                    let position = t.v0 + weights.x * (t.v1 - t.v0) + weights.y * (t.v2 - t.v0);
                    let estimate = contribution_estimate(position, normal, v, q);
                    let weight = estimate * arcs.length / group.probability;
                    sum += weight;
                    if (next_uniform(rng) * sum < weight) {
                        point.triangle = group.first + i;
                        point.weights = weights;
                        chosen_estimate = estimate;
                    }
                }
            }
        }
    }
    point.inverse_density = sum / (chosen_estimate * f32(POINT_DRAWS * DESCENTS));
    return point;
}
