//! Properties that vary over a surface: roughness and metalness, vertex colours, normal maps. The estimators agree with the
//! oracle and with closed forms.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::generate::stage::{add, camera, diffuse, emitter};
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::scene::{Image, Material, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{against, assert_none, oracle};
use super::cells::{Cells, renderer, settings, threshold};

/// An image of 8 x 8 random texels.
fn image(seed: u64, mut texel: impl FnMut(&mut Pcg) -> [u8; 3]) -> Image {
    let mut pcg = Pcg::new(seed);
    let mut opaque = |_| {
        let [r, g, b] = texel(&mut pcg);
        [r, g, b, 255]
    };
    Image { width: 8, height: 8, rgba: (0..64).map(&mut opaque).collect() }
}

/// Changes the materials of the floor, the walls and a ring, all of which have texture coordinates.
fn change(scene: &mut Scene, change: impl Fn(Material) -> Material) {
    for material in &mut scene.materials {
        if ["floor", "wall", "brass"].contains(&material.name.as_str()) {
            *material = change(material.clone());
        }
    }
}

/// The room with every feature. A texture varies roughness (0.3 to 1) and metalness. The floor and a translucent curtain have
/// vertex colours.
fn varied() -> Scene {
    let mut scene = zoo(Light::Area);
    let texture = scene.add_texture(image(77, |pcg| [0, 80 + pcg.below(176) as u8, pcg.below(256) as u8]));
    change(&mut scene, |material| Material {
        metallic: 0.9,
        roughness: 0.9,
        specular: 1.0,
        surface_texture: Some(texture),
        ..material
    });
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
    scene.meshes.iter_mut().for_each(|mesh| mesh.add_tangents());
    scene
}

/// Normals that lean by up to about 45 degrees.
fn bumps() -> Image {
    image(79, |pcg| [60 + pcg.below(136) as u8, 60 + pcg.below(136) as u8, 220])
}

const GATES: [(f64, f64); 2] = [(5.0, 6.0), (0.0, f64::INFINITY)];

#[test]
fn varying_roughness_metalness_and_colours_agree_with_the_oracle() {
    let scene = varied();
    let truth = oracle(&scene, &GATES, [24, 16], 800);
    assert_none(against("varied", &Estimator::ALL, &scene, &GATES, &truth));
    // Negative control: factors without the texture.
    let mut plain = scene.clone();
    plain.materials.iter_mut().for_each(|material| material.surface_texture = None);
    assert!(!against("no texture", &[Estimator::Lcs], &plain, &GATES, &truth).is_empty());
}

/// The room, whose floor, walls and ring have another material: `change` of a diffuse one.
fn room_of(change_one: impl Fn(Material) -> Material) -> Scene {
    let mut scene = zoo(Light::Area);
    change(&mut scene, |m| change_one(Material { metallic: 0.0, roughness: 0.6, specular: 0.0, ..m }));
    scene
}

#[test]
fn clear_coats_agree_with_the_oracle() {
    // Rough and smooth. The base is partly a metal, so that a lobe lies under the coat, too.
    for clearcoat_roughness in [0.5, 0.0] {
        // The base is dark, so that the coat sends a large part of the light.
        let dark = |m| Material { metallic: 0.3, base_color_texture: None, base_color: [0.05, 0.1, 0.1, 1.0], ..m };
        let of = |clearcoat| room_of(|m| Material { clearcoat, clearcoat_roughness, ..dark(m) });
        let scene = of(1.0);
        let truth = oracle(&scene, &GATES, [24, 16], 800);
        assert_none(against("clear coat", &Estimator::ALL, &scene, &GATES, &truth));
        // Negative control: no clear coat.
        assert!(!against("bare", &[Estimator::Lcs], &of(0.0), &GATES, &truth).is_empty());
    }
}

#[test]
fn specular_colours_agree_with_the_oracle() {
    let of = |specular_color| room_of(|m| Material { specular: 0.9, specular_color, ..m });
    let scene = of([0.2, 2.0, 12.0]);
    let truth = oracle(&scene, &GATES, [24, 16], 800);
    assert_none(against("colours", &Estimator::ALL, &scene, &GATES, &truth));
    // Negative control: white.
    assert!(!against("white", &[Estimator::Lcs], &of([1.0; 3]), &GATES, &truth).is_empty());
}

#[test]
fn normal_maps_agree_with_the_oracle() {
    let scene = with_normal_map(zoo(Light::Area), bumps());
    let truth = oracle(&scene, &GATES, [24, 16], 800);
    assert_none(against("bumps", &Estimator::ALL, &scene, &GATES, &truth));
    // Negative control: half of the slopes.
    let mut smoother = scene.clone();
    change(&mut smoother, |material| Material { normal_scale: 0.5, ..material });
    assert!(!against("smoother", &[Estimator::Lcs], &smoother, &GATES, &truth).is_empty());
}

/// A map of (128, 128, 255) changes no bit of the image.
#[test]
fn a_flat_normal_map_changes_nothing() {
    let image_of = |scene: &Scene| {
        let settings = settings(Estimator::Bdpt, [24, 16]).max_depth(6).build().unwrap();
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
    scene.meshes[0].add_tangents();
    camera(&mut scene, eye, DVec3::ZERO, 0.2, [8, 8]);
    scene
}

/// A Lambert plane whose normal leans by the angle a reflects (1 + cos a) / 2 of the light to all viewers on the side of the
/// normal: the rest would come from below the plane. Viewers on the other side see a flat plane, which loses nothing.
#[test]
fn a_leaning_normal_loses_no_more_than_the_light_from_below() {
    for (x, expected) in [(1.5, (1.0 + 0.5f64.sqrt()) / 2.0), (-1.5, 1.0)] {
        let scene = leaning(DVec3::new(x, 0.2, 0.6), diffuse("white", [1.0; 3]));
        for estimator in Estimator::ALL {
            let s = settings(estimator, [8, 8]).max_depth(2).build().unwrap();
            let (mean, error) = Cells::measure(&mut renderer(&scene, &s), Gate::OPEN, 8, 1, 16, 60).whole();
            eprintln!("{estimator} from x = {x}: {mean:.5} +- {error:.5}, expected {expected:.5}");
            assert!((mean - expected).abs() < threshold(8) * error + 1e-4, "{estimator}, {x}: {mean} +- {error}");
            assert!(error < 0.01);
        }
    }
}
