// Queries of a light tree by importance (lcs): from a subtree to a leaf, from the leaf to one of its vertices, and from K
// such vertices to the one that gets a shadow ray.
#import frontier
#import leaf
#import slots
#import connection

// Follows a traversal from its start to a leaf. Returns the leaf and 1 / P(leaf | q), or NONE at a dead node, whose children both
// have importance 0. P contains both kinds of choices, by power and by importance.
fn descend_by_importance(start: Traversal, receiver: Receiver, rng: ptr<function, u32>) -> Candidate {
    var current = start.node;
    var u = start.u;
    var p = start.p;
    if ((current & LEAF_BIT) == 0u) {
        // The loop exits at its end, as in `descend`.
        loop {
            if (EXIT_AT_TOP && (current & LEAF_BIT) != 0u) {
                break;
            }
            let node = load_tree_node(current);
            let importance = vec2<f32>(node_importance(node.left, receiver), node_importance(node.right, receiver));
            let power = select(vec2<f32>(0.0), vec2<f32>(total_power(node.left), total_power(node.right)), importance > vec2<f32>(0.0));
            let weights = select(importance, power, start.by_power);
            // The less likely child takes the low end of the uniform, where floats are finest. So rare children are drawn
            // with exactly the probability that P contains.
            let lesser = min(weights.x, weights.y) / (weights.x + weights.y);
            let take_lesser = u < lesser;
            let take_left = take_lesser == (weights.x < weights.y);
            u = remap_uniform(u, select(lesser, 0.0, take_lesser), select(1.0 - lesser, lesser, take_lesser), rng);
            p *= select(vec2<f32>(power.y, importance.y), vec2<f32>(power.x, importance.x), take_left)
                / vec2<f32>(power.x + power.y, importance.x + importance.y);
            current = select(node.right.child, node.left.child, take_left);
            current = select(NONE, current, importance.x + importance.y > 0.0);
            continuing {
                break if !EXIT_AT_TOP & ((current & LEAF_BIT) != 0u);
            }
        }
    }
    return Candidate(current, 1.0 / (POWER_PROBABILITY * p.x + (1.0 - POWER_PROBABILITY) * p.y));
}

// Share of the light from the direction `w` that q scatters to the sensor, approximated as in `outgoing_light`. Tables need no lower
// limit, because directions at q are not rounded. `medium`: the medium of q, if q is an event.
fn scattered_share(q: PathVertex, medium: Medium, w: vec3<f32>, min_cosine: f32) -> f32 {
    if (is_in_medium(q)) {
        return 4.0 * PI * phase_value(medium, -dot(q.to_previous, w));
    }
    return max(vertex_cosine(q, w), min_cosine);
}

// Contribution of v to q if surfaces were diffuse and nothing lay between v and q; 0 if v cannot contribute. v comes from its
// leaf record, whose normal is rounded. So the test whether v faces q allows an error of DIRECTION_ERROR.
fn vertex_importance(q: PathVertex, medium: Medium, v: PathVertex) -> f32 {
    let offset = v.position - q.position;
    let d2 = dot(offset, offset);
    let d = sqrt(d2);
    let w = offset * (1.0 / d);
    // At grazing angles, glossy and transmitting surfaces return more light than the cosine says.
    let min_cosine = select(1e-4, 0.05, HAS_GLOSSY || HAS_TRANSMISSION);
    let cosines = scattered_share(q, medium, w, min_cosine) * outgoing_light(v, -w, min_cosine);
    let sent = max(max_component(v.throughput) * cosines / d2, MIN_IMPORTANCE);
    let is_facing = !is_one_sided(v) | (dot(v.geometric, w) < DIRECTION_ERROR);
    return select(0.0, sent, is_in_reach(q, v, w, d) & faces(q, w) & is_facing & (cosines > 0.0));
}

// Chooses a vertex of a leaf by `vertex_importance`; NONE if none can contribute. The weight of `leaf` is 1 / P(leaf | q),
// the weight of the result is 1 / P(j | q).
fn choose_in_leaf(q: PathVertex, leaf: Candidate, rng: ptr<function, u32>) -> Candidate {
    let count = ((leaf.vertex >> 27u) & 15u) + 1u;
    let first = leaf.vertex & LEAF_FIRST;
    var chosen = Candidate(NONE, 0.0);
    var chosen_importance = 0.0;
    var sum = 0.0;
    // Loaded once for all vertices.
    var medium: Medium;
    if (HAS_MEDIA) {
        medium = load_medium(select(0u, q.material, is_in_medium(q)));
    }
    for (var i = 0u; i < count; i++) {
        let importance = vertex_importance(q, medium, load_leaf_vertex(first + i));
        sum += importance;
        // The uniform is below 1, so that the first vertex that can contribute is taken. The uniform has steps of 2^-32,
        // so that a rare vertex is taken with exactly the probability that its weight contains.
        if (min(next_fine_uniform(rng), 1.0 - UNIFORM_STEP) * sum < importance) {
            chosen.vertex = first + i;
            chosen_importance = importance;
        }
    }
    if (chosen.vertex != NONE) {
        chosen.weight = leaf.weight * (sum / chosen_importance);
    }
    return chosen;
}

