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
//!
//! With distortion, pixels are uniform in the distorted image, so p has the Jacobian of the map as a factor. With an aperture, each ray starts
//! at a point l of it, chosen uniformly, and meets the ray of the pinhole on the plane in focus, at P. Pixels have the area A f^2 there, so with
//! the distance f of the plane p = |P - l|^2 / (A f^2 cos d^2), where cos and d belong to the ray from l.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::scene::{Aperture, Distortion};
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
    /// The point of the sensor that receives the light: the pinhole, a point of the aperture, or of the sensor plane.
    pub sensor: DVec3,
    /// The density p of the camera rays at the point, per m^2.
    pub density: f64,
    /// The length in metres that counts besides the way to that point: 0 unless there is an aperture.
    pub delay: f64,
}

impl<'a> Sensor<'a> {
    pub fn new(scene: &'a Scene, camera: usize, resolution: [u32; 2]) -> Sensor<'a> {
        let camera = &scene.cameras[camera];
        let plain = Lens { distortion: camera.lens.distortion, aperture: camera.lens.aperture, ..Lens::PINHOLE };
        assert!(camera.lens == plain, "the oracle has no vignetting, and only square pixels");
        assert!(camera.lens.aperture.is_none_or(|aperture| aperture.blades == 0), "the oracle's apertures are discs");
        let resolution = resolution.map(f64::from);
        let half_height = match camera.projection {
            Projection::Perspective { yfov } => (yfov / 2.0).tan(),
            Projection::Orthographic { height } => height / 2.0,
            Projection::Aimed { .. } => 1.0,
        };
        let shift = [0, 1].map(|k| (camera.principal_point[k] - 0.5) * resolution[k]);
        Sensor { camera, resolution, half: [half_height * resolution[0] / resolution[1], half_height], shift }
    }

    /// The camera ray through image coordinates in pixels, and the length in metres that counts besides those of its segments.
    pub fn ray(&self, x: f64, y: f64, pcg: &mut Pcg) -> (Ray, f64) {
        let [w, h] = self.resolution;
        let transform = &self.camera.transform;
        if let Projection::Aimed { aims, .. } = &self.camera.projection {
            let aim = aims[y as usize * w as usize + x as usize];
            return (Ray::new(transform.translation, (aim.point - transform.translation).normalize()), 0.0);
        }
        let (x, y) = (x - self.shift[0], y - self.shift[1]);
        let (x, y) = ((2.0 * x / w - 1.0) * self.half[0], (1.0 - 2.0 * y / h) * self.half[1]);
        let (start, direction, delay) = match (&self.camera.projection, self.camera.lens.aperture) {
            (Projection::Orthographic { .. }, _) => (DVec3::new(x, y, 0.0), DVec3::NEG_Z, 0.0),
            (_, None) => (DVec3::ZERO, self.undistorted(x, y), 0.0),
            (_, Some(aperture)) => {
                let (start, in_focus) = (point_of(aperture, pcg), self.undistorted(x, y) * aperture.focus);
                (start, in_focus - start, in_focus.length() - (in_focus - start).length())
            }
        };
        let ray = Ray::new(transform.transform_point3(start), transform.transform_vector3(direction).normalize());
        (ray, delay)
    }

    /// How the camera sees a point. `None` if the point is outside the image or not in front of the sensor.
    pub fn project(&self, point: DVec3, pcg: &mut Pcg) -> Option<Seen> {
        let p = self.camera.transform.inverse().transform_point3(point);
        if p.z >= 0.0 || self.camera.projection.aims().is_some() {
            return None;
        }
        let [w, h] = self.resolution;
        let area = 4.0 * self.half[0] * self.half[1] / (w * h);
        let (on_plane, sensor, density, delay) = match (&self.camera.projection, self.camera.lens.aperture) {
            (Projection::Orthographic { .. }, _) => (p, DVec3::new(p.x, p.y, 0.0), 1.0 / area, 0.0),
            (_, None) => {
                let cos = -p.z / p.length();
                (p / -p.z, DVec3::ZERO, 1.0 / (area * cos.powi(3) * p.length_squared()), 0.0)
            }
            (_, Some(aperture)) => {
                let start = point_of(aperture, pcg);
                let way = p - start;
                let in_focus = start + way * (aperture.focus / -p.z);
                let length = (in_focus - start).length();
                let cos = -way.z / way.length();
                let density = length * length / (area * aperture.focus.powi(2) * cos * way.length_squared());
                (in_focus / aperture.focus, start, density, in_focus.length() - length)
            }
        };
        let (on_plane, stretch) = self.distorted(on_plane);
        let x = (on_plane.x / self.half[0] + 1.0) / 2.0 * w + self.shift[0];
        let y = (1.0 - on_plane.y / self.half[1]) / 2.0 * h + self.shift[1];
        if !(0.0..w).contains(&x) || !(0.0..h).contains(&y) {
            return None;
        }
        let pixel = y as usize * w as usize + x as usize;
        let sensor = self.camera.transform.transform_point3(sensor);
        Some(Seen { pixel, sensor, density: density * stretch, delay })
    }

    /// Where the lens moves a point of the image plane, and the Jacobian of this map, by differences.
    fn distorted(&self, on_plane: DVec3) -> (DVec2, f64) {
        let at = |x: f64, y: f64| moved(&self.camera.lens.distortion, DVec2::new(x, y));
        let (x, y) = (on_plane.x, on_plane.y);
        let step = 1e-6;
        let along_x = (at(x + step, y) - at(x - step, y)) / (2.0 * step);
        let along_y = (at(x, y + step) - at(x, y - step)) / (2.0 * step);
        match self.camera.lens.distortion {
            Distortion::None => (DVec2::new(x, y), 1.0),
            _ => (at(x, y), along_x.perp_dot(along_y).abs()),
        }
    }

    /// The point at distance 1 along the view that the lens moves to this point of the image plane: a fixed point, which converges for lenses
    /// that move points less than they are far apart.
    fn undistorted(&self, x: f64, y: f64) -> DVec3 {
        let wanted = DVec2::new(x, y);
        let mut from = wanted;
        if self.camera.lens.distortion != Distortion::None {
            for _ in 0..100 {
                from += wanted - moved(&self.camera.lens.distortion, from);
            }
            let left = (moved(&self.camera.lens.distortion, from) - wanted).length();
            assert!(left < 1e-9, "the oracle cannot invert this lens: {left}");
        }
        DVec3::new(from.x, from.y, -1.0)
    }
}

/// A uniform point of the aperture, in the frame of the camera.
fn point_of(aperture: Aperture, pcg: &mut Pcg) -> DVec3 {
    let (radius, angle) = (0.5 * aperture.diameter * pcg.uniform().sqrt(), TAU * pcg.uniform());
    DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
}

/// Where the lens moves a point of the image plane, whose y axis points up, unlike that of OpenCV.
fn moved(distortion: &Distortion, point: DVec2) -> DVec2 {
    let (x, y) = (point.x, -point.y);
    let r2 = x * x + y * y;
    let (x, y) = match *distortion {
        Distortion::None => (x, y),
        Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => {
            let polynomial = |a: f64, b: f64, c: f64| 1.0 + r2 * (a + r2 * (b + r2 * c));
            let factor = polynomial(k1, k2, k3) / polynomial(k4, k5, k6);
            let aside = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
            (x * factor + aside, y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
        }
        Distortion::Fisheye(_) => panic!("the oracle has no fisheye"),
    };
    DVec2::new(x, -y)
}
