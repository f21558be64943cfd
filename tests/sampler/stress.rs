//! Stress tests of tree traversals. A traversal returns the same probability as an independent walk in hundreds of random trees
//! (thousands in an ignored test), in trees over degenerate input, and in trees over a million vertices. Children whose
//! probability is near 2^-24 or below are drawn as often as they should be.

use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::Item;
use taugate::internals::wgsl::layout::TreeNode;

use crate::reach::check;
use crate::shader_function::{CompiledFunction, ShaderFunction, contents};
use crate::walk::{Ends, Pool, Query, odd_items, odd_query, room, walk};
use crate::{BOUNDS, DRAW, Input, input, item_and_weight, query_of_room, tree_buffers};

/// Maximum relative error of 1 / P: a product over about twenty levels in f32.
const TOLERANCE: f64 = 1e-5;

/// Trees with one query each. The nodes of all trees are concatenated in one array.
struct Forest {
    trees: Vec<(Pool, Query)>,
    next_node: u32,
    next_vertex: u32,
}

impl Forest {
    fn new() -> Forest {
        Forest { trees: vec![], next_node: 0, next_vertex: 0 }
    }

    fn plant(&mut self, items: Vec<Item>, leaf_size: usize, spatial: bool, query: Query) {
        let pool = Pool::new(items, leaf_size, spatial, self.next_node, self.next_vertex);
        self.next_node += pool.nodes.len() as u32;
        self.next_vertex += pool.items.len() as u32;
        self.trees.push((pool, query));
    }

    /// Computes the probabilities of all vertices by a walk, with the node bounds from the device. Asserts that every vertex
    /// inside a gate has P > 0, and that the probabilities of all vertices and dead ends sum to 1. Asserts that `draws`
    /// traversals per tree return the P of the walk. Returns the number of vertices inside their gates, and the number of
    /// traversals that ended at a vertex.
    fn check(&self, draws: usize, pcg: &mut Pcg) -> [usize; 2] {
        let nodes: Vec<TreeNode> = self.trees.iter().flat_map(|(pool, _)| pool.nodes.iter().copied()).collect();
        let inputs: Vec<Input> = self
            .trees
            .iter()
            .flat_map(|(pool, query)| {
                (0..pool.nodes.len() as u32).map(|i| input(query, pool.first_node + i, pool.spatial, 0))
            })
            .collect();
        let bounds: Vec<[f32; 2]> = BOUNDS.run(&inputs, &[contents("tree_nodes", &nodes)]);
        let planted = || self.trees.iter().filter(|(pool, _)| !pool.items.is_empty());
        let seeds: Vec<Input> = planted()
            .flat_map(|(pool, query)| vec![(pool, query); draws])
            .map(|(pool, query)| input(query, pool.root, pool.spatial, pcg.next_u32()))
            .collect();
        let found: Vec<[u32; 2]> = DRAW.run(&seeds, &tree_buffers(&nodes));
        // Some drivers lose values that the last iteration of a loop assigns. The renderer sets EXIT_AT_TOP for these drivers.
        let at_top: Vec<[u32; 2]> = DRAW.compile(&[("EXIT_AT_TOP", 1.0)]).run(&seeds, &tree_buffers(&nodes));
        assert!(found == at_top, "EXIT_AT_TOP changes the result of a traversal");
        let [mut valid, mut drawn] = [0, 0];
        for ((pool, query), found) in planted().zip(found.chunks_exact(draws)) {
            let ends = walk(pool, |node| bounds[node as usize].map(f64::from));
            valid += check(pool, query, &ends)[0];
            drawn += agreeing(pool, query, &ends, found);
        }
        [valid, drawn]
    }
}

/// Asserts that traversals return the P of the walk. Returns the number of traversals that ended at a vertex.
fn agreeing(pool: &Pool, query: &Query, ends: &Ends, found: &[[u32; 2]]) -> usize {
    let hits = found.iter().map(|&end| item_and_weight(pool, end));
    hits.filter_map(|(item, weight)| item.map(|j| (j, weight)))
        .inspect(|&(j, weight)| {
            let p = ends.items[j];
            assert!((weight * p - 1.0).abs() < TOLERANCE, "1 / P of {:?} is {weight}, P {p}: {query:?}", pool.items[j]);
        })
        .count()
}

