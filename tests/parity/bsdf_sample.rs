//! `bsdf_sample`: directions against their density by chi-square, weights against f / pdf, and the white furnace.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::scene::Material;

use crate::materials::{ALPHAS, Reference, set};
use crate::shader_function::{CompiledFunction, ShaderFunction};
use crate::statistics::{chi_square, level};
use crate::values::{dvec, polar, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&SAMPLE];

const SAMPLE: ShaderFunction = ShaderFunction {
    imports: &["bsdf_sample"],
    input: "u: vec4<f32>, w: vec3<f32>, material: u32, to_light: u32, front: u32, pad: vec2<u32>",
    result: "direction: vec3<f32>, pdf: f32, weight: vec3<f32>, pdf_reverse: f32, valid: u32, delta: u32, pad: vec2<u32>",
    body: "let b = make_bsdf(input.material, vec3<f32>(1.0), input.front == 1u);
        let s = bsdf_sample(b, input.w, input.to_light == 1u, input.u);
        result.direction = s.direction; result.pdf = s.pdf; result.weight = s.weight; result.pdf_reverse = s.pdf_reverse;
        result.valid = u32(s.valid); result.delta = u32(s.delta);",
};

/// Input of one sample: random numbers, the known direction and the surface. `bsdf_edges` uses it too.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Input {
    pub u: [f32; 4],
    pub w: [f32; 3],
    pub material: u32,
    pub to_light: u32,
    pub front: u32,
    pub pad: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Got {
    direction: [f32; 3],
    pdf: f32,
    weight: [f32; 3],
    pdf_reverse: f32,
    valid: u32,
    delta: u32,
    pad: [u32; 2],
}

#[derive(Clone, Copy)]
struct Case {
    material: usize,
    /// Known direction, above the surface.
    w: DVec3,
    front: bool,
    to_light: bool,
}

fn run(kernel: &CompiledFunction, case: Case, uniforms: impl Iterator<Item = [f32; 4]>) -> Vec<Got> {
    let Case { material, w, front, to_light } = case;
    let inputs: Vec<Input> = uniforms
        .map(|u| Input {
            u,
            w: vec3(w),
            material: material as u32,
            to_light: to_light.into(),
            front: front.into(),
            pad: [0; 2],
        })
        .collect();
    kernel.run(&inputs, &set().buffers())
}

/// Uniform random numbers of 24 bits, as kernels draw them.
pub fn random(seed: u64, n: usize) -> impl Iterator<Item = [f32; 4]> {
    let mut pcg = Pcg::new(seed);
    (0..n).map(move |_| [0; 4].map(|_| (pcg.next_u32() >> 8) as f32 / 16_777_216.0))
}

/// Evenly spread points of the unit cube (Roberts 2018, the R sequence in four dimensions).
pub fn even(n: usize) -> impl Iterator<Item = [f32; 4]> {
    let g: f64 = 1.167_303_978_261_418_7;
    (0..n).map(move |i| {
        [1, 2, 3, 4].map(|k| ((0.5 + i as f64 * g.powi(-k)).fract() as f32).min(1.0 - 1.0 / 16_777_216.0))
    })
}

const BINS: usize = 32;

/// Cell of a direction, in equal steps of cosine and azimuth.
fn bin(d: DVec3) -> usize {
    let cell = |x: f64| ((x * BINS as f64) as usize).min(BINS - 1);
    let azimuth = d.y.atan2(d.x) / std::f64::consts::TAU;
    cell(0.5 + 0.5 * d.z) * BINS + cell(azimuth - azimuth.floor())
}

/// Probability of each cell of the sphere, by integrating `pdf` over solid angle. The last entry is the probability of a
/// lost sample.
fn expected(pdf: impl Fn(DVec3) -> f64) -> Vec<f64> {
    const STEPS: usize = 20;
    let mut cells = vec![0.0; BINS * BINS + 1];
    let n = BINS * STEPS;
    for i in 0..n {
        for j in 0..n {
            let d = polar(2.0 * (i as f64 + 0.5) / n as f64 - 1.0, std::f64::consts::TAU * (j as f64 + 0.5) / n as f64);
            cells[i / STEPS * BINS + j / STEPS] += pdf(d) * 4.0 * std::f64::consts::PI / (n * n) as f64;
        }
    }
    cells[BINS * BINS] = (1.0 - cells.iter().sum::<f64>()).max(0.0);
    cells
}

