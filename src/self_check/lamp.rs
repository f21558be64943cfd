//! Checks a triangle that emits radiance 1 and is seen directly. For a pixel inside the triangle, every sample is exactly 1. So is the
//! mean, except for the rounding of one division.

use std::f64::consts::FRAC_PI_3;

use glam::{DVec2, DVec3};

use super::{Method, Verdict};
use crate::error::Result;
use crate::generate::parts;
use crate::gpu::Device;
use crate::render::Renderer;
use crate::scene::{Mesh, Scene};

pub const RADIANCE: f32 = 1.0;
/// Corners of the triangle in the plane at distance 1 from the camera, counter-clockwise.
const CORNERS: [DVec2; 3] = [DVec2::new(-0.45, -0.4), DVec2::new(0.45, -0.35), DVec2::new(0.05, 0.45)];
const YFOV: f64 = FRAC_PI_3;
/// Width and height of the image in pixels.
const SIDE: u32 = 24;
/// Upper bound on the distance by which rounding to 32 bits moves an edge.
const MARGIN: f64 = 1e-4;

fn scene() -> Scene {
    let mut scene = Scene::default();
    let lamp = parts::material(&mut scene, parts::emitter("lamp", [1.0; 3]));
    let positions = CORNERS.map(|c| [c.x as f32, c.y as f32, -1.0]).to_vec();
    parts::add(&mut scene, "lamp", lamp, Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() });
    parts::camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, YFOV, [SIDE, SIDE]);
    scene
}

/// Whether the whole pixel (x, y) lies inside the triangle.
fn is_inner(x: u32, y: u32) -> bool {
    let inside = |point: DVec2| {
        (0..3).all(|i| {
            let (a, b) = (CORNERS[i], CORNERS[(i + 1) % 3]);
            (b - a).perp_dot(point - a) > MARGIN
        })
    };
    let corner = |dx: u32, dy: u32| {
        let part = |pixel: u32| 2.0 * f64::from(pixel) / f64::from(SIDE) - 1.0;
        (0.5 * YFOV).tan() * DVec2::new(part(x + dx), -part(y + dy))
    };
    [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)].into_iter().all(inside)
}

/// Whether a mean is right. Vulkan allows an error of 2.5 ulp for a division.
fn is_right(mean: f32, expected: f32) -> bool {
    (mean - expected).abs() <= 4.0 * f32::EPSILON * expected
}

pub fn check(device: &Device, method: Method, expected: f32) -> Result<Verdict> {
    let scene = scene();
    let settings = method.settings(&scene, "max-depth = 2\nlight-paths = 256")?;
    let mut renderer = Renderer::new(device, &scene, &settings)?;
    for _ in 0..8 {
        renderer.iterate(8)?;
    }
    let mean = renderer.film().mean();
    let inner: Vec<f32> = (0..SIDE * SIDE)
        .filter(|i| is_inner(i % SIDE, i / SIDE))
        .flat_map(|i| mean[3 * i as usize..][..3].to_vec())
        .collect();
    let pixels = inner.len() / 3;
    if inner.iter().all(|&radiance| is_right(radiance, expected)) {
        return Ok(Verdict::Right(format!("{expected} in all {pixels} inner pixels")));
    }
    let min = inner.iter().copied().fold(f32::INFINITY, f32::min);
    let max = inner.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    Ok(Verdict::Wrong(format!("expected {expected} in all {pixels} inner pixels, found {min} to {max}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_may_be_rounded_but_not_wrong() {
        let ulps = |n: f32| 1.0 + n * f32::EPSILON;
        assert!([0.0, 2.5, -2.5, 4.0].iter().all(|&n| is_right(ulps(n), RADIANCE)));
        assert!([5.0, -5.0, 1e4, f32::NAN].iter().all(|&n| !is_right(ulps(n), RADIANCE)));
        assert!(!is_right(0.0, RADIANCE));
    }
}
