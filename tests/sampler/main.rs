//! Tests of the tree query. A walk on the host computes the probability of drawing each vertex from the bounds of the nodes. The
//! tests check the probabilities that the device returns, how often it draws each vertex, and the mean of its estimates. Every
//! vertex inside the gate must have a probability above 0.

#[path = "../common/device.rs"]
mod device;
#[path = "../common/shader_function.rs"]
mod shader_function;
#[path = "../common/statistics.rs"]
mod statistics;

mod reach;
mod stress;
mod walk;

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::material::Material;
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::{NONE, PathVertex, TreeNode};

use shader_function::{CompiledFunction, Contents, ShaderFunction, contents};
use statistics::{chi_square, level};
use walk::{Ends, Pool, Query, room, walk};

const BOUNDS: ShaderFunction = ShaderFunction {
    imports: &["lightcone"],
    input: "q: vec3<f32>, node: u32, lo: f32, hi: f32, spatial: u32, pad: u32, eta_hi: f32",
    result: "left: f32, right: f32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, input.eta_hi, 0.0, 0.0);
        result.left = node_bound(load_tree_child(input.node, 0u), shell, input.spatial == 1u);
        result.right = node_bound(load_tree_child(input.node, 1u), shell, input.spatial == 1u);",
};

const DRAW: ShaderFunction = ShaderFunction {
    imports: &["query"],
    input: "q: vec3<f32>, root: u32, lo: f32, hi: f32, spatial: u32, seed: u32, eta_hi: f32",
    result: "vertex: u32, weight: f32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, input.eta_hi, 0.0, 0.0);
        var rng = input.seed;
        let found = descend(input.root, shell, input.spatial == 1u, &rng);
        result.vertex = found.vertex; result.weight = found.weight;",
};

/// Input of both kernels. `number` is the index of a node for `BOUNDS` and the reference of the root for `DRAW`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    q: [f32; 3],
    number: u32,
    lo: f32,
    hi: f32,
    spatial: u32,
    seed: u32,
    eta_hi: f32,
    pad: [u32; 3],
}

fn input(query: &Query, number: u32, spatial: bool, seed: u32) -> Input {
    let [lo, hi] = query.shell();
    Input { q: query.q, number, lo, hi, spatial: spatial.into(), seed, eta_hi: query.eta_hi, pad: [0; 3] }
}

/// B(N, q) of both children of every node of a pool, as the device computes it.
fn device_bounds(kernel: &CompiledFunction, pool: &Pool, query: &Query) -> Vec<[f64; 2]> {
    let inputs: Vec<Input> =
        (0..pool.nodes.len() as u32).map(|i| input(query, pool.first_node + i, pool.spatial, 0)).collect();
    if inputs.is_empty() {
        return vec![];
    }
    let bounds: Vec<[f32; 2]> = kernel.run(&inputs, &[contents("tree_nodes", &pool.nodes)]);
    bounds.iter().map(|b| b.map(f64::from)).collect()
}

/// Probabilities of all ends of a traversal, from the device's bounds.
fn ends(kernel: &CompiledFunction, pool: &Pool, query: &Query) -> Ends {
    let bounds = device_bounds(kernel, pool, query);
    walk(pool, |node| bounds[(node - pool.first_node) as usize])
}

/// The results of `n` traversals: the index of the vertex among the pool's items (`None` at a dead end), and 1 / P.
fn draw(kernel: &CompiledFunction, pool: &Pool, query: &Query, n: usize, pcg: &mut Pcg) -> Vec<(Option<usize>, f64)> {
    let inputs: Vec<Input> = (0..n).map(|_| input(query, pool.root, pool.spatial, pcg.next_u32())).collect();
    let buffers = tree_buffers(&pool.nodes);
    let found: Vec<[u32; 2]> = kernel.run(&inputs, &buffers);
    found.iter().map(|&end| item_and_weight(pool, end)).collect()
}

/// Buffers for `DRAW`. `descend` reads only the nodes, but the imported modules declare the other buffers.
fn tree_buffers(nodes: &[TreeNode]) -> [Contents; 3] {
    let no_vertex: [PathVertex; 1] = Zeroable::zeroed();
    let no_material: [Material; 1] = Zeroable::zeroed();
    [contents("tree_nodes", nodes), contents("light_vertices", &no_vertex), contents("materials", &no_material)]
}

