//! `bsdf_eval` against f64: its value, both densities, and reciprocity. Values of opaque materials are also compared with the
//! oracle.

use std::f64::consts::{PI, TAU};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;

use crate::materials::set;
use crate::shader_function::ShaderFunction;
use crate::values::{dvec, polar, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&EVAL];

const EVAL: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "wl: vec3<f32>, material: u32, wc: vec3<f32>, front: u32, base: vec3<f32>, pad: f32",
    result: "f: vec3<f32>, to_light: f32, swapped: vec3<f32>, to_sensor: f32, back_to_light: f32, back_to_sensor: f32,
        black: f32, parts: f32",
    body: "var b = make_bsdf(input.material, input.base, input.front == 1u);
        let v = bsdf_eval(b, input.wl, input.wc);
        result.f = v.f; result.to_light = v.pdf_to_light; result.to_sensor = v.pdf_to_sensor;
        let s = bsdf_eval(b, input.wc, input.wl);
        result.swapped = s.f; result.back_to_light = s.pdf_to_light; result.back_to_sensor = s.pdf_to_sensor;
        if (input.wl.z > 0.0 && input.wc.z > 0.0) {
            result.parts = bsdf_eval_reflection(b, input.wl, input.wc).f.x;
        } else if (input.wl.z * input.wc.z < 0.0 && !is_delta(b)) {
            result.parts = bsdf_eval_transmission(b, input.wl, input.wc).f.x;
        }
        b.black = true;
        result.black = bsdf_eval(b, input.wl, input.wc).f.x;",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Input {
    wl: [f32; 3],
    material: u32,
    wc: [f32; 3],
    front: u32,
    base: [f32; 3],
    pad: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    f: [f32; 3],
    to_light: f32,
    swapped: [f32; 3],
    to_sensor: f32,
    back_to_light: f32,
    back_to_sensor: f32,
    black: f32,
    parts: f32,
}

/// Random pairs of directions. Half of them are near the mirrored or refracted direction, where narrow lobes are. Some
/// directions are close to grazing.
fn inputs(n: usize) -> Vec<Input> {
    let set = set();
    let mut pcg = Pcg::new(41);
    let cosine = |pcg: &mut Pcg| if pcg.below(6) == 0 { pcg.range(2e-3, 0.03) } else { pcg.range(0.03, 1.0) };
    (0..n)
        .map(|i| {
            let material = i % set.kinds.len();
            let glass = set.kinds[material].transmission > 0.0;
            let front = pcg.below(2);
            let azimuth = pcg.range(0.0, TAU);
            let wc = polar(cosine(&mut pcg), azimuth) * if glass && pcg.below(2) == 0 { -1.0 } else { 1.0 };
            let mut wl = polar(cosine(&mut pcg), pcg.range(0.0, TAU));
            let width = 3.0 * f64::from(set.kinds[material].roughness).powi(2) * pcg.range(-1.0, 1.0);
            let across = glass && pcg.below(2) == 0;
            if pcg.below(2) == 0 {
                let mut sine = (1.0 - wc.z * wc.z).max(0.0).sqrt();
                if across {
                    let ior = f64::from(set.kinds[material].ior);
                    sine = (sine * if (front == 1) == (wc.z > 0.0) { 1.0 / ior } else { ior }).min(0.999);
                }
                let turned = wc.y.atan2(wc.x) + PI + width;
                wl = polar(((1.0 - sine * sine).sqrt() + width).clamp(2e-3, 1.0), turned);
            }
            if let Some(retroreflector) = set.kinds[material].retroreflector
                && pcg.below(3) == 0
            {
                // Near the direction that the light comes from.
                let width = f64::from(retroreflector.angle).to_radians() * pcg.range(-2.0, 2.0);
                wl = polar((wc.z + width).clamp(2e-3, 1.0), azimuth + width * pcg.range(0.0, 1.0));
            }
            if (wc.z < 0.0) != across {
                wl.z = -wl.z;
            }
            let base = [0; 3].map(|_| if i % 9 == 0 { 1.0 } else { pcg.uniform() as f32 });
            Input { wl: vec3(wl), material: material as u32, wc: vec3(wc), front: front as u32, base, pad: 0.0 }
        })
        .collect()
}