fn odd_forest(trees: usize, seed: u64) -> Forest {
    let mut pcg = Pcg::new(seed);
    let mut forest = Forest::new();
    for i in 0..trees {
        let spatial = i % 2 == 0;
        let (items, scale) = odd_items(&mut pcg, spatial);
        let query = odd_query(&mut pcg, &items, scale);
        // A third of the shade points lie on glass.
        let query = Query { eta_hi: if i % 3 == 0 { 1.5 } else { 1.0 }, ..query };
        forest.plant(items, [1, 4, 16][pcg.below(3)], spatial, query);
    }
    forest
}

#[test]
fn hundreds_of_trees_return_the_probabilities_of_the_walk() {
    let [valid, drawn] = odd_forest(600, 101).check(32, &mut Pcg::new(102));
    assert!(valid > 1_000 && drawn > 3_000, "{valid} vertices inside their gates, {drawn} draws of a vertex");
}

/// `cargo test --release --test sampler -- --ignored --nocapture ten_thousand`
#[test]
#[ignore = "takes a minute"]
fn ten_thousand_trees_return_the_probabilities_of_the_walk() {
    let [valid, drawn] = odd_forest(10_000, 103).check(64, &mut Pcg::new(104));
    println!("{valid} vertices inside their gates, {drawn} draws of a vertex");
    assert!(valid > 20_000 && drawn > 100_000, "{valid} vertices inside their gates, {drawn} draws of a vertex");
}

/// Lists of `n` vertices. Each list is degenerate in one way: in positions, travel times or powers.
fn degenerate(pcg: &mut Pcg, n: usize) -> Vec<(&'static str, Vec<Item>)> {
    type MakeItem<'a> = &'a mut dyn FnMut(&mut Pcg, i32) -> ([f32; 4], f32);
    let mut make = |name, item: MakeItem| {
        let items = (0..n as i32).map(|i| {
            let (point, power) = item(pcg, i);
            Item { point, power, index: i as u32 }
        });
        (name, items.collect())
    };
    let place = |pcg: &mut Pcg| [0, 1, 2, 3].map(|k| pcg.range(if k == 3 { 0.0 } else { -5.0 }, 5.0) as f32);
    let orders = |i: i32| 10f32.powi(-(i % 31));
    // The coordinates halve from each vertex to the next, so most vertices lie in a tiny corner of the box.
    let piled = |i: i32| 2f32.powi(-(i % 100));
    vec![
        make("one place and time", &mut |_, _| ([1.0, -2.0, 0.5, 3.0], 1.0)),
        make("one place", &mut |pcg, _| ([1.0, -2.0, 0.5, place(pcg)[3]], 1.0)),
        make("one time", &mut |pcg, _| {
            let p = place(pcg);
            ([p[0], p[1], p[2], 3.0], 1.0)
        }),
        make("times one step apart", &mut |pcg, i| {
            let p = place(pcg);
            ([p[0], p[1], p[2], 3.0 + (i % 4) as f32 * 2.0 * f32::EPSILON], 1.0)
        }),
        make("powers over thirty orders", &mut |pcg, i| (place(pcg), orders(i))),
        make("denormal powers", &mut |pcg, i| (place(pcg), f32::from_bits(1 + (i % 7) as u32))),
        make("one power among denormals", &mut |pcg, i| (place(pcg), if i == 0 { 1e30 } else { 1e-44 })),
        make("halving coordinates", &mut |_, i| ([piled(i), -piled(i), 0.0, 5.0 * piled(i)], 1.0)),
        make("halving coordinates, powers over thirty orders", &mut |_, i| {
            ([piled(i), piled(i), piled(i), 5.0 - 5.0 * piled(i)], orders(i))
        }),
        make("a cluster and one far away", &mut |pcg, i| {
            let p = place(pcg);
            (if i == 0 { [1e6, 0.0, 0.0, 10.0] } else { p.map(|x| 1e-4 * x) }, 1.0)
        }),
    ]
}

