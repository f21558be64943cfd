//! `shared/vertex.wgsl`: sides, cosines, indices of refraction and ray origins of every kind of vertex.

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::wgsl::layout::PathVertex;
use taugate::internals::wgsl::layout::constants::*;

use crate::materials::set;
use crate::scatter::buffers;
use crate::shader_function::ShaderFunction;
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&SIDES];

const SIDES: ShaderFunction = ShaderFunction {
    imports: &["vertex"],
    input: "v: PathVertex, w: vec3<f32>, pad: f32",
    result: "step: vec3<f32>, cosine: f32, end: vec3<f32>, faces: u32, eta: vec2<f32>, pad: vec2<f32>",
    body: "result.cosine = vertex_cosine(input.v, input.w); result.faces = u32(faces(input.v, input.w));
        result.eta = eta_range(input.v); result.step = ray_offset(input.v, input.w); result.end = ray_end(input.v, input.w);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    v: PathVertex,
    w: [f32; 3],
    pad: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    step: [f32; 3],
    cosine: f32,
    end: [f32; 3],
    faces: u32,
    eta: [f32; 2],
    pad: [f32; 2],
}

/// A vertex of every kind, whether it has a normal, and whether it exchanges light on both sides.
fn kinds() -> Vec<(PathVertex, bool, bool)> {
    let glass =
        set().kinds.iter().position(|m| m.transmission > 0.0).expect("a material that lets light through") as u32;
    let opaque = set().kinds.iter().position(|m| m.transmission == 0.0).expect("an opaque material") as u32;
    let of = |material: u32, flags: u32| PathVertex { material, flags, eta: 1.0, ..Zeroable::zeroed() };
    vec![
        (of(opaque, VERTEX_FRONT), true, false),
        (of(glass, VERTEX_FRONT | VERTEX_TRANSMITS), true, true),
        (of(EMIT_ONE_SIDED, VERTEX_EMITTER), true, false),
        (of(EMIT_TWO_SIDED, VERTEX_EMITTER), true, true),
        (of(EMIT_POINT, VERTEX_EMITTER), false, true),
        (of(EMIT_SPOT, VERTEX_EMITTER), false, true),
    ]
}

#[test]
fn every_kind_of_vertex_knows_its_sides() {
    let mut pcg = Pcg::new(144);
    let kinds = kinds();
    let inputs: Vec<Input> = (0..3000)
        .map(|i| {
            let (v, has_normal, _) = kinds[i % kinds.len()];
            let offset = if has_normal { 1e-3 } else { 0.0 };
            let (position, geometric) = (vec3(3.0 * direction(&mut pcg)), vec3(direction(&mut pcg)));
            Input { v: PathVertex { position, geometric, offset, ..v }, w: vec3(direction(&mut pcg)), pad: 0.0 }
        })
        .collect();
    let results: Vec<Got> = SIDES.run(&inputs, &buffers());
    for (i, (g, r)) in inputs.iter().zip(&results).enumerate() {
        let (v, has_normal, both_sides) = kinds[i % kinds.len()];
        let side = dvec(&g.v.geometric).dot(dvec(&g.w));
        if side.abs() < 1e-5 {
            continue;
        }
        let cosine = if has_normal { side.abs() } else { 1.0 };
        assert!((f64::from(r.cosine) - cosine).abs() < 1e-6, "{g:?} {r:?}");
        assert_eq!(r.faces == 1, both_sides || side > 0.0, "{g:?} {r:?}");
        let transmits = v.flags & VERTEX_TRANSMITS != 0;
        let other = if transmits { set().kinds[v.material as usize].ior } else { 1.0 };
        assert_eq!(r.eta, [1.0, other.max(1.0)], "{g:?} {r:?}");
        // The ray starts beside the surface, on the side of `w`. A vertex without a surface has no offset.
        let step = f64::from(g.v.offset) * side.signum() * dvec(&g.v.geometric);
        assert!((dvec(&r.step) - step).length() < 1e-9, "{g:?} {r:?}");
        assert!((dvec(&r.end) - dvec(&g.v.position) - step).length() < 1e-6, "{g:?} {r:?}");
    }
}
