//! A camera that moves in a renderer which was prepared for another one.

use glam::DVec3;
use taugate::internals::generate::shapes::cuboid;
use taugate::internals::generate::stage::{add, glass, light, material};
use taugate::internals::generate::{Kind, build};
use taugate::internals::render::Renderer;
use taugate::internals::scene::{Camera, LightKind, Scene};
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Sampling, Settings};

use super::cells::{Cells, disagreements, renderer, settings};

const SIZE: [u32; 2] = [24, 16];
const GATE: Gate = Gate { lo: 8.0, hi: 9.0 };
/// Greatest part of the light that may move when all coordinates round differently: a ray or a choice at an edge falls to the other
/// side, and one path of 1,536 is another one.
const ROUNDING: f64 = 2e-3;
/// The unit of render space in the Cornell box, and the distance that a sensor may stand from its origin, in metres.
const UNIT: f64 = 4.0;
const FARTHEST: f64 = UNIT / 4.0;

fn short(estimator: Estimator) -> Settings {
    settings(estimator, SIZE).max_depth(8).light_paths(500).build().unwrap()
}

/// The Cornell box with a block of glass and a lamp of each kind.
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

/// The camera of the scene, `metres` away from where it stands.
fn moved(scene: &Scene, metres: f64) -> Camera {
    let mut camera = scene.cameras[0].clone();
    camera.transform.translation += metres * DVec3::new(0.6, -0.3, 0.74).normalize();
    camera
}

/// A renderer that was prepared for a camera `metres` away, and then got that of the scene.
fn from_elsewhere(scene: &Scene, settings: &Settings, metres: f64) -> Renderer {
    let elsewhere = Scene { cameras: vec![moved(scene, metres)], ..scene.clone() };
    let mut renderer = renderer(&elsewhere, settings);
    renderer.iterate(1).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.set_camera(&scene.cameras[0]).unwrap(), "{metres} m are not too far");
    assert_eq!(renderer.film().iterations(), 0, "the film starts anew");
    renderer
}

fn image(renderer: &mut Renderer) -> Vec<f32> {
    renderer.restart(5, GATE).unwrap();
    (0..4).for_each(|_| renderer.iterate(4).unwrap_or_else(|e| panic!("{e}")));
    renderer.film().mean()
}

/// Part of the light of `a` that is elsewhere in `b`.
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
fn a_moved_camera_sees_what_one_there_sees() {
    let scene = mixed();
    for estimator in [Estimator::Pt, Estimator::Bdpt] {
        let usual = image(&mut renderer(&scene, &short(estimator)));
        let there = image(&mut from_elsewhere(&scene, &short(estimator), 0.99 * FARTHEST));
        let difference = difference(&usual, &there);
        assert!(difference < ROUNDING, "{estimator:?}: {difference:e}");
    }
    // Trees are others where vertices swap places, so the means tell.
    let settings = short(Estimator::Lcs);
    let usual = Cells::measure(&mut renderer(&scene, &settings), GATE, 8, 1, 4, 1);
    let mut renderer = from_elsewhere(&scene, &settings, 0.99 * FARTHEST);
    let found = disagreements(&usual, &Cells::measure(&mut renderer, GATE, 8, 1, 4, 1001));
    assert!(found.is_empty(), "{found:?}");
}

/// The siblings that must fail: a camera a centimetre beside its place.
#[test]
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
    assert!(!renderer.set_camera(&moved(&scene, 1.01 * FARTHEST)).unwrap());
    assert_eq!((renderer.film().iterations(), renderer.film().mean()), (1, before));
    assert!(renderer.set_camera(&moved(&scene, 0.99 * FARTHEST)).unwrap());
}

/// What no light could reach from the first camera may be lit for the next one.
#[test]
fn a_moved_camera_has_its_own_bounds() {
    let scene = build(Kind::CornellBox);
    let back = |metres: f64| {
        let mut camera = scene.cameras[0].clone();
        camera.transform.translation.z += metres;
        camera
    };
    // The lamp is seen after some 4 m of travel; half a metre further back nothing arrives so early.
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
