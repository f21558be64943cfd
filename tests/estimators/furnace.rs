//! Furnace test: a closed room that absorbs nothing. After some bounces, a flash with energy Q fills the volume V evenly. From
//! then on, the radiance that arrives at any point within a gate of width w is Q w / (4 pi V), whatever the shape of the room.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use taugate::internals::generate::parts::{add, camera, diffuse, material, metal};
use taugate::internals::generate::shapes::{cuboid, inside_out};
use taugate::internals::generate::{Kind, build};
use taugate::internals::scene::{Material, Mesh, Scene};
use taugate::internals::self_check::sphere::gated_radiance;
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{Cells, is_long, renderer, settings, threshold};

/// Largest allowed relative error of the energy.
const LOSS: f64 = 0.005;

fn volume(mesh: &Mesh) -> f64 {
    let at = |i: u32| Vec3::from(mesh.positions[i as usize]).as_dvec3();
    mesh.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum::<f64>().abs()
}

/// A room with four white walls, a wall that is a mirror and a wall that emits, and the radiance per metre of gate.
fn room() -> (Scene, f64) {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [1.0; 3]));
    let silver = material(&mut scene, metal("mirror", [1.0; 3], 0.0));
    let lamp = material(&mut scene, Material { emission: [2.0; 3], double_sided: false, ..diffuse("lamp", [1.0; 3]) });
    let size = DVec3::new(1.5, 1.2, 1.0);
    let walls = inside_out(cuboid(DVec3::ZERO, size));
    let part =
        |triangles: std::ops::Range<usize>| Mesh { triangles: walls.triangles[triangles].to_vec(), ..walls.clone() };
    // Faces of a cuboid come in the order -z, +z, -x, +x, -y, +y.
    add(&mut scene, "walls", white, part(4..12));
    add(&mut scene, "mirror", silver, part(0..2));
    add(&mut scene, "lamp", lamp, part(2..4));
    camera(&mut scene, DVec3::new(1.1, 0.5, 0.6), DVec3::new(0.0, 0.6, 0.4), 1.2, [8, 8]);
    let energy = PI * 2.0 * size.x * size.y;
    (scene, energy / (4.0 * PI * size.element_product()))
}

/// The sphere of the closed form with a point light of intensity pi in its centre, and the radiance per metre of gate.
fn sphere(albedo: f32) -> (Scene, f64) {
    let scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 5, albedo });
    let truth = 4.0 * PI * PI / (4.0 * PI * volume(&scene.meshes[0]));
    (scene, truth)
}

/// Chords have a mean length of 4/3 m in the sphere and of 4 V / S = 0.8 m in the room, so light in these gates has been
/// reflected over 100 times.
const SPHERE_GATE: Gate = Gate { lo: 140.0, hi: 142.0 };
const ROOM_GATE: Gate = Gate { lo: 84.0, hi: 94.0 };

/// Mean over the image relative to the truth, minus 1, and its standard error.
fn excess((scene, per_metre): &(Scene, f64), gate: Gate, estimator: Estimator, long: bool) -> (f64, f64) {
    let start = std::time::Instant::now();
    // Pixels per side, light paths and samples per pixel that keep the noise well below `LOSS`.
    let (side, light_paths, samples) = match (estimator, long) {
        (Estimator::Pt, false) => (16, 1, 8),
        (Estimator::Pt, true) => (32, 10_000, 8),
        (_, false) => (8, 50, 1),
        (_, true) => (16, 4000, 4),
    };
    let s = settings(estimator, [side; 2]).max_depth(254).light_paths(light_paths).build().unwrap();
    let mut renderer = renderer(scene, &s);
    let (mean, error) = Cells::measure(&mut renderer, gate, 32, 1, samples, 70).whole();
    let truth = per_metre * (gate.hi - gate.lo);
    eprintln!(
        "{estimator}: {:+.3} % +- {:.3} % in {:?}",
        100.0 * (mean / truth - 1.0),
        100.0 * error / truth,
        start.elapsed()
    );
    assert_eq!(renderer.stats().dropped, 0);
    (mean / truth - 1.0, error / truth)
}

fn keeps_its_energy(scene: &(Scene, f64), gate: Gate, estimator: Estimator, long: bool) {
    let (off, error) = excess(scene, gate, estimator, long);
    assert!(error < 0.5 * LOSS, "{estimator}: the standard error {error} is too large for this test");
    assert!(off.abs() < LOSS && off.abs() < threshold(4) * error, "{estimator}: {off:+.4} +- {error:.4}");
}

#[test]
fn the_closed_form_says_the_same() {
    let truth = gated_radiance(1.0, 1.0, SPHERE_GATE.lo, SPHERE_GATE.hi);
    assert!((truth / (0.75 * 2.0) - 1.0).abs() < 1e-9, "{truth}");
    assert!((sphere(1.0).1 / 0.75 - 1.0).abs() < 1e-3);
}

#[test]
fn a_hundred_reflections_lose_nothing() {
    let all = [Estimator::Lcs, Estimator::Pt];
    for &estimator in if is_long() { &all[..] } else { &all[..1] } {
        keeps_its_energy(&sphere(1.0), SPHERE_GATE, estimator, false);
    }
}

/// `cargo test --release --test estimators -- --ignored --nocapture loses_nothing`
#[test]
#[ignore = "takes minutes"]
fn a_sphere_loses_nothing_with_any_estimator() {
    for estimator in Estimator::ALL {
        keeps_its_energy(&sphere(1.0), SPHERE_GATE, estimator, true);
    }
}

#[test]
#[ignore = "takes minutes"]
fn a_room_with_a_lamp_and_a_mirror_loses_nothing() {
    for estimator in Estimator::ALL {
        keeps_its_energy(&room(), ROOM_GATE, estimator, true);
    }
}

/// Negative control: the walls absorb a thousandth of the light per reflection, a tenth in a hundred reflections.
#[test]
#[ignore = "takes five seconds; the test whose sensitivity it shows runs always"]
fn walls_that_absorb_a_thousandth_are_noticed() {
    let (off, error) = excess(&sphere(0.999), SPHERE_GATE, Estimator::Lcs, false);
    assert!(off < -LOSS - threshold(1) * error);
}
