//! A diffuse floor that an orthographic camera sees at an angle, in the light of a point light: travel times and radiance have
//! closed forms.

use glam::DVec3;
use taugate::internals::generate::parts::{add, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{Camera, LightKind, Projection, Scene};

const ALBEDO: f32 = 0.6;
const INTENSITY: f32 = 2.0;
const LAMP: DVec3 = DVec3::new(-0.4, -1.2, 0.7);
/// The axis of the camera meets the floor, z = 0, after 3 m. The floor is nearer to the lower part of the sensor plane.
const TO_FLOOR: f64 = 3.0;
const HEIGHT: f64 = 4.0;
/// Where the axis meets the image.
const CENTRE: [f64; 2] = [0.3, 0.6];
pub const RESOLUTION: [u32; 2] = [24, 16];

/// Light arrives from 2.80 m to 11.9 m, and half of it by 3.32 m. If the sensor were a point at the camera's place, paths over the
/// floor would take at least 3.14 m. So a bound that ignores the size of the sensor would find the first gate dark.
pub const GATES: [(f64, f64); 4] = [(2.7, 3.0), (3.3, 4.0), (5.0, 12.0), (0.0, f64::INFINITY)];

fn forward() -> DVec3 {
    DVec3::new(0.1, 0.6, -0.8).normalize()
}

pub fn floor() -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [ALBEDO; 3]));
    add(&mut scene, "floor", grey, quad(DVec3::new(-8.0, -8.0, 0.0), 16.0 * DVec3::X, 16.0 * DVec3::Y, [1.0; 2]));
    light(&mut scene, "lamp", LAMP, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY; 3] });
    scene.add_camera(Camera {
        projection: Projection::Orthographic { height: HEIGHT },
        principal_point: CENTRE,
        lens: taugate::Lens::PINHOLE,
        ..Camera::looking_at("parallel", -TO_FLOOR * forward(), DVec3::ZERO, 1.0, RESOLUTION)
    });
    scene
}

/// Mean radiance of each pixel through the gate [lo, hi), row by row. A point p of the floor has the radiance
/// albedo / pi I h / s^3, with the height h of the lamp and its distance s from p. Its light arrives after s + d, where d is the
/// distance from p to the sensor plane. The error of the quadrature is below 1e-3 of the brightest pixel.
pub fn gated_pixels((lo, hi): (f64, f64)) -> Vec<f64> {
    const STEPS: u32 = 64;
    let right = forward().cross(DVec3::Y).normalize();
    let up = right.cross(forward());
    let [width, height] = RESOLUTION;
    let metres_per_pixel = HEIGHT / f64::from(height);
    let radiance = |column: f64, row: f64| {
        let x = (column - CENTRE[0] * f64::from(width)) * metres_per_pixel;
        let y = (CENTRE[1] * f64::from(height) - row) * metres_per_pixel;
        let start = -TO_FLOOR * forward() + x * right + y * up;
        let d = -start.z / forward().z;
        let s = (start + d * forward()).distance(LAMP);
        let seen = lo <= s + d && s + d < hi;
        if seen { f64::from(ALBEDO * INTENSITY) / std::f64::consts::PI * LAMP.z / s.powi(3) } else { 0.0 }
    };
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let inside = |i: u32, step: u32| f64::from(i) + (f64::from(step) + 0.5) / f64::from(STEPS);
    pixels
        .map(|(column, row)| {
            let points = (0..STEPS * STEPS).map(|k| radiance(inside(column, k % STEPS), inside(row, k / STEPS)));
            points.sum::<f64>() / f64::from(STEPS * STEPS)
        })
        .collect()
}
