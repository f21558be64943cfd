//! `shared/point.wgsl`: how a vertex stores material properties that vary over the surface, and the BSDF with these properties.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec2, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts;
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::Geometry;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{Image, Material, Mesh, Scene};
use taugate::internals::settings::Emitters;
use taugate_oracle::texture::{sample, sample_data};

use crate::materials::Set;
use crate::shader_function::{ShaderFunction, contents};
use crate::texture::texels;
use crate::values::{direction, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&PACK, &VARY, &COATS, &FACTORS, &WORDS];

const PACK: ShaderFunction = ShaderFunction {
    imports: &["point"],
    input: "base: vec3<f32>, metallic: f32, color: vec3<f32>, alpha: f32, rest: vec4<f32>",
    result: "base: vec3<f32>, metallic: f32, color: vec3<f32>, alpha: f32, rest: vec4<f32>",
    body: "let coats = CoatFactors(input.color, input.rest.x, input.rest.y, input.rest.z);
        let p = unpack_point(pack_point(PointProperties(input.base, input.metallic, input.alpha, coats, input.rest.w)));
        result.base = p.base; result.metallic = p.metallic; result.alpha = p.alpha; result.color = p.coats.specular_color;
        result.rest = vec4<f32>(p.coats.specular, p.coats.clearcoat, p.coats.clearcoat_roughness, p.transmission);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct Point {
    base: [f32; 3],
    metallic: f32,
    // The specular colour.
    color: [f32; 3],
    alpha: f32,
    // Specular strength, clear coat and its roughness, transmission.
    rest: [f32; 4],
}

/// Points with properties from 0 to 1. The first two have only zeros and ones.
fn points(count: usize) -> Vec<Point> {
    let mut pcg = Pcg::new(201);
    let zeros =
        Point { base: [0.0, 1.0, 0.0], metallic: 1.0, color: [1.0, 0.0, 1.0], alpha: 1.0, rest: [0.0, 1.0, 0.0, 1.0] };
    let ones =
        Point { base: [1.0, 0.0, 1.0], metallic: 0.0, color: [0.0, 1.0, 0.0], alpha: 0.0, rest: [1.0, 0.0, 1.0, 0.0] };
    let mut unit = || pcg.uniform() as f32;
    let mut random = |_| {
        // Squares and fourth powers have many small values.
        let base = [unit().powi(2), unit().powi(4), unit()];
        let (metallic, alpha) = (unit(), unit().powi(2));
        let color = [unit().powi(2), unit().powi(4), unit()];
        Point { base, metallic, color, alpha, rest: [0; 4].map(|_| unit()) }
    };
    [zeros, ones].into_iter().chain((0..count).map(&mut random)).collect()
}

/// Whether `b` may be `a` after the square root was rounded to a multiple of 1 / `steps`. Half a step of the root changes its
/// square by about a step times the root.
fn is_near(a: f32, b: f32, steps: f32) -> bool {
    (a - b).abs() <= 1.1 / steps * a.sqrt() + 0.3 / steps.powi(2) + 1e-9
}

/// With coat textures, the words also hold the factors of the coats, so base colour and roughness have fewer bits. With a
/// transmission texture as well, base colour and roughness have 8 bits.
#[test]
fn packed_coats_keep_their_digits() {
    let inputs = points(20_000);
    for (transmits, steps) in [(0.0, 1023.0), (1.0, 255.0)] {
        let results: Vec<Point> = PACK.compile(&[("HAS_TRANSMISSION_TEXTURES", transmits)]).run(&inputs, &[]);
        for (i, (g, r)) in inputs.iter().zip(&results).enumerate() {
            let transmission = if transmits > 0.0 { g.rest[3] } else { 1.0 };
            let all = |a: [f32; 3], b: [f32; 3], steps| a.into_iter().zip(b).all(|(a, b)| is_near(a, b, steps));
            assert!(all(g.base, r.base, steps) && all(g.color, r.color, 255.0), "{g:?} {r:?}");
            let mut exact = vec![(g.metallic, r.metallic), (transmission, r.rest[3])];
            exact.extend((0..3).map(|k| (g.rest[k], r.rest[k])));
            assert!(exact.iter().all(|(a, b)| (a - b).abs() <= 0.51 / 255.0), "{g:?} {r:?}");
            let least = if transmits > 0.0 { 1.3e-3 } else { 1.1e-3 };
            assert!(is_near(g.alpha, r.alpha, steps) || (r.alpha == 0.0 && g.alpha < least), "{g:?} {r:?}");
            let expected = Point { rest: [g.rest[0], g.rest[1], g.rest[2], transmission], ..*g };
            assert!(i > 1 || *r == expected, "0 and 1 are exact");
        }
    }
}

#[test]
fn packed_properties_keep_their_digits() {
    let inputs = points(20_000);
    for transmits in [0.0, 1.0] {
        let constants = [("HAS_COAT_TEXTURES", 0.0), ("HAS_TRANSMISSION_TEXTURES", transmits)];
        let results: Vec<Point> = PACK.compile(&constants).run(&inputs, &[]);
        for (g, r) in inputs.iter().zip(&results) {
            assert!(g.base.into_iter().zip(r.base).all(|(a, b)| is_near(a, b, 65535.0)), "{g:?} {r:?}");
            assert!((g.metallic - r.metallic).abs() <= 0.51 / 255.0, "{g:?} {r:?}");
            assert!(is_near(g.alpha, r.alpha, 65535.0) || (r.alpha == 0.0 && g.alpha < 1.001e-3), "{g:?} {r:?}");
            let transmission = if transmits > 0.0 { g.rest[3] } else { 1.0 };
            assert!((transmission - r.rest[3]).abs() <= 0.51 / 255.0, "{g:?} {r:?}");
            assert_eq!((r.color, &r.rest[..3]), ([1.0; 3], &[1.0; 3][..]), "without textures, the coat factors are 1");
        }
    }
}

const VARY: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "wl: vec3<f32>, other: u32, wc: vec3<f32>, constant: u32, base: vec3<f32>, front: u32",
    result: "f: vec4<f32>, pdfs: vec4<f32>, expected_f: vec4<f32>, expected_pdfs: vec4<f32>",
    body: "let m = load_material(input.constant);
        let p = PointProperties(input.base, m.metallic, m.alpha, WHITE_COATS, 1.0);
        let a = bsdf_eval(make_varying_bsdf(input.other, p, input.front == 1u), input.wl, input.wc);
        let b = bsdf_eval(make_bsdf(input.constant, input.base, input.front == 1u), input.wl, input.wc);
        result.f = vec4<f32>(a.f, 0.0); result.pdfs = vec4<f32>(a.pdf_to_light, a.pdf_to_sensor, 0.0, 0.0);
        result.expected_f = vec4<f32>(b.f, 0.0);
        result.expected_pdfs = vec4<f32>(b.pdf_to_light, b.pdf_to_sensor, 0.0, 0.0);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Pair {
    wl: [f32; 3],
    other: u32,
    wc: [f32; 3],
    constant: u32,
    base: [f32; 3],
    front: u32,
}

/// Where a varying material has the metalness and the alpha of a constant material, both have the same BSDF.
#[test]
fn a_varying_bsdf_is_the_constant_bsdf_of_the_point() {
    let glass = |metallic, roughness| Material {
        metallic,
        transmission: 0.5,
        ior: 1.4,
        ..parts::plastic("half glass", [1.0; 3], roughness)
    };
    let plastic = |metallic, roughness| Material { metallic, ..parts::plastic("plastic", [1.0; 3], roughness) };
    let values = [(1.0, 1.0), (0.0, 0.9), (0.3, 0.41), (0.8, 0.2), (0.5, 0.0)];
    let kinds = values.map(|(m, r)| plastic(m, r)).into_iter().chain(values.map(|(m, r)| glass(m, r))).collect();
    let set = Set::new(kinds);
    let mut pcg = Pcg::new(202);
    let inputs: Vec<Pair> = (0..20_000)
        .map(|i| {
            let constant = (i % 10) as u32;
            let base = [0; 3].map(|_| pcg.uniform() as f32);
            let (wl, wc) = (vec3(direction(&mut pcg)), vec3(direction(&mut pcg)));
            // The second of five materials varies: the first one is a metal, which without a texture has no transmission.
            Pair { wl, other: constant / 5 * 5 + 1, wc, constant, base, front: pcg.below(2) as u32 }
        })
        .collect();
    let results: Vec<[[f32; 4]; 4]> = VARY.run(&inputs, &set.buffers());
    let mut lit = 0;
    for (g, [f, pdfs, expected_f, expected_pdfs]) in inputs.iter().zip(&results) {
        for (got, expected) in f.iter().chain(pdfs).zip(expected_f.iter().chain(expected_pdfs)) {
            assert!((got - expected).abs() <= 1e-5 * expected.abs() + 1e-7, "{g:?}: {got} {expected}");
        }
        lit += usize::from(f[0] > 0.0);
    }
    assert!(lit > 5000, "only {lit} pairs scatter");
}

const WORDS: ShaderFunction = ShaderFunction {
    imports: &["surface"],
    input: "uv: vec2<f32>, material: u32, pad: u32",
    result: "base: vec3<f32>, metallic: f32, alpha: f32, varies: u32, transmission: f32, factor: f32",
    body: "var s: Surface; s.uv = input.uv; s.material = input.material; s.color = vec4<f32>(1.0);
        let words = point_words(s); let m = load_material(s.material);
        let lobe = metallic_and_alpha(m, words);
        result.varies = u32(varies(m)); result.metallic = lobe.x; result.alpha = lobe.y;
        result.transmission = transmission_at(m, words); result.factor = transmission_factor(m, input.uv);
        result.base = bitcast<vec3<f32>>(words);
        if (varies(m)) { result.base = unpack_point(words).base; }",
};

const COATS: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "wl: vec3<f32>, other: u32, wc: vec3<f32>, constant: u32, color: vec3<f32>, specular: f32, \
        clearcoat: f32, clearcoat_roughness: f32, pad: vec2<f32>",
    result: "f: vec4<f32>, pdfs: vec4<f32>, expected_f: vec4<f32>, expected_pdfs: vec4<f32>",
    body: "let m = load_material(input.constant); let base = vec3<f32>(0.5, 0.9, 0.2);
        let coats = CoatFactors(input.color, input.specular, input.clearcoat, input.clearcoat_roughness);
        let p = PointProperties(base, m.metallic, m.alpha, coats, 1.0);
        let a = bsdf_eval(make_varying_bsdf(input.other, p, true), input.wl, input.wc);
        let b = bsdf_eval(make_bsdf(input.constant, base, true), input.wl, input.wc);
        result.f = vec4<f32>(a.f, 0.0); result.pdfs = vec4<f32>(a.pdf_to_light, a.pdf_to_sensor, 0.0, 0.0);
        result.expected_f = vec4<f32>(b.f, 0.0);
        result.expected_pdfs = vec4<f32>(b.pdf_to_light, b.pdf_to_sensor, 0.0, 0.0);",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct CoatedPair {
    wl: [f32; 3],
    other: u32,
    wc: [f32; 3],
    constant: u32,
    color: [f32; 3],
    specular: f32,
    clearcoat: f32,
    clearcoat_roughness: f32,
    pad: [f32; 2],
}

