//! `street`: a street at night, lit by a lamp beside the camera. A car drives towards the camera for two seconds.

use glam::{DAffine3, DVec3};

use super::glb::Motion;
use super::numbers::Pcg;
use super::parts::{add, camera, diffuse, light, material, mesh, place, plastic, turned};
use super::shapes::{append, cuboid, cylinder, quad};
use crate::scene::{LightKind, Mesh, Scene};

/// Length of the street in metres; it begins behind the camera.
const LENGTH: f64 = 72.0;
/// Metres of street behind the camera.
const BEHIND: f64 = 6.0;
/// Half the minimum distance between houses on opposite sides, in metres.
const HALF_WIDTH: f64 = 7.0;
/// Distances in metres of the car in front of the camera, at the start and at the end of the drive.
const CAR_DISTANCES: [f64; 2] = [48.0, 14.0];
/// Duration of the drive in seconds.
const SECONDS: f32 = 2.0;

pub fn build() -> Scene {
    let mut scene = Scene::default();
    ground(&mut scene);
    houses(&mut scene);
    cars(&mut scene);
    camera(&mut scene, DVec3::new(0.0, 1.6, 0.0), DVec3::new(0.0, 1.2, -30.0), 0.5, [320, 180]);
    let lamp = LightKind::Point { intensity: [400.0; 3] };
    light(&mut scene, "lamp", DVec3::new(0.5, 0.8, 0.0), DVec3::NEG_Z, lamp);
    scene
}

/// The drive of the car: along the street at constant speed.
pub fn motion() -> Motion {
    Motion {
        node: "car",
        times: vec![0.0, SECONDS],
        positions: CAR_DISTANCES.map(|distance| car_position(distance).to_array().map(|x| x as f32)).to_vec(),
    }
}

/// The car's position at a distance in front of the camera.
fn car_position(distance: f64) -> DVec3 {
    DVec3::new(-1.6, 0.0, -distance)
}

fn ground(scene: &mut Scene) {
    let asphalt = material(scene, diffuse("asphalt", [0.12, 0.12, 0.13]));
    let kerb = material(scene, diffuse("pavement", [0.35, 0.34, 0.32]));
    let far = DVec3::new(-HALF_WIDTH, 0.0, BEHIND - LENGTH);
    add(scene, "road", asphalt, quad(far, DVec3::Z * LENGTH, DVec3::X * (2.0 * HALF_WIDTH), [1.0, 1.0]));
    for side in [-1.0, 1.0] {
        let (inner, outer) = (side * 4.5, side * HALF_WIDTH);
        let low = DVec3::new(inner.min(outer), 0.0, BEHIND - LENGTH);
        add(scene, "pavement", kerb, cuboid(low, DVec3::new(inner.max(outer), 0.12, BEHIND)));
    }
}

/// Rows of houses of different heights and colours, and one at the end of the street.
fn houses(scene: &mut Scene) {
    let mut pcg = Pcg::new(7);
    let colours = [[0.55, 0.32, 0.25], [0.62, 0.58, 0.48], [0.40, 0.42, 0.45], [0.68, 0.62, 0.40]];
    let paints = colours.map(|rgb| material(scene, diffuse("house", rgb)));
    for side in [-1.0, 1.0] {
        for n in 0..7 {
            let near = BEHIND - 10.0 * f64::from(n);
            let (setback, height) = (pcg.range(0.0, 1.2), pcg.range(5.0, 9.0));
            let (inner, outer) = (side * (HALF_WIDTH + setback), side * (HALF_WIDTH + 5.0));
            let low = DVec3::new(inner.min(outer), 0.0, near - 9.6);
            let high = DVec3::new(inner.max(outer), height, near);
            let paint = paints[(pcg.uniform() * 4.0) as usize % 4];
            add(scene, &format!("house {n}"), paint, cuboid(low, high));
        }
    }
    let low = DVec3::new(-HALF_WIDTH - 5.0, 0.0, BEHIND - 1.0 - LENGTH);
    add(scene, "last house", paints[1], cuboid(low, DVec3::new(HALF_WIDTH + 5.0, 8.0, BEHIND - LENGTH)));
}

/// The car that drives, and two that are parked.
fn cars(scene: &mut Scene) {
    let red = material(scene, plastic("red paint", [0.55, 0.05, 0.04], 0.3));
    let blue = material(scene, plastic("blue paint", [0.06, 0.12, 0.40], 0.3));
    let rubber = material(scene, diffuse("rubber", [0.05, 0.05, 0.05]));
    let bodies = [red, blue].map(|paint| mesh(scene, "body", paint, body()));
    let wheels = mesh(scene, "wheels", rubber, wheels());
    let mut car = |node: &str, body: u32, transform: DAffine3| {
        place(scene, node, body, transform);
        place(scene, node, wheels, transform);
    };
    car("car", bodies[0], DAffine3::from_translation(car_position(CAR_DISTANCES[0])));
    car("parked car 1", bodies[1], turned(DVec3::new(3.4, 0.0, -11.0), 0.0));
    car("parked car 2", bodies[1], turned(DVec3::new(3.3, 0.0, -26.0), 0.05));
}

/// A car's body, 4.2 m long, with its front towards +z and the origin on the road.
fn body() -> Mesh {
    let mut body = cuboid(DVec3::new(-0.85, 0.3, -2.1), DVec3::new(0.85, 0.85, 2.1));
    let cabin = cuboid(DVec3::new(-0.72, 0.85, -1.6), DVec3::new(0.72, 1.45, 0.7));
    append(&mut body, &cabin, DAffine3::IDENTITY);
    body
}

fn wheels() -> Mesh {
    let mut all = Mesh::default();
    for (x, z) in [(-0.85, -1.3), (0.65, -1.3), (-0.85, 1.3), (0.65, 1.3)] {
        // The cylinder stands on its base; turn its axis from y to x.
        let turn = glam::DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z);
        let transform = DAffine3::from_mat3_translation(turn, DVec3::new(x, 0.32, z));
        append(&mut all, &cylinder(0.32, 0.2, 20), transform);
    }
    all
}
