// One query of a light tree: from the shell of a shade point to a light vertex.
#import candidate
#import lightcone
#import scatter
#import random

fn make_shell(q: PathVertex) -> Shell {
    var other = q.eta;
    if (HAS_TRANSMISSION) {
        other = medium_towards(q, -q.geometric);
    }
    return Shell(q.position, frame.gate_lo - q.tau - frame.slack, frame.gate_hi - q.tau + frame.slack,
        min(q.eta, other), max(q.eta, other));
}

// One traversal from `root`: the vertex and 1 / P(j | q), or NONE at a dead node.
fn descend(root: u32, shell: Shell, spatial: bool, rng: ptr<function, u32>) -> Candidate {
    var current = root;
    var weight = 1.0;
    while ((current & LEAF_BIT) == 0u) {
        let left = tree_nodes[current].left;
        let right = tree_nodes[current].right;
        let bound_left = node_bound(left, shell, spatial);
        let bound_right = node_bound(right, shell, spatial);
        let sum = bound_left + bound_right;
        if (!(sum > 0.0)) {
            return Candidate(NONE, 0.0);
        }
        // Eq. 5.
        *rng = *rng * 747796405u + 2891336453u;
        let take_left = f32(hash32(*rng) >> 8u) * (1.0 / 16777216.0) * sum < bound_left;
        weight *= sum / select(bound_right, bound_left, take_left);
        current = select(right.child, left.child, take_left);
    }
    // A leaf of several vertices: one of them uniformly.
    let count = ((current >> 27u) & 15u) + 1u;
    *rng = *rng * 747796405u + 2891336453u;
    let pick = min(u32(f32(hash32(*rng) >> 8u) * (1.0 / 16777216.0) * f32(count)), count - 1u);
    return Candidate((current & LEAF_FIRST) + pick, weight * f32(count));
}
