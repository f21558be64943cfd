//! `hidden-letter`: the letter F behind a screen. A laser and a sensor beside the screen see the letter only by way of a wall.
//!
//! The wall is z = 0, with x and y in [-1, 1]. The letter is in the plane z = 1 and faces the wall. The equipment stands at
//! [`EQUIPMENT`]. All in metres.

use glam::DVec3;

use super::parts::{add, camera, diffuse, light, material};
use super::shapes::quad;
use crate::scene::{LightKind, Scene};

const EQUIPMENT: DVec3 = DVec3::new(2.0, 0.0, 1.5);
/// Smallest x and y, width and height of the bars of the letter. Seen from the wall, x grows to the left, so the letter is mirrored.
const BARS: [[f64; 4]; 3] = [[-0.3, -0.4, 0.15, 0.8], [-0.15, 0.25, 0.45, 0.15], [-0.15, -0.05, 0.3, 0.15]];

pub fn build() -> Scene {
    let mut scene = Scene::default();
    let wall = material(&mut scene, diffuse("wall", [0.7; 3]));
    let white = material(&mut scene, diffuse("white", [0.9; 3]));
    let black = material(&mut scene, diffuse("black", [0.0; 3]));
    add(&mut scene, "wall", wall, quad(DVec3::new(-1.0, -1.0, 0.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0; 2]));
    for (i, [x, y, width, height]) in BARS.into_iter().enumerate() {
        let bar = quad(DVec3::new(x, y, 1.0), height * DVec3::Y, width * DVec3::X, [1.0; 2]);
        add(&mut scene, &format!("letter, bar {}", i + 1), white, bar);
    }
    let screen = quad(DVec3::new(1.2, -1.0, 1.15), 2.0 * DVec3::Y, 0.85 * DVec3::Z, [1.0; 2]);
    add(&mut scene, "screen", black, screen);
    let kind = LightKind::Beam { power: [1.0; 3], radius: 0.0 };
    light(&mut scene, "laser", EQUIPMENT, -EQUIPMENT.normalize(), kind);
    camera(&mut scene, EQUIPMENT, DVec3::ZERO, 0.8, [160, 120]);
    scene
}
