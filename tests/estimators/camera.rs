//! Moving the camera of a renderer that was prepared for another position.

use glam::DVec3;
use taugate::internals::generate::parts::{add, glass, light, material};
use taugate::internals::generate::shapes::cuboid;
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::{PreparedScene, Renderer};
use taugate::internals::scene::{Camera, LightKind, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Merge, Sampling, Settings};

use super::cells::{Cells, device, disagreements, renderer, settings};

const SIZE: [u32; 2] = [24, 16];
const GATE: Gate = Gate { lo: 8.0, hi: 9.0 };
/// Largest fraction of the light that may change when all coordinates round differently. A ray or a random choice at an edge may
/// fall to the other side, and each of the 1,536 paths of an iteration is a visible part of the image.
const ROUNDING: f64 = 2e-3;
/// The unit of render space in the Cornell box, in metres, and the maximum distance of a sensor from the origin of render space.
const UNIT: f64 = 4.0;
const MAX_DISTANCE: f64 = UNIT / 4.0;

fn short(estimator: Estimator) -> Settings {
    settings(estimator, SIZE).max_depth(8).light_paths(500).build().unwrap()
}

/// Without photons, whose aims rounding may change: images with them have the same mean, but other noise.
fn without_photons(estimator: Estimator) -> Settings {
    short(estimator).change().merge(Merge::Off).build().unwrap()
}

/// The Cornell box with its area light, a glass block, a point light and a beam.
fn mixed() -> Scene {
    let mut scene = build(Kind::CornellBox);
    let clear = material(&mut scene, glass("glass"));
    add(&mut scene, "block", clear, cuboid(DVec3::new(0.1, 0.62, 0.1), DVec3::new(0.5, 0.9, 0.5)));
    let point = LightKind::Point { intensity: [0.3, 0.5, 0.9] };
    light(&mut scene, "point", DVec3::new(0.7, 1.6, 0.5), DVec3::NEG_Y, point);
    let beam = LightKind::Beam { power: [2.0, 1.0, 1.0], radius: 0.02 };
    light(&mut scene, "beam", DVec3::new(0.2, 1.2, 0.9), DVec3::new(-0.2, -0.3, -1.0), beam);
    scene
}

/// The scene's camera, moved by `metres`.
fn moved(scene: &Scene, metres: f64) -> Camera {
    let mut camera = scene.cameras[0].clone();
    camera.transform.translation += metres * DVec3::new(0.6, -0.3, 0.74).normalize();
    camera
}

/// A renderer that was prepared for a camera `metres` away, and then received the scene's own camera.
fn from_elsewhere(scene: &Scene, settings: &Settings, metres: f64) -> Renderer {
    let elsewhere = Scene { cameras: vec![moved(scene, metres)], ..scene.clone() };
    let mut renderer = renderer(&elsewhere, settings);
    renderer.iterate(1).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.set_camera(&scene.cameras[0]).unwrap(), "the renderer refused a move by {metres} m");
    assert_eq!(renderer.film().iterations(), 0, "the film is not empty after the move");
    renderer
}

fn image(renderer: &mut Renderer) -> Vec<f32> {
    renderer.restart(5, GATE).unwrap();
    (0..4).for_each(|_| renderer.iterate(4).unwrap_or_else(|e| panic!("{e}")));
    renderer.film().mean()
}

/// Sum of the absolute differences of `a` and `b`, relative to the sum of `a`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let sum = |values: &mut dyn Iterator<Item = f32>| values.map(f64::from).sum::<f64>();
    sum(&mut a.iter().zip(b).map(|(x, y)| (x - y).abs())) / sum(&mut a.iter().copied())
}

#[test]
fn a_camera_that_stays_sees_the_same_bits() {
    let scene = build(Kind::CornellBox);
    for estimator in Estimator::ALL {
        let settings = short(estimator).change().sampling(Sampling::Adaptive).build().unwrap();
        let usual = image(&mut renderer(&scene, &settings));
        assert!(usual.iter().any(|&x| x > 0.0), "a black image proves nothing");
        assert!(usual == image(&mut from_elsewhere(&scene, &settings, 0.0)), "{estimator:?}");
    }
}

#[test]
fn a_moved_camera_gives_the_image_of_a_new_renderer() {
    let scene = mixed();
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        let settings = without_photons(estimator);
        let usual = image(&mut renderer(&scene, &settings));
        let there = image(&mut from_elsewhere(&scene, &settings, 0.99 * MAX_DISTANCE));
        let difference = difference(&usual, &there);
        assert!(difference < ROUNDING, "{estimator:?}: {difference:e}");
    }
    // Rounding may swap light vertices in the order of a tree, so images of lcs differ and only their means can be compared. There are
    // photons, too.
    let settings = short(Estimator::Lcs);
    let usual = Cells::measure(&mut renderer(&scene, &settings), GATE, 8, 1, 4, 1);
    let mut renderer = from_elsewhere(&scene, &settings, 0.99 * MAX_DISTANCE);
    let found = disagreements(&usual, &Cells::measure(&mut renderer, GATE, 8, 1, 4, 1001));
    assert!(found.is_empty(), "{found:?}");
}