#[test]
fn degenerate_input_keeps_every_vertex_in_reach() {
    let mut pcg = Pcg::new(105);
    let mut forest = Forest::new();
    for n in [0, 1, 2, 3, 400] {
        for (_, items) in degenerate(&mut pcg, n) {
            for (spatial, leaf) in [(true, 1), (false, 1), (false, 16)] {
                let mut items = items.clone();
                if spatial {
                    items.iter_mut().for_each(|i| i.point[3] = 0.0);
                }
                for eta_hi in [1.0, 1.5, 3.0] {
                    let query = Query { eta_hi, ..odd_query(&mut pcg, &items, 5.0) };
                    forest.plant(items.clone(), leaf, spatial, query);
                }
            }
        }
    }
    let [valid, drawn] = forest.check(64, &mut pcg);
    assert!(valid > 3_000 && drawn > 10_000, "{valid} vertices inside their gates, {drawn} draws of a vertex");
}

#[test]
fn a_million_vertices() {
    let mut pcg = Pcg::new(106);
    for spatial in [true, false] {
        let items = room(&mut pcg, 1_000_000, spatial);
        let sample = Pool::new(items[..1000].to_vec(), 1, spatial, 0, 0);
        let query = query_of_room(&mut pcg, &sample);
        let mut forest = Forest::new();
        forest.plant(items, 1, spatial, query);
        let [valid, drawn] = forest.check(20_000, &mut pcg);
        assert!(valid > 10_000 && drawn > 5_000, "spatial {spatial}: {valid} vertices inside the gate, {drawn} drawn");
    }
}

/// How many of the `rounds` traversals of a thread end at `vertex`.
const COUNT: ShaderFunction = ShaderFunction {
    imports: &["query"],
    input: "root: u32, vertex: u32, rounds: u32, seed: u32",
    result: "count: u32",
    body: "let shell = Shell(vec3<f32>(0.0), 0.0, 1e9, 1.0, 1.0, 0.0, 0.0);
        var rng = input.seed;
        for (var i = 0u; i < input.rounds; i++) {
            result.count += u32(descend(input.root, shell, false, &rng).vertex == input.vertex);
        }",
};

/// How many of a hundred million traversals end at the weaker vertex in a tree with two vertices. `share` is its power relative
/// to the power of the other vertex. `first` says whether the weaker vertex is the first child.
fn rare_draws(kernel: &CompiledFunction, share: f32, first: bool) -> u32 {
    const THREADS: u32 = 20_000;
    const ROUNDS: u32 = 5_000;
    let at = |x: f32, power: f32, index| Item { point: [x, 1.0, 0.0, 0.0], power, index };
    let powers = if first { [share, 1.0] } else { [1.0, share] };
    let pool = Pool::new(vec![at(-1.0, powers[0], 0), at(1.0, powers[1], 1)], 1, false, 0, 0);
    let mut pcg = Pcg::new(107);
    let wanted = u32::from(!first);
    let inputs: Vec<[u32; 4]> = (0..THREADS).map(|_| [pool.root, wanted, ROUNDS, pcg.next_u32()]).collect();
    let counts: Vec<u32> = kernel.run(&inputs, &tree_buffers(&pool.nodes));
    counts.iter().sum()
}

/// With random numbers of 24 bits, a first child of share 1e-9 was drawn with probability 6e-8, and a second child of share
/// 2e-8 was never drawn. The returned P was wrong for both. A correct traversal fails one of these assertions with a probability
/// of about 1e-4 per share and child (Poisson).
fn a_rare_child_is_drawn_as_rarely_as_it_should(first: bool) {
    let kernel = COUNT.compile(&[]);
    let [never, few] = [1e-9, 3e-7].map(|share| rare_draws(&kernel, share, first));
    assert!(never <= 3, "first {first}: {never} draws, 0.1 expected");
    assert!((12..=54).contains(&few), "first {first}: {few} draws, 30 expected");
}

#[test]
fn a_rare_first_child_is_drawn_as_rarely_as_it_should() {
    a_rare_child_is_drawn_as_rarely_as_it_should(true);
}

#[test]
fn a_rare_second_child_is_drawn_as_rarely_as_it_should() {
    a_rare_child_is_drawn_as_rarely_as_it_should(false);
}

/// Negative control: a share that is three times as large.
#[test]
fn a_child_that_is_drawn_three_times_as_often_is_noticed() {
    let many = rare_draws(&COUNT.compile(&[]), 1e-6, true);
    assert!(many > 54, "{many} draws at a share three times as large would pass");
}
