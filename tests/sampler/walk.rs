//! Trees over random vertices, and a walk that computes the probability of drawing each vertex from the bounds of the nodes.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::gate::rounding_allowance;
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::constants::{LEAF_BIT, LEAF_FIRST};
use taugate::internals::wgsl::layout::{NONE, TreeChild, TreeNode};
use taugate_oracle::lightcone::{self, Bounds, Extent};

/// A tree over light vertices. Its nodes and vertices may start anywhere in arrays that several trees share.
pub struct Pool {
    pub items: Vec<Item>,
    pub nodes: Vec<TreeNode>,
    pub root: u32,
    pub first_node: u32,
    pub first_vertex: u32,
    /// Whether this is a 3D tree, in which v_tau of every vertex is 0.
    pub spatial: bool,
}

impl Pool {
    pub fn new(mut items: Vec<Item>, leaf_size: usize, spatial: bool, first_node: u32, first_vertex: u32) -> Pool {
        let Tree { nodes, root } =
            Tree::build(&mut items, TreeOptions { leaf_size, buckets: 8, first_node, first_vertex });
        Pool { items, nodes, root, first_node, first_vertex, spatial }
    }
}

/// A shade point, and the gate minus the travel time of the sensor subpath.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    pub q: [f32; 3],
    pub gate: Gate,
    /// Index of refraction on the far side of the shade point's surface; 1 for opaque surfaces. The near side has index 1.
    pub eta_hi: f32,
}

impl Query {
    /// Ends of the light-cone shell: the gate, widened for rounding as `make_shell` does it.
    pub fn shell(&self) -> [f32; 2] {
        let slack = rounding_allowance(self.gate, 0.0);
        [self.gate.lo as f32 - slack, (self.gate.hi as f32).min(3e38) + slack]
    }

    /// Whether a connection to this vertex can meet the gate.
    pub fn is_valid(&self, item: &Item) -> bool {
        let v = DVec3::new(item.point[0].into(), item.point[1].into(), item.point[2].into());
        let q = DVec3::new(self.q[0].into(), self.q[1].into(), self.q[2].into());
        // The connection runs on either side of the surface. Its optical path is its length times eta of that side.
        let through = |eta: f64| lightcone::in_shell(self.gate, eta * v, item.point[3].into(), eta * q, 0.0);
        through(1.0) || through(self.eta_hi.into())
    }
}

/// The probabilities of all ends of a traversal.
pub struct Ends {
    /// P of each item of the pool: the probability of its leaf, divided by the number of items in the leaf.
    pub items: Vec<f64>,
    /// Probability of a dead end: a node whose children both have a bound of 0.
    pub dead: f64,
}

/// Computes the probabilities of all ends (Eq. 5). `bounds` returns B(N, q) of the two children of a node.
pub fn walk(pool: &Pool, bounds: impl Fn(u32) -> [f64; 2]) -> Ends {
    let mut ends = Ends { items: vec![0.0; pool.items.len()], dead: 0.0 };
    let mut open = if pool.root == NONE { vec![] } else { vec![(pool.root, 1.0)] };
    while let Some((reference, p)) = open.pop() {
        if reference & LEAF_BIT != 0 {
            let first = ((reference & LEAF_FIRST) - pool.first_vertex) as usize;
            let count = ((reference >> 27) & 15) as usize + 1;
            ends.items[first..first + count].fill(p / count as f64);
            continue;
        }
        let node = pool.nodes[(reference - pool.first_node) as usize];
        let [left, right] = bounds(reference);
        if left + right <= 0.0 {
            ends.dead += p;
            continue;
        }
        for (child, bound) in [(node.left, left), (node.right, right)] {
            if bound > 0.0 {
                open.push((child.child, p * bound / (left + right)));
            }
        }
    }
    ends
}

