//! Edge cases of all kinds of surfaces: alpha from the narrowest lobe that is not a delta up to 1, and angles up to 0.1
//! degrees from grazing. Samples agree with evaluation, the BSDF is reciprocal, and no surface reflects more light than it
//! receives.

use std::sync::OnceLock;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::parts;
use taugate::internals::scene::{Material, Retroreflector};

use crate::bsdf_sample::{Input, even, random};
use crate::materials::Set;
use crate::shader_function::{CompiledFunction, ShaderFunction};
use crate::values::{dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&EDGE];

/// The smallest alpha is just above DELTA_ALPHA, 0.001, below which a lobe is a delta.
pub const ALPHAS: [f64; 5] = [1.05e-3, 0.01, 0.1, 0.5, 1.0];
/// Angles from the normal, in degrees.
pub const ANGLES: [f64; 6] = [0.0, 45.0, 75.0, 85.0, 89.0, 89.9];

/// White rough surfaces of every kind and alpha, then one diffuse surface and three smooth ones.
pub fn edges() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| {
        let white = [1.0; 3];
        let rough = |m: Material| ALPHAS.map(|alpha| Material { roughness: alpha.sqrt() as f32, ..m.clone() });
        let mut kinds = vec![];
        kinds.extend(rough(parts::metal("conductor", white, 1.0)));
        kinds.extend(rough(parts::plastic("plastic", white, 1.0)));
        kinds.extend(rough(parts::glass("rough glass")));
        kinds.extend(rough(Material { ior: 3.0, ..parts::glass("dense glass") }));
        kinds.push(parts::diffuse("lambert", white));
        kinds.push(parts::metal("mirror", white, 0.0));
        kinds.push(parts::plastic("smooth plastic", white, 0.0));
        kinds.push(parts::glass("smooth glass"));
        let coat = |m: Material| Material { clearcoat: 1.0, ..m };
        kinds.extend(rough(coat(parts::metal("coated metal", white, 1.0))));
        let rough_coat =
            |roughness| Material { clearcoat_roughness: roughness, ..coat(parts::diffuse("coated", white)) };
        kinds.extend([0.1, 0.5, 1.0].map(rough_coat));
        let retroreflecting = |angle| Material {
            retroreflector: Some(Retroreflector { share: 1.0, angle }),
            ..parts::diffuse("retroreflector", white)
        };
        let [min, max] = [Retroreflector::MIN_ANGLE, Retroreflector::MAX_ANGLE];
        kinds.extend([min, 1.0, 10.0, max].map(retroreflecting));
        Set::new(kinds)
    })
}

const EDGE: ShaderFunction = ShaderFunction {
    imports: &["bsdf_sample"],
    input: "u: vec4<f32>, w: vec3<f32>, material: u32, to_light: u32, front: u32, pad: vec2<u32>",
    result: "direction: vec3<f32>, pdf: f32, weight: f32, f: f32, swapped: f32, eval_pdf: f32, valid: u32, delta: u32,
        pdf_reverse: f32, eval_reverse: f32",
    body: "let b = make_bsdf(input.material, vec3<f32>(1.0), input.front == 1u);
        let s = bsdf_sample(b, input.w, input.to_light == 1u, input.u);
        let wl = select(input.w, s.direction, input.to_light == 1u);
        let wc = select(s.direction, input.w, input.to_light == 1u);
        let v = bsdf_eval(b, wl, wc);
        result.direction = s.direction; result.pdf = s.pdf; result.weight = s.weight.x;
        result.valid = u32(s.valid); result.delta = u32(s.delta); result.pdf_reverse = s.pdf_reverse;
        result.f = v.f.x; result.swapped = bsdf_eval(b, wc, wl).f.x;
        result.eval_pdf = select(v.pdf_to_sensor, v.pdf_to_light, input.to_light == 1u);
        result.eval_reverse = select(v.pdf_to_light, v.pdf_to_sensor, input.to_light == 1u);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Got {
    pub direction: [f32; 3],
    pub pdf: f32,
    pub weight: f32,
    pub f: f32,
    swapped: f32,
    eval_pdf: f32,
    pub valid: u32,
    pub delta: u32,
    pdf_reverse: f32,
    eval_reverse: f32,
}

/// A surface, and one known direction of light.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub material: usize,
    pub angle: f64,
    pub front: bool,
    pub to_light: bool,
}

