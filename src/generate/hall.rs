//! `hundred-lamps`: a hall with a hundred spot lights of unequal power. Blocks on its floor cast shadows on each other.

use glam::{DAffine3, DVec3};

use super::numbers::Pcg;
use super::parts::{add, camera, diffuse, light, material, mesh, place, plastic, turned};
use super::shapes::{cuboid, quad};
use crate::scene::{LightKind, Scene};

/// Number of rows of lamps, and of lamps per row.
const ROWS: u32 = 10;
/// Side of the square floor in metres.
const SIDE: f64 = 12.0;
/// Height of the hall in metres.
const HEIGHT: f64 = 4.0;
/// Range of the lamps' intensities in W / sr. Half of the lamps have less than a tenth of the highest intensity.
const INTENSITY: [f64; 2] = [0.05, 10.0];

pub fn build() -> Scene {
    let mut scene = Scene::default();
    shell(&mut scene);
    let mut pcg = Pcg::new(100);
    blocks(&mut scene, &mut pcg);
    lamps(&mut scene, &mut pcg);
    camera(&mut scene, DVec3::new(-5.6, 2.4, 5.6), DVec3::new(0.4, 0.8, -0.6), 0.9, [320, 180]);
    scene
}

/// Floor, ceiling and walls.
fn shell(scene: &mut Scene) {
    let floor = material(scene, plastic("floor", [0.40, 0.36, 0.30], 0.5));
    let wall = material(scene, diffuse("wall", [0.70, 0.70, 0.68]));
    let accent = material(scene, diffuse("accent wall", [0.55, 0.28, 0.20]));
    let (x, y, z) = (DVec3::X * SIDE, DVec3::Y * HEIGHT, DVec3::Z * SIDE);
    let low = DVec3::new(-0.5 * SIDE, 0.0, -0.5 * SIDE);
    add(scene, "floor", floor, quad(low, z, x, [1.0, 1.0]));
    add(scene, "ceiling", wall, quad(low + y, x, z, [1.0, 1.0]));
    add(scene, "back wall", accent, quad(low, x, y, [1.0, 1.0]));
    add(scene, "front wall", wall, quad(low + x + z, -x, y, [1.0, 1.0]));
    add(scene, "left wall", wall, quad(low + z, -z, y, [1.0, 1.0]));
    add(scene, "right wall", wall, quad(low + x, z, y, [1.0, 1.0]));
}

/// Rotated blocks of different heights, one in the middle of every second square of the floor.
fn blocks(scene: &mut Scene, pcg: &mut Pcg) {
    let paint = material(scene, diffuse("block", [0.62, 0.60, 0.55]));
    let half = DVec3::new(0.3, 0.0, 0.3);
    let block = mesh(scene, "block", paint, cuboid(-half, half + DVec3::Y));
    for n in (0..36).step_by(2) {
        let (row, column) = (n / 6, (n % 6 + n / 6 % 2) % 6);
        let at = DVec3::new(2.0 * f64::from(column) - 5.0, 0.001, 2.0 * f64::from(row) - 5.0);
        let size = DVec3::new(pcg.range(0.5, 1.5), pcg.range(0.3, 2.2), pcg.range(0.5, 1.5));
        let turn = turned(at, pcg.range(0.0, 1.5));
        place(scene, &format!("block {n}"), block, turn * DAffine3::from_scale(size));
    }
}

/// Spot lights just below the ceiling. Each has a random position in its square of a grid, and a random tilt.
fn lamps(scene: &mut Scene, pcg: &mut Pcg) {
    let square = SIDE / f64::from(ROWS);
    for n in 0..ROWS * ROWS {
        let mut along = |k: u32| (f64::from(k) + pcg.range(0.1, 0.9)) * square - 0.5 * SIDE;
        let position = DVec3::new(along(n % ROWS), HEIGHT - 0.05, along(n / ROWS));
        let lean = DVec3::new(pcg.range(-0.5, 0.5), -1.0, pcg.range(-0.5, 0.5));
        let u = pcg.uniform();
        let watts = INTENSITY[0] + (INTENSITY[1] - INTENSITY[0]) * (u * u * u * u);
        let tint = [pcg.range(0.8, 1.0), pcg.range(0.7, 0.9), pcg.range(0.5, 1.0)];
        let inner = pcg.range(0.1, 0.3);
        let outer = inner + pcg.range(0.2, 0.4);
        let kind =
            LightKind::Spot { intensity: tint.map(|t| (watts * t) as f32), inner: inner as f32, outer: outer as f32 };
        light(scene, &format!("lamp {n}"), position, lean, kind);
    }
}