/// B(N, q) by the oracle's equations. In the 3D tree, a node that the shell only touches keeps 1/1000 of its power, as in the
/// shader.
pub fn paper_bound(child: &TreeChild, query: &Query, spatial: bool) -> f64 {
    let wide = |v: [f32; 3]| DVec3::new(v[0].into(), v[1].into(), v[2].into());
    let (bounds, q) = (Bounds { min: wide(child.lo), max: wide(child.hi) }, wide(query.q));
    let node = Extent { bounds, tau: [child.tau_lo.into(), child.tau_hi.into()] };
    let gate = Gate { lo: query.shell()[0].into(), hi: query.shell()[1].into() };
    if lightcone::pruned(gate, node, q, 0.0) {
        return 0.0;
    }
    let bytes = [child.buckets_low.to_le_bytes(), child.buckets_high.to_le_bytes()].concat();
    let buckets: Vec<f64> = bytes.iter().map(|&b| f64::from(b) * f64::from(child.power_unit)).collect();
    let power = if spatial {
        lightcone::effective_power_3d(gate, buckets[0], bounds, q, 0.0).max(1e-3 * buckets[0])
    } else {
        lightcone::effective_power_4d(gate, node, &buckets, q, 0.0)
    };
    let near = lightcone::distances(q, bounds).0;
    power / (near * near).max(0.25 * (bounds.max - bounds.min).length_squared()).max(1e-20)
}

/// `n` vertices in a room of 8 m x 4 m x 8 m. Their travel times span 10 m (0 in a 3D tree), their powers three orders of
/// magnitude.
pub fn room(pcg: &mut Pcg, n: usize, spatial: bool) -> Vec<Item> {
    let mut place = |size: f64| pcg.range(-size, size) as f32;
    (0..n as u32)
        .map(|index| {
            let point = [place(4.0), place(2.0), place(4.0), if spatial { 0.0 } else { 6.0 + place(5.0) }];
            Item { point, power: 10f32.powf(place(1.5)), index }
        })
        .collect()
}

/// Up to 40 vertices that may be degenerate in several ways: powers over 30 orders of magnitude, coincident vertices, equal
/// travel times, boxes that are flat or a single point. Also returns the scale of the scene, from 0.01 m to 1000 m.
pub fn odd_items(pcg: &mut Pcg, spatial: bool) -> (Vec<Item>, f64) {
    let n = [0, 1, 2, 3, 5, 8, 17, 40][pcg.below(8)];
    let scale = [0.01, 1.0, 30.0, 1000.0][pcg.below(4)];
    let orders = [0.0, 4.0, 30.0][pcg.below(3)];
    let extent: [f64; 4] = std::array::from_fn(|_| [0.0, 1e-6, 0.1, 1.0][pcg.below(4)]);
    let coincident = pcg.below(6) == 0;
    let centre: [f64; 3] = std::array::from_fn(|_| pcg.range(-1.0, 1.0));
    let start = pcg.range(0.0, 2.0);
    let mut point = [0.0f32; 4];
    let items = (0..n as u32)
        .map(|index| {
            if index == 0 || !coincident || pcg.below(8) == 0 {
                for k in 0..3 {
                    point[k] = (scale * (centre[k] + extent[k] * pcg.range(-1.0, 1.0))) as f32;
                }
                point[3] = if spatial { 0.0 } else { (scale * (start + extent[3] * pcg.uniform())) as f32 };
            }
            Item { point, power: 10f64.powf(-orders * pcg.uniform()) as f32, index }
        })
        .collect();
    (items, scale)
}

/// A shade point at a vertex, among the vertices or far from them. The gate lies near the travel time through one of the
/// vertices; it may be thin, or have no end.
pub fn odd_query(pcg: &mut Pcg, items: &[Item], scale: f64) -> Query {
    let mut q: [f32; 3] = std::array::from_fn(|_| (scale * pcg.range(-1.5, 1.5)) as f32);
    let mut near = scale * pcg.range(0.0, 3.0);
    if !items.is_empty() {
        let item = items[pcg.below(items.len())];
        if pcg.below(4) == 0 {
            q = [item.point[0], item.point[1], item.point[2]];
        }
        let target = items[pcg.below(items.len())];
        let d2: f64 = (0..3).map(|k| f64::from(target.point[k] - q[k]).powi(2)).sum();
        near = f64::from(target.point[3]) + d2.sqrt();
    }
    let gate = match pcg.below(5) {
        0 => Gate { lo: 0.0, hi: f64::INFINITY },
        1 => Gate { lo: near * 0.9, hi: f64::INFINITY },
        2 => Gate { lo: near * (1.0 - 1e-4 * pcg.uniform()), hi: near * 1.0001 + 1e-6 },
        _ => Gate { lo: near * pcg.range(0.7, 1.0), hi: near * pcg.range(1.0, 1.3) + 1e-6 },
    };
    // The device stores the gate in f32.
    Query { q, gate: Gate { lo: f64::from(gate.lo as f32), hi: f64::from(gate.hi as f32) }, eta_hi: 1.0 }
}
