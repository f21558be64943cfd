//! One test per bug, named after the bug.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, emitter, light, material};
use taugate::internals::generate::shapes::{append, cuboid, quad};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{AlphaMode, LightKind, Material, Mesh, Scene};
use taugate::internals::settings::{Emitters, Estimator, Sampling};

use super::cells::{renderer, settings};
use super::sun::sunny_box;

/// A shadow ray accepted any hit, not the nearest one. When it hit a translucent veil it went on behind the veil, and missed the
/// wall in front of it.
#[test]
fn a_veil_behind_a_wall_does_not_open_the_wall() {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    let sheet =
        |y: f64, half: f64| quad(DVec3::new(-half, y, -half), DVec3::X * 2.0 * half, DVec3::Z * 2.0 * half, [1.0, 1.0]);
    add(&mut scene, "floor", white, sheet(0.0, 1.0));
    // The wall has many small triangles, so that the BVH is not traversed in the order along the ray.
    let mut wall = Mesh::default();
    for i in 0..900 {
        let corner = DVec3::new(f64::from(i % 30) * 0.2 - 3.0, 0.5, f64::from(i / 30) * 0.2 - 3.0);
        append(&mut wall, &quad(corner, DVec3::X * 0.2, DVec3::Z * 0.2, [1.0, 1.0]), glam::DAffine3::IDENTITY);
    }
    add(&mut scene, "wall", white, wall);
    let veil = Material { alpha_mode: AlphaMode::Blend, base_color: [0.5, 0.5, 0.5, 0.3], ..diffuse("veil", [0.0; 3]) };
    let veil = material(&mut scene, veil);
    add(&mut scene, "veil", veil, sheet(1.0, 3.0));
    let lamp = material(&mut scene, emitter("lamp", [50.0; 3]));
    add(&mut scene, "lamp", lamp, sheet(2.0, 0.5));
    camera(&mut scene, DVec3::new(0.0, 0.4, 0.9), DVec3::new(0.0, 0.0, 0.0), 0.9, [16, 16]);
    // Paths have two segments: lamp, floor, pinhole. The wall stands between lamp and floor.
    let s = settings(Estimator::Pt, [16, 16]).max_depth(2).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    renderer.iterate(16).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.film().mean().iter().all(|&x| x == 0.0), "light came through the wall");
}

/// A floor and a wall that a thin beam of 1 W lights. A lamp that is a million times stronger is enclosed in a box far away.
fn beam_beside_a_lamp() -> Scene {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    add(&mut scene, "floor", white, quad(DVec3::new(-2.0, 0.0, -2.0), DVec3::Z * 4.0, DVec3::X * 4.0, [1.0, 1.0]));
    add(&mut scene, "wall", white, quad(DVec3::new(-2.0, 0.0, -2.0), DVec3::X * 4.0, DVec3::Y * 4.0, [1.0, 1.0]));
    // The box encloses the lamp: no light leaves it.
    add(&mut scene, "box", white, cuboid(DVec3::splat(9.0), DVec3::splat(11.0)));
    let lamp = LightKind::Point { intensity: [1e5; 3] };
    light(&mut scene, "lamp", DVec3::splat(10.0), DVec3::NEG_Y, lamp);
    let beam = LightKind::Beam { power: [1.0; 3], radius: 0.0 };
    light(&mut scene, "beam", DVec3::new(0.5, 3.0, 0.0), DVec3::NEG_Y, beam);
    camera(&mut scene, DVec3::new(0.0, 1.5, 3.0), DVec3::new(0.0, 0.5, 0.0), 0.9, [16, 16]);
    scene
}

/// The spot of a beam of zero radius existed only in iterations in which some light path had drawn the beam. The beam is drawn in
/// proportion to its power, so next to a strong lamp its light was lost.
#[test]
fn a_thin_beam_keeps_its_light_beside_a_far_stronger_lamp() {
    let scene = beam_beside_a_lamp();
    for estimator in [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
        let mean = |emitters: Emitters| {
            // Paths have at most three segments: light, spot, another surface, pinhole.
            let s = settings(estimator, [16, 16]).max_depth(3).light_paths(64).emitters(emitters).build().unwrap();
            let mut renderer = renderer(&scene, &s);
            (0..8).for_each(|_| renderer.iterate(8).unwrap_or_else(|e| panic!("{e}")));
            renderer.film().mean().iter().map(|&x| f64::from(x)).sum::<f64>()
        };
        let (both, alone) = (mean(Emitters::Scene), mean(Emitters::Nodes(vec!["beam".into()])));
        assert!(
            alone > 0.0 && (both / alone - 1.0).abs() < 0.02,
            "{estimator:?}: {both} beside the lamp, {alone} alone"
        );
    }
}

