// Chooses the light vertices that a shade point connects to.
//
// pt:        one emitter point of the pool, uniformly.
// bdpt:      every vertex of one light subpath, the same subpath for all shade points of a sensor subpath.
// lcs-paper: K independent traversals of each tree. At every node, one of the two children is taken with a probability
//            proportional to its bound B(N, q) (Eq. 5). The bound is 0 if the child lies outside the light-cone shell
//            (Eq. 19). Otherwise it shrinks with the part of the child that the shell misses (Eqs. 22 to 24). The traversal
//            ends at a dead node, where both bounds are 0, or at a leaf, where one vertex is taken uniformly. P(j | q) is the
//            product of all these probabilities.
// lcs for histograms (ESTIMATOR_LCS_BY_TIME): the pool is sorted by travel time. K evenly spaced vertices are chosen from the
//            part of the pool whose travel times allow them to meet the gate.
// epc:       as bdpt. If the connection is too short for the gate, the candidate stands for an ellipsoidal connection.
// All:       deterministic vertices (punctual lights, the spot of a thin beam) one by one. If there are many, some of them
//            are drawn, or the trees hold them.
//
// A candidate that cannot contribute (gate, depth, facing) is dropped here, before it costs a ray.
#import query
#import slots

const ESTIMATOR_PT: u32 = 0u;
const ESTIMATOR_BDPT: u32 = 1u;
const ESTIMATOR_LCS_PAPER: u32 = 2u;
const ESTIMATOR_LCS_BY_TIME: u32 = 3u;
const ESTIMATOR_EPC: u32 = 4u;
override ESTIMATOR: u32 = 2u;

// One thread serves one shade point.
@compute @workgroup_size(WORKGROUP)
fn shell_query(@builtin(global_invocation_id) id: vec3<u32>) {
    let rank = dispatch.rank + id.x;
    if (rank >= counters[dispatch.counter]) {
        return;
    }
    let item = begin_work_item(rank);
    var used = item.used;
    if (ESTIMATOR == ESTIMATOR_PT) {
        used = query_emitter(item.q, item.index, item.sample, item.depth, used);
    } else if (ESTIMATOR == ESTIMATOR_BDPT || ESTIMATOR == ESTIMATOR_EPC) {
        used = query_light_path(item.q, item.index, item.sample, used);
    } else if (ESTIMATOR == ESTIMATOR_LCS_BY_TIME) {
        if (item.is_open) {
            used = query_by_time(item.q, item.index, item.sample, item.depth, used);
        }
    } else {
        used = query_trees(item.q, item.index, item.sample, item.depth, used);
    }
    end_work_item(item.q.owner);
}

fn query_emitter(q: PathVertex, index: u32, sample: u32, depth: u32, used: u32) -> u32 {
    let first = frame.deterministic_count;
    let n = frame.emitter_vertex_count;
    if (n == 0u) {
        return used;
    }
    let words = random_words(STREAM_QUERY, index, sample, depth, 1u, frame.seed);
    write_candidate(used, connectable_or_none(q, first + random_below(words.xy, n)), f32(n));
    return used + 1u;
}

fn query_light_path(q: PathVertex, index: u32, sample: u32, used: u32) -> u32 {
    let path = random_below(random_words(STREAM_QUERY, index, sample, 0u, 1u, frame.seed).xy, frame.light_paths);
    let first = path_offsets[path];
    let count = min(path_offsets[path + 1u] - first, frame.slots - used);
    for (var i = 0u; i < count; i++) {
        write_candidate(used + i, connectable_or_none(q, first + i), f32(frame.light_paths));
    }
    return used + count;
}

// Number of vertices with a travel time below `tau`, among the `count` vertices from `first` on, which are sorted by travel time.
fn vertices_before(tau: f32, first: u32, count: u32) -> u32 {
    var lo = 0u;
    var hi = count;
    while (lo < hi) {
        let middle = (lo + hi) / 2u;
        let is_before = light_vertex_tau(first + middle) < tau;
        lo = select(lo, middle + 1u, is_before);
        hi = select(middle, hi, is_before);
    }
    return lo;
}

// Systematic sampling: each of the n vertices is drawn with probability K / n, and all of them if n is at most K.
fn query_by_time(q: PathVertex, index: u32, sample: u32, depth: u32, used: u32) -> u32 {
    if (frame.tree4_root == NONE) {
        return used;
    }
    // The only tree node holds the bounds of the sorted vertices, and their number in `child`.
    let all = load_tree_child(frame.tree4_root, 0u);
    let shell = make_shell(q);
    let distances = box_distances(q.position, all.lo, all.hi);
    let first = frame.deterministic_count;
    let begin = vertices_before(shell.lo - distances.y * shell.eta_hi, first, all.child);
    let n = vertices_before(shell.hi - distances.x * shell.eta_lo, first, all.child) - begin;
    let count = min(frame.queries, n);
    if (count == 0u) {
        return used;
    }
    let offset = random_below(random_words(STREAM_QUERY, index, sample, depth, 1u, frame.seed).xy, n);
    for (var k = 0u; k < count; k++) {
        // k n / count, rounded down, without overflow.
        let step = k * (n / count) + (k * (n % count)) / count;
        let vertex = first + begin + (offset + step) % n;
        write_candidate(used + k, connectable_or_none(q, vertex), f32(n) / f32(count));
    }
    return used + count;
}

fn query_trees(q: PathVertex, index: u32, sample: u32, depth: u32, used_before: u32) -> u32 {
    let shell = make_shell(q);
    var used = used_before;
    // One loop serves both trees: a second traversal would double the kernel's code.
    let trees = select(0u, 1u, frame.tree3_root != NONE) + select(0u, 1u, frame.tree4_root != NONE);
    let queries = frame.queries * trees;
    for (var k = 0u; k < queries; k++) {
        let spatial = frame.tree3_root != NONE && k < frame.queries;
        let root = select(frame.tree4_root, frame.tree3_root, spatial);
        var rng = random_words(STREAM_QUERY, index, sample, depth, 16u + k, frame.seed).x;
        let found = descend(root, shell, spatial, &rng);
        var vertex = found.vertex;
        if (vertex != NONE) {
            vertex = connectable_or_none(q, vertex);
        }
        // 1 / P is at least 1, except that it is 0 at a dead node. A dead node counts as a tried connection too, so its
        // weight is not 0.
        write_candidate(used, vertex, max(found.weight, 1.0) / f32(frame.queries));
        used += 1u;
    }
    return used;
}
