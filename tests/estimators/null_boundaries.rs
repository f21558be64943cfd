//! Null boundaries: fog in meshes that do not refract gives the same image as fog in boxes.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::parts::{add, camera, glass, material};
use taugate::internals::generate::shapes::{cuboid, inside_out};
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

/// What bounds the two media.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Bounds {
    Boxes,
    Meshes,
    /// Meshes whose triangles face inwards. The instance of the second one is mirrored.
    MeshesInsideOut,
}

/// The room with the two media. The camera stands inside of the larger one if `is_inside`.
fn room(lamps: Light, density: f64, bounds: Bounds, is_inside: bool) -> Scene {
    let mut scene = zoo(lamps);
    for (medium, [lo, hi]) in fog(density).into_iter().zip([LARGE, SMALL]) {
        if bounds == Bounds::Boxes {
            scene.media.push(Medium { bounds: Some([lo, hi]), ..medium });
            continue;
        }
        let null = material(&mut scene, Material { interior: Some(medium), ior: 1.0, ..glass("null") });
        let mesh = cuboid(lo, hi);
        add(&mut scene, "fog", null, if bounds == Bounds::Meshes { mesh } else { inside_out(mesh) });
    }
    if bounds == Bounds::MeshesInsideOut {
        let instance = scene.instances.last_mut().unwrap();
        instance.transform = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        // Negating x below also turns the mesh inside out. This `inside_out` cancels that, so the triangles still face inwards.
        let mesh = &mut scene.meshes[instance.mesh as usize];
        *mesh = inside_out(std::mem::take(mesh));
        mesh.positions.iter_mut().for_each(|p| p[0] = -p[0]);
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
    let boxes = image(&room(lamps, 1.0, Bounds::Boxes, is_inside), Estimator::Lcs, gate, iterations, 1);
    for &estimator in estimators {
        for bounds in [Bounds::Meshes, Bounds::MeshesInsideOut] {
            let meshes = image(&room(lamps, 1.0, bounds, is_inside), estimator, gate, iterations, 100);
            eprintln!("{estimator} {gate:?} {bounds:?}: {:?}, in boxes {:?}", meshes.whole(), boxes.whole());
            assert_none(disagreements(&boxes, &meshes));
        }
    }
    let denser = image(&room(lamps, 1.5, Bounds::Meshes, is_inside), Estimator::Bdpt, gate, iterations, 100);
    assert!(!disagreements(&boxes, &denser).is_empty(), "{gate:?}: denser fog is not rejected");
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
