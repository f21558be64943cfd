//! Null boundaries: fog in meshes that do not refract gives the same image as fog in boxes.

use glam::DVec3;
use taugate::internals::generate::shapes::cuboid;
use taugate::internals::generate::stage::{add, camera, glass, material};
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::scene::{Material, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::assert_none;
use super::cells::{Cells, disagreements, renderer, settings};

const SIZE: [u32; 2] = [16, 16];
/// A large box of fog in the room, and a small one of other fog inside of it.
const LARGE: [DVec3; 2] = [DVec3::new(-0.9, 0.2, -0.95), DVec3::new(0.95, 2.1, 0.8)];
const SMALL: [DVec3; 2] = [DVec3::new(-0.3, 0.6, -0.5), DVec3::new(0.4, 1.4, 0.3)];

fn fog(density: f64) -> [Medium; 2] {
    let g = [0.7, -0.3];
    let lobes = PhaseFunction::DoubleHenyeyGreenstein { g, weight: 0.8 };
    let sigma = |x: [f64; 3]| x.map(|x| density * x);
    let thin =
        Medium { sigma_s: sigma([0.3, 0.4, 0.5]), sigma_a: [0.05, 0.0, 0.02], phase: lobes, ..Medium::default() };
    let thick =
        Medium { sigma_s: sigma([1.6, 1.3, 1.0]), sigma_a: [0.1; 3], phase: PhaseFunction::Rayleigh, ..thin.clone() };
    [thin, thick]
}

/// The room with the two media: in boxes, or in meshes. The camera stands inside of the larger one if `is_inside`.
fn room(lamps: Light, density: f64, in_meshes: bool, is_inside: bool) -> Scene {
    let mut scene = zoo(lamps);
    for (medium, [lo, hi]) in fog(density).into_iter().zip([LARGE, SMALL]) {
        if in_meshes {
            let null = material(&mut scene, Material { interior: Some(medium), ior: 1.0, ..glass("null") });
            add(&mut scene, "fog", null, cuboid(lo, hi));
        } else {
            scene.media.push(Medium { bounds: Some([lo, hi]), ..medium });
        }
    }
    if is_inside {
        scene.cameras.clear();
        camera(&mut scene, DVec3::new(0.7, 1.2, 0.7), DVec3::new(0.0, 0.9, -0.6), 1.0, SIZE);
    }
    scene
}

fn image(scene: &Scene, estimator: Estimator, [lo, hi]: [f64; 2], iterations: u32, seed: u32) -> Cells {
    let s = settings(estimator, SIZE).max_depth(8).build().unwrap();
    Cells::measure(&mut renderer(scene, &s), Gate { lo, hi }, 8, iterations, 4, seed)
}

/// Compares images of fog in meshes with an image of fog in boxes. Fog with 1.5 times the density must differ.
fn compare(lamps: Light, is_inside: bool, gate: [f64; 2], estimators: &[Estimator], iterations: u32) {
    let boxes = image(&room(lamps, 1.0, false, is_inside), Estimator::Lcs, gate, iterations, 1);
    for &estimator in estimators {
        let meshes = image(&room(lamps, 1.0, true, is_inside), estimator, gate, iterations, 100);
        eprintln!("{estimator} {gate:?}: {:?}, in boxes {:?}", meshes.whole(), boxes.whole());
        assert_none(disagreements(&boxes, &meshes));
    }
    let denser = image(&room(lamps, 1.5, true, is_inside), Estimator::Bdpt, gate, iterations, 100);
    assert!(!disagreements(&boxes, &denser).is_empty(), "{gate:?}");
}

#[test]
fn fog_in_meshes_is_fog_in_boxes() {
    compare(Light::Punctual, true, [4.0, 5.0], &[Estimator::Lcs], 1);
}

/// `cargo test --release --test estimators -- --ignored --nocapture fog_in_meshes`
#[test]
#[ignore = "takes minutes"]
fn fog_in_meshes_is_fog_in_boxes_for_all_estimators() {
    let all = Estimator::ALL;
    let but_pt: Vec<Estimator> = all.into_iter().filter(|&e| e != Estimator::Pt).collect();
    compare(Light::Punctual, false, [5.0, 6.0], &all, 4);
    compare(Light::Area, true, [0.0, f64::INFINITY], &all, 4);
    compare(Light::Beam, false, [6.5, 7.5], &but_pt, 4);
}
