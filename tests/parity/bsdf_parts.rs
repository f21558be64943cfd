//! Parts of `shared/bsdf.wgsl`: Fresnel terms, GGX, the albedo of the coat, and the probabilities of the lobes.

use taugate::internals::generate::numbers::Pcg;
use taugate_oracle::{bsdf, ggx};

use crate::materials::set;
use crate::shader_function::ShaderFunction;
use crate::values::{dvec, polar, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&FRESNEL, &GGX, &LOBES, &RETROREFLECTION];

/// Whether `got` is within a relative tolerance of `expected`.
fn close(got: f32, expected: f64, tolerance: f64) -> bool {
    (f64::from(got) - expected).abs() <= tolerance * expected.abs()
}

const FRESNEL: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "cosine: f32, eta_i: f32, eta_t: f32, f0: f32",
    result: "dielectric: f32, schlick: f32",
    body: "result.dielectric = fresnel_dielectric(input.cosine, input.eta_i, input.eta_t);
        result.schlick = schlick(vec3<f32>(input.f0), input.cosine).y;",
};

#[test]
fn fresnel_terms() {
    let mut pcg = Pcg::new(31);
    let mut inputs: Vec<[f32; 4]> = vec![[1.0, 1.0, 1.5, 0.04], [0.0, 1.0, 1.5, 0.0], [0.0, 1.5, 1.0, 1.0]];
    inputs.extend((0..20_000).map(|i| {
        let eta = pcg.range(1.0, 2.5) as f32;
        let (a, b) = if i % 2 == 0 { (1.0, eta) } else { (eta, 1.0) };
        [pcg.range(0.0, 1.0).powi(3) as f32, a, b, pcg.uniform() as f32]
    }));
    let results: Vec<[f32; 2]> = FRESNEL.run(&inputs, &[]);
    for (g, r) in inputs.iter().zip(&results) {
        let [cosine, eta_i, eta_t, f0] = g.map(f64::from);
        let critical = 1.0 - (eta_i / eta_t).powi(2) * (1.0 - cosine * cosine);
        let expected = bsdf::fresnel_dielectric(cosine, eta_t / eta_i);
        // The refracted cosine is a square root. Its error grows as 1 / root near total reflection.
        let tolerance = 1e-5 + 1e-6 / critical.abs().sqrt().max(1e-3);
        assert!((f64::from(r[0]) - expected).abs() <= tolerance, "{g:?}: {} {expected}", r[0]);
        assert!((0.0..=1.0 + 1e-6).contains(&r[0]));
        assert!(close(r[1], f0 + (1.0 - f0) * (1.0 - cosine).powi(5), 1e-5), "{g:?}: {}", r[1]);
    }
}

const GGX: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "w: vec3<f32>, alpha: f32, h: vec3<f32>, pad: f32, u: vec2<f32>, pad2: vec2<f32>",
    result: "d: f32, lambda: f32, pdf: f32, pad: f32, h: vec3<f32>, pad2: f32",
    body: "result.d = ggx_d(input.h, input.alpha); result.lambda = ggx_lambda(input.w, input.alpha);
        result.pdf = ggx_visible_pdf(input.w, input.h, input.alpha);
        result.h = ggx_sample_visible(input.w, input.alpha, input.u);",
};

#[test]
fn ggx_agrees_with_f64() {
    let mut pcg = Pcg::new(32);
    let mut inputs: Vec<[f32; 12]> = vec![];
    for i in 0..30_000 {
        let alpha = [0.001, 0.01, 0.05, 0.3, 1.0][i % 5];
        let w = vec3(polar(if i % 7 == 0 { 2e-3 } else { pcg.range(1e-3, 1.0) }, pcg.range(0.0, 6.3)));
        // h is within a few widths of the lobe, where most of the lobe's power is.
        let tan = alpha * pcg.uniform().powi(2) * 10.0;
        let h = vec3(polar(1.0 / (1.0 + tan * tan).sqrt(), pcg.range(0.0, 6.3)));
        let u = [pcg.uniform(), pcg.uniform()].map(|x| x as f32);
        inputs.push([w[0], w[1], w[2], alpha as f32, h[0], h[1], h[2], 0.0, u[0], u[1], 0.0, 0.0]);
    }
    let results: Vec<[f32; 8]> = GGX.run(&inputs, &[]);
    for (g, r) in inputs.iter().zip(&results) {
        let (w, alpha, h) = (dvec(&g[..3]), f64::from(g[3]), dvec(&g[4..7]));
        assert!(close(r[0], ggx::distribution(alpha, h), 1e-5), "{g:?} {r:?}");
        let lambda = ggx::lambda(alpha, w);
        // Lambda is half of (root - 1), so rounding errors near 1 remain as an absolute error.
        assert!((f64::from(r[1]) - lambda).abs() <= 2e-7 + 1e-5 * lambda, "{g:?} {r:?} {lambda}");
        let pdf = ggx::distribution(alpha, h) * w.dot(h).max(0.0) / (w.z * (1.0 + lambda));
        // The cosine to h is a sum of three products, with an absolute error of 3e-7.
        let tolerance = 2e-5 + 3e-7 / w.dot(h).abs().max(1e-9);
        assert!(close(r[2], pdf, tolerance) || w.dot(h).abs() < 1e-6, "{g:?} {r:?} {pdf}");
        let drawn = dvec(&r[4..7]);
        assert!((drawn.length() - 1.0).abs() < 1e-5 && drawn.z >= 0.0 && drawn.dot(w) > -1e-6, "{g:?} {drawn}");
    }
}