fn item_and_weight(pool: &Pool, [vertex, weight]: [u32; 2]) -> (Option<usize>, f64) {
    ((vertex != NONE).then(|| (vertex - pool.first_vertex) as usize), f32::from_bits(weight).into())
}

/// A random shade point, and a gate of 1 m near the travel time through one of the vertices. Travel times in [`room`] span
/// about 10 m.
fn query_of_room(pcg: &mut Pcg, pool: &Pool) -> Query {
    let q = [pcg.range(-4.0, 4.0) as f32, pcg.range(-2.0, 2.0) as f32, pcg.range(-4.0, 4.0) as f32];
    let about = pool.items[pcg.below(pool.items.len())].point;
    let tau = f64::from((0..3).map(|k| (about[k] - q[k]).powi(2)).sum::<f32>().sqrt() + about[3]);
    let shift = pcg.range(-0.4, 0.4);
    Query { q, gate: Gate { lo: tau + shift - 0.5, hi: tau + shift + 0.5 }, eta_hi: 1.0 }
}

/// How often each vertex was drawn; the last count is of dead ends.
fn counts(found: &[(Option<usize>, f64)], items: usize) -> Vec<f64> {
    let mut counts = vec![0.0; items + 1];
    found.iter().for_each(|(item, _)| counts[item.unwrap_or(items)] += 1.0);
    counts
}

/// p-value of the counts of `n` traversals against the probabilities of the walk.
fn p_value(counts: &[f64], ends: &Ends, n: usize) -> f64 {
    let expected: Vec<f64> = ends.items.iter().chain([&ends.dead]).map(|p| p * n as f64).collect();
    chi_square(counts, &expected)
}

#[test]
fn draws_have_the_probabilities_of_the_walk() {
    const N: usize = 100_000;
    let (bounds, draws) = (BOUNDS.compile(&[]), DRAW.compile(&[]));
    let mut pcg = Pcg::new(81);
    let sizes = [1, 2, 64, 1000];
    let level = level(sizes.len() * 3 * 2 * 2 * 2);
    let (mut valid, mut dead) = (0, 0.0);
    for (n, leaf, spatial) in sizes
        .iter()
        .flat_map(|&n| [1, 4, 16].map(|leaf| (n, leaf)))
        .flat_map(|(n, leaf)| [(n, leaf, true), (n, leaf, false)])
    {
        let pool = Pool::new(room(&mut pcg, n, spatial), leaf, spatial, 0, 7);
        for _ in 0..2 {
            let query = query_of_room(&mut pcg, &pool);
            let name = format!("{n} vertices, leaf {leaf}, spatial {spatial}, {query:?}");
            let ends = ends(&bounds, &pool, &query);
            let sum: f64 = ends.items.iter().sum();
            assert!((sum + ends.dead - 1.0).abs() < 1e-5, "{name}: probabilities sum to {sum} + {}", ends.dead);
            let found = draw(&draws, &pool, &query, N, &mut pcg);

            // The device returns 1 / P with the P of the walk. The product of ten ratios in f32 has a relative error of about 1e-6.
            for &(item, weight) in &found {
                if let Some(j) = item {
                    let p = ends.items[j];
                    assert!((weight * p - 1.0).abs() < 1e-4, "{name}: 1 / P is {weight}, P of the walk {p}");
                }
            }
            let p = p_value(&counts(&found, n), &ends, N);
            assert!(p > level, "{name}: p = {p:e}, level {level:e}");

            // The expected value of the estimator f / P is the sum of f over all valid vertices, unless one of them has P = 0.
            let f = |j: usize| if query.is_valid(&pool.items[j]) { 1.0 + (j % 5) as f64 } else { 0.0 };
            let exhaustive: f64 = (0..n).map(f).sum();
            let reached: f64 =
                (0..n).filter(|&j| ends.items[j] > 0.0).map(|j| ends.items[j] * (f(j) / ends.items[j])).sum();
            assert!((reached - exhaustive).abs() <= 1e-9 * exhaustive, "{name}: expected {reached}, sum {exhaustive}");
            let mean = found.iter().map(|&(item, weight)| item.map_or(0.0, |j| f(j) * weight)).sum::<f64>() / N as f64;
            let second: f64 = (0..n).filter(|&j| f(j) > 0.0).map(|j| f(j) * f(j) / ends.items[j]).sum();
            let error = ((second - exhaustive * exhaustive).max(0.0) / N as f64).sqrt();
            // Rare vertices skew the distribution of the mean. Where every vertex is drawn more than 25 times on average, the
            // mean is nearly normal: a deviation of 4.5 sigma has p = 7e-6.
            let often = (0..n).all(|j| f(j) == 0.0 || ends.items[j] * N as f64 > 25.0);
            if often {
                assert!(
                    (mean - exhaustive).abs() <= 4.5 * error + 1e-5 * exhaustive,
                    "{name}: mean {mean} +- {error}, sum {exhaustive}"
                );
            }
            valid += (0..n).filter(|&j| f(j) > 0.0).count();
            dead += ends.dead;
        }
    }
    assert!(valid > 500 && dead > 0.01, "{valid} valid vertices, probability {dead} of dead ends");
}