/// If any surface has alpha, the first hit of a beam is random. Then the pool gets no vertex of its own for the beam. The bug: the
/// subpaths that are left hardly ever started at a beam beside a far stronger lamp.
#[test]
fn a_weak_beam_keeps_its_light_where_a_surface_has_alpha() {
    let mut scene = beam_beside_a_lamp();
    let veil = Material { alpha_mode: AlphaMode::Blend, base_color: [0.8, 0.8, 0.8, 0.5], ..diffuse("veil", [0.8; 3]) };
    let veil = material(&mut scene, veil);
    add(&mut scene, "veil", veil, quad(DVec3::new(-1.9, 3.9, 0.0), DVec3::X * 0.1, DVec3::Z * 0.1, [1.0, 1.0]));
    let mean = |emitters: Emitters| {
        let s = settings(Estimator::Bdpt, [16, 16]).max_depth(3).light_paths(1000).emitters(emitters).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        (0..8).for_each(|_| renderer.iterate(8).unwrap_or_else(|e| panic!("{e}")));
        renderer.film().mean().iter().map(|&x| f64::from(x)).sum::<f64>()
    };
    // 500 of 8,000 subpaths start at the beam: a standard error of 4.5 %.
    let ratio = mean(Emitters::Scene) / mean(Emitters::Nodes(vec!["beam".into()]));
    assert!((ratio - 1.0).abs() < 0.2, "{ratio} times the light beside the lamp");
}

/// A mask with a cutoff above 1 hides the whole surface. The bug: the surface was opaque where its alpha was 1.
#[test]
fn a_mask_that_no_alpha_reaches_is_not_there() {
    let mut scene = Scene::default();
    let mask = Material { alpha_mode: AlphaMode::Mask(1.5), ..diffuse("mask", [0.0; 3]) };
    let mask = material(&mut scene, mask);
    let lamp = material(&mut scene, emitter("lamp", [1.0; 3]));
    let sheet = |z: f64| quad(DVec3::new(-4.0, -4.0, z), DVec3::X * 8.0, DVec3::Y * 8.0, [1.0, 1.0]);
    add(&mut scene, "mask", mask, sheet(-1.0));
    add(&mut scene, "lamp", lamp, sheet(-2.0));
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.5, [4, 4]);
    let s = settings(Estimator::Pt, [4, 4]).max_depth(1).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    renderer.iterate(1).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.film().mean().iter().all(|&x| x == 1.0), "{:?}", renderer.film().mean());
}

/// A kernel added up the samples of a pixel in a loop whose threads took different exits. SwiftShader then lost samples of pixels
/// with unequal sample counts: lamps were up to 18 % too dark.
#[test]
fn pixels_that_see_a_lamp_alone_show_all_of_it() {
    let mut scene = Scene::default();
    let lamp = material(&mut scene, emitter("lamp", [1.0; 3]));
    // The lamp's edges are 7.5 pixels from the centre. Adaptive sampling gives the pixels on an edge more samples.
    let half = 2.0 * (0.25f64).tan() * 7.5 / 12.0;
    add(
        &mut scene,
        "lamp",
        lamp,
        quad(DVec3::new(-half, -half, -2.0), DVec3::X * 2.0 * half, DVec3::Y * 2.0 * half, [1.0, 1.0]),
    );
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.5, [24, 24]);
    let s = settings(Estimator::Pt, [24, 24]).max_depth(1).sampling(Sampling::Adaptive).build().unwrap();
    let mut renderer = renderer(&scene, &s);
    (0..4).for_each(|_| renderer.iterate(16).unwrap_or_else(|e| panic!("{e}")));
    let [min, max] = renderer.samples_in_pixels();
    assert!(min < max, "{min} samples in every pixel");
    let mean = renderer.film().mean();
    for y in 5..19 {
        for x in 5..19 {
            let pixel = &mean[(y * 24 + x) * 3..][..3];
            assert!(pixel.iter().all(|&value| value == 1.0), "pixel {x}, {y}: {pixel:?}");
        }
    }
}

/// The unit of render space was the distance of the farthest object. One object 1e10 m away made the squared distances of the near
/// scene so small that MIS weights no longer summed to 1. The image became up to twice as bright with `pt`, and more with `bdpt`.
/// Later, the far point that stands for a sun was no farther away than such an object, so the sun shone from another direction.
#[test]
fn an_object_far_behind_the_camera_changes_nothing() {
    let (lamp, mut sun) = (build(Kind::CornellBox), sunny_box());
    sun.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    let cases = [(&lamp, Estimator::Pt), (&lamp, Estimator::Bdpt), (&lamp, Estimator::Lcs), (&sun, Estimator::Pt)];
    for (near, estimator) in cases {
        let render = |scene: &Scene| {
            let s = settings(estimator, [16, 16]).max_depth(4).build().unwrap();
            let mut renderer = renderer(scene, &s);
            renderer.iterate(16).unwrap_or_else(|e| panic!("{e}"));
            renderer.film().mean().iter().map(|&x| f64::from(x)).sum::<f64>()
        };
        let alone = render(near);
        for distance in [1e7, 1e10, 1e12] {
            let mut scene = near.clone();
            let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
            add(&mut scene, "far", grey, quad(DVec3::new(0.0, 0.0, distance), DVec3::X, DVec3::Y, [1.0, 1.0]));
            let ratio = render(&scene) / alone;
            assert!((ratio - 1.0).abs() < 1e-3, "{estimator}, {distance:e} m: {ratio} times as bright");
        }
    }
}
