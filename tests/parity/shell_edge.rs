//! No vertex that `gate_weight` accepts is pruned, even if its travel time is within rounding of the gate's edge.

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::lightcone::tree::{Item, Tree, TreeOptions};
use taugate::internals::render::material::Material;
use taugate::internals::settings::units::Gate;
use taugate::internals::wgsl::layout::{PathVertex, TreeChild};

use crate::shader_function::{ShaderFunction, contents};
use crate::values::{direction, frame_with_gate, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&EDGE, &GATE];

const GATE: ShaderFunction = ShaderFunction {
    imports: &["gate"],
    input: "v_tau: f32, connection: f32, q_tau: f32",
    result: "open: u32",
    body: "result.open = u32(gate_weight(travel_time(input.v_tau, input.connection, input.q_tau)));",
};

#[test]
fn the_gate_is_half_open() {
    let gate = Gate { lo: 8.0, hi: 12.0 };
    let (below, above) = (8f32.next_down(), 12f32.next_down());
    let inputs = [
        ([8.0, 0.0, 0.0], 1),
        ([2.0, 3.0, 3.0], 1),
        ([0.0, below, 0.0], 0),
        ([0.0, 0.0, above], 1),
        ([4.0, 4.0, 4.0], 0),
        ([0.0, 0.0, 0.0], 0),
        ([3e38, 0.0, 0.0], 0),
        ([f32::NAN, 0.0, 10.0], 0),
    ];
    let input: Vec<[f32; 3]> = inputs.iter().map(|i| i.0).collect();
    let open: Vec<u32> = GATE.run(&input, &[frame_with_gate(gate)]);
    assert_eq!(open, inputs.map(|i| i.1));
    // An empty gate accepts nothing. Two gates that touch accept no travel time twice.
    let closed: Vec<u32> = GATE.run(&input, &[frame_with_gate(Gate { lo: 8.0, hi: 8.0 })]);
    assert!(closed.iter().all(|&o| o == 0));
    let next: Vec<u32> = GATE.run(&input, &[frame_with_gate(Gate { lo: 12.0, hi: f64::INFINITY })]);
    assert!(open.iter().zip(&next).all(|(a, b)| a + b <= 1) && next[4] == 1);
}

const EDGE: ShaderFunction = ShaderFunction {
    imports: &["query", "segment"],
    input: "c: TreeChild, q: vec3<f32>, q_tau: f32, v: vec3<f32>, v_tau: f32",
    result: "open: u32, bound3: f32, bound4: f32, tau: f32",
    body: "var q: PathVertex;
        q.position = input.q; q.tau = input.q_tau; q.eta = 1.0;
        let shell = make_shell(q);
        let offset = input.v - input.q;
        let d = sqrt(dot(offset, offset));
        result.tau = input.v_tau + d + input.q_tau;
        result.open = u32(gate_weight(travel_time(input.v_tau, optical_length(q, offset / d, d), input.q_tau)));
        result.bound3 = node_bound(input.c, shell, true);
        result.bound4 = node_bound(input.c, shell, false);",
};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Input {
    child: TreeChild,
    q: [f32; 3],
    q_tau: f32,
    v: [f32; 3],
    v_tau: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    open: u32,
    bound3: f32,
    bound4: f32,
    tau: f32,
}

/// Nodes with one to four vertices. For one of the vertices, q_tau is chosen such that the travel time of the path is within
/// a few rounding steps of `edge`.
fn cases(edge: f64, spatial: bool, buckets: u32, n: usize) -> Vec<Input> {
    let mut pcg = Pcg::new(21);
    let mut cases = vec![];
    while cases.len() < n {
        let extent = [0.0, 1e-6, 0.5, 5.0][pcg.below(4)];
        let duration = if spatial { 0.0 } else { [0.0, 1e-6, 0.5, 5.0][pcg.below(4)] };
        let (centre, start) = (direction(&mut pcg) * pcg.range(0.0, 0.3 * edge), 0.2 * edge * pcg.uniform());
        let mut items: Vec<Item> = (0..2 + 2 * pcg.below(4) as u32)
            .map(|index| {
                let p = vec3(centre + extent * direction(&mut pcg));
                let tau = if spatial { 0.0 } else { (start + duration * pcg.uniform()) as f32 };
                Item { point: [p[0], p[1], p[2], tau], power: 1.0, index }
            })
            .collect();
        let options = TreeOptions { leaf_size: 1, buckets, first_node: 0, first_vertex: 0 };
        let tree = Tree::build(&mut items, options);
        let q = vec3(direction(&mut pcg) * pcg.range(0.0, 0.3 * edge));
        let half = items.len() / 2;
        for (child, range) in [(tree.nodes[0].left, 0..half), (tree.nodes[0].right, half..items.len())] {
            let item = items[range.start + pcg.below(range.len())];
            let v = [item.point[0], item.point[1], item.point[2]];
            let d = (glam::Vec3::from(v) - glam::Vec3::from(q)).length();
            let steps = pcg.range(-3.0, 3.0) * edge * 6e-8;
            let q_tau = (edge - f64::from(d) - f64::from(item.point[3]) + steps) as f32;
            if q_tau >= 0.0 {
                cases.push(Input { child, q, q_tau, v, v_tau: item.point[3] });
            }
        }
    }
    cases
}

/// Asserts that no accepted vertex is pruned at one end of a gate, in both trees and with 8 and 5 buckets.
fn check(gate: Gate, edge: f64) {
    let kernels = [8u32, 5].map(|buckets| (buckets, EDGE.compile(&[("BUCKET_COUNT", buckets.into())])));
    for ((buckets, kernel), spatial) in kernels.iter().flat_map(|k| [(k, true), (k, false)]) {
        let inputs = cases(edge, spatial, *buckets, 20_000);
        let material = Material { ior: 1.0, ..Zeroable::zeroed() };
        let no_vertex: [PathVertex; 1] = Zeroable::zeroed();
        let buffers =
            [frame_with_gate(gate), contents("materials", &[material]), contents("light_vertices", &no_vertex)];
        let results: Vec<Got> = kernel.run(&inputs, &buffers);
        let open = results.iter().filter(|r| r.open == 1).count();
        assert!(
            open > 4_000 && open < 16_000,
            "the gate accepts {open} of {} vertices at the edge {edge} of {gate:?}",
            inputs.len()
        );
        let bound = |r: &Got| if spatial { r.bound3 } else { r.bound4 };
        assert!(results.iter().all(|r| bound(r).is_finite()));
        let dropped: Vec<_> = results.iter().filter(|r| r.open == 1 && bound(r) <= 0.0).collect();
        assert!(
            dropped.is_empty(),
            "{gate:?}, spatial {spatial}, {buckets} buckets: {} of {open} valid vertices pruned, such as {:?}",
            dropped.len(),
            dropped[0]
        );
    }
}

#[test]
fn a_vertex_at_the_edge_of_a_gate_is_kept() {
    for gate in [Gate { lo: 20.0, hi: 20.5 }, Gate { lo: 300.0, hi: 300.02 }] {
        check(gate, gate.lo);
        check(gate, gate.hi);
    }
}

#[test]
fn a_vertex_at_the_edge_of_an_open_gate_is_kept() {
    check(Gate { lo: 20.0, hi: f64::INFINITY }, 20.0);
}
