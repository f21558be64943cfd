//! The sensor of the path tracer: camera rays, and the pixel that sees a point.
//!
//! A pixel measures the mean radiance over its area on the image plane. A pinhole has its image plane at distance 1, and all
//! camera rays start at the pinhole. The image plane of an orthographic camera is the sensor itself: rays start on it, in
//! parallel, and the travel time of a path ends on it.
//!
//! A small surface with the intensity I (W / sr) towards the sensor adds I p to its pixel. Here p is the density, per area
//! perpendicular to the line of sight, with which the uniform camera rays of the pixel pass the surface. With the area A of a
//! pixel on the image plane, p = 1 / A for parallel rays. The rays of a pinhole have the density 1 / (A cos^3) per solid angle,
//! so p = 1 / (A cos^3 d^2) at the distance d. An aimed pixel has a single ray, even if it has a field of view, so no light is
//! projected into it.

use glam::DVec3;
use taugate::{Camera, Lens, Projection, Scene};

use super::geometry::Ray;

/// A camera with the size of its image plane.
pub struct Sensor<'a> {
    camera: &'a Camera,
    resolution: [f64; 2],
    /// Half the size of the image plane.
    half: [f64; 2],
    /// Image coordinates of the principal point minus those of the image's centre, in pixels.
    shift: [f64; 2],
}

/// How the sensor sees a point.
pub struct Seen {
    /// Index of the pixel, row by row.
    pub pixel: usize,
    /// The point of the sensor that receives the light: the pinhole, or a point of the sensor plane.
    pub sensor: DVec3,
    /// The density p of the camera rays at the point, per m^2.
    pub density: f64,
}

impl<'a> Sensor<'a> {
    pub fn new(scene: &'a Scene, camera: usize, resolution: [u32; 2]) -> Sensor<'a> {
        let camera = &scene.cameras[camera];
        assert!(camera.lens == Lens::PINHOLE, "the oracle has no lenses");
        let resolution = resolution.map(f64::from);
        let half_height = match camera.projection {
            Projection::Perspective { yfov } => (yfov / 2.0).tan(),
            Projection::Orthographic { height } => height / 2.0,
            Projection::Aimed { .. } => 1.0,
        };
        let shift = [0, 1].map(|k| (camera.principal_point[k] - 0.5) * resolution[k]);
        Sensor { camera, resolution, half: [half_height * resolution[0] / resolution[1], half_height], shift }
    }

    /// The camera ray through image coordinates in pixels.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let [w, h] = self.resolution;
        let transform = &self.camera.transform;
        if let Projection::Aimed { aims, .. } = &self.camera.projection {
            let aim = aims[y as usize * w as usize + x as usize];
            return Ray::new(transform.translation, (aim.point - transform.translation).normalize());
        }
        let (x, y) = (x - self.shift[0], y - self.shift[1]);
        let (x, y) = ((2.0 * x / w - 1.0) * self.half[0], (1.0 - 2.0 * y / h) * self.half[1]);
        let [start, direction] = match self.camera.projection {
            Projection::Orthographic { .. } => [DVec3::new(x, y, 0.0), DVec3::NEG_Z],
            _ => [DVec3::ZERO, DVec3::new(x, y, -1.0)],
        };
        Ray::new(transform.transform_point3(start), transform.transform_vector3(direction).normalize())
    }

    /// How the camera sees a point. `None` if the point is outside the image or not in front of the sensor.
    pub fn project(&self, point: DVec3) -> Option<Seen> {
        let p = self.camera.transform.inverse().transform_point3(point);
        if p.z >= 0.0 || self.camera.projection.aims().is_some() {
            return None;
        }
        let [w, h] = self.resolution;
        let area = 4.0 * self.half[0] * self.half[1] / (w * h);
        let (on_plane, sensor, density) = match self.camera.projection {
            Projection::Orthographic { .. } => (p, DVec3::new(p.x, p.y, 0.0), 1.0 / area),
            _ => {
                let cos = -p.z / p.length();
                (p / -p.z, DVec3::ZERO, 1.0 / (area * cos.powi(3) * p.length_squared()))
            }
        };
        let x = (on_plane.x / self.half[0] + 1.0) / 2.0 * w + self.shift[0];
        let y = (1.0 - on_plane.y / self.half[1]) / 2.0 * h + self.shift[1];
        if !(0.0..w).contains(&x) || !(0.0..h).contains(&y) {
            return None;
        }
        let pixel = y as usize * w as usize + x as usize;
        Some(Seen { pixel, sensor: self.camera.transform.transform_point3(sensor), density })
    }
}
