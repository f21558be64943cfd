// The frontier of a tree as a shade point sees it: subtrees that together hold every vertex that can contribute. K queries start
// among them instead of at the root: the importance of a small box tells more than a chain of guesses from great ones, and the
// upper levels are paid for once.
#import importance
#import query

// Subtrees at most, 1 to MOST_SUBTREES (`--frontier`); 1: the root alone.
override FRONTIER: u32 = 32u;
const MOST_SUBTREES: u32 = 32u;
// Looks at a subtree to open it at most: as many again as fill the frontier, since many prove to be dead.
const LOOKS: u32 = 64u;
// A subtree counts for so much of the frontier's power beyond its own: choices by power find each of them whatever digits floats lack.
const LEAST_SHARE: f32 = 1.0 / 1024.0;

// What a uniform in [0, 1) resolves.
const RESOLUTION: f32 = 1.0 / 16777216.0;

// Part of the queries that go by power alone wherever a node is not pruned. Errors of the importance multiply from level to
// level; a vertex that it all but misses is found with this part of its share of the power, so that none shines far too bright.
const BY_POWER: f32 = 1.0 / 16.0;

struct Frontier {
    // A ring, from `first` on.
    nodes: array<u32, MOST_SUBTREES>,
    // Power and importance of a subtree; after `grow_frontier` of it and of all before it.
    goals: array<vec2<f32>, MOST_SUBTREES>,
    first: u32,
    count: u32,
}

// Where a query starts, or has come to.
struct Way {
    node: u32,
    // How it chooses: by power, or by importance.
    by_power: bool,
    // What is left of its uniform.
    rest: f32,
    // Probabilities of the way so far by power and by importance.
    p: vec2<f32>,
}

// `u` in [start, start + part), stretched to [0, 1). The digits that the stretching uncovers, those below the last of `u`, are drawn.
fn refill(u: f32, start: f32, part: f32, rng: ptr<function, u32>) -> f32 {
    let fresh = next_fine_uniform(rng);
    // From u to the next float: 2^-23 of the power of two below it.
    let last_digit = bitcast<f32>(bitcast<u32>(u) & 0x7f800000u) * 1.1920929e-7;
    let stretched = clamp((max(u - start, 0.0) + last_digit * fresh) / part, 0.0, 1.0 - RESOLUTION);
    // Of a small part hardly any digit is left.
    return select(stretched, min(fresh, 1.0 - RESOLUTION), part < 1.0 / 256.0);
}

fn join_frontier(f: ptr<function, Frontier>, node: u32, goal: vec2<f32>) {
    let at = ((*f).first + (*f).count) % MOST_SUBTREES;
    (*f).nodes[at] = node;
    (*f).goals[at] = goal;
    (*f).count += 1u;
}

// Opens subtrees breadth first from `root` on until there are enough; those of importance 0 are left out. Empty where no vertex can
// contribute; a root that is a leaf is all of its frontier.
fn grow_frontier(f: ptr<function, Frontier>, root: u32, receiver: Receiver) {
    (*f).first = 0u;
    (*f).count = 0u;
    join_frontier(f, root, vec2<f32>(1.0));
    // Leaves met in a row: when there is nothing else, nothing is left to open.
    var closed = 0u;
    for (var look = 0u; look < LOOKS && closed < (*f).count && (*f).count < FRONTIER; look++) {
        let current = (*f).nodes[(*f).first];
        let goal = (*f).goals[(*f).first];
        (*f).first = ((*f).first + 1u) % MOST_SUBTREES;
        (*f).count -= 1u;
        if ((current & LEAF_BIT) != 0u) {
            join_frontier(f, current, goal);
            closed += 1u;
            continue;
        }
        closed = 0u;
        let node = load_tree_node(current);
        let importance = vec2<f32>(node_importance(node.left, receiver), node_importance(node.right, receiver));
        if (importance.x > 0.0) {
            join_frontier(f, node.left.child, vec2<f32>(total_power(node.left), importance.x));
        }
        if (importance.y > 0.0) {
            join_frontier(f, node.right.child, vec2<f32>(total_power(node.right), importance.y));
        }
    }
    var power = 0.0;
    for (var i = 0u; i < (*f).count; i++) {
        power += (*f).goals[((*f).first + i) % MOST_SUBTREES].x;
    }
    var sum = vec2<f32>(0.0);
    for (var i = 0u; i < (*f).count; i++) {
        let at = ((*f).first + i) % MOST_SUBTREES;
        sum += (*f).goals[at] + vec2<f32>(LEAST_SHARE * power, 0.0);
        (*f).goals[at] = sum;
    }
}

// The subtree of a frontier that is not empty at the uniform `u`. Stratified values of `u` lead to different parts of the tree.
fn enter_frontier(f: ptr<function, Frontier>, u: f32, rng: ptr<function, u32>) -> Way {
    let by_power = u < BY_POWER;
    let rest = refill(u, select(BY_POWER, 0.0, by_power), select(1.0 - BY_POWER, BY_POWER, by_power), rng);
    let all = (*f).goals[((*f).first + (*f).count - 1u) % MOST_SUBTREES];
    // The first subtree whose sum is above what is asked for.
    let asked = rest * select(all.y, all.x, by_power);
    var lo = 0u;
    var hi = (*f).count - 1u;
    while (lo < hi) {
        let middle = (lo + hi) / 2u;
        let sum = (*f).goals[((*f).first + middle) % MOST_SUBTREES];
        let below = asked < select(sum.y, sum.x, by_power);
        lo = select(middle + 1u, lo, below);
        hi = select(hi, middle, below);
    }
    let at = ((*f).first + lo) % MOST_SUBTREES;
    let before = select((*f).goals[((*f).first + max(lo, 1u) - 1u) % MOST_SUBTREES], vec2<f32>(0.0), lo == 0u) / all;
    let p = (*f).goals[at] / all - before;
    let start = select(before.y, before.x, by_power);
    return Way((*f).nodes[at], by_power, refill(rest, start, select(p.y, p.x, by_power), rng), p);
}