impl View {
    /// The known direction, rounded to f32 as on the device.
    pub fn w(&self) -> DVec3 {
        // Sine and cosine are computed separately, so that the cosine of 89.9 degrees keeps its digits.
        let (sine, cosine) = self.angle.to_radians().sin_cos();
        DVec3::new(sine * 0.6, sine * 0.8, cosine).as_vec3().as_dvec3()
    }

    pub fn name(&self) -> String {
        let m = &edges().kinds[self.material];
        let View { angle, front, to_light, .. } = self;
        format!("{} {} alpha {:.4} at {angle}, front {front}, to light {to_light}", m.name, m.ior, m.roughness.powi(2))
    }
}

/// Every surface at every angle. Glass is seen from both sides, and sampled towards the light and towards the sensor.
pub fn views() -> Vec<View> {
    let mut views = vec![];
    for (material, m) in edges().kinds.iter().enumerate() {
        let sides: &[(bool, bool)] = match m.transmission > 0.0 {
            true => &[(true, true), (true, false), (false, true), (false, false)],
            false => &[(true, true)],
        };
        for &angle in &ANGLES {
            views.extend(sides.iter().map(|&(front, to_light)| View { material, angle, front, to_light }));
        }
    }
    views
}

/// Samples of all views, from one dispatch. Returns one list per view, with one sample per element of `uniforms`.
pub fn sample(kernel: &CompiledFunction, views: &[View], uniforms: &[[f32; 4]]) -> Vec<Vec<Got>> {
    let inputs: Vec<Input> = views
        .iter()
        .flat_map(|v| {
            uniforms.iter().map(|&u| Input {
                u,
                w: vec3(v.w()),
                material: v.material as u32,
                to_light: v.to_light.into(),
                front: v.front.into(),
                pad: [0; 2],
            })
        })
        .collect();
    let got: Vec<Got> = kernel.run(&inputs, &edges().buffers());
    got.chunks_exact(uniforms.len()).map(<[Got]>::to_vec).collect()
}

pub fn kernel() -> CompiledFunction {
    EDGE.compile(&[])
}

#[test]
fn samples_agree_with_evaluation_and_light_runs_either_way() {
    let uniforms: Vec<[f32; 4]> = random(161, 2000).collect();
    let views = views();
    let mut compared = 0;
    let mut wrong = vec![];
    for (view, samples) in views.iter().zip(sample(&kernel(), &views, &uniforms)) {
        let reference = edges().at(view.material, [1.0; 3]);
        for s in samples.iter().filter(|s| s.valid == 1) {
            let d = dvec(&s.direction);
            let numbers = [s.pdf, s.pdf_reverse, s.weight, s.f, s.swapped];
            assert!(numbers.iter().all(|x| x.is_finite()) && (d.length() - 1.0).abs() < 1e-5, "{}: {s:?}", view.name());
            if s.delta == 1 {
                assert!(s.pdf == 1.0 && s.pdf_reverse == 1.0, "{s:?}");
                continue;
            }
            compared += 1;
            let (wl, wc) = if view.to_light { (d, view.w()) } else { (view.w(), d) };
            let (index_l, index_c) = (reference.index(wl, view.front), reference.index(wc, view.front));
            // The length of a direction has an error of about 1e-7. The two cosines to the facet then have a relative
            // difference of 1e-7 over the cosine.
            let h = (index_l * reference.facing_lobe(wl) + index_c * wc).normalize();
            let facet = h.dot(reference.facing_lobe(wl)).abs().min(h.dot(wc).abs());
            // Vulkan allows `inverseSqrt` an error of 2 ULP, and `normalize` and `reflect` inherit it. Reflection at a facet
            // of length 1 + e returns a direction of length 1 + 4 e. So the length of a direction shows the error of its
            // cosines.
            let off = (d.length() - 1.0).abs().max(1e-7);
            // Near total reflection, the Fresnel terms depend on the refracted cosine, which is a root of a small difference.
            let ior2 = f64::from(edges().kinds[view.material].ior).powi(2);
            let root = (1.0 - ior2 * (1.0 - facet * facet)).abs().sqrt().max(1e-4);
            let fresnel = if view.front { 0.0 } else { 20.0 * off * ior2 / root };
            let tolerance = 1e-5 + if d.z > 0.0 { 1e-6 / facet + fresnel } else { 1e-6 / (facet * facet) };
            let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= tolerance * b.abs();
            // Reciprocity: swapping the directions scales f by the squared ratio of the indices of refraction.
            let ratio = (index_l / index_c).powi(2);
            let agrees = close(s.weight * s.pdf, s.f.into())
                && close(s.pdf, s.eval_pdf.into())
                && close(s.pdf_reverse, s.eval_reverse.into());
            if !agrees || !close(s.swapped, ratio * f64::from(s.f)) {
                wrong.push(format!("{}: {s:?}", view.name()));
            }
            // Reciprocity without the squared ratio must fail.
            assert!(ratio == 1.0 || tolerance > 0.1 || !close(s.swapped, s.f.into()), "{s:?}");
        }
    }
    assert!(wrong.is_empty(), "{} of {compared}\n{}", wrong.len(), wrong[..wrong.len().min(20)].join("\n"));
    assert!(compared > 200_000, "only {compared} samples compared");
}