/// Texels multiply the factors of both coats.
#[test]
fn varying_coats_are_the_constant_coats_of_the_point() {
    let full = Material {
        specular: 0.9,
        specular_color: [0.5, 2.0, 20.0],
        clearcoat: 0.8,
        clearcoat_roughness: 0.7,
        metallic: 0.25,
        ..parts::plastic("full", [1.0; 3], 0.4)
    };
    let mut pcg = Pcg::new(204);
    let texels: Vec<[f32; 6]> = (0..40).map(|_| [0; 6].map(|_| pcg.uniform() as f32)).collect();
    let mut kinds = vec![full.clone()];
    kinds.extend(texels.iter().map(|&[red, green, blue, specular, clearcoat, roughness]| Material {
        specular: full.specular * specular,
        specular_color: [0.5 * red, 2.0 * green, 20.0 * blue],
        clearcoat: full.clearcoat * clearcoat,
        clearcoat_roughness: full.clearcoat_roughness * roughness,
        ..full.clone()
    }));
    let set = Set::new(kinds);
    let inputs: Vec<CoatedPair> = (0..20_000)
        .map(|i| {
            let [red, green, blue, specular, clearcoat, clearcoat_roughness] = texels[i % 40];
            let color = [red, green, blue];
            let (wl, wc) = (vec3(direction(&mut pcg)), vec3(direction(&mut pcg)));
            let constant = 1 + (i % 40) as u32;
            CoatedPair { wl, other: 0, wc, constant, color, specular, clearcoat, clearcoat_roughness, pad: [0.0; 2] }
        })
        .collect();
    let results: Vec<[[f32; 4]; 4]> = COATS.run(&inputs, &set.buffers());
    let mut lit = 0;
    for (g, [f, pdfs, expected_f, expected_pdfs]) in inputs.iter().zip(&results) {
        for (got, expected) in f.iter().chain(pdfs).zip(expected_f.iter().chain(expected_pdfs)) {
            assert!((got - expected).abs() <= 1e-4 * expected.abs() + 1e-6, "{g:?}: {got} {expected}");
        }
        lit += usize::from(f[0] > 0.0);
    }
    assert!(lit > 3000, "only {lit} pairs scatter");
}