/// Relative tolerance of f and of densities. A narrow lobe amplifies the rounding error of the half vector by its slope,
/// about 4 / alpha (alpha is at least 0.05 here). Grazing directions divide the error by their cosine.
const TOLERANCE: f64 = 1e-3;

/// For a refraction, the smaller of the cosines between the facet normal and the two directions. For a reflection, 1.
///
/// Near total reflection, the shader computes this cosine as the root of a difference, which f32 rounds by a few 1e-7. The
/// relative error of the transmitted light is then 1e-6 over the squared cosine.
fn facet_cosine(wl: DVec3, wc: DVec3, front: bool, ior: f64) -> f64 {
    if wl.z * wc.z > 0.0 {
        return 1.0;
    }
    let index = |w: DVec3| if (w.z > 0.0) == front { 1.0 } else { ior };
    let h = (index(wl) * wl + index(wc) * wc).normalize();
    h.dot(wl).abs().min(h.dot(wc).abs())
}

#[test]
fn values_and_densities_agree_with_f64() {
    let set = set();
    let inputs = inputs(150_000);
    let results: Vec<Got> = EVAL.run(&inputs, &set.buffers());
    let (mut reflected, mut refracted, mut oracle) = (0, 0, 0);
    for (g, r) in inputs.iter().zip(&results) {
        // Normalize again in f64: near total reflection, the half vector is sensitive to the lengths of both directions.
        let (wl, wc, front) = (dvec(&g.wl).normalize(), dvec(&g.wc).normalize(), g.front == 1);
        let base = g.base.map(f64::from);
        let reference = set.at(g.material as usize, base);
        let m = &set.kinds[g.material as usize];
        let f = reference.f(wl, wc, front);
        // `TOLERANCE` assumes that alpha is at least 0.05. A retroreflector may have a smaller alpha.
        let steep = m.retroreflector.map_or(0.0, |r| 3e-7 / (r.alpha() * wl.z.min(wc.z).abs()));
        let tolerance = TOLERANCE + steep + 1e-6 / facet_cosine(wl, wc, front, m.ior.into()).powi(2);
        let close = |got: f32, expected: f64, floor: f64| {
            (f64::from(got) - expected).abs() <= tolerance * expected.abs() + floor
        };
        for k in 0..3 {
            assert!(close(r.f[k], f[k], 1e-7), "{} alpha {}: {g:?} {r:?}\n f {f:?}", m.name, reference.alpha);
        }
        assert_eq!(r.black, 0.0);
        let same = r.parts == r.f[0] || (wl.z < 0.0 && wc.z < 0.0) || m.clearcoat > 0.0 || m.retroreflector.is_some();
        assert!(same, "bsdf_eval differs from its reflection or transmission part: {g:?} {r:?}");
        if wl.z < 0.0 && wc.z < 0.0 {
            continue;
        }
        if f[0] > 0.0 {
            for (got, expected) in
                [(r.to_light, reference.pdf(wc, wl, front)), (r.to_sensor, reference.pdf(wl, wc, front))]
            {
                assert!(
                    close(got, expected, 1e-7),
                    "{} alpha {}: {g:?} {r:?}\n pdf {expected}",
                    m.name,
                    reference.alpha
                );
            }
        }
        // Reciprocity: swapping the directions scales f by the squared ratio of the indices of refraction.
        let index = |z: f64| if (z > 0.0) == front { 1.0 } else { f64::from(m.ior) };
        let ratio = (index(wl.z) / index(wc.z)).powi(2);
        for k in 0..3 {
            assert!(close(r.swapped[k], ratio * f64::from(r.f[k]), 1e-7), "{g:?} {r:?} {ratio}");
        }
        if f[0] > 0.0 {
            assert!(
                close(r.back_to_sensor, r.to_light.into(), 1e-7) && close(r.back_to_light, r.to_sensor.into(), 1e-7)
            );
        }
        if wl.z * wc.z < 0.0 {
            refracted += usize::from(f[0] > 0.0);
            continue;
        }
        reflected += usize::from(f[0] > 0.0);
        // The oracle's table of the coat's albedo is finer towards grazing angles. There the 32 linear cells of the
        // renderer's table are off by 0.003, so the diffuse part may differ by 1 % of an uncoated base.
        if m.transmission == 0.0 {
            let independent = set.prepared[g.material as usize].at(base).eval(wl, wc);
            // Under a clear coat, both tables together may be off by 3 % of the transmitted light at grazing angles.
            let under = if m.clearcoat > 0.0 { 3e-2 } else { 0.0 };
            let coated = if m.specular > 0.0 { f64::from(1.0 - m.metallic) } else { 0.0 };
            for k in 0..3 {
                let floor = 1e-7 + 1e-2 * coated * base[k] / PI + under * independent[k];
                assert!(close(r.f[k], independent[k], floor), "{}: {g:?} {r:?}\n oracle {independent:?}", m.name);
            }
            oracle += 1;
        }
    }
    assert!(
        reflected > 40_000 && refracted > 5_000 && oracle > 40_000,
        "{reflected} reflections, {refracted} refractions, {oracle} compared with the oracle"
    );
}