fn cases() -> Vec<Case> {
    let set = set();
    let mut cases = vec![];
    let mut add = |material, cosine, front, to_light| {
        cases.push(Case { material, w: polar(cosine, 0.7).as_vec3().as_dvec3(), front, to_light });
    };
    add(set.named("lambert", 1.0), 0.6, true, true);
    for alpha in ALPHAS {
        add(set.named("conductor", alpha), 0.8, true, true);
        add(set.named("conductor", alpha), 0.2, true, false);
    }
    add(set.named("plastic", 0.3), 0.4, true, true);
    for (front, to_light) in [(true, true), (false, true), (true, false), (false, false)] {
        add(set.named("rough glass", 0.3), 0.75, front, to_light);
    }
    add(set.kinds.len() - 1, 0.5, true, true);
    add(set.named("coated plastic", 0.25), 0.6, true, true);
    add(set.named("coated rough glass", 0.36), 0.75, true, true);
    add(set.named("coated rough glass", 0.36), 0.75, false, false);
    add(set.named("retroreflector", 0.25), 0.7, true, true);
    add(set.named("coated retroreflector", 0.25), 0.5, true, false);
    cases
}

#[test]
fn directions_have_their_density() {
    const N: usize = 300_000;
    let (kernel, cases) = (SAMPLE.compile(&[]), cases());
    let level = level(cases.len());
    for (i, &case) in cases.iter().enumerate() {
        let reference = set().at(case.material, [1.0; 3]);
        let mut observed = vec![0.0; BINS * BINS + 1];
        for s in run(&kernel, case, random(51 + i as u64, N)) {
            let d = dvec(&s.direction);
            observed[if s.valid == 1 { bin(d) } else { BINS * BINS }] += 1.0;
        }
        let p_value = |reference: Reference, w: DVec3| {
            let cells = expected(|d| reference.pdf(w, d, case.front));
            chi_square(&observed, &cells.iter().map(|p| p * N as f64).collect::<Vec<_>>())
        };
        let name = format!("{} alpha {:.2} from {}", set().kinds[case.material].name, reference.alpha, case.w);
        let p = p_value(reference, case.w);
        assert!(p > level, "{name}: p = {p:e}, level {level:e}");
        // Wrong densities must fail. Lobes are 4 % too wide, or more where they get few samples: plastic (a tenth of the samples)
        // and lobes under clear coats. The diffuse surface has no lobe; there the density is 3 % off.
        let lambert = set().kinds[case.material].name == "lambert";
        let wrong = if lambert {
            let cells = expected(|d| reference.pdf(case.w, d, true) * (1.03 - 0.06 * f64::from(u8::from(d.z > 0.7))));
            chi_square(&observed, &cells.iter().map(|p| p * N as f64).collect::<Vec<_>>())
        } else {
            let mut wider = reference;
            wider.alpha *= match set().kinds[case.material].name.as_str() {
                "plastic" => 1.15,
                "coated plastic" => 1.5,
                "coated rough glass" => 1.08,
                "retroreflector" | "coated retroreflector" => {
                    wider.retro_alpha *= 1.05;
                    1.0
                }
                _ => 1.04,
            };
            p_value(wider, case.w)
        };
        assert!(wrong < level, "{name}: a wrong density passes with p = {wrong:e}");
    }
}

#[test]
fn weights_are_value_over_density() {
    let (set, kernel) = (set(), SAMPLE.compile(&[]));
    for case in cases() {
        let reference = set.at(case.material, [1.0; 3]);
        for s in run(&kernel, case, random(61, 5_000)).iter().filter(|s| s.valid == 1) {
            let d = dvec(&s.direction).normalize();
            let (wl, wc) = if case.to_light { (d, case.w) } else { (case.w, d) };
            let (f, pdf) = (reference.f(wl, wc, case.front), reference.pdf(case.w, d, case.front));
            let reverse = reference.pdf(d, case.w, case.front);
            // Directions near the horizon, and directions refracted along a facet, have large rounding errors.
            if d.z.abs() < 0.02 || pdf < 1e-4 {
                continue;
            }
            let close = |got: f32, expected: f64| (f64::from(got) / expected - 1.0).abs() < 3e-3;
            assert!(close(s.pdf, pdf) && close(s.pdf_reverse, reverse), "{s:?} {pdf} {reverse}");
            assert!(close(s.weight[0], f[0] / pdf), "{s:?} {f:?} {pdf}");
            assert_eq!(s.delta, 0);
        }
    }
}

