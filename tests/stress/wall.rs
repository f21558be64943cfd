//! A plane that faces the pinhole and is lit by a point light at the pinhole: travel times and radiance have closed forms.

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::{LightKind, Scene};

/// Reflectance of the plane. The light has an intensity of 1 W / sr.
pub const ALBEDO: f32 = 0.5;

/// The plane at `distance` metres, seen with a vertical field of view of `yfov` radians. The plane fills the view.
pub fn wall(distance: f64, yfov: f64, resolution: [u32; 2]) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [ALBEDO; 3]));
    let half = distance * ((0.5 * yfov).tan() * 1.5).max(0.3);
    let side = 2.0 * half;
    add(
        &mut scene,
        "wall",
        grey,
        quad(DVec3::new(-half, -half, -distance), DVec3::X * side, DVec3::Y * side, [1.0; 2]),
    );
    light(&mut scene, "light", DVec3::ZERO, DVec3::NEG_Y, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, yfov, resolution);
    scene
}

/// Mean radiance that arrives in [lo, hi) at each pixel of a film of `side` x `side` pixels, row by row. At the point (x, y) of
/// the film at distance 1, with r^2 = x^2 + y^2, plane distance h and albedo a, the travel time is 2 h sqrt(1 + r^2) and the
/// radiance a / (pi h^2) (1 + r^2)^(-3/2).
pub fn gated_pixels(distance: f64, yfov: f64, side: usize, lo: f64, hi: f64) -> Vec<f64> {
    let extent = (0.5 * yfov).tan();
    let radius2 = |tau: f64| ((tau / (2.0 * distance)).powi(2) - 1.0).max(0.0);
    let (inner, outer) = (radius2(lo), radius2(hi));
    let edge = |i: usize| extent * (2.0 * i as f64 / side as f64 - 1.0);
    // The integral of (1 + x^2 + y^2)^(-3/2): in closed form along y, with the midpoint rule along x.
    let integral_to = |x: f64, y: f64| y / ((1.0 + x * x) * (1.0 + x * x + y * y).sqrt());
    const STEPS: usize = 20_000;
    let mut pixels = vec![];
    for row in 0..side {
        for column in 0..side {
            let (x0, x1) = (edge(column), edge(column + 1));
            let (y0, y1) = (edge(row), edge(row + 1));
            let step = (x1 - x0) / STEPS as f64;
            let strip = |x: f64, r2: f64| {
                let reach = (r2 - x * x).max(0.0).sqrt();
                (integral_to(x, y1.clamp(-reach, reach)) - integral_to(x, y0.clamp(-reach, reach))).max(0.0)
            };
            let ring = |x: f64| strip(x, outer) - strip(x, inner);
            let integral: f64 = (0..STEPS).map(|i| ring(x0 + (i as f64 + 0.5) * step) * step).sum();
            let area = (x1 - x0) * (y1 - y0);
            pixels.push(f64::from(ALBEDO) / (std::f64::consts::PI * distance * distance) * integral / area);
        }
    }
    pixels
}
