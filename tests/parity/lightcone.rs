//! `shared/lightcone.wgsl`: pruning nodes, and the bounds of their power in the light-cone shell (Eqs. 18 to 24).

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::TreeChild;
use taugate_oracle::lightcone::{self, Bounds, Extent};

use crate::shader_function::ShaderFunction;
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&BOUNDS];

const BOUNDS: ShaderFunction = ShaderFunction {
    imports: &["lightcone"],
    input: "c: TreeChild, q: vec3<f32>, lo: f32, hi: f32, eta_hi: f32, pad: vec2<f32>",
    result: "d: vec2<f32>, pruned: u32, overlap: f32, buckets: f32, bound3: f32, bound4: f32, first: f32",
    body: "let shell = Shell(input.q, input.lo, input.hi, 1.0, input.eta_hi, 0.0, 0.0);
        let d = box_distances(input.q, input.c.lo, input.c.hi) * vec2<f32>(1.0, input.eta_hi);
        result.d = d;
        result.pruned = u32(is_pruned(input.c.tau_lo, input.c.tau_hi, d, shell));
        result.overlap = spatial_overlap(d, shell);
        result.buckets = bucket_power(input.c, d, shell);
        result.bound3 = node_bound(input.c, shell, true);
        result.bound4 = node_bound(input.c, shell, false);
        result.first = bytes_to_floats(input.c.buckets_low).x + 256.0 * bytes_to_floats(input.c.buckets_high).w;",
};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Input {
    child: TreeChild,
    q: [f32; 3],
    lo: f32,
    hi: f32,
    eta_hi: f32,
    pad: [f32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    d: [f32; 2],
    pruned: u32,
    overlap: f32,
    buckets: f32,
    bound3: f32,
    bound4: f32,
    first: f32,
}

struct Case {
    input: Input,
    items: Vec<Item>,
}

/// Children of trees over a few vertices, with their vertices and a shell. They include degenerate boxes, equal travel times,
/// shade points inside the box, and thin gates.
fn cases(n: usize) -> Vec<Case> {
    let mut pcg = Pcg::new(11);
    let mut cases = vec![];
    while cases.len() < n {
        let size = [0.0, 1e-6, 0.1, 1.0, 10.0][pcg.below(5)];
        let duration = [0.0, 1e-5, 0.3, 5.0][pcg.below(4)];
        let centre = direction(&mut pcg) * pcg.range(0.0, 20.0);
        let start = pcg.range(0.0, 30.0);
        let mut items: Vec<Item> = (0..2 * (1 + pcg.below(8)) as u32)
            .map(|index| {
                let p = vec3(centre + size * direction(&mut pcg));
                let tau = (start + duration * pcg.uniform()) as f32;
                Item { point: [p[0], p[1], p[2], tau], power: 10f64.powf(pcg.range(-6.0, 2.0)) as f32, index }
            })
            .collect();
        let options = TreeOptions { leaf_size: 1, buckets: 8, first_node: 0, first_vertex: 0 };
        let tree = Tree::build(&mut items, options);
        let half = items.len() / 2;
        let q = match pcg.below(4) {
            0 => dvec(&items[0].point[..3]),
            1 => centre + 0.5 * size * direction(&mut pcg),
            _ => direction(&mut pcg) * pcg.range(0.0, 20.0),
        };
        let eta_hi = if pcg.below(4) == 0 { 1.5 } else { 1.0 };
        // The gate starts near the travel time through a vertex, or anywhere.
        let about = pcg.below(items.len());
        let near = (dvec(&items[about].point[..3]) - q).length() + f64::from(items[about].point[3]);
        let lo = if pcg.below(4) == 0 { pcg.range(0.0, 60.0) } else { near + 3.0 * pcg.range(-1.0, 1.0).powi(3) };
        let hi = match pcg.below(5) {
            0 => 3e38,
            1 => lo + 1e-3,
            _ => lo + pcg.range(0.0, 2.0),
        };
        let root = tree.nodes[0];
        for (child, items) in [(root.left, items[..half].to_vec()), (root.right, items[half..].to_vec())] {
            let input = Input { child, q: vec3(q), lo: lo as f32, hi: hi as f32, eta_hi, pad: [0.0; 2] };
            cases.push(Case { input, items });
        }
    }
    cases
}

/// Rounding error of a bound, in metres. Times and distances are below 100 m, where f32 has steps of 2^-17 m; a bound adds a
/// few of them.
const EPSILON: f64 = 4e-5;

/// The power of each travel-time bucket.
fn powers(c: &TreeChild) -> [f64; 8] {
    let bytes = [c.buckets_low.to_le_bytes(), c.buckets_high.to_le_bytes()].concat();
    std::array::from_fn(|i| f64::from(bytes[i]) * f64::from(c.power_unit))
}

#[test]
fn bounds_agree_with_the_paper_in_f64() {
    let cases = cases(20_000);
    let inputs: Vec<Input> = cases.iter().map(|c| c.input).collect();
    let results: Vec<Got> = BOUNDS.run(&inputs, &[]);
    let (mut pruned, mut kept, mut inside) = (0, 0, 0);
    for (g, r) in inputs.iter().zip(&results) {
        let c = &g.child;
        let node =
            Extent { bounds: Bounds { min: dvec(&c.lo), max: dvec(&c.hi) }, tau: [c.tau_lo.into(), c.tau_hi.into()] };
        let q = dvec(&g.q);
        let (near, far) = lightcone::distances(q, node.bounds);
        let far = far * f64::from(g.eta_hi);
        // The inputs are exact in f32. A difference, a length and a product have a relative error below four steps of 2^-24.
        assert!((f64::from(r.d[0]) - near).abs() <= 2.5e-7 * near, "{r:?} {near}");
        assert!((f64::from(r.d[1]) - far).abs() <= 2.5e-7 * far, "{r:?} {far}");
        inside += usize::from(near == 0.0);
        let bytes = [c.buckets_low.to_le_bytes(), c.buckets_high.to_le_bytes()].concat();
        assert_eq!(r.first, f32::from(bytes[0]) + 256.0 * f32::from(bytes[7]));

        // Eq. 19. The device may decide differently only where the boundary is closer than the rounding error.
        let gate = Gate { lo: g.lo.into(), hi: g.hi.into() };
        let beyond = (gate.lo - node.tau[1] - far).max(node.tau[0] + near - gate.hi);
        if beyond.abs() > EPSILON {
            assert_eq!(r.pruned == 1, beyond > 0.0, "{r:?} {beyond}");
        }
        if r.pruned == 1 {
            pruned += 1;
            assert_eq!([r.bound3, r.bound4], [0.0; 2]);
            continue;
        }
        kept += 1;
        if g.eta_hi == 1.0 {
            compare_powers(g, r, node, gate, q, (near, far));
        }
        // B(N, q) is power over squared distance. The squared distance is at least the squared half diagonal of the box.
        let half2 = 0.25 * (node.bounds.max - node.bounds.min).length_squared();
        let least2 = (near * near).max(half2).max(1e-20);
        // With `spatial`, the bound also contains the spatial overlap. In a real 3D tree all power is in bucket 0; these nodes use
        // all buckets.
        let buckets = f64::from(r.buckets);
        for (bound, power) in [(r.bound3, buckets * f64::from(r.overlap)), (r.bound4, buckets)] {
            let expected = power / least2;
            // d_min has an error of EPSILON / 10, so 1 / d_min^2 has twice its relative error.
            let tolerance = 1e-4 + if near * near > half2 { EPSILON * 0.2 / near } else { 0.0 };
            assert!(
                (f64::from(bound) / expected - 1.0).abs() < tolerance || expected == 0.0,
                "{bound} {expected} {near}"
            );
        }
    }
    assert!(
        pruned > 2_000 && kept > 5_000 && inside > 1_000,
        "{pruned} nodes pruned, {kept} kept, {inside} with q inside the box"
    );
}

/// Compares the effective power of a node with the oracle's.
fn compare_powers(g: &Input, r: &Got, node: Extent, gate: Gate, q: DVec3, (near, far): (f64, f64)) {
    // Eq. 22. The shader keeps 1/1000 of the power of a node that the shell only touches, and all power of a node whose
    // distances from q are all equal. Nodes whose distances are almost equal are skipped: rounding decides their share.
    let share = lightcone::effective_power_3d(gate, 1.0, node.bounds, q, 0.0);
    let tolerance = 1e-5 + EPSILON / (far - near).max(1e-9);
    assert!(r.overlap > 0.0 && r.overlap <= 1.0 + 1e-6, "{r:?}");
    if tolerance < 0.1 {
        assert!((f64::from(r.overlap) - share.max(1e-3)).abs() <= tolerance, "{r:?} {share} {tolerance}");
    }
    // Eqs. 23 and 24. The device may keep or drop a bucket that is within rounding of the gate's ends.
    let buckets = powers(&g.child);
    let wide = Gate { lo: gate.lo - EPSILON, hi: gate.hi + EPSILON };
    let narrow = Gate { lo: gate.lo + EPSILON, hi: gate.hi - EPSILON };
    let most = lightcone::effective_power_4d(wide, node, &buckets, q, 0.0);
    let least = lightcone::effective_power_4d(narrow, node, &buckets, q, 0.0);
    let got = f64::from(r.buckets);
    assert!(got >= least * (1.0 - 1e-6) && got <= most * (1.0 + 1e-6), "{least} <= {got} <= {most}");
}

#[test]
fn a_node_with_a_valid_vertex_has_the_power_of_its_bucket() {
    let cases = cases(40_000);
    // The renderer widens the shell by more than the rounding error. These shells are not widened, so the test ignores
    // vertices that are within EPSILON of the gate's ends.
    let inputs: Vec<Input> = cases.iter().map(|c| c.input).collect();
    let results: Vec<Got> = BOUNDS.run(&inputs, &[]);
    let mut valid = 0;
    for (case, r) in cases.iter().zip(&results) {
        let g = &case.input;
        let gate = Gate { lo: f64::from(g.lo) + EPSILON, hi: f64::from(g.hi) - EPSILON };
        for item in &case.items {
            let d = (dvec(&item.point[..3]) - dvec(&g.q)).length();
            let v_tau = f64::from(item.point[3]);
            let open = [1.0, f64::from(g.eta_hi)].iter().any(|eta| lightcone::in_gate(gate, v_tau + eta * d));
            if !open {
                continue;
            }
            valid += 1;
            assert_eq!(r.pruned, 0, "{item:?} {r:?}");
            assert!(r.bound4 > 0.0 && f64::from(r.buckets) >= f64::from(item.power) * (1.0 - 1e-6), "{item:?} {r:?}");
        }
    }
    assert!(valid > 10_000, "only {valid} vertices inside their gates");
}