const FACTORS: ShaderFunction = ShaderFunction {
    imports: &["surface"],
    input: "uv: vec2<f32>, material: u32, pad: u32",
    result: "color: vec3<f32>, specular: f32, clearcoat: f32, clearcoat_roughness: f32, rough: u32, varies: u32",
    body: "let m = load_material(input.material); let coats = coat_factors(m, input.uv);
        result.color = coats.specular_color; result.specular = coats.specular; result.clearcoat = coats.clearcoat;
        result.clearcoat_roughness = coats.clearcoat_roughness; result.varies = u32(varies(m));
        let p = PointProperties(vec3<f32>(0.5), m.metallic, m.alpha, coats, 1.0);
        result.rough = u32(has_rough_clearcoat(m, pack_point(p)));",
};

/// Each texture gives one factor, from the right channels. Without coat textures, the factors are 1.
#[test]
fn coat_factors_come_from_their_channels() {
    let mut pcg = Pcg::new(205);
    let mut scene = Scene::default();
    let mut texture = || {
        let image = Image { width: 4, height: 3, rgba: (0..12).map(|_| pcg.next_u32().to_le_bytes()).collect() };
        parts::texture(&mut scene, image)
    };
    let [specular_texture, specular_color_texture] = [texture(), texture()].map(Some);
    let [clearcoat_texture, clearcoat_roughness_texture] = [texture(), texture()].map(Some);
    let plain = Material { clearcoat: 0.5, clearcoat_roughness: 0.1, ..parts::plastic("plain", [1.0; 3], 0.5) };
    let textured = Material {
        specular_texture,
        specular_color_texture,
        clearcoat_texture,
        clearcoat_roughness_texture,
        ..plain.clone()
    };
    for material in [plain, textured] {
        let material = parts::material(&mut scene, material);
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let triangle = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let mesh = parts::mesh(&mut scene, "triangle", material, triangle);
        parts::place(&mut scene, "node", mesh, DAffine3::IDENTITY);
    }
    let geometry = Geometry::new(&scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &AlbedoTable::new());
    assert!(geometry.features.coat_textures && geometry.features.surface_textures && geometry.features.textures);
    let buffers = [
        contents("materials", &geometry.materials),
        contents("textures", &geometry.textures),
        texels(&scene, &geometry),
    ];
    let inputs: Vec<[u32; 4]> = (0..4000)
        .map(|i| [(pcg.range(-2.0, 2.0) as f32).to_bits(), (pcg.range(-2.0, 2.0) as f32).to_bits(), i % 2, 0])
        .collect();
    let results: Vec<[u32; 8]> = FACTORS.run(&inputs, &buffers);
    let mut rough = 0;
    for (g, r) in inputs.iter().zip(&results) {
        let uv = DVec2::new(f32::from_bits(g[0]).into(), f32::from_bits(g[1]).into());
        let m = &scene.materials[g[2] as usize];
        let [red, green, blue, _] = sample(&scene, m.specular_color_texture, uv);
        let specular = sample_data(&scene, m.specular_texture, uv)[3];
        let clearcoat = sample_data(&scene, m.clearcoat_texture, uv)[0];
        let roughness = sample_data(&scene, m.clearcoat_roughness_texture, uv)[1];
        for (k, expected) in [red, green, blue, specular, clearcoat, roughness].into_iter().enumerate() {
            assert!((f64::from(f32::from_bits(r[k])) - expected).abs() < 1e-4, "{k}: {g:?} {r:?} {expected}");
        }
        assert_eq!(r[7], g[2], "only the second material varies");
        // The clear coat is a mirror below a GGX alpha of 0.001. Values close to it are skipped: the vertex has 8 bits per factor.
        if (0.1 * roughness - 0.001f64.sqrt()).abs() > 4e-4 {
            assert_eq!(r[6] == 1, clearcoat > 0.0 && 0.1 * roughness > 0.001f64.sqrt(), "{g:?} {r:?}");
        }
        rough += r[6] * g[2];
    }
    assert!((500..1900).contains(&rough), "{rough}");
}

