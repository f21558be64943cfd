// One query of a light tree: from the light-cone shell of a shade point to a light vertex.
#import candidate
#import lightcone
#import vertex
#import random

// The light-cone shell of q (Eqs. 7 to 9), widened by the rounding allowance.
fn make_shell(q: PathVertex) -> Shell {
    let eta = eta_range(q);
    return Shell(q.position, frame.gate_lo - q.tau - frame.rounding_allowance, frame.gate_hi - q.tau + frame.rounding_allowance,
        eta.x, eta.y, frame.gap_lo - q.tau + frame.rounding_allowance, frame.gap_hi - q.tau - frame.rounding_allowance);
}

// Advances the generator of a query. Returns 32 random bits.
fn next_word(rng: ptr<function, u32>) -> u32 {
    *rng = *rng * 747796405u + 2891336453u;
    return hash32(*rng);
}

// Advances the generator of a query. Returns a uniform in [0, 1), in steps of 2^-24.
fn next_uniform(rng: ptr<function, u32>) -> f32 {
    return f32(next_word(rng) >> 8u) * (1.0 / 16777216.0);
}

// Advances the generator of a query. Returns a uniform in [0, 1], in steps of 2^-32 near 0. Rounding can make it exactly 1.
fn next_fine_uniform(rng: ptr<function, u32>) -> f32 {
    return f32(next_word(rng)) * (1.0 / 4294967296.0);
}

// One traversal of lcs-paper from `root`. Returns a vertex and 1 / P(j | q), or NONE at a dead node, where both bounds are 0.
// `spatial`: 3D tree.
fn descend(root: u32, shell: Shell, spatial: bool, rng: ptr<function, u32>) -> Candidate {
    var current = root;
    var weight = 1.0;
    if ((current & LEAF_BIT) == 0u) {
        // The loop exits at its end: with a condition at the top, masked SIMD would run the body once more.
        loop {
            if (EXIT_AT_TOP && (current & LEAF_BIT) != 0u) {
                break;
            }
            let node = load_tree_node(current);
            let bound_left = node_bound(node.left, shell, spatial);
            let bound_right = node_bound(node.right, shell, spatial);
            let sum = bound_left + bound_right;
            // Eq. 5. The uniform has 32 bits, and the less likely child takes the low end, where floats are finest. So rare
            // children are drawn with exactly the probability that P contains.
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
    // One vertex of the leaf, uniformly.
    let count = ((current >> 27u) & 15u) + 1u;
    let pick = min(u32(next_uniform(rng) * f32(count)), count - 1u);
    return Candidate((current & LEAF_FIRST) + pick, weight * f32(count));
}
