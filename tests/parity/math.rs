//! `shared/math.wgsl`: frames, warps and packed directions.

use std::f64::consts::TAU;

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::geometry::octahedral;

use crate::shader_function::ShaderFunction;
use crate::values::{directions, dvec};

pub const KERNELS: &[&ShaderFunction] = &[&FRAME, &TURNS, &WARPS, &OCTAHEDRAL, &SMALL];

const FRAME: ShaderFunction = ShaderFunction {
    imports: &["math"],
    input: "n: vec3<f32>, pad: f32",
    result: "t: vec3<f32>, a: f32, b: vec3<f32>, c: f32, n: vec3<f32>, d: f32",
    body: "let m = frame_around(input.n); result.t = m[0]; result.b = m[1]; result.n = m[2];",
};

#[test]
fn frames_are_orthonormal_and_right_handed() {
    let inputs: Vec<[f32; 4]> =
        directions(1, 20_000).iter().map(|n| [n.x as f32, n.y as f32, n.z as f32, 0.0]).collect();
    let frames: Vec<[f32; 12]> = FRAME.run(&inputs, &[]);
    for (input, f) in inputs.iter().zip(&frames) {
        let [t, b, n] = [dvec(&f[0..3]), dvec(&f[4..7]), dvec(&f[8..11])];
        assert_eq!(n, dvec(&input[..3]));
        // `frame_around` has an error of 3e-7 over the whole sphere; products and lengths add a few roundings.
        let worst = [t.dot(b), t.dot(n), b.dot(n), t.length() - 1.0, b.length() - 1.0, (t.cross(b) - n).length()];
        assert!(worst.iter().all(|x| x.abs() < 2e-6), "{n}: {worst:?}");
    }
}

const TURNS: ShaderFunction = ShaderFunction {
    imports: &["math"],
    input: "phi: f32",
    result: "turn: vec2<f32>",
    body: "result.turn = cosine_and_sine(input.phi);",
};

/// Vulkan allows the built-in sine and cosine an error of 5e-4. In SwiftShader they have an error of 1e-4.
#[test]
fn sines_are_right_on_every_device() {
    let quarters = (0..=4).map(|quarter| (f64::from(quarter) * std::f64::consts::FRAC_PI_2) as f32);
    let angles: Vec<f32> = (0..100_000).map(|i| i as f32 * (TAU as f32 / 1e5)).chain(quarters).collect();
    // First the setting for this device, then the setting for unknown devices.
    for constants in [&[][..], &[("EXACT_SINES", 0.0)]] {
        let turns: Vec<[f32; 2]> = TURNS.compile(constants).run(&angles, &[]);
        for (&angle, [cosine, sine]) in angles.iter().zip(turns) {
            let (s, c) = f64::from(angle).sin_cos();
            let off = (f64::from(cosine) - c).abs().max((f64::from(sine) - s).abs());
            assert!(off < 1.5e-7, "{angle}: {cosine} {sine}, off by {off:e}");
        }
    }
}

const WARPS: ShaderFunction = ShaderFunction {
    imports: &["math"],
    input: "u: vec2<f32>",
    result: "cosine: vec3<f32>, pad0: f32, triangle: vec2<f32>, pad1: vec2<f32>",
    body: "result.cosine = cosine_hemisphere(input.u); result.triangle = uniform_triangle(input.u);",
};

#[test]
fn warps_agree_with_f64() {
    let mut pcg = Pcg::new(2);
    let last = 1.0 - 1.0 / 16_777_216.0;
    let mut inputs = vec![[0.0f32, 0.0], [0.0, last], [last, 0.0], [last, last], [0.5, 0.25]];
    inputs.extend((0..20_000).map(|_| [pcg.uniform() as f32, pcg.uniform() as f32]));
    let results: Vec<[f32; 8]> = WARPS.run(&inputs, &[]);
    for (u, r) in inputs.iter().zip(&results) {
        let [x, y] = u.map(f64::from);
        let (radius, angle) = (x.sqrt(), std::f64::consts::TAU * y);
        let expected = DVec3::new(radius * angle.cos(), radius * angle.sin(), (1.0 - x).sqrt());
        assert!((dvec(&r[..3]) - expected).length() < 5e-6, "{x} {y}: {:?} {expected}", &r[..3]);
        let (b, c) = (f64::from(r[4]), f64::from(r[5]));
        assert!((b - (1.0 - radius)).abs() < 1e-6 && (c - radius * y).abs() < 1e-6);
        assert!(b >= 0.0 && c >= 0.0 && b + c <= 1.0 + 1e-6);
    }
}

