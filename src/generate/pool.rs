//! `pool`: a camera and a laser above a pool of water with a rough bed, steps, and a ball on the bed.

use glam::{DAffine3, DVec3};

use super::parts::{add, camera, diffuse, glass, light, material};
use super::shapes::{append, ball, cuboid, quad};
use crate::scene::{LightKind, Material, Medium, Scene};

/// Depth of the water in metres, and half of the width of the pool.
const DEPTH: f64 = 5.0;
const HALF: f64 = 4.0;
/// Height of camera and lamp above the water.
const HEIGHT: f64 = 2.0;

pub fn build() -> Scene {
    let mut scene = Scene::default();
    let sand = material(&mut scene, diffuse("sand", [0.5, 0.45, 0.35]));
    let stone = material(&mut scene, diffuse("stone", [0.3, 0.3, 0.32]));
    let paint = material(&mut scene, diffuse("paint", [0.7, 0.15, 0.1]));
    // The block of water reaches below the bed and into the walls, so that there is no air between them.
    let clear = Medium { sigma_a: [0.35, 0.07, 0.03], ..Medium::default() };
    let look = Material { ior: 1.33, group_ior: Some(1.36), interior: Some(clear), ..glass("water") };
    let water = material(&mut scene, look);
    let reach = HALF + 0.2;
    add(&mut scene, "water", water, cuboid(DVec3::new(-reach, -DEPTH - 0.2, -reach), DVec3::new(reach, 0.0, reach)));
    let far = DVec3::new(-reach - 0.1, -DEPTH, -reach - 0.1);
    let (x, z) = (DVec3::X * (2.0 * reach + 0.2), DVec3::Z * (2.0 * reach + 0.2));
    add(&mut scene, "bed", sand, quad(far, z, x, [1.0; 2]));
    let mut steps = cuboid(DVec3::new(-HALF, -DEPTH - 0.1, -HALF), DVec3::new(-1.5, -3.5, -1.0));
    append(
        &mut steps,
        &cuboid(DVec3::new(-HALF, -DEPTH - 0.1, -HALF), DVec3::new(-2.6, -2.0, -2.2)),
        DAffine3::IDENTITY,
    );
    add(&mut scene, "steps", stone, steps);
    let mut sphere = ball(0.6, 32, 16);
    sphere.positions.iter_mut().for_each(|p| *p = [p[0] + 0.9, p[1] - DEPTH as f32 + 0.6, p[2] + 0.3]);
    add(&mut scene, "ball", paint, sphere);
    let eye = DVec3::new(0.0, HEIGHT, 0.0);
    camera(&mut scene, eye, DVec3::new(-0.3, -DEPTH, -0.4), 0.6, [256, 256]);
    let lamp = LightKind::Spot { intensity: [100.0; 3], inner: 0.35, outer: 0.45 };
    light(&mut scene, "laser", eye, DVec3::NEG_Y, lamp);
    scene
}
