//! `shared/texture.wgsl` and the parts of `surface.wgsl` that read textures, against the oracle's texture look-ups.

use glam::{DAffine2, DAffine3, DVec2, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts;
use taugate::internals::render::albedo::AlbedoTable;
use taugate::internals::render::geometry::{Geometry, TexelLayout};
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{AlphaMode, Image, Material, Mesh, Scene, Texture, Wrap};
use taugate::internals::settings::Emitters;
use taugate::internals::wgsl::layout::{NONE, TextureInfo};
use taugate_oracle::texture::sample;

use crate::shader_function::{Contents, ShaderFunction, contents};

pub const KERNELS: &[&ShaderFunction] = &[&SAMPLE, &PARTS, &SURFACE];

/// Textures with every pair of wrap modes and both filters, on images of 1 x 1, 5 x 3 and 8 x 8 texels. Three materials, one
/// per alpha mode, use some of them.
fn scene() -> Scene {
    let mut pcg = Pcg::new(101);
    let mut scene = Scene::default();
    for (width, height) in [(1, 1), (5, 3), (8, 8)] {
        let rgba = (0..width * height).map(|_| pcg.next_u32().to_le_bytes()).collect();
        scene.images.push(Image { width, height, rgba });
        let modes = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
        for wrap in modes.iter().flat_map(|&a| modes.map(|b| [a, b])) {
            let image = scene.images.len() as u32 - 1;
            let transform = DAffine2::IDENTITY;
            scene.textures.extend([true, false].map(|linear| Texture { image, wrap, linear, transform }));
        }
    }
    // Every third texture has a transform of its own. One of them is texture 42, the emission texture of two materials.
    for (i, texture) in scene.textures.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
        let size = DVec2::new(pcg.range(-2.0, 2.0), pcg.range(0.3, 2.0));
        let offset = DVec2::new(pcg.range(-3.0, 3.0), pcg.uniform());
        texture.transform = DAffine2::from_scale_angle_translation(size, i as f64, offset);
    }
    for (i, alpha_mode) in [AlphaMode::Opaque, AlphaMode::Blend, AlphaMode::Mask(0.4)].into_iter().enumerate() {
        let material = Material {
            base_color: [0.9, 0.5, 0.25, 0.75],
            base_color_texture: (i != 0).then_some(20),
            emission: [3.0, 2.0, 1.0],
            emission_texture: (i != 1).then_some(42),
            alpha_mode,
            ..parts::diffuse("textured", [1.0; 3])
        };
        scene.materials.push(material);
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = parts::mesh(
            &mut scene,
            "triangle",
            i as u32,
            Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() },
        );
        parts::place(&mut scene, "node", mesh, DAffine3::IDENTITY);
    }
    scene
}

fn buffers(scene: &Scene) -> (Geometry, [Contents; 3]) {
    let geometry = Geometry::new(scene, &RenderSpace::metres(DVec3::ZERO), &Emitters::Scene, &AlbedoTable::new());
    let buffers = [
        contents("materials", &geometry.materials),
        contents("textures", &geometry.textures),
        texels(scene, &geometry),
    ];
    (geometry, buffers)
}

/// The array of texels of the scene; one word if there are none, because a buffer needs an element to be bound.
pub fn texels(scene: &Scene, geometry: &Geometry) -> Contents {
    let mut bytes = vec![0; TexelLayout::WORD * geometry.texels.words.max(1)];
    let copied = geometry.texels.write(scene, |offset, part| {
        bytes[offset..offset + part.len()].copy_from_slice(part);
        Ok::<(), ()>(())
    });
    copied.expect("copying does not fail");
    contents("texels", &bytes)
}

const SAMPLE: ShaderFunction = ShaderFunction {
    imports: &["texture"],
    input: "uv: vec2<f32>, texture: u32, pad: u32",
    result: "color: vec4<f32>",
    body: "result.color = sample_texture(input.texture, input.uv);",
};

#[test]
fn textures_agree_with_the_oracle() {
    let scene = scene();
    let (_, buffers) = buffers(&scene);
    let mut pcg = Pcg::new(102);
    let mut inputs: Vec<[u32; 4]> = vec![[0.3f32.to_bits(), 0.4f32.to_bits(), NONE, 0]];
    for i in 0..60_000 {
        let texture = i % scene.textures.len();
        let has_transform = scene.textures[texture].transform != DAffine2::IDENTITY;
        let reach = if has_transform { 1.0 } else { [1.0, 3.0, 50.0][i / scene.textures.len() % 3] };
        let mut coordinate = || (pcg.range(-reach, reach) as f32).to_bits();
        inputs.push([coordinate(), coordinate(), texture as u32, 0]);
    }
    let results: Vec<[f32; 4]> = SAMPLE.run(&inputs, &buffers);
    let mut compared = 0;
    for (g, r) in inputs.iter().zip(&results) {
        let uv = DVec2::new(f32::from_bits(g[0]).into(), f32::from_bits(g[1]).into());
        let texture = (g[2] != NONE).then_some(g[2]);
        let expected = sample(&scene, texture, uv);
        if let Some(t) = texture.map(|t| &scene.textures[t as usize]) {
            let image = &scene.images[t.image as usize];
            let p = t.transform.transform_point2(uv) * DVec2::new(image.width.into(), image.height.into());
            // Between two texels, both are the nearest.
            let between = (p - p.round()).abs().min_element() < 4e-4;
            if !t.linear && between {
                continue;
            }
        }
        compared += 1;
        for k in 0..4 {
            // Positions are up to 400 texels, with an error of 3e-5 texels. With a transform, they are below 40 texels. Neighbouring texels
            // differ by up to 1.
            assert!((f64::from(r[k]) - expected[k]).abs() < 4e-4, "{uv} of {:?}: {r:?} {expected:?}", texture);
        }
    }
    assert!(compared > 55_000);
    assert_eq!(results[0], [1.0; 4]);
}