/// Negative control: a camera that is a centimetre off.
#[test]
#[ignore = "takes ten seconds; the tests whose sensitivity it shows run always"]
fn a_camera_beside_its_place_is_noticed() {
    let scene = mixed();
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        let mut renderer = renderer(&scene, &short(estimator));
        let usual = image(&mut renderer);
        assert!(renderer.set_camera(&moved(&scene, 0.01)).unwrap());
        assert!(difference(&usual, &image(&mut renderer)) > 2.0 * ROUNDING, "{estimator:?}");
    }
}

#[test]
fn a_camera_too_far_away_is_refused() {
    let scene = build(Kind::CornellBox);
    let mut renderer = renderer(&scene, &short(Estimator::Bdpt));
    renderer.iterate(1).unwrap_or_else(|e| panic!("{e}"));
    let before = renderer.film().mean();
    assert!(!renderer.set_camera(&moved(&scene, 1.01 * MAX_DISTANCE)).unwrap());
    assert_eq!((renderer.film().iterations(), renderer.film().mean()), (1, before));
    assert!(renderer.set_camera(&moved(&scene, 0.99 * MAX_DISTANCE)).unwrap());
}

/// The bounds on travel times follow the camera: a gate may be dark for the first camera and lit for the next.
#[test]
fn a_moved_camera_has_its_own_bounds() {
    let scene = build(Kind::CornellBox);
    let back = |metres: f64| {
        let mut camera = scene.cameras[0].clone();
        camera.transform.translation.z += metres;
        camera
    };
    // Light from the lamp travels about 4 m to the camera. For a camera 0.9 m further back, no light arrives in this gate.
    let nearest = DVec3::new(0.0, 1.98, 0.25).distance(scene.cameras[0].transform.translation);
    let gate = Gate { lo: 0.0, hi: nearest + 0.2 };
    let settings = short(Estimator::Bdpt).change().gate(gate).build().unwrap();
    let mut renderer = renderer(&Scene { cameras: vec![back(0.9)], ..scene.clone() }, &settings);
    assert!(renderer.is_dark());
    assert!(renderer.set_camera(&back(0.0)).unwrap() && !renderer.is_dark());
    renderer.iterate(4).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.film().mean().iter().any(|&x| x > 0.0), "the lamp is in view");
    assert!(renderer.set_camera(&back(0.9)).unwrap());
}

/// A preview shares the prepared scene with the full renderer, but moves only its own camera and headlamp.
#[test]
fn a_headlamp_moves_with_the_camera_of_a_preview() {
    let with_headlamp = |camera: Camera| {
        let mut scene = mixed();
        light(
            &mut scene,
            "headlamp",
            camera.transform.translation,
            DVec3::NEG_Z,
            LightKind::Point { intensity: [9.0; 3] },
        );
        Scene { cameras: vec![camera], ..scene }
    };
    let scene = with_headlamp(mixed().cameras[0].clone());
    let elsewhere = with_headlamp(moved(&scene, 0.99 * MAX_DISTANCE));
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        let settings = without_photons(estimator);
        let usual = image(&mut renderer(&scene, &settings));

        let mut prepared = PreparedScene::new(&elsewhere, &settings).unwrap();
        let mut full = Renderer::from_prepared(&device(), &elsewhere, &settings, &prepared).unwrap();
        let before = image(&mut full);
        let mut preview = full.sibling(&elsewhere, &settings, &prepared).unwrap();
        assert!(prepared.follow_nearby(&scene, &settings).unwrap());
        assert!(preview.set_camera(&scene.cameras[0]).unwrap());
        assert!(difference(&usual, &image(&mut preview)) > 2.0 * ROUNDING, "the headlamp makes no difference");
        preview.set_lights(&prepared).unwrap();
        let difference = difference(&usual, &image(&mut preview));
        assert!(difference < ROUNDING, "{estimator:?}: {difference:e}");
        assert!(image(&mut full) == before, "the lights of the image moved too");
    }
    let settings = short(Estimator::Pt);
    let usual = Cells::measure(&mut renderer(&scene, &settings), GATE, 8, 1, 4, 1);
    let mut prepared = PreparedScene::new(&elsewhere, &settings).unwrap();
    let mut renderer = Renderer::from_prepared(&device(), &elsewhere, &settings, &prepared).unwrap();
    assert!(prepared.follow_nearby(&scene, &settings).unwrap());
    assert!(renderer.set_camera(&scene.cameras[0]).unwrap());
    renderer.set_lights(&prepared).unwrap();
    let found = disagreements(&usual, &Cells::measure(&mut renderer, GATE, 8, 1, 4, 1001));
    assert!(found.is_empty(), "{found:?}");
}