/// The fraction of light that leaves a surface. Samples towards the light carry radiance, which changes with the index of
/// refraction; the sum undoes that change.
fn albedo(view: &View, samples: &[Got]) -> f64 {
    let reference = edges().at(view.material, [1.0; 3]);
    let returned = samples.iter().filter(|s| s.valid == 1).map(|s| {
        let d = dvec(&s.direction);
        let cosine = if s.delta == 1 { 1.0 } else { d.z.abs() };
        let squeeze = match view.to_light {
            true => (reference.index(d, view.front) / reference.index(view.w(), view.front)).powi(2),
            false => 1.0,
        };
        f64::from(s.weight) * cosine * squeeze
    });
    returned.sum::<f64>() / samples.len() as f64
}

/// White furnace: a white surface under uniform light may not be brighter than the light. Evenly spread samples have an error
/// of 1e-4. Smooth and diffuse surfaces return all light. Rough surfaces lose the light that scatters several times between
/// facets.
#[test]
fn a_white_furnace_gains_nothing_at_the_edges() {
    let uniforms: Vec<[f32; 4]> = even(1 << 15).collect();
    let (views, mut wrong) = (views(), vec![]);
    let kernel = kernel();
    for (views, found) in views.chunks(40).map(|v| (v, sample(&kernel, v, &uniforms))) {
        for (view, samples) in views.iter().zip(&found) {
            let (m, albedo) = (&edges().kinds[view.material], albedo(view, samples));
            let is_smooth = m.roughness == 0.0 || m.specular == 0.0;
            let lossless = is_smooth && m.clearcoat == 0.0 && m.retroreflector.is_none();
            let least = if lossless { 0.999 } else { 0.3 };
            if m.name == "conductor" {
                println!("| {:.4} | {} | {albedo:.3} |", m.roughness.powi(2), view.angle);
            }
            if !(albedo <= 1.0 + 1e-3 && albedo >= least) {
                wrong.push(format!("{}: {albedo}", view.name()));
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {}\n{}", wrong.len(), views.len(), wrong.join("\n"));
}

/// The furnace test would detect a sampler whose weights are 0.5 % too large.
#[test]
fn a_furnace_that_gains_half_a_percent_is_noticed() {
    let uniforms: Vec<[f32; 4]> = even(1 << 15).collect();
    let lambert = edges().named("lambert", 1.0);
    let view = View { material: lambert, angle: 45.0, front: true, to_light: true };
    let mut samples = sample(&kernel(), &[view], &uniforms).remove(0);
    samples.iter_mut().for_each(|s| s.weight *= 1.005);
    assert!(albedo(&view, &samples) > 1.0 + 1e-3);
}