const OCTAHEDRAL: ShaderFunction = ShaderFunction {
    imports: &["math"],
    input: "packed: u32",
    result: "n: vec3<f32>, pad: f32",
    body: "result.n = decode_octahedral(input.packed);",
};

#[test]
fn octahedral_normals_come_back() {
    let normals = directions(3, 20_000);
    let packed: Vec<u32> = normals.iter().map(|n| octahedral(n.as_vec3().to_array())).collect();
    let decoded: Vec<[f32; 4]> = OCTAHEDRAL.run(&packed, &[]);
    for (n, d) in normals.iter().zip(&decoded) {
        let angle = n.cross(dvec(&d[..3])).length().asin();
        assert!(n.dot(dvec(&d[..3])) > 0.0 && angle < 1e-4, "{n} came back {angle} rad off");
    }
}

const SMALL: ShaderFunction = ShaderFunction {
    imports: &["math", "path", "random"],
    input: "v: vec3<f32>, x: f32, key: vec4<u32>",
    result: "square: f32, greatest: f32, luminance: f32, finite: u32, mis: f32, hash: u32, pad: vec2<u32>,
        words: vec4<u32>, uniforms: vec4<f32>",
    body: "result.square = square(input.x); result.greatest = max_component(input.v);
        result.luminance = luminance(input.v); result.finite = u32(is_finite(input.v)); result.mis = mis(input.x);
        result.hash = hash32(input.key.x); result.words = pcg4d(input.key);
        result.uniforms = random4(input.key.x & 3u, input.key.y, input.key.z, 5u, 2u, input.key.w);",
};

#[test]
fn small_helpers() {
    let mut pcg = Pcg::new(4);
    let specials = [0.0, -0.0, 1.0, f32::MAX, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::MIN_POSITIVE];
    let mut inputs: Vec<[u32; 8]> = vec![];
    for i in 0..5000 {
        let mut component = || if i < 500 { specials[pcg.below(8)] } else { pcg.range(-3.0, 3.0) as f32 };
        let v = [component(), component(), component(), pcg.range(-3.0, 3.0) as f32];
        inputs.push([v.map(f32::to_bits), [0; 4].map(|_: u32| pcg.next_u32())].concat().try_into().unwrap());
    }
    let results: Vec<[u32; 16]> = SMALL.run(&inputs, &[]);
    for (g, r) in inputs.iter().zip(&results) {
        let v = [g[0], g[1], g[2], g[3]].map(f32::from_bits);
        assert_eq!(r[3] == 1, v[..3].iter().all(|x| x.is_finite()), "{v:?}");
        if r[3] == 1 {
            assert_eq!(f32::from_bits(r[1]), v[0].max(v[1]).max(v[2]));
            let y = 0.2126 * f64::from(v[0]) + 0.7152 * f64::from(v[1]) + 0.0722 * f64::from(v[2]);
            // Devices may flush denormal terms to 0.
            let flushed = 3.0 * f64::from(f32::MIN_POSITIVE);
            let tolerance = 1e-6 * f64::from(v[0].abs().max(v[1].abs()).max(v[2].abs())) + flushed;
            let got = f64::from(f32::from_bits(r[2]));
            assert!((got - y).abs() <= tolerance, "{v:?}: {got} instead of {y}");
        }
        assert_eq!([r[0], r[4]].map(f32::from_bits), [v[3] * v[3]; 2]);
        let key = [g[4], g[5], g[6], g[7]];
        assert_eq!(r[5], pcg_output(key[0]));
        assert_eq!(r[8..12], pcg4d(key));
        let used = pcg4d([key[1], key[2], ((key[0] & 3) << 28) | (5 << 14) | 2, key[3]]);
        assert_eq!([r[12], r[13], r[14], r[15]].map(f32::from_bits), used.map(|w| (w >> 8) as f32 / 16_777_216.0));
    }
}

/// The hash function pcg4d (Jarzynski and Olano 2020).
fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        for (a, b, c) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[a] = v[a].wrapping_add(v[b].wrapping_mul(v[c]));
        }
    };
    mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    mix(&mut v);
    v
}

/// The output function RXS-M-XS of PCG, 32 bits (O'Neill 2014).
fn pcg_output(state: u32) -> u32 {
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}
