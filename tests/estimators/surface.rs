//! Properties that vary over a surface: roughness and metalness, vertex colours, normal maps. The estimators agree with the
//! oracle and with closed forms.

use std::f64::consts::TAU;

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, metal, plastic};
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::scene::{Image, Material, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;
use taugate_oracle::bsdf::{Bsdf, PreparedMaterial};

use super::agreement::{against, assert_none, feature_estimators, oracle, oracle_samples};
use super::cells::{Cells, is_long, renderer, settings, threshold};

/// An image of 8 x 8 random texels.
fn image(seed: u64, mut texel: impl FnMut(&mut Pcg) -> [u8; 3]) -> Image {
    let mut pcg = Pcg::new(seed);
    let mut opaque = |_| {
        let [r, g, b] = texel(&mut pcg);
        [r, g, b, 255]
    };
    Image { width: 8, height: 8, rgba: (0..64).map(&mut opaque).collect() }
}

/// An image of one white texel, which changes no factor. Negative controls use it in place of another image, so that they share
/// the kernels of the tested scene.
fn white() -> Image {
    Image { width: 1, height: 1, rgba: vec![[255; 4]] }
}

/// Changes the materials of the floor, the walls and a ring, all of which have texture coordinates.
fn change(scene: &mut Scene, change: impl Fn(Material) -> Material) {
    for material in &mut scene.materials {
        if ["floor", "wall", "brass"].contains(&material.name.as_str()) {
            *material = change(material.clone());
        }
    }
}

/// Texels that vary roughness (0.3 to 1) and metalness.
fn roughness_and_metalness() -> Image {
    image(77, |pcg| [0, 80 + pcg.below(176) as u8, pcg.below(256) as u8])
}

/// The room with every feature. `texels` vary roughness and metalness. The floor and a translucent curtain have vertex colours. The
/// walls are dark, and have a rough clear coat of this strength.
fn varied(texels: Image, clearcoat: f32) -> Scene {
    let mut scene = zoo(Light::Area);
    let texture = scene.add_texture(texels);
    change(&mut scene, |material| Material {
        metallic: 0.9,
        roughness: 0.9,
        specular: 1.0,
        surface_texture: Some(texture),
        ..material
    });
    let wall = scene.materials.iter_mut().find(|material| material.name == "wall").unwrap();
    let dark = Material { metallic: 0.3, base_color_texture: None, base_color: [0.05, 0.1, 0.1, 1.0], ..wall.clone() };
    *wall = Material { clearcoat, clearcoat_roughness: 0.5, ..dark };
    let mut pcg = Pcg::new(78);
    for mesh in scene.meshes.iter_mut().filter(|mesh| ["floor", "curtain"].contains(&mesh.name.as_str())) {
        mesh.colors = mesh.positions.iter().map(|_| [0; 4].map(|_| pcg.range(0.1, 1.0) as f32)).collect();
    }
    scene
}

/// Adds a normal map to the floor, the walls and a ring of the room.
fn with_normal_map(mut scene: Scene, map: Image) -> Scene {
    let texture = scene.add_texture(map);
    change(&mut scene, |material| Material { normal_texture: Some(texture), ..material });
    scene.meshes.iter_mut().for_each(|mesh| mesh.add_tangents().unwrap());
    scene
}

/// Normals that lean by up to about 45 degrees.
fn bumps() -> Image {
    image(79, |pcg| [60 + pcg.below(136) as u8, 60 + pcg.below(136) as u8, 220])
}

const GATES: [(f64, f64); 2] = [(5.0, 6.0), (0.0, f64::INFINITY)];

#[test]
fn varying_roughness_metalness_colours_and_a_coat_agree_with_the_oracle() {
    let scene = varied(roughness_and_metalness(), 1.0);
    let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
    assert_none(against("varied", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative controls: factors without the texture, and hardly any coat, with the same kernels.
    for (name, other) in [("no texture", varied(white(), 1.0)), ("no coat", varied(roughness_and_metalness(), 1e-6))] {
        assert!(!against(name, &[Estimator::Lcs], &other, &GATES[..1], &truth).is_empty(), "{name}");
    }
}

/// The room. `change_one` makes the materials of its floor, walls and ring from diffuse ones.
fn room_of(change_one: impl Fn(Material) -> Material) -> Scene {
    let mut scene = zoo(Light::Area);
    change(&mut scene, |m| change_one(Material { metallic: 0.0, roughness: 0.6, specular: 0.0, ..m }));
    scene
}

/// `cargo test --release --test estimators -- --ignored clear_coats`
#[test]
#[ignore = "takes ten seconds; a coat on the walls of another room is tested always"]
fn clear_coats_agree_with_the_oracle() {
    // Rough, and smooth in long runs. The base is partly a metal, so that a lobe lies under the coat, too.
    for &clearcoat_roughness in if is_long() { &[0.5, 0.0][..] } else { &[0.5] } {
        // The base is dark, so that the coat sends a large part of the light.
        let dark = |m| Material { metallic: 0.3, base_color_texture: None, base_color: [0.05, 0.1, 0.1, 1.0], ..m };
        let of = |clearcoat| room_of(|m| Material { clearcoat, clearcoat_roughness, ..dark(m) });
        let scene = of(1.0);
        let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
        assert_none(against("clear coat", &feature_estimators(&scene), &scene, &GATES, &truth));
        // Negative control: hardly any clear coat, with the same kernels.
        assert!(!against("bare", &[Estimator::Lcs], &of(1e-6), &GATES[..1], &truth).is_empty());
    }
}

/// `cargo test --release --test estimators -- --ignored specular_colours`
#[test]
#[ignore = "textures of specular colours are tested always"]
fn specular_colours_agree_with_the_oracle() {
    let of = |specular_color| room_of(|m| Material { specular: 0.9, specular_color, ..m });
    let scene = of([0.2, 2.0, 12.0]);
    let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
    assert_none(against("colours", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative control: almost white, with the same kernels.
    assert!(!against("white", &[Estimator::Lcs], &of([1.0, 1.0, 1.001]), &GATES[..1], &truth).is_empty());
}

/// An image whose four channels vary.
fn four_channels() -> Image {
    let mut pcg = Pcg::new(80);
    let texel = |_| [0; 4].map(|_| pcg.below(256) as u8);
    Image { width: 8, height: 8, rgba: (0..64).map(texel).collect() }
}

/// Adds a texture to the room, and changes materials with `with`, which receives the texture.
fn with_texture(room: &Scene, image: Image, with: impl Fn(Material, Option<u32>) -> Material) -> Scene {
    let mut scene = room.clone();
    let texture = Some(scene.add_texture(image));
    change(&mut scene, |m| with(m, texture));
    scene
}

/// `cargo test --release --test estimators -- --ignored varying_plastics`
#[test]
#[ignore = "takes twenty seconds; the textures of coats are tested always"]
fn varying_plastics_agree_with_the_oracle() {
    let plain = room_of(|m| Material { specular: 0.9, specular_color: [4.0, 10.0, 40.0], ..m });
    let of = |image| {
        with_texture(&plain, image, |m, texture| Material {
            specular_texture: texture,
            specular_color_texture: texture,
            ..m
        })
    };
    let scene = of(four_channels());
    let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
    assert_none(against("varied plastic", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative control: factors without textures.
    assert!(!against("plain plastic", &[Estimator::Lcs], &of(white()), &GATES[..1], &truth).is_empty());
}

/// The long version of `clear_coats_agree_with_the_oracle`, with textures.
/// `cargo test --release --test estimators -- --ignored varying_clear_coats`
#[test]
#[ignore = "takes half a minute; coats without textures and the textures of coats are tested always"]
fn varying_clear_coats_agree_with_the_oracle() {
    // The base is dark, so that the coat sends a large part of the light.
    let dark = |m| Material { base_color_texture: None, base_color: [0.02, 0.05, 0.05, 1.0], ..m };
    let plain = room_of(|m| Material { clearcoat: 1.0, clearcoat_roughness: 0.8, ..dark(m) });
    let of = |image| {
        with_texture(&plain, image, |m, texture| Material {
            clearcoat_texture: texture,
            clearcoat_roughness_texture: texture,
            ..m
        })
    };
    let scene = of(four_channels());
    let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
    assert_none(against("varied clear coat", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative control: factors without textures.
    assert!(!against("plain clear coat", &[Estimator::Lcs], &of(white()), &GATES[..1], &truth).is_empty());
}

/// Adds a surface beside the room at `z`, with coats whose strengths, colour and roughness are textures. Kernels take
/// many seconds to compile, and all scenes with this surface share them, whatever coats their other surfaces have.
fn add_textured_coats(scene: &mut Scene, z: f64, roughness: f32) {
    let white = Some(scene.add_texture(white()));
    let material = scene.add_material(Material {
        roughness,
        specular: 1.0,
        clearcoat: 1.0,
        specular_texture: white,
        specular_color_texture: white,
        clearcoat_texture: white,
        clearcoat_roughness_texture: white,
        ..diffuse("coats", [0.5; 3])
    });
    add(scene, "coats", material, quad(DVec3::new(0.0, 0.0, z), DVec3::X * 0.1, DVec3::Y * 0.1, [1.0, 1.0]));
}

/// Textures of one colour give the same image as factors, up to the rounding of texels to bytes.
#[test]
#[ignore = "takes five seconds; textures are compared with the oracle always"]
fn constant_textures_are_factors() {
    let image_of = |scene: &Scene| {
        let settings = settings(Estimator::Bdpt, [24, 16]).max_depth(6).build().unwrap();
        let mut renderer = renderer(scene, &settings);
        renderer.iterate(8).unwrap();
        renderer.film().mean()
    };
    // The bytes of colours are sRGB: 188 is 0.503.
    let half = 0.502_886_5;
    let mut factors = room_of(|m| Material {
        specular: 0.4,
        specular_color: [20.0 * half, 10.0, 5.0 * half],
        clearcoat: 0.2,
        clearcoat_roughness: 0.6,
        ..m
    });
    let mut textured = room_of(|m| Material {
        specular: 1.0,
        specular_color: [20.0, 10.0, 5.0],
        clearcoat: 1.0,
        clearcoat_roughness: 1.0,
        ..m
    });
    let mut plain = |rgba| Some(textured.add_texture(Image { width: 1, height: 1, rgba: vec![rgba] }));
    let color = plain([188, 255, 188, 102]);
    let coat = plain([51, 153, 0, 0]);
    change(&mut textured, |m| Material {
        specular_texture: color,
        specular_color_texture: color,
        clearcoat_texture: coat,
        clearcoat_roughness_texture: coat,
        ..m
    });
    for scene in [&mut factors, &mut textured] {
        add_textured_coats(scene, -6.0, 0.6);
    }
    let (a, b) = (image_of(&factors), image_of(&textured));
    let sum: f64 = a.iter().map(|x| f64::from(*x)).sum();
    let off: f64 = a.iter().zip(&b).map(|(x, y)| f64::from((x - y).abs())).sum();
    eprintln!("mean difference {:.5} of the mean", off / sum);
    assert!(off < 0.01 * sum, "{off} of {sum}");
}

#[test]
#[ignore = "takes ten seconds; a leaning normal is tested always, and `parity` compares normals with the oracle"]
fn normal_maps_agree_with_the_oracle() {
    let scene = with_normal_map(zoo(Light::Area), bumps());
    let truth = oracle(&scene, &GATES, [24, 16], oracle_samples());
    assert_none(against("bumps", &feature_estimators(&scene), &scene, &GATES, &truth));
    // Negative control: half of the slopes.
    let mut smoother = scene.clone();
    change(&mut smoother, |material| Material { normal_scale: 0.5, ..material });
    assert!(!against("smoother", &[Estimator::Lcs], &smoother, &GATES[..1], &truth).is_empty());
}

/// A map of (128, 128, 255) changes no bit of the image.
#[test]
#[ignore = "takes five seconds; `parity` tests flat normal maps always"]
fn a_flat_normal_map_changes_nothing() {
    let image_of = |scene: &Scene| {
        let settings = settings(Estimator::Lcs, [24, 16]).max_depth(6).build().unwrap();
        let mut renderer = renderer(scene, &settings);
        renderer.iterate(2).unwrap();
        renderer.film().mean()
    };
    let plain = zoo(Light::Area);
    let flat = with_normal_map(plain.clone(), image(0, |_| [128, 128, 255]));
    assert_eq!(image_of(&plain), image_of(&flat));
}

/// A white plane in a box whose walls emit a radiance of 1, and a camera at `eye` that sees only the plane. The normal map
/// leans all normals by 45 degrees towards +x.
fn leaning(eye: DVec3, material: Material) -> Scene {
    let mut scene = Scene::default();
    let texture = scene.add_texture(image(0, |_| [218, 128, 218]));
    let white = scene.add_material(Material { normal_texture: Some(texture), ..material });
    let lamp = scene.add_material(emitter("lamp", [1.0; 3]));
    add(&mut scene, "plane", white, quad(DVec3::new(-1.0, -1.0, 0.0), DVec3::X * 2.0, DVec3::Y * 2.0, [1.0, 1.0]));
    add(&mut scene, "box", lamp, inside_out(cuboid(DVec3::splat(-3.0), DVec3::splat(3.0))));
    scene.meshes[0].add_tangents().unwrap();
    camera(&mut scene, eye, DVec3::ZERO, 0.2, [8, 8]);
    scene
}

/// A Lambert plane whose normal leans by the angle a reflects (1 + cos a) / 2 of the light to all viewers on the side of the
/// normal: the rest would come from below the plane. Viewers on the other side see a flat plane, which loses nothing.
#[test]
fn a_leaning_normal_loses_no_more_than_the_light_from_below() {
    for (x, expected) in [(1.5, (1.0 + 0.5f64.sqrt()) / 2.0), (-1.5, 1.0)] {
        let scene = leaning(DVec3::new(x, 0.2, 0.6), diffuse("white", [1.0; 3]));
        for estimator in feature_estimators(&scene) {
            let s = settings(estimator, [8, 8]).max_depth(2).build().unwrap();
            let (mean, error) = Cells::measure(&mut renderer(&scene, &s), Gate::OPEN, 8, 1, 16, 60).whole();
            eprintln!("{estimator} from x = {x}: {mean:.5} +- {error:.5}, expected {expected:.5}");
            assert!((mean - expected).abs() < threshold(8) * error + 1e-4, "{estimator}, {x}: {mean} +- {error}");
            assert!(error < 0.01);
        }
    }
}

/// Light that a plane with this normal sends towards `wo` if a radiance of 1 arrives from all directions above z = 0: an integral with
/// the BSDF of the oracle.
fn albedo(bsdf: &Bsdf, normal: DVec3, wo: DVec3) -> f64 {
    let x = normal.any_orthonormal_vector();
    let local = |d: DVec3| DVec3::new(d.dot(x), d.dot(normal.cross(x)), d.dot(normal));
    let (rings, sectors) = (300, 600);
    let mut sum = 0.0;
    for i in 0..rings {
        let cosine = (i as f64 + 0.5) / rings as f64;
        let sine = (1.0 - cosine * cosine).sqrt();
        for j in 0..sectors {
            let (sin, cos) = (TAU * (j as f64 + 0.5) / sectors as f64).sin_cos();
            let wi = local(DVec3::new(sine * cos, sine * sin, cosine));
            sum += bsdf.eval(wi, local(wo))[0] * wi.z.max(0.0);
        }
    }
    sum * TAU / (rings * sectors) as f64
}

/// White furnace with a normal map: rough metal and plastic reflect the light from above that their lobes at the turned normal collect,
/// and no more than arrives. Viewers behind the turned normal see a flat plane.
#[test]
#[ignore = "takes ten seconds; a leaning normal of a diffuse plane is tested always"]
fn leaning_glossy_lobes_gain_nothing() {
    // The texel of `leaning`.
    let normal = (DVec3::new(218.0, 128.0, 218.0) / 127.5 - 1.0).normalize();
    for (x, material) in [
        (1.5, metal("metal", [1.0; 3], 0.5)),
        (0.2, metal("metal", [1.0; 3], 0.5)),
        (-1.5, metal("metal", [1.0; 3], 0.5)),
        (1.5, plastic("plastic", [1.0; 3], 0.5)),
    ] {
        let scene = leaning(DVec3::new(x, 0.2, 0.6), material.clone());
        let prepared = PreparedMaterial::new(&material);
        let bsdf = prepared.at([1.0; 3]);
        let pixels = (0..64).map(|i| [f64::from(i % 8) + 0.5, f64::from(i / 8) + 0.5]);
        let towards_eye = pixels.map(|pixel| -scene.cameras[0].direction([8, 8], pixel));
        let seen = |wo: DVec3| if wo.dot(normal) > 0.0 { normal } else { DVec3::Z };
        let expected = towards_eye.map(|wo| albedo(&bsdf, seen(wo), wo)).sum::<f64>() / 64.0;
        assert!(expected < 1.001, "{expected}");
        for estimator in feature_estimators(&scene) {
            let s = settings(estimator, [8, 8]).max_depth(2).build().unwrap();
            let (mean, error) = Cells::measure(&mut renderer(&scene, &s), Gate::OPEN, 8, 2, 16, 60).whole();
            eprintln!("{} from x = {x}, {estimator}: {mean:.5} +- {error:.5}, expected {expected:.5}", material.name);
            assert!((mean - expected).abs() < threshold(8) * error + 2e-3, "{estimator}, {x}: {mean} +- {error}");
            assert!(error < 0.01);
        }
    }
}

/// A smooth black plane in a box whose walls emit a radiance of 1 shows the Fresnel reflectance of its coat. A texture of a coat
/// has two texels: the left half of the plane has the left one.
#[test]
fn a_textured_coat_reflects_in_proportion_to_its_texels() {
    let black = Material { roughness: 0.0, base_color: [0.0, 0.0, 0.0, 1.0], ..diffuse("black", [0.0; 3]) };
    let schlick = |f0: f64, cosine: f64| f0 + (1.0 - f0) * (1.0 - cosine).powi(5);
    // Kind of coat, the texels, and F0 and the strength of both halves.
    let left = [102, 188, 153, 51];
    let cases = [
        ("clear coat", [(0.04, 0.4), (0.04, 1.0)]),
        ("strength", [(0.04, 0.2), (0.04, 1.0)]),
        ("colour", [(0.04 * 0.1328683, 1.0), (0.04, 1.0)]),
    ];
    for (name, expected) in cases {
        let mut scene = leaning(DVec3::new(0.0, -1.2, 0.9), black.clone());
        let image = Image { width: 2, height: 1, rgba: vec![left, [255; 4]] };
        let texture = scene.add_texture(image);
        scene.textures[texture as usize].linear = false;
        let of = |kind| (name == kind).then_some(texture);
        let (clearcoat_texture, specular_texture, specular_color_texture) =
            (of("clear coat"), of("strength"), of("colour"));
        let m = &mut scene.materials[0];
        m.normal_texture = None;
        let (clearcoat, specular) = if clearcoat_texture.is_some() { (1.0, 0.0) } else { (0.0, 1.0) };
        *m = Material { clearcoat, specular, clearcoat_texture, specular_texture, specular_color_texture, ..m.clone() };
        add_textured_coats(&mut scene, -4.0, 0.0);
        for estimator in feature_estimators(&scene) {
            let s = settings(estimator, [8, 8]).max_depth(2).build().unwrap();
            let mut renderer = renderer(&scene, &s);
            renderer.iterate(4).unwrap();
            let film = renderer.film().mean();
            // Red. The columns next to the border between the halves are left out.
            for (half, (f0, strength)) in expected.into_iter().enumerate() {
                for (row, column) in (0..8).flat_map(|row| (0..3).map(move |column| (row, column))) {
                    let column = if half == 0 { column } else { 7 - column };
                    let seen = scene.cameras[0].direction([8, 8], [column as f64 + 0.5, row as f64 + 0.5]);
                    let truth = strength * schlick(f0, -seen.z);
                    let got = f64::from(film[3 * (row * 8 + column)]);
                    assert!((got / truth - 1.0).abs() < 0.03, "{name}, {estimator}, {column}, {row}: {got} {truth}");
                }
            }
        }
    }
}