#[test]
fn exactly_grazing_directions_give_nothing() {
    let set = set();
    let mut inputs = vec![];
    for material in 0..set.kinds.len() as u32 {
        for (wl, wc) in [
            ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ] {
            inputs.push(Input { wl, material, wc, front: 1, base: [1.0; 3], pad: 0.0 });
        }
    }
    let results: Vec<Got> = EVAL.run(&inputs, &set.buffers());
    assert!(results.iter().all(|r| r.f == [0.0; 3] && r.to_light == 0.0 && r.to_sensor == 0.0));
}

/// A past bug: the reverse density mixed the half vector of a mirrored frame with the direction of an inverted frame.
#[test]
fn the_reverse_density_of_a_rough_refraction() {
    let set = set();
    let rough_glass = set.named("rough glass", 0.3);
    let (wl, wc) = (polar(-0.84, 6.06).as_vec3(), polar(0.75, 3.43).as_vec3());
    let input =
        Input { wl: wl.into(), material: rough_glass as u32, wc: wc.into(), front: 1, base: [1.0; 3], pad: 0.0 };
    let r: Vec<Got> = EVAL.run(&[input], &set.buffers());
    // The same pair of directions with the surface turned upside down.
    let turn = |w: glam::Vec3| [w.x, -w.y, -w.z];
    let turned = Input { wl: turn(wc), wc: turn(wl), front: 0, ..input };
    let t: Vec<Got> = EVAL.run(&[turned], &set.buffers());
    assert!((r[0].to_sensor / t[0].to_light - 1.0).abs() < 1e-4, "{} {}", r[0].to_sensor, t[0].to_light);
}

/// The specular factor of KHR_materials_specular scales the coat at all angles. A past bug scaled only its reflectance at
/// normal incidence.
#[test]
fn specular_below_one_dims_the_coat_at_grazing_angles() {
    let set = set();
    let half = set.kinds.iter().position(|m| m.name == "half specular").unwrap();
    let (wl, wc) = (polar(0.05, 0.0), polar(0.05, PI));
    let input = Input { wl: vec3(wl), material: half as u32, wc: vec3(wc), front: 1, base: [0.0; 3], pad: 0.0 };
    let r: Vec<Got> = EVAL.run(&[input], &set.buffers());
    let expected = set.prepared[half].at([0.0; 3]).eval(wl, wc)[0];
    assert!((f64::from(r[0].f[0]) / expected - 1.0).abs() < 1e-3, "{} {expected}", r[0].f[0]);
}
