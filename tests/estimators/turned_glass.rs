//! Glass that faces inwards is turned around: a wall behind a pane against the closed form.

use std::f64::consts::PI;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material};
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::scene::{LightKind, Mesh, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::cells::{Cells, renderer, settings, threshold};

/// Thickness of the pane in metres, and its index of refraction.
const THICKNESS: f64 = 0.02;
const INDEX: f64 = 1.5;

/// A wall 4 m before the camera, a pane 1 m before it, and a lamp of 1 W/sr half way between the wall and the camera.
fn scene(turn: fn(Mesh) -> Mesh) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-9.0, -9.0, -4.0), 18.0 * DVec3::X, 18.0 * DVec3::Y, [1.0; 2]));
    let clear = material(&mut scene, glass("clear"));
    add(&mut scene, "pane", clear, turn(cuboid(DVec3::new(-3.0, -3.0, -1.0 - THICKNESS), DVec3::new(3.0, 3.0, -1.0))));
    light(&mut scene, "lamp", DVec3::NEG_Z * 2.0, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [4, 4]);
    scene
}

/// Light that passes both faces once. Light that is reflected between them arrives 6 cm later.
#[test]
fn a_pane_that_faces_inwards_shows_the_wall_as_the_closed_form_says() {
    let face = 1.0 - ((INDEX - 1.0) / (INDEX + 1.0)).powi(2);
    let truth = 0.5 / PI / 4.0 * face * face;
    let tau = 6.0 + (INDEX - 1.0) * THICKNESS;
    let gate = Gate { lo: tau - 0.005, hi: tau + 0.005 };
    let turns: [fn(Mesh) -> Mesh; 2] = [|pane| pane, inside_out];
    for (turn, estimator) in turns.into_iter().flat_map(|turn| [Estimator::Pt, Estimator::Lcs].map(|e| (turn, e))) {
        let s = settings(estimator, [4, 4]).max_depth(4).light_paths(200).splat_paths(50).build().unwrap();
        let (found, error) = Cells::measure(&mut renderer(&scene(turn), &s), gate, 4, 4, 8, 100).whole();
        eprintln!("{estimator}: {found:.5} +- {error:.1e}, expected {truth:.5}");
        let off = |truth: f64| ((found - truth).abs() - 1e-3 * truth).max(0.0) / error.max(1e-9);
        assert!(off(truth) < threshold(1) && off(1.05 * truth) > threshold(1), "{estimator}");
    }
}
