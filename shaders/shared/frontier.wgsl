// The frontier of a tree as a shade point sees it: subtrees that together hold every vertex that can contribute. K queries start
// among them instead of at the root: the importance of a small box tells more than a chain of guesses from great ones, and the
// upper levels are paid for once.
#import importance
#import query

// Subtrees at most, 1 to MAX_SUBTREES (`--frontier`); 1: the root alone.
override FRONTIER: u32 = 32u;
const MAX_SUBTREES: u32 = 32u;
// Upper bound on the subtrees that are visited: twice those that fill the frontier, since many prove to be dead.
const MAX_VISITS: u32 = 64u;
// A subtree counts for so much of the frontier's power beyond its own: choices by power find each of them whatever digits floats lack.
const MIN_SHARE: f32 = 1.0 / 1024.0;

// Step of a uniform in [0, 1): 1 minus it is the largest one.
const UNIFORM_STEP: f32 = 1.0 / 16777216.0;

// Part of the queries that go by power alone wherever a node is not pruned. Errors of the importance multiply from level to
// level; a vertex that it all but misses is found with this part of its share of the power, so that none shines far too bright.
const POWER_PROBABILITY: f32 = 1.0 / 16.0;

struct Frontier {
    // A ring, from `first` on.
    nodes: array<u32, MAX_SUBTREES>,
    // Power and importance of each subtree; `grow_frontier` turns them into prefix sums.
    weights: array<vec2<f32>, MAX_SUBTREES>,
    first: u32,
    count: u32,
    // Every subtree is a leaf.
    only_leaves: bool,
}

// A traversal of a light tree, from where it starts.
struct Traversal {
    node: u32,
    // How it chooses: by power, or by importance.
    by_power: bool,
    // The uniform that the next choice uses.
    u: f32,
    // Probabilities of the choices so far, by power and by importance.
    p: vec2<f32>,
}

// `u` in [start, start + part), stretched to [0, 1). The digits that the stretching uncovers, those below the last of `u`, are drawn.
fn remap_uniform(u: f32, start: f32, part: f32, rng: ptr<function, u32>) -> f32 {
    let fresh = next_fine_uniform(rng);
    // From u to the next float: 2^-23 of the power of two below it.
    let last_digit = bitcast<f32>(bitcast<u32>(u) & 0x7f800000u) * 1.1920929e-7;
    let stretched = clamp((max(u - start, 0.0) + last_digit * fresh) / part, 0.0, 1.0 - UNIFORM_STEP);
    // Of a small part hardly any digit is left.
    return select(stretched, min(fresh, 1.0 - UNIFORM_STEP), part < 1.0 / 256.0);
}

fn push_subtree(f: ptr<function, Frontier>, node: u32, weights: vec2<f32>) {
    let at = ((*f).first + (*f).count) % MAX_SUBTREES;
    (*f).nodes[at] = node;
    (*f).weights[at] = weights;
    (*f).count += 1u;
}

// Opens subtrees breadth first from `root` on until there are enough; those of importance 0 are left out. Empty where no vertex can
// contribute; a root that is a leaf is all of its frontier.
fn grow_frontier(f: ptr<function, Frontier>, root: u32, receiver: Receiver) {
    (*f).first = 0u;
    (*f).count = 0u;
    push_subtree(f, root, vec2<f32>(1.0));
    // Leaves met in a row: when there is nothing else, nothing is left to open.
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
    (*f).only_leaves = closed == (*f).count;
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

// The subtree of a frontier that is not empty at the uniform `u`. Stratified values of `u` lead to different parts of the tree.
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
