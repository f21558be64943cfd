//! `shared/point.wgsl`: properties of a material that vary over the surface, as a vertex stores them, and the BSDF that they
//! make.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec2, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::stage;
use taugate::internals::oracle::texture::{sample, sample_data};
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::Geometry;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{Image, Material, Mesh, Scene};
use taugate::internals::settings::Emitters;

use crate::materials::Set;
use crate::shader_function::{ShaderFunction, contents};
use crate::texture::texels;
use crate::values::{direction, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&PACK, &VARY, &WORDS];

const PACK: ShaderFunction = ShaderFunction {
    imports: &["point"],
    input: "base: vec3<f32>, metallic: f32, alpha: f32, pad: vec3<f32>",
    result: "base: vec3<f32>, metallic: f32, alpha: f32, pad: vec3<f32>",
    body: "let p = unpack_point(pack_point(PointProperties(input.base, input.metallic, input.alpha)));
        result.base = p.base; result.metallic = p.metallic; result.alpha = p.alpha;",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct Point {
    base: [f32; 3],
    metallic: f32,
    alpha: f32,
    // WGSL aligns the last vector, and the struct, to 16 bytes.
    pad: [f32; 7],
}

#[test]
fn packed_properties_keep_their_digits() {
    let mut pcg = Pcg::new(201);
    let point = |base, metallic, alpha| Point { base, metallic, alpha, pad: [0.0; 7] };
    let mut inputs = vec![point([0.0, 1.0, 0.0], 1.0, 1.0), point([1.0, 0.0, 1.0], 0.0, 0.0)];
    inputs.extend((0..20_000).map(|_| {
        let mut unit = || pcg.uniform() as f32;
        // Squares and fourth powers have many small values.
        point([unit().powi(2), unit().powi(4), unit()], unit(), unit().powi(2))
    }));
    let results: Vec<Point> = PACK.run(&inputs, &[]);
    assert_eq!(results[..2], inputs[..2], "0 and 1 are exact");
    for (g, r) in inputs.iter().zip(&results) {
        for (a, b) in g.base.iter().zip(&r.base) {
            // Half a step of 16 bits of the root: the error of its square is the step times the root.
            assert!((a - b).abs() <= 1.1 / 65535.0 * a.sqrt() + 1e-9, "{g:?} {r:?}");
        }
        assert!((g.metallic - r.metallic).abs() <= 0.51 / 255.0, "{g:?} {r:?}");
        let near = (g.alpha - r.alpha).abs() <= 1.1 / 65535.0 * g.alpha.sqrt() + 1e-9;
        assert!(near || (r.alpha == 0.0 && g.alpha < 1.001e-3), "{g:?} {r:?}");
    }
}

const VARY: ShaderFunction = ShaderFunction {
    imports: &["bsdf"],
    input: "wl: vec3<f32>, other: u32, wc: vec3<f32>, constant: u32, base: vec3<f32>, front: u32",
    result: "f: vec4<f32>, pdfs: vec4<f32>, expected_f: vec4<f32>, expected_pdfs: vec4<f32>",
    body: "let m = load_material(input.constant);
        let p = PointProperties(input.base, m.metallic, m.alpha);
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

/// A material with other factors gives the same BSDF where it has the metalness and the alpha of a constant material.
#[test]
fn a_varying_bsdf_is_the_constant_bsdf_of_the_point() {
    let glass = |metallic, roughness| Material {
        metallic,
        transmission: 0.5,
        ior: 1.4,
        ..stage::plastic("half glass", [1.0; 3], roughness)
    };
    let plastic = |metallic, roughness| Material { metallic, ..stage::plastic("plastic", [1.0; 3], roughness) };
    let values = [(1.0, 1.0), (0.0, 0.9), (0.3, 0.41), (0.8, 0.2), (0.5, 0.0)];
    let kinds = values.map(|(m, r)| plastic(m, r)).into_iter().chain(values.map(|(m, r)| glass(m, r))).collect();
    let set = Set::new(kinds);
    let mut pcg = Pcg::new(202);
    let inputs: Vec<Pair> = (0..20_000)
        .map(|i| {
            let constant = (i % 10) as u32;
            let base = [0; 3].map(|_| pcg.uniform() as f32);
            let (wl, wc) = (vec3(direction(&mut pcg)), vec3(direction(&mut pcg)));
            Pair { wl, other: constant / 5 * 5, wc, constant, base, front: pcg.below(2) as u32 }
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
    result: "base: vec3<f32>, metallic: f32, alpha: f32, varies: u32, pad: vec2<u32>",
    body: "var s: Surface; s.uv = input.uv; s.material = input.material; s.color = vec4<f32>(1.0);
        let words = point_words(s); let m = load_material(s.material);
        let lobe = metallic_and_alpha(m, words);
        result.varies = u32(varies(m)); result.metallic = lobe.x; result.alpha = lobe.y;
        result.base = bitcast<vec3<f32>>(words);
        if (varies(m)) { result.base = unpack_point(words).base; }",
};

/// The texture multiplies the factors. A material without such a texture keeps its factors and its exact base colour.
#[test]
fn surface_textures_multiply_the_factors() {
    let mut pcg = Pcg::new(203);
    let mut scene = Scene::default();
    let mut image = || Image { width: 5, height: 4, rgba: (0..20).map(|_| pcg.next_u32().to_le_bytes()).collect() };
    let (color, surface) = (image(), image());
    let color = stage::texture(&mut scene, color);
    let surface = stage::texture(&mut scene, surface);
    for surface_texture in [None, Some(surface)] {
        let material = Material {
            base_color_texture: Some(color),
            surface_texture,
            metallic: 0.75,
            ..stage::plastic("textured", [0.9, 0.5, 0.3], 0.8)
        };
        let material = stage::material(&mut scene, material);
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let triangle = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let mesh = stage::mesh(&mut scene, "triangle", material, triangle);
        stage::place(&mut scene, "node", mesh, DAffine3::IDENTITY);
    }
    let geometry = Geometry::new(&scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &AlbedoTable::new());
    assert!(geometry.features.surface_textures);
    let buffers = [
        contents("materials", &geometry.materials),
        contents("textures", &geometry.textures),
        texels(&scene, &geometry),
    ];
    let inputs: Vec<[u32; 4]> = (0..4000)
        .map(|i| [(pcg.range(-2.0, 2.0) as f32).to_bits(), (pcg.range(-2.0, 2.0) as f32).to_bits(), i % 2, 0])
        .collect();
    let results: Vec<[u32; 8]> = WORDS.run(&inputs, &buffers);
    for (g, r) in inputs.iter().zip(&results) {
        let uv = DVec2::new(f32::from_bits(g[0]).into(), f32::from_bits(g[1]).into());
        let m = &scene.materials[g[2] as usize];
        let base = sample(&scene, m.base_color_texture, uv);
        let [_, green, blue, _] = sample_data(&scene, m.surface_texture, uv);
        let value = |k: usize| f64::from(f32::from_bits(r[k]));
        assert_eq!(r[5], g[2], "only the second material varies");
        let close = |k: usize| (value(k) - f64::from(m.base_color[k]) * base[k]).abs() < 1e-4;
        assert!((0..3).all(close), "{g:?} {r:?}");
        // The vertex stores the metalness with 8 bits.
        assert!((value(3) - f64::from(m.metallic) * blue).abs() < 2.1e-3, "{g:?} {r:?}");
        assert!((value(4) - (f64::from(m.roughness) * green).powi(2)).abs() < 2e-4, "{g:?} {r:?}");
    }
}
