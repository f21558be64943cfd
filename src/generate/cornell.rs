//! `cornell-box`: a box of 2 m with its floor at y = 0, open towards the camera at +z.

use glam::DVec3;

use super::parts::{add, camera, diffuse, emitter, material, mesh, metal, place, turned};
use super::shapes::{cuboid, divided, quad};
use crate::scene::Scene;

/// Default roughness of the metal box.
pub const ROUGHNESS: f32 = 0.45;
/// Number of triangles that may be divided.
const DIVIDED: u32 = 34;
/// Number of triangles of the light.
const LIGHT: u32 = 2;

/// Builds the scene with at least `triangles` triangles. The light is not divided: each of its triangles would be an emitter of
/// its own and change the cost of a render.
pub fn build(roughness: f32, triangles: u32) -> Scene {
    let subdivisions = (0..16).find(|&n| DIVIDED * 4u32.pow(n) + LIGHT >= triangles).unwrap_or(0);
    let quad = |corner, u, v| divided(quad(corner, u, v, [1.0, 1.0]), subdivisions);
    let cuboid = |min, max| divided(cuboid(min, max), subdivisions);
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.73, 0.73, 0.73]));
    let red = material(&mut scene, diffuse("red", [0.63, 0.06, 0.05]));
    let green = material(&mut scene, diffuse("green", [0.14, 0.45, 0.09]));
    let steel = material(&mut scene, metal("steel", [0.77, 0.78, 0.80], roughness));
    let light = material(&mut scene, emitter("light", [17.0, 12.0, 4.0]));

    let corner = DVec3::new;
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    add(&mut scene, "floor", white, quad(corner(-1.0, 0.0, -1.0), z, x));
    add(&mut scene, "ceiling", white, quad(corner(-1.0, 2.0, -1.0), x, z));
    add(&mut scene, "back", white, quad(corner(-1.0, 0.0, -1.0), x, y));
    add(&mut scene, "left", red, quad(corner(-1.0, 0.0, 1.0), -z, y));
    add(&mut scene, "right", green, quad(corner(1.0, 0.0, -1.0), z, y));
    // 1 cm below the ceiling, with its front facing down.
    let (across, along) = (DVec3::X * 0.5, DVec3::Z * 0.4);
    add(&mut scene, "light", light, super::shapes::quad(corner(-0.25, 1.99, -0.2), across, along, [1.0, 1.0]));

    let half = DVec3::new(0.3, 0.0, 0.3);
    let short = mesh(&mut scene, "short box", white, cuboid(-half, half + DVec3::Y * 0.6));
    place(&mut scene, "short box", short, turned(corner(0.36, 0.0, 0.34), -0.29));
    let tall = mesh(&mut scene, "tall box", steel, cuboid(-half, half + DVec3::Y * 1.2));
    place(&mut scene, "tall box", tall, turned(corner(-0.34, 0.0, -0.28), 0.32));

    camera(&mut scene, corner(0.0, 1.0, 3.9), corner(0.0, 1.0, 0.0), 0.655, [256, 256]);
    scene
}