#[test]
fn mirrors_and_smooth_glass_by_hand() {
    let (set, kernel) = (set(), SAMPLE.compile(&[]));
    let at = |name: &str, w: DVec3, front, to_light, n| {
        let case = Case { material: set.named(name, 0.0), w, front, to_light };
        run(&kernel, case, random(71, n))
    };
    let w = polar(0.6, 0.3).as_vec3().as_dvec3();
    for s in at("mirror", w, true, true, 100) {
        assert!(s.valid == 1 && s.delta == 1 && s.pdf == 1.0);
        assert!((dvec(&s.direction) - DVec3::new(-w.x, -w.y, w.z)).length() < 1e-6 && (s.weight[0] - 1.0).abs() < 1e-6);
    }
    // Radiance scales with the squared index of refraction when it crosses the surface; the flux of light particles does not.
    for (front, to_light, squeeze) in
        [(true, true, 1.0 / 2.25), (false, true, 2.25), (true, false, 1.0), (false, false, 1.0)]
    {
        let relative = if front { 1.5 } else { 1.0 / 1.5 };
        let w = if front { w } else { polar(0.9, 0.3).as_vec3().as_dvec3() };
        let samples = at("smooth glass", w, front, to_light, 20_000);
        let mut through = 0.0;
        for s in &samples {
            assert!(s.valid == 1 && s.delta == 1);
            let d = dvec(&s.direction);
            if d.z < 0.0 {
                through += 1.0;
                // Snell: tangential parts scale with the index.
                assert!((d.x + w.x / relative).abs() < 1e-6 && (d.y + w.y / relative).abs() < 1e-6);
                assert!((f64::from(s.weight[0]) - squeeze).abs() < 1e-5, "{s:?} {squeeze}");
            } else {
                assert!((s.weight[0] - 1.0).abs() < 1e-5);
            }
        }
        let passed = 1.0 - taugate_oracle::bsdf::fresnel_dielectric(w.z, relative);
        let error = (passed * (1.0 - passed) / samples.len() as f64).sqrt();
        assert!((through / samples.len() as f64 - passed).abs() < 4.0 * error, "{through} {passed}");
    }
    // Total reflection.
    let beyond = at("smooth glass", polar(0.7, 0.0), false, true, 1000);
    assert!(beyond.iter().all(|s| s.direction[2] > 0.0));
}

/// White furnace: a white surface under uniform light may not be brighter than the light at any angle. The mean of 2^17
/// evenly spread samples has an error of a few 1e-4, because weights of GGX are at most 1. The test allows a gain of 1e-3.
#[test]
fn a_white_furnace_gains_nothing() {
    const N: usize = 1 << 17;
    let (set, kernel) = (set(), SAMPLE.compile(&[]));
    for (material, m) in set.kinds.iter().enumerate() {
        // In degrees from the normal; the last is 0.1 degrees from grazing.
        for angle in [0.0f64, 30.0, 60.0, 80.0, 87.0, 89.0, 89.9] {
            let glass = m.transmission > 0.0;
            for (front, to_light) in [(true, true), (true, false), (false, false)] {
                // Radiance changes where it enters glass, so glass is only sampled towards the sensor. Opaque surfaces are
                // only seen from the front.
                if (glass && to_light) || (!glass && !front) {
                    continue;
                }
                let case = Case { material, w: polar(angle.to_radians().cos(), 0.4), front, to_light };
                let sum: f64 = run(&kernel, case, even(N)).iter().filter(|s| s.valid == 1).map(weight).sum();
                let albedo = sum / N as f64;
                let name = format!("{} alpha {:.2} at {angle} degrees, front {front}", m.name, m.roughness.powi(2));
                assert!(albedo <= 1.0 + 1e-3, "{name}: {albedo}");
                assert!(albedo >= minimum_albedo(m, angle), "{name}: {albedo}");
            }
        }
    }
}

/// The fraction of light that a sample returns, in the brightest channel: the same one in all samples of a coloured surface.
fn weight(s: &Got) -> f64 {
    let cosine = if s.delta == 1 { 1.0 } else { s.direction[2].abs() };
    f64::from(s.weight.into_iter().fold(0.0, f32::max) * cosine)
}

/// Lower limit of the albedo. Diffuse and smooth surfaces lose nothing. Rough ones lose the light that scatters several times
/// between facets, up to 70 %.
fn minimum_albedo(m: &Material, angle: f64) -> f64 {
    let alpha = f64::from(m.roughness).powi(2);
    if m.retroreflector.is_some() && m.clearcoat == 0.0 && m.roughness < 0.1 {
        // Over a mirror, the wide lobe loses light to the horizon at grazing angles.
        if angle < 70.0 { 0.98 } else { 0.7 }
    } else if m.retroreflector.is_some_and(|retroreflector| retroreflector.angle < 1.0) {
        if angle < 89.5 { 0.98 } else { 0.6 }
    } else if m.clearcoat > 0.0 {
        // With two mirrors, the albedo is C + (1 - C)^2, where C is the albedo of the clear coat.
        if alpha < 1e-3 && m.clearcoat_roughness == 0.0 { 0.75 } else { 0.3 }
    } else if m.specular == 0.0 || alpha < 1e-3 {
        0.99
    } else if alpha < 0.06 && angle < 70.0 {
        0.98
    } else {
        0.3
    }
}