const PARTS: ShaderFunction = ShaderFunction {
    imports: &["texture"],
    input: "i: i32, size: i32, mode: u32, c: f32, x: i32, y: i32, texture: u32, pad: u32",
    result: "texel: vec4<f32>, wrapped: i32, linear: f32, pad: vec2<u32>",
    body: "result.wrapped = wrap_texel(input.i, input.size, input.mode);
        result.linear = srgb_to_linear(vec3<f32>(input.c)).x;
        result.texel = texel(load_texture(input.texture), input.x, input.y, ENCODING_COLOR);",
};

#[test]
fn wrapping_texels_and_srgb() {
    let scene = scene();
    let (geometry, buffers) = buffers(&scene);
    let mut pcg = Pcg::new(103);
    let inputs: Vec<[u32; 8]> = (0..20_000u32)
        .map(|k| {
            // From -1 to 2 size; far outside of this range if the mode is to clamp.
            let mut coordinate = |size: u32, mode: u32| match mode {
                2 => (pcg.below(201) as i32 - 100) as u32,
                _ => (pcg.below(2 * size as usize + 2) as i32 - 1) as u32,
            };
            let size = 1 + k / 3 % 9;
            let texture = k % scene.textures.len() as u32;
            let info = &geometry.textures[texture as usize];
            let (x, y) = (coordinate(info.width, info.sampler & 3), coordinate(info.height, (info.sampler >> 2) & 3));
            let i = coordinate(size, k % 3);
            let c = if k < 256 { k as f32 / 255.0 } else { pcg.uniform() as f32 };
            [i, size, k % 3, c.to_bits(), x, y, texture, 0]
        })
        .collect();
    let results: Vec<[u32; 8]> = PARTS.run(&inputs, &buffers);
    let wrap = |i: i32, size: i32, mode: u32| match mode {
        2 => i.clamp(0, size - 1),
        1 if i.rem_euclid(2 * size) >= size => 2 * size - 1 - i.rem_euclid(2 * size),
        _ => i.rem_euclid(size),
    };
    let linear = |s: f64| if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
    for (g, r) in inputs.iter().zip(&results) {
        assert_eq!(r[4] as i32, wrap(g[0] as i32, g[1] as i32, g[2]), "{g:?}");
        let expected = linear(f32::from_bits(g[3]).into());
        // The Vulkan specification allows `pow` an error of about 2^-16 here.
        assert!((f64::from(f32::from_bits(r[5])) - expected).abs() < 1.6e-5, "{g:?}");
        let info: &TextureInfo = &geometry.textures[g[6] as usize];
        let image = &scene.images[scene.textures[g[6] as usize].image as usize];
        assert_eq!((info.width, info.height), (image.width, image.height));
        let x = wrap(g[4] as i32, info.width as i32, info.sampler & 3) as u32;
        let y = wrap(g[5] as i32, info.height as i32, (info.sampler >> 2) & 3) as u32;
        let bytes = image.rgba[(y * info.width + x) as usize].map(|b| f64::from(b) / 255.0);
        let expected = [linear(bytes[0]), linear(bytes[1]), linear(bytes[2]), bytes[3]];
        for k in 0..4 {
            assert!((f64::from(f32::from_bits(r[k])) - expected[k]).abs() < 1.6e-5, "{g:?}");
        }
    }
}

const SURFACE: ShaderFunction = ShaderFunction {
    imports: &["surface"],
    input: "uv: vec2<f32>, material: u32, pad: u32",
    result: "base: vec4<f32>, emission: vec3<f32>, coverage: f32",
    body: "var s: Surface; s.uv = input.uv; s.material = input.material; s.color = vec4<f32>(1.0);
        result.base = base_color(s); result.emission = emission(s); result.coverage = coverage(s);",
};

#[test]
fn factors_multiply_textures_and_alpha_gives_the_coverage() {
    let scene = scene();
    let (_, buffers) = buffers(&scene);
    let mut pcg = Pcg::new(104);
    let inputs: Vec<[u32; 4]> =
        (0..3000).map(|i| [(pcg.uniform() as f32).to_bits(), (pcg.uniform() as f32).to_bits(), i % 3, 0]).collect();
    let results: Vec<[f32; 8]> = SURFACE.run(&inputs, &buffers);
    for (g, r) in inputs.iter().zip(&results) {
        let uv = DVec2::new(f32::from_bits(g[0]).into(), f32::from_bits(g[1]).into());
        let m = &scene.materials[g[2] as usize];
        let (base, light) = (sample(&scene, m.base_color_texture, uv), sample(&scene, m.emission_texture, uv));
        let expected: Vec<f64> = (0..4).map(|k| f64::from(m.base_color[k]) * base[k]).collect();
        let coverage = match m.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Blend => expected[3],
            AlphaMode::Mask(cutoff) => f64::from(u8::from(expected[3] >= cutoff.into())),
        };
        for k in 0..4 {
            assert!((f64::from(r[k]) - expected[k]).abs() < 1e-4, "{g:?} {r:?} {expected:?}");
        }
        for k in 0..3 {
            assert!((f64::from(r[4 + k]) - f64::from(m.emission[k]) * light[k]).abs() < 3e-4, "{g:?} {r:?}");
        }
        if matches!(m.alpha_mode, AlphaMode::Mask(_)) && (expected[3] - 0.4).abs() < 1e-4 {
            continue;
        }
        assert!((f64::from(r[7]) - coverage).abs() < 1e-4, "{g:?} {r:?} {coverage}");
    }
}
