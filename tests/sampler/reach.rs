//! In thousands of small degenerate trees, every vertex inside the gate has a probability above 0. The walk visits all vertices.

use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::Item;
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::{NONE, TreeNode};

use crate::shader_function::contents;
use crate::walk::{Ends, Pool, Query, odd_items, odd_query, paper_bound, walk};
use crate::{BOUNDS, Input, device_bounds, input};

const TREES: usize = 10_000;

/// Trees with one query each. The nodes of all trees are concatenated in one array.
fn trees() -> Vec<(Pool, Query)> {
    let mut pcg = Pcg::new(91);
    let (mut first_node, mut first_vertex) = (0, 0);
    (0..TREES)
        .map(|i| {
            let spatial = i % 2 == 0;
            let (items, scale) = odd_items(&mut pcg, spatial);
            let query = odd_query(&mut pcg, &items, scale);
            let pool = Pool::new(items, [1, 4, 16][pcg.below(3)], spatial, first_node, first_vertex);
            first_node += pool.nodes.len() as u32;
            first_vertex += pool.items.len() as u32;
            (pool, query)
        })
        .collect()
}

/// Asserts that every vertex inside the gate has P > 0, and that the probabilities of all ends sum to 1. Returns the number
/// of vertices inside the gate and the number of vertices with P = 0.
pub fn check(pool: &Pool, query: &Query, ends: &Ends) -> [usize; 2] {
    let mut valid = 0;
    for (item, p) in pool.items.iter().zip(&ends.items).filter(|(item, _)| query.is_valid(item)) {
        valid += 1;
        assert!(
            *p > 0.0,
            "{item:?} of {} can never be drawn by {query:?}, spatial {}: {:?}",
            pool.items.len(),
            pool.spatial,
            pool.nodes
        );
    }
    let sum = ends.items.iter().sum::<f64>() + ends.dead;
    assert!((sum - 1.0).abs() < 1e-5 || pool.root == NONE, "the probabilities of all ends sum to {sum}");
    [valid, ends.items.iter().filter(|&&p| p == 0.0).count()]
}

fn totals(found: impl Iterator<Item = [usize; 2]>) {
    let [valid, dead] = found.fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    assert!(valid > 20_000 && dead > 10_000, "{valid} vertices inside their gates, {dead} with P = 0");
}

#[test]
fn the_papers_bounds_reach_every_valid_vertex() {
    totals(trees().iter().map(|(pool, query)| {
        let bound = |node: u32| {
            let node = pool.nodes[(node - pool.first_node) as usize];
            [node.left, node.right].map(|child| paper_bound(&child, query, pool.spatial))
        };
        check(pool, query, &walk(pool, bound))
    }));
}

#[test]
fn the_devices_bounds_reach_every_valid_vertex() {
    let trees = trees();
    let nodes: Vec<TreeNode> = trees.iter().flat_map(|(pool, _)| pool.nodes.clone()).collect();
    let inputs: Vec<Input> = trees
        .iter()
        .flat_map(|(pool, query)| {
            (0..pool.nodes.len() as u32).map(|i| input(query, pool.first_node + i, pool.spatial, 0))
        })
        .collect();
    let bounds: Vec<[f32; 2]> = BOUNDS.run(&inputs, &[contents("tree_nodes", &nodes)]);
    totals(
        trees.iter().map(|(pool, query)| check(pool, query, &walk(pool, |node| bounds[node as usize].map(f64::from)))),
    );
}

#[test]
fn an_empty_pool_has_no_root() {
    let pool = Pool::new(vec![], 1, false, 0, 0);
    assert_eq!((pool.root, pool.nodes.len()), (NONE, 0));
}

/// Two far vertices have the smallest power that a tree keeps, and lie at the edge of the shell. Their bound was a denormal
/// number, which a device may flush to 0: then the vertex inside the gate could not be drawn.
#[test]
fn bounds_of_the_weakest_vertices_are_normal_numbers() {
    let at = |x: f32, power: f32, index| Item { point: [x, 0.0, 0.0, 0.0], power, index };
    let kernel = BOUNDS.compile(&[]);
    for distance in [100.0f32, 1e3, 1e4, 1e5] {
        let items = vec![at(0.0, 1.0, 0), at(1.0, 1.0, 1), at(distance, 1e-38, 2), at(1.3 * distance, 1e-38, 3)];
        let pool = Pool::new(items, 1, true, 0, 0);
        let reach = f64::from(distance);
        let query = Query { q: [0.0; 3], gate: Gate { lo: reach * 0.99999, hi: reach * 1.00001 }, eta_hi: 1.0 };
        let bounds = device_bounds(&kernel, &pool, &query);
        assert!(bounds[0][1] >= f64::from(f32::MIN_POSITIVE), "{distance} m: bounds {bounds:?}");
        let ends = walk(&pool, |node| bounds[node as usize]);
        assert_eq!(check(&pool, &query, &ends)[0], 1);
    }
}
