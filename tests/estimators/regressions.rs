//! One test a bug, named after it.

use glam::DVec3;
use taugate::generate::shapes::{append, quad};
use taugate::generate::stage::{add, camera, diffuse, emitter, material};
use taugate::scene::{AlphaMode, Material, Mesh, Scene};
use taugate::settings::Estimator;

use super::cells::{renderer, settings};

/// A shadow ray took any hit; when that was a veil it let pass, it went on from there and missed the walls before the veil.
#[test]
fn a_veil_behind_a_wall_does_not_open_the_wall() {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    let sheet =
        |y: f64, half: f64| quad(DVec3::new(-half, y, -half), DVec3::X * 2.0 * half, DVec3::Z * 2.0 * half, [1.0, 1.0]);
    add(&mut scene, "floor", white, sheet(0.0, 1.0));
    // Many small triangles, so that the hierarchy's order is not that of the ray.
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
    let mut s = settings(Estimator::Pt, [16, 16]);
    // The lamp, a point of the floor, the pinhole: the wall stands between the first two.
    s.max_depth = 2;
    let mut renderer = renderer(&scene, &s);
    renderer.iterate(16).unwrap_or_else(|e| panic!("{e}"));
    assert!(renderer.film().mean().iter().all(|&x| x == 0.0), "light came through the wall");
}
