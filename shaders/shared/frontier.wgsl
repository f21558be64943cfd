// The frontier of a tree for a shade point: subtrees that together hold every vertex that can contribute. K queries start at
// these subtrees instead of at the root. The importance of a small box is more accurate than a chain of choices between large
// boxes, and the upper levels of the tree are paid for once per shade point.
#import importance
#import query

// Maximum number of subtrees, 1 to MAX_SUBTREES (`--frontier`). With 1, the frontier is the root alone.
override FRONTIER: u32 = 32u;
const MAX_SUBTREES: u32 = 32u;
// Upper bound on the number of visited subtrees: twice the number that fills the frontier, because many prove to be dead.
const MAX_VISITS: u32 = 64u;
// Fraction of the frontier's power that is added to the power of each subtree. So choices by power can reach every subtree,
// even if its own power is too small for the digits of the prefix sum.
const MIN_SHARE: f32 = 1.0 / 1024.0;

// Step of a uniform in [0, 1): the largest uniform is 1 minus this step.
const UNIFORM_STEP: f32 = 1.0 / 16777216.0;

// Share of the queries that choose by power alone among the children that are not pruned. Errors of the importance multiply
// from level to level. A vertex with a far too small importance is still found with this fraction of its share of the power,
// so that it does not become far too bright.
const POWER_PROBABILITY: f32 = 1.0 / 16.0;

struct Frontier {
    // A ring buffer that begins at `first`.
    nodes: array<u32, MAX_SUBTREES>,
    // Power (x) and importance (y) of each subtree. `grow_frontier` turns them into prefix sums.
    weights: array<vec2<f32>, MAX_SUBTREES>,
    first: u32,
    count: u32,
}

// The start of a traversal of a light tree.
struct Traversal {
    node: u32,
    // Whether the traversal chooses children by power instead of by importance.
    by_power: bool,
    // The uniform for the next choice.
    u: f32,
    // Probability of the choices so far if they are made by power (x), and if they are made by importance (y).
    p: vec2<f32>,
}

// Maps `u` from [start, start + part) to [0, 1). The mapping needs digits below the last digit of `u`; these are drawn from `rng`.
fn remap_uniform(u: f32, start: f32, part: f32, rng: ptr<function, u32>) -> f32 {
    let fresh = next_fine_uniform(rng);
    // Distance from u to the next float: 2^-23 times the largest power of two up to u.
    let last_digit = bitcast<f32>(bitcast<u32>(u) & 0x7f800000u) * 1.1920929e-7;
    let stretched = clamp((max(u - start, 0.0) + last_digit * fresh) / part, 0.0, 1.0 - UNIFORM_STEP);
    // If the part is small, u has hardly any digits left. The result is then a fresh uniform.
    return select(stretched, min(fresh, 1.0 - UNIFORM_STEP), part < 1.0 / 256.0);
}

// Appends a subtree to the ring. `weights`: its power and its importance.
fn push_subtree(f: ptr<function, Frontier>, node: u32, weights: vec2<f32>) {
    let at = ((*f).first + (*f).count) % MAX_SUBTREES;
    (*f).nodes[at] = node;
    (*f).weights[at] = weights;
    (*f).count += 1u;
}

// Opens subtrees breadth first from `root` on until there are enough, and leaves out subtrees with importance 0. The frontier
// is empty if no vertex can contribute. If the root is a leaf, this leaf is the frontier.
fn grow_frontier(f: ptr<function, Frontier>, root: u32, receiver: Receiver) {
    (*f).first = 0u;
    (*f).count = 0u;
    push_subtree(f, root, vec2<f32>(1.0));
    // Number of leaves met in a row. If it reaches the number of subtrees, all subtrees are leaves.
    var closed = 0u;
    for (var visit = 0u; visit < MAX_VISITS && closed < (*f).count && (*f).count < FRONTIER; visit++) {
        let current = (*f).nodes[(*f).first];
        let weights = (*f).weights[(*f).first];
        (*f).first = ((*f).first + 1u) % MAX_SUBTREES;
        (*f).count -= 1u;
        if ((current & LEAF_BIT) != 0u) {
            push_subtree(f, current, weights);
            closed += 1u;
            continue;
        }
        closed = 0u;
        let node = load_tree_node(current);
        let importance = vec2<f32>(node_importance(node.left, receiver), node_importance(node.right, receiver));
        if (importance.x > 0.0) {
            push_subtree(f, node.left.child, vec2<f32>(total_power(node.left), importance.x));
        }
        if (importance.y > 0.0) {
            push_subtree(f, node.right.child, vec2<f32>(total_power(node.right), importance.y));
        }
    }
    var power = 0.0;
    for (var i = 0u; i < (*f).count; i++) {
        power += (*f).weights[((*f).first + i) % MAX_SUBTREES].x;
    }
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < (*f).count; i++) {
        let at = ((*f).first + i) % MAX_SUBTREES;
        sum += (*f).weights[at] + vec2<f32>(MIN_SHARE * power, 0.0);
        (*f).weights[at] = sum;
    }
}

// Chooses a subtree of a frontier that is not empty, at the uniform `u`. Stratified values of `u` lead to different
// parts of the tree.
fn sample_frontier(f: ptr<function, Frontier>, u: f32, rng: ptr<function, u32>) -> Traversal {
    let by_power = u < POWER_PROBABILITY;
    let start_of_mode = select(POWER_PROBABILITY, 0.0, by_power);
    let rest = remap_uniform(u, start_of_mode, select(1.0 - POWER_PROBABILITY, POWER_PROBABILITY, by_power), rng);
    let all = (*f).weights[((*f).first + (*f).count - 1u) % MAX_SUBTREES];
    // The first subtree whose prefix sum is above `wanted`.
    let wanted = rest * select(all.y, all.x, by_power);
    var lo = 0u;
    var hi = (*f).count - 1u;
    while (lo < hi) {
        let middle = (lo + hi) / 2u;
        let sum = (*f).weights[((*f).first + middle) % MAX_SUBTREES];
        let below = wanted < select(sum.y, sum.x, by_power);
        lo = select(middle + 1u, lo, below);
        hi = select(hi, middle, below);
    }
    let at = ((*f).first + lo) % MAX_SUBTREES;
    let before = select((*f).weights[((*f).first + max(lo, 1u) - 1u) % MAX_SUBTREES], vec2<f32>(0.0), lo == 0u) / all;
    let p = (*f).weights[at] / all - before;
    let start = select(before.y, before.x, by_power);
    return Traversal((*f).nodes[at], by_power, remap_uniform(rest, start, select(p.y, p.x, by_power), rng), p);
}