// Target function of the resampling: the contribution of the connection of q and v as `connect` computes it. It leaves out
// visibility, and takes the mean densities of grids.
fn target_function(q: PathVertex, v: PathVertex) -> f32 {
    let segment = segment_between(q.position, v.position);
    let tau = connection_time(q, v, segment.direction, sqrt(segment.length2));
    uses_mean_densities = true;
    let open = unshadowed(q, v);
    uses_mean_densities = false;
    return (open.x + open.y + open.z) * (open.w * gate_weight_before_delays(tau));
}

// Number of parts of equal length into which the gate is divided, 1 to MAX_TIME_GROUPS. K queries yield one vertex for each part,
// so that with many responses late light gets as many connections as early light.
override TIME_GROUPS: u32 = 1u;
const MAX_TIME_GROUPS: u32 = 16u;

// The part of the gate that contains a travel time.
fn time_group(tau: f32) -> u32 {
    // Where travel times omit the ways to a wall, a gate from 0 on is extended below 0 (`Plan::set`). Hardly any light is there.
    let lo = max(frame.gate_lo, 0.0);
    let part = max(tau - lo, 0.0) / (frame.gate_hi - lo);
    return min(u32(part * f32(TIME_GROUPS)), TIME_GROUPS - 1u);
}

// For each part of the gate: the vertex chosen so far or NONE, its target, and the sum of the weights of all candidates.
struct Choices {
    vertices: array<u32, MAX_TIME_GROUPS>,
    targets: array<f32, MAX_TIME_GROUPS>,
    sums: array<f32, MAX_TIME_GROUPS>,
}

// Minimum number of queries of a shade point, unless K is smaller.
const MIN_QUERIES: u32 = 4u;
// Whether a medium scatters light.
override HAS_SCATTERING: bool = false;

// Maximum number of queries for q. In media that scatter, sensor subpaths have many vertices, and the first matter most. So the number
// is halved once for surfaces behind the first vertex, and once per bounce for events (docs/notebook/fog-query-cost.md). With several
// parts of the gate, it is not halved.
fn max_queries(q: PathVertex) -> u32 {
    if (!HAS_SCATTERING || TIME_GROUPS > 1u) {
        return frame.queries;
    }
    let bounces = (q.flags & VERTEX_DEPTH) - 1u;
    let halvings = min(bounces, select(1u, 31u, is_in_medium(q)));
    return max(frame.queries >> halvings, min(frame.queries, MIN_QUERIES));
}

// Resampling of up to K stratified queries of one tree by their unshadowed contribution (Talbot et al. 2005). Writes one vertex per part
// of the gate to the slots from `first` on, with the factor that replaces 1 / (K P(j | q)).
fn resample(root: u32, q: PathVertex, receiver: Receiver, first: u32, rng: ptr<function, u32>) {
    var chosen: Choices;
    for (var g = 0u; g < TIME_GROUPS; g++) {
        chosen.vertices[g] = NONE;
        chosen.sums[g] = 0.0;
    }
    var frontier: Frontier;
    grow_frontier(&frontier, root, receiver);
    let jitter = min(next_fine_uniform(rng), 1.0 - UNIFORM_STEP);
    // If a frontier with room for MAX_SUBTREES has few subtrees, few can contribute, and two queries per subtree are enough. A smaller
    // frontier (`--frontier`) may have few subtrees because it is full.
    let enough = select(frame.queries, max(2u * frontier.count, MIN_QUERIES), FRONTIER == MAX_SUBTREES);
    let queries = select(min(max_queries(q), enough), 0u, frontier.count == 0u);
    for (var k = 0u; k < queries; k++) {
        let start = sample_frontier(&frontier, (f32(k) + jitter) / f32(queries), rng);
        let leaf = descend_by_importance(start, receiver, rng);
        if (leaf.vertex == NONE) {
            continue;
        }
        let candidate = choose_in_leaf(q, leaf, rng);
        if (candidate.vertex == NONE) {
            continue;
        }
        let v = load_light_vertex(candidate.vertex);
        let segment = segment_between(q.position, v.position);
        let g = time_group(connection_time(q, v, segment.direction, sqrt(segment.length2)));
        let target_value = target_function(q, v);
        let weight = target_value * candidate.weight;
        if (!(weight < 3e38)) {
            // The weight is not a number or not finite. The vertex stays, so that its connection is counted as dropped.
            chosen.vertices[g] = candidate.vertex;
            chosen.targets[g] = target_value;
            chosen.sums[g] = weight;
            continue;
        }
        chosen.sums[g] += weight;
        if (next_uniform(rng) * chosen.sums[g] < weight) {
            chosen.vertices[g] = candidate.vertex;
            chosen.targets[g] = target_value;
        }
    }
    for (var g = 0u; g < TIME_GROUPS; g++) {
        let vertex = chosen.vertices[g];
        let weight = chosen.sums[g] / (chosen.targets[g] * f32(queries));
        // Weight 0 marks an unused slot. Queries that find no vertex get weight 1, so that gather.wgsl counts them as tried.
        write_candidate(first + g, vertex, select(weight, 1.0, vertex == NONE));
    }
}