/// The texture multiplies the factors. A material without such a texture keeps its factors and its exact base colour.
#[test]
fn surface_textures_multiply_the_factors() {
    let mut pcg = Pcg::new(203);
    let mut scene = Scene::default();
    let mut image = || Image { width: 5, height: 4, rgba: (0..20).map(|_| pcg.next_u32().to_le_bytes()).collect() };
    let (color, surface) = (image(), image());
    let color = parts::texture(&mut scene, color);
    let surface = parts::texture(&mut scene, surface);
    for surface_texture in [None, Some(surface)] {
        let material = Material {
            base_color_texture: Some(color),
            surface_texture,
            metallic: 0.75,
            transmission: 0.5,
            transmission_texture: surface_texture,
            ..parts::plastic("textured", [0.9, 0.5, 0.3], 0.8)
        };
        let material = parts::material(&mut scene, material);
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let triangle = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let mesh = parts::mesh(&mut scene, "triangle", material, triangle);
        parts::place(&mut scene, "node", mesh, DAffine3::IDENTITY);
    }
    let geometry = Geometry::new(&scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &AlbedoTable::new());
    assert!(geometry.features.surface_textures && geometry.features.transmission_textures);
    let buffers = [
        contents("materials", &geometry.materials),
        contents("textures", &geometry.textures),
        texels(&scene, &geometry),
    ];
    let inputs: Vec<[u32; 4]> = (0..4000)
        .map(|i| [(pcg.range(-2.0, 2.0) as f32).to_bits(), (pcg.range(-2.0, 2.0) as f32).to_bits(), i % 2, 0])
        .collect();
    let results: Vec<[u32; 8]> = WORDS.compile(&[("HAS_COAT_TEXTURES", 0.0)]).run(&inputs, &buffers);
    for (g, r) in inputs.iter().zip(&results) {
        let uv = DVec2::new(f32::from_bits(g[0]).into(), f32::from_bits(g[1]).into());
        let m = &scene.materials[g[2] as usize];
        let base = sample(&scene, m.base_color_texture, uv);
        let [_, green, blue, _] = sample_data(&scene, m.surface_texture, uv);
        let red = sample_data(&scene, m.transmission_texture, uv)[0];
        let value = |k: usize| f64::from(f32::from_bits(r[k]));
        assert_eq!(r[5], g[2], "only the second material varies");
        let close = |k: usize| (value(k) - f64::from(m.base_color[k]) * base[k]).abs() < 1e-4;
        assert!((0..3).all(close), "{g:?} {r:?}");
        assert!((value(7) - red).abs() < 1e-4, "{g:?} {r:?}");
        // The vertex stores the metalness and the transmission with 8 bits.
        assert!((value(6) - f64::from(m.transmission) * red).abs() < 2.1e-3, "{g:?} {r:?}");
        assert!((value(3) - f64::from(m.metallic) * blue).abs() < 2.1e-3, "{g:?} {r:?}");
        assert!((value(4) - (f64::from(m.roughness) * green).powi(2)).abs() < 2e-4, "{g:?} {r:?}");
    }
}