#[test]
fn one_over_p_averages_to_one() {
    const N: usize = 400_000;
    let (bounds, draws) = (BOUNDS.compile(&[]), DRAW.compile(&[]));
    let mut pcg = Pcg::new(82);
    for spatial in [true, false] {
        let pool = Pool::new(room(&mut pcg, 64, spatial), 4, spatial, 0, 0);
        let query = query_of_room(&mut pcg, &pool);
        let ends = ends(&bounds, &pool, &query);
        let mut sums = [0.0; 64];
        for (item, weight) in draw(&draws, &pool, &query, N, &mut pcg) {
            item.into_iter().for_each(|j| sums[j] += weight / N as f64);
        }
        let level = 4.2; // Standard errors. Two-sided, p = 2.7e-5 per vertex: below 4e-3 for all vertices of both trees.
        for (j, item) in pool.items.iter().enumerate().filter(|(_, item)| query.is_valid(item)) {
            let error = ((1.0 / ends.items[j] - 1.0) / N as f64).sqrt();
            assert!(error < 0.2, "vertex {j} is too rare for this test: {}", ends.items[j]);
            assert!((sums[j] - 1.0).abs() < level * error, "{item:?}: mean {} +- {error}", sums[j]);
        }
    }
}

/// With 2 million draws, the chi-square test detects probabilities that are 1 % wrong, and a gate that is 2 % late.
#[test]
fn slightly_wrong_probabilities_are_rejected() {
    const N: usize = 2_000_000;
    let (bounds, draws) = (BOUNDS.compile(&[]), DRAW.compile(&[]));
    let mut pcg = Pcg::new(83);
    for spatial in [true, false] {
        let pool = Pool::new(room(&mut pcg, 64, spatial), 1, spatial, 0, 0);
        let query = query_of_room(&mut pcg, &pool);
        let right = ends(&bounds, &pool, &query);
        let counts = counts(&draw(&draws, &pool, &query, N, &mut pcg), 64);
        let level = level(4);
        let p = p_value(&counts, &right, N);
        assert!(p > level, "spatial {spatial}: right probabilities have p = {p:e}");

        // Vertices with half of the total probability get 1 % more, the others 1 % less.
        let mut below = 0.0;
        let wrong: Vec<f64> = right
            .items
            .iter()
            .map(|p| {
                below += p;
                p * if below < 0.5 { 1.01 } else { 0.99 }
            })
            .collect();
        let total = wrong.iter().sum::<f64>() + right.dead;
        let scaled = Ends { items: wrong.iter().map(|p| p / total).collect(), dead: right.dead / total };
        let p = p_value(&counts, &scaled, N);
        assert!(p < level, "spatial {spatial}: P off by 1 % passes with p = {p:e}");

        let late = Query { gate: Gate { lo: query.gate.lo * 1.02, hi: query.gate.hi * 1.02 }, ..query };
        let p = p_value(&counts, &ends(&bounds, &pool, &late), N);
        assert!(p < level, "spatial {spatial}: a gate off by 2 % passes with p = {p:e}");
    }
}
