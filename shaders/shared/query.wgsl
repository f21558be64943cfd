// One query of a light tree: from the shell of a shade point to a light vertex.
#import candidate
#import lightcone
#import vertex
#import random

fn make_shell(q: PathVertex) -> Shell {
    let eta = eta_range(q);
    return Shell(q.position, frame.gate_lo - q.tau - frame.rounding_allowance, frame.gate_hi - q.tau + frame.rounding_allowance,
        eta.x, eta.y);
}

// A uniform in [0, 1) and the next state of a query's generator.
fn next_uniform(rng: ptr<function, u32>) -> f32 {
    *rng = *rng * 747796405u + 2891336453u;
    return f32(hash32(*rng) >> 8u) * (1.0 / 16777216.0);
}

// A uniform in [0, 1] in steps of 2^-32 near 0.
fn next_fine_uniform(rng: ptr<function, u32>) -> f32 {
    *rng = *rng * 747796405u + 2891336453u;
    return f32(hash32(*rng)) * (1.0 / 4294967296.0);
}

// One traversal from `root`: the vertex and 1 / P(j | q), or NONE at a dead node.
fn descend(root: u32, shell: Shell, spatial: bool, rng: ptr<function, u32>) -> Candidate {
    var current = root;
    var weight = 1.0;
    if ((current & LEAF_BIT) == 0u) {
        // Left at the end: masked SIMD would run the body once more for a condition at the top.
        loop {
            if (EXIT_AT_TOP && (current & LEAF_BIT) != 0u) {
                break;
            }
            let node = load_tree_node(current);
            let bound_left = node_bound(node.left, shell, spatial);
            let bound_right = node_bound(node.right, shell, spatial);
            let sum = bound_left + bound_right;
            // Eq. 5, with all 32 bits and the lesser child at the low end, where floats are fine: rare children are drawn as
            // rarely as P says.
            let take_lesser = next_fine_uniform(rng) * sum < min(bound_left, bound_right);
            let take_left = take_lesser == (bound_left < bound_right);
            weight *= sum / select(bound_right, bound_left, take_left);
            current = select(node.right.child, node.left.child, take_left);
            current = select(NONE, current, sum > 0.0);
            continuing {
                break if !EXIT_AT_TOP & ((current & LEAF_BIT) != 0u);
            }
        }
        if (current == NONE) {
            return Candidate(NONE, 0.0);
        }
    }
    // A leaf of several vertices: one of them uniformly.
    let count = ((current >> 27u) & 15u) + 1u;
    let pick = min(u32(next_uniform(rng) * f32(count)), count - 1u);
    return Candidate((current & LEAF_FIRST) + pick, weight * f32(count));
}
