//! Times what the host builds: the light trees of an iteration, and the BVH of a scene.
//!
//!     cargo bench --bench host [-- FILTER]

#[path = "../common/flatten.rs"]
mod flatten;

use divan::Bencher;
use divan::counter::ItemsCount;
use taugate::internals::bvh;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};

fn main() {
    divan::main();
}

/// Random light vertices in a room of 10 m x 4 m x 10 m, with travel times up to 30 m.
fn items(n: usize) -> Vec<Item> {
    let mut pcg = Pcg::new(3);
    let mut next = |scale: f64| (scale * pcg.uniform()) as f32;
    let item = |index| Item { point: [next(10.0), next(4.0), next(10.0), next(30.0)], power: next(1.0) + 1e-6, index };
    (0..n as u32).map(item).collect()
}

#[divan::bench(args = [10_000, 200_000, 1_600_000], consts = [1, 8], sample_count = 7, sample_size = 1)]
fn tree_build<const LEAF: usize>(bencher: Bencher, vertices: usize) {
    let items = items(vertices);
    let options = TreeOptions { leaf_size: LEAF, buckets: 8, first_node: 0, first_vertex: 0 };
    bencher
        .counter(ItemsCount::new(vertices))
        .with_inputs(|| items.clone())
        .bench_local_refs(|items| Tree::build(items, options));
}

#[divan::bench(args = [10_000, 200_000, 1_000_000], sample_count = 7, sample_size = 1)]
fn bvh_build(bencher: Bencher, triangles: u32) {
    let (corners, _) = flatten::cluttered_room(triangles);
    bencher.counter(ItemsCount::new(corners.len())).bench_local(|| bvh::build(&corners));
}
