// The frontier of a tree for a shade point: subtrees that together hold every vertex that can contribute. K queries start at
// these subtrees instead of at the root. The importance of a small box is more accurate than a chain of choices between large
// boxes, and the upper levels of the tree are visited only once per shade point.
#import importance
#import query

// Maximum number of subtrees, 1 to MAX_SUBTREES (`--frontier`). With 1, the frontier is the root alone.
override FRONTIER: u32 = 32u;
const MAX_SUBTREES: u32 = 32u;
// Upper bound on the number of visited subtrees: twice the number that fills the frontier. A subtree with a child of importance 0
// does not enlarge the frontier.
const MAX_VISITS: u32 = 64u;
// Fraction of the frontier's power that is added to the power of each subtree. So choices by power can reach every subtree,
// even if its own power is too small for the digits of the prefix sum.
const MIN_SHARE: f32 = 1.0 / 1024.0;

// Step of a uniform in [0, 1): the largest uniform is 1 minus this step.
const UNIFORM_STEP: f32 = 1.0 / 16777216.0;

// Share of the queries that choose by power alone among the children that are not pruned. Errors of the importance multiply
// from level to level. The probability of a leaf is still at least about this fraction of its share of the power. So vertices
// with a far too small importance do not become far too bright.
const POWER_PROBABILITY: f32 = 1.0 / 16.0;

struct Frontier {
    // A ring buffer that begins at `first`.
    nodes: array<u32, MAX_SUBTREES>,
    // Power and importance of each subtree: see `pack_weights`.
    weights: array<u32, MAX_SUBTREES>,
    first: u32,
    count: u32,
    // Sums of the powers (x) and of the importances (y) of all subtrees.
    all: vec2<f32>,
    // Power that `subtree_weights` adds to the power of each subtree.
    min_power: f32,
    // The subtree that the next query looks at first, and the sums of the subtrees before it. The uniforms of the queries ascend, so no
    // query looks back.
    next: u32,
    before: vec2<f32>,
    // Whether `before` and `next` belong to choices by power, which come first.
    is_by_power: bool,
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

// Power (x) and importance (y) in one word: the upper 16 bits of each float. This halves the private array, which is slow.
// The lost digits cause no bias, because P contains the weights as they are stored.
fn pack_weights(weights: vec2<f32>) -> u32 {
    let words = bitcast<vec2<u32>>(weights);
    return (words.x & 0xffff0000u) | (words.y >> 16u);
}

fn unpack_weights(word: u32) -> vec2<f32> {
    return bitcast<vec2<f32>>(vec2<u32>(word & 0xffff0000u, word << 16u));
}

// Appends a subtree to the ring. `weights`: its power and its importance, packed.
fn push_subtree(f: ptr<function, Frontier>, node: u32, weights: u32) {
    let at = ((*f).first + (*f).count) % MAX_SUBTREES;
    (*f).nodes[at] = node;
    (*f).weights[at] = weights;
    (*f).count += 1u;
}

// Power (with `min_power`) and importance of the subtree with the given number, from 0 in the order of the ring.
fn subtree_weights(f: ptr<function, Frontier>, number: u32) -> vec2<f32> {
    return unpack_weights((*f).weights[((*f).first + number) % MAX_SUBTREES]) + vec2<f32>((*f).min_power, 0.0);
}

// Opens subtrees breadth first from `root` on until there are enough, and leaves out subtrees with importance 0. If the
// frontier is empty, no vertex can contribute. If the root is a leaf, this leaf is the frontier.
fn grow_frontier(f: ptr<function, Frontier>, root: u32, receiver: Receiver) {
    (*f).first = 0u;
    (*f).count = 0u;
    push_subtree(f, root, pack_weights(vec2<f32>(1.0)));
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
            push_subtree(f, node.left.child, pack_weights(vec2<f32>(total_power(node.left), importance.x)));
        }
        if (importance.y > 0.0) {
            push_subtree(f, node.right.child, pack_weights(vec2<f32>(total_power(node.right), importance.y)));
        }
    }
    (*f).min_power = 0.0;
    var power = 0.0;
    for (var i = 0u; i < (*f).count; i++) {
        power += subtree_weights(f, i).x;
    }
    (*f).min_power = MIN_SHARE * power;
    (*f).all = vec2<f32>(0.0);
    for (var i = 0u; i < (*f).count; i++) {
        (*f).all += subtree_weights(f, i);
    }
    (*f).next = 0u;
    (*f).before = vec2<f32>(0.0);
    (*f).is_by_power = true;
}

// Chooses a subtree of a frontier that is not empty, at the uniform `u`, which must not be less than in the call before.
// Stratified values of `u` lead to different parts of the tree.
fn sample_frontier(f: ptr<function, Frontier>, u: f32, rng: ptr<function, u32>) -> Traversal {
    let by_power = u < POWER_PROBABILITY;
    let start_of_mode = select(POWER_PROBABILITY, 0.0, by_power);
    let rest = remap_uniform(u, start_of_mode, select(1.0 - POWER_PROBABILITY, POWER_PROBABILITY, by_power), rng);
    if (!by_power && (*f).is_by_power) {
        (*f).is_by_power = false;
        (*f).next = 0u;
        (*f).before = vec2<f32>(0.0);
    }
    // The first subtree at which the prefix sum exceeds `wanted`. P is the difference of the same rounded sums.
    let wanted = rest * select((*f).all.y, (*f).all.x, by_power);
    var after = (*f).before + subtree_weights(f, (*f).next);
    loop {
        let is_found = wanted < select(after.y, after.x, by_power) || (*f).next + 1u >= (*f).count;
        if (is_found) {
            break;
        }
        (*f).next += 1u;
        (*f).before = after;
        after += subtree_weights(f, (*f).next);
    }
    let before = (*f).before / (*f).all;
    let p = after / (*f).all - before;
    let start = select(before.y, before.x, by_power);
    return Traversal((*f).nodes[((*f).first + (*f).next) % MAX_SUBTREES], by_power, remap_uniform(rest, start, select(p.y, p.x, by_power), rng), p);
}