const LOBES: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "base: vec3<f32>, cosine: f32, material: u32, front: u32, pad: vec2<u32>",
    result: "coat: f32, diffuse: f32, gloss: f32, glass: f32, clearcoat: f32, delta: u32, eta: f32",
    body: "let b = make_bsdf(input.material, input.base, input.front == 1u);
        result.coat = coat_albedo(b, input.cosine);
        let lobes = lobe_probabilities(b, input.cosine);
        result.diffuse = lobes.diffuse; result.gloss = lobes.gloss; result.glass = lobes.glass; result.clearcoat = lobes.clearcoat;
        result.delta = u32(is_delta(b)); result.eta = b.eta_below / b.eta_above;",
};

#[test]
fn lobes_and_the_albedo_of_the_coat() {
    let set = set();
    let mut pcg = Pcg::new(33);
    let mut inputs: Vec<[u32; 8]> = vec![];
    for i in 0..20_000 {
        let base = if i % 10 == 0 { [0.0f32; 3] } else { [0; 3].map(|_| pcg.uniform() as f32) };
        let cosine =
            [0.0, 1.0, 1e-4][i % 3] * f64::from(u8::from(i < 300)) + f64::from(u8::from(i >= 300)) * pcg.uniform();
        let [x, y, z] = base.map(f32::to_bits);
        inputs.push([x, y, z, (cosine as f32).to_bits(), pcg.below(set.kinds.len()) as u32, i as u32 & 1, 0, 0]);
    }
    let results: Vec<[u32; 7]> = LOBES.run(&inputs, &set.buffers());
    for (g, r) in inputs.iter().zip(&results) {
        let [x, y, z, cosine] = [g[0], g[1], g[2], g[3]].map(|v| f64::from(f32::from_bits(v)));
        let reference = set.at(g[4] as usize, [x, y, z]);
        let got = [r[0], r[1], r[2], r[3], r[4]].map(|v| f64::from(f32::from_bits(v)));
        let name = &set.kinds[g[4] as usize].name;
        // A position in the table is up to 31, where the error of f32 is about 2e-6.
        assert!((got[0] - reference.coat_albedo(cosine)).abs() < 1e-5, "{name} {cosine}: {got:?}");
        for (a, b) in got[1..].iter().zip(reference.lobes(cosine)) {
            assert!((a - b).abs() < 1e-4, "{name} {cosine}: {got:?} {:?}", reference.lobes(cosine));
        }
        assert!((got[1..].iter().sum::<f64>() - 1.0).abs() < 1e-6);
        assert_eq!(r[5] == 1, reference.is_delta(), "{name}");
        let ior = f64::from(set.kinds[g[4] as usize].ior);
        let eta = f64::from(f32::from_bits(r[6]));
        assert!((eta - if g[5] == 1 { ior } else { 1.0 / ior }).abs() < 1e-6);
    }
}

const RETROREFLECTION: ShaderFunction = ShaderFunction {
    imports: &["retroreflector"],
    input: "w: vec3<f32>, alpha: f32, u: vec2<f32>, pad: vec2<f32>",
    result: "direction: vec3<f32>, f: f32, pdf: f32, swapped: f32, reverse: f32, mirrored: f32",
    body: "let d = sample_retroreflection(input.alpha, input.w, input.u);
        result.direction = d; result.mirrored = dot(mirror_about_normal(input.w), input.w);
        if (d.z > 0.0) {
            result.f = retroreflection(input.alpha, d, input.w); result.swapped = retroreflection(input.alpha, input.w, d);
            result.pdf = retroreflection_pdf(input.alpha, input.w, d);
            result.reverse = retroreflection_pdf(input.alpha, d, input.w);
        }",
};

#[test]
fn retroreflection_agrees_with_f64() {
    let mut pcg = Pcg::new(34);
    let mut inputs: Vec<[f32; 8]> = vec![];
    for i in 0..30_000 {
        // The narrowest lobe, two typical lobes of road signs, and wide lobes.
        let alpha = [0.00136, 0.003, 0.014, 0.1, 0.9][i % 5];
        let w = vec3(polar(pcg.range(0.03, 1.0), pcg.range(0.0, 6.3)));
        inputs.push([w[0], w[1], w[2], alpha, pcg.uniform() as f32, pcg.uniform() as f32, 0.0, 0.0]);
    }
    let results: Vec<[f32; 8]> = RETROREFLECTION.run(&inputs, &[]);
    let turned = |w: glam::DVec3| glam::DVec3::new(-w.x, -w.y, w.z);
    for (g, r) in inputs.iter().zip(&results) {
        let (w, alpha, d) = (dvec(&g[..3]).normalize(), f64::from(g[3]), dvec(&r[..3]).normalize());
        assert!((f64::from(r[7]) - w.dot(turned(w))).abs() < 1e-6);
        if d.z < 0.02 {
            continue;
        }
        // The half vector has an absolute error of 2e-7, and the lobe a slope of at most 2 / alpha.
        let tolerance = 1e-3 + 5e-7 / alpha / w.z.min(d.z);
        let (f, pdf) = (ggx::lobe(alpha, turned(d), w), ggx::pdf(alpha, turned(d), w));
        assert!(close(r[3], f, tolerance) && close(r[5], f, tolerance), "{g:?} {r:?} {f}");
        assert!(close(r[4], pdf, tolerance), "{g:?} {r:?} {pdf}");
        assert!(close(r[6], ggx::pdf(alpha, turned(w), d), tolerance), "{g:?} {r:?}");
    }
}
