//! Cameras: where they stand, which rays they see, and where the travel time of their light ends.

#![warn(missing_docs)]

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use glam::{DAffine3, DVec3, dvec2};

use super::check::{Checked, MAX_COORDINATE};
use super::lens::Lens;
use super::vignetting::Vignetting;
use crate::error::{Error, Result};
use crate::printable::escaped;

/// A camera. It looks along -Z of its transform, with +Y up and +X to the right.
///
/// The travel time of a path ends where its camera ray starts (see [`Camera::origin`]). For a perspective camera this point is
/// the pinhole, and for aimed rays it is their common start. For an orthographic camera it is a point of the sensor plane: the
/// plane through the camera's place, perpendicular to the view. Surfaces behind this point are not seen; the near and far planes
/// of a file have no effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Unique among the cameras of the scene.
    pub name: String,
    /// World from camera space: rotation and translation only. The loader removes scale.
    pub transform: DAffine3,
    /// Kind and size of the view.
    pub projection: Projection,
    /// Width / height, if the file specifies it.
    pub aspect: Option<f64>,
    /// Pixels across and down: `extras.width` and `extras.height`, if the file specifies them.
    pub resolution: Option<[u32; 2]>,
    /// Where the camera's axis meets the image, as fractions of its width and height from the top left corner; the centre is
    /// [`Camera::CENTRED`]. It may lie outside the image.
    pub principal_point: [f64; 2],
    /// The lens of a perspective camera; [`Lens::PINHOLE`] if there is none. Other cameras have none.
    pub lens: Lens,
}

/// How a camera projects the scene. The width of the view follows from its height and from the resolution.
#[derive(Debug, Clone, PartialEq)]
pub enum Projection {
    /// A pinhole: all camera rays start at the camera's place.
    Perspective {
        /// Vertical field of view in radians, in (0, pi).
        yfov: f64,
    },
    /// Parallel camera rays, which start on the sensor plane.
    Orthographic {
        /// Height of the view in metres, > 0: twice the `ymag` of glTF.
        height: f64,
    },
    /// Each pixel looks from the camera's place at a point of its own, as in a scan of a wall or a LiDAR. No glTF file has such a
    /// camera.
    Aimed {
        /// One point per pixel, row by row.
        aims: Arc<[Aim]>,
        /// Width and height in radians of the square field of view of each pixel, in [0, pi / 2]. 0: the pixel measures the
        /// radiance along a single ray.
        pixel_fov: f64,
    },
}

/// The point at which a pixel of [`Projection::Aimed`] looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// World space, in metres. It must differ from the camera's place.
    pub point: DVec3,
    /// Length in metres, >= 0, that is subtracted from the travel times of this pixel. For example, the distance between the point
    /// and the camera, if travel times end at the point.
    pub uncounted: f64,
}

impl Projection {
    /// Whether the camera rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        matches!(self, Projection::Orthographic { .. })
    }

    /// Vertical field of view in radians; `None` if the camera is not [`Projection::Perspective`].
    pub fn yfov(&self) -> Option<f64> {
        match *self {
            Projection::Perspective { yfov } => Some(yfov),
            _ => None,
        }
    }

    /// Height of the view in metres; `None` if the camera is not [`Projection::Orthographic`].
    pub fn view_height(&self) -> Option<f64> {
        match *self {
            Projection::Orthographic { height } => Some(height),
            _ => None,
        }
    }

    /// The points at which the pixels look; `None` if the camera has an image plane.
    pub fn aims(&self) -> Option<&[Aim]> {
        match self {
            Projection::Aimed { aims, .. } => Some(aims),
            _ => None,
        }
    }

    /// Half the height of the image plane at distance 1 from a pinhole (without unit), or of the sensor plane (in metres). For
    /// [`Projection::Aimed`], half the height of one pixel at distance 1.
    pub(crate) fn half_height(&self) -> f64 {
        match *self {
            Projection::Perspective { yfov } => (0.5 * yfov).tan(),
            Projection::Orthographic { height } => 0.5 * height,
            Projection::Aimed { pixel_fov, .. } => (0.5 * pixel_fov).tan(),
        }
    }

    /// Whether a camera at `place` (world space, in metres) can have this projection. The error is a clause that follows the name of
    /// the camera.
    pub(super) fn check(&self, place: DVec3) -> Checked {
        match self {
            &Projection::Perspective { yfov } if !(yfov > 0.0 && yfov < PI) => {
                Err(format!("has a yfov of {yfov}; it must be between 0 and pi"))
            }
            &Projection::Orthographic { height } if !(height > 0.0 && height <= MAX_COORDINATE) => {
                Err(format!("has a view {height} m high; use a height above 0, up to {MAX_COORDINATE:e} m"))
            }
            Projection::Aimed { pixel_fov, .. } if !(0.0..=FRAC_PI_2).contains(pixel_fov) => {
                Err(format!("has pixels with a field of view of {pixel_fov}; it must be from 0 to pi / 2"))
            }
            Projection::Aimed { aims, .. } if aims.is_empty() || !aims.iter().all(|aim| aim.is_valid(place)) => {
                Err(format!(
                    "aims at no point, at its own place, at a point farther than {MAX_COORDINATE:e} m from the origin, or omits a \
                     length that is negative or above {MAX_COORDINATE:e} m"
                ))
            }
            _ => Ok(()),
        }
    }
}

impl Aim {
    /// Whether a pixel of a camera at `place` can look at this point.
    fn is_valid(&self, place: DVec3) -> bool {
        let is_near = self.point.abs().max_element() <= MAX_COORDINATE;
        is_near && (0.0..=MAX_COORDINATE).contains(&self.uncounted) && self.point.distance(place) > 0.0
    }
}

impl Camera {
    /// The principal point of a camera whose axis meets the centre of the image.
    pub const CENTRED: [f64; 2] = [0.5; 2];

    /// Unit direction in world space of the camera ray through the point `film` of an image of this resolution. `film` is in
    /// pixels: column, then row from the top; the centre of the first pixel is (0.5, 0.5). For [`Projection::Aimed`], the
    /// direction towards the pixel's point.
    ///
    /// # Panics
    /// If the rays are aimed, and the resolution has no pixels or more pixels than there are points.
    pub fn direction(&self, resolution: [u32; 2], film: [f64; 2]) -> DVec3 {
        let local = match &self.projection {
            Projection::Perspective { .. } => {
                let DVec3 { x, y, .. } = self.on_image_plane(resolution, film);
                let to = self.lens.distortion.direction(dvec2(x, -y));
                DVec3::new(to.x, -to.y, -to.z)
            }
            Projection::Orthographic { .. } => DVec3::NEG_Z,
            Projection::Aimed { aims, .. } => {
                let [column, row] = [0, 1].map(|k| (film[k].max(0.0) as usize).min(resolution[k] as usize - 1));
                let aim = aims[row * resolution[0] as usize + column];
                return (aim.point - self.transform.translation).normalize();
            }
        };
        self.transform.transform_vector3(local).normalize()
    }

    /// Start of the camera ray through `film` in world space, in metres: the pinhole, or a point of the sensor plane. `film` is a
    /// point of the image as in [`Camera::direction`].
    pub fn origin(&self, resolution: [u32; 2], film: [f64; 2]) -> DVec3 {
        match self.projection {
            Projection::Perspective { .. } | Projection::Aimed { .. } => self.transform.translation,
            Projection::Orthographic { .. } => self.transform.transform_point3(self.on_image_plane(resolution, film)),
        }
    }

    /// The starts of the camera rays through the four corners of the image, as [`Camera::origin`].
    pub(crate) fn corners(&self, resolution: [u32; 2]) -> [DVec3; 4] {
        film_corners(resolution).map(|film| self.origin(resolution, film))
    }

    /// The largest tangent of the angle to the view in an image of this resolution, with some room; for a fisheye the largest angle in
    /// radians. Fails if the lens distorts so much that two directions have one pixel, or if the table of its vignetting ends inside the
    /// image. The error names the camera.
    pub(crate) fn lens_limit(&self, resolution: [u32; 2]) -> Result<f64> {
        let corners = [[0.0; 2], resolution.map(f64::from)].map(|film| {
            let DVec3 { x, y, .. } = self.on_image_plane(resolution, film);
            dvec2(x, -y)
        });
        let named = |why| Error::settings(format!("camera '{}' {why}", escaped(&self.name)));
        let limit = self.lens.distortion.limit(corners).map_err(named)?;
        if self.lens.vignetting != Vignetting::None {
            let view = self.transform.transform_vector3(DVec3::NEG_Z);
            let angles = film_corners(resolution).map(|film| self.direction(resolution, film).angle_between(view));
            self.lens.vignetting.check_reach(angles.into_iter().fold(0.0, f64::max)).map_err(named)?;
        }
        Ok(limit)
    }

    /// The point `film` on the image plane relative to the principal point: x to the right, y up, in the unit of
    /// [`Projection::half_height`].
    fn on_image_plane(&self, resolution: [u32; 2], film: [f64; 2]) -> DVec3 {
        let [width, height] = resolution.map(f64::from);
        let half_height = self.projection.half_height();
        let [centre_x, centre_y] = self.principal_point;
        let x = 2.0 * (film[0] / width - centre_x) * half_height * width / height * self.lens.pixel_aspect;
        let y = 2.0 * (centre_y - film[1] / height) * half_height;
        DVec3::new(x, y, 0.0)
    }
}

/// The corners of an image in pixels.
fn film_corners(resolution: [u32; 2]) -> [[f64; 2]; 4] {
    let [width, height] = resolution.map(f64::from);
    [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at (5, 0, 0) that looks along -X.
    fn camera(projection: Projection) -> Camera {
        let transform =
            DAffine3::from_translation(5.0 * DVec3::X) * DAffine3::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let (name, principal_point) = (String::new(), Camera::CENTRED);
        Camera { name, transform, projection, aspect: None, resolution: None, principal_point, lens: Lens::PINHOLE }
    }

    fn close(a: DVec3, b: DVec3) -> bool {
        (a - b).length() < 1e-12
    }

    #[test]
    fn a_pinhole_looks_through_the_centre_of_its_image() {
        let camera = camera(Projection::Perspective { yfov: std::f64::consts::FRAC_PI_2 });
        let close = |a: DVec3, b: DVec3| close(a, b.normalize());
        assert!(close(camera.direction([40, 20], [20.0, 10.0]), DVec3::NEG_X));
        // Half the height of the image is 45 degrees up, and the left edge is twice as far from the axis.
        assert!(close(camera.direction([40, 20], [20.0, 0.0]), DVec3::new(-1.0, 1.0, 0.0)));
        assert!(close(camera.direction([40, 20], [0.0, 10.0]), DVec3::new(-1.0, 0.0, 2.0)));
        let shifted = Camera { principal_point: [0.25, 1.0], ..camera };
        assert!(close(shifted.direction([40, 20], [10.0, 20.0]), DVec3::NEG_X));
        assert_eq!(shifted.corners([40, 20]), [5.0 * DVec3::X; 4]);
    }

    #[test]
    fn an_aimed_pixel_looks_at_its_point() {
        let aim = |x: f64, y: f64, z: f64| Aim { point: DVec3::new(x, y, z), uncounted: 0.0 };
        let aims = [aim(4.0, 0.0, 0.0), aim(5.0, 2.0, 0.0), aim(5.0, 0.0, 7.0), aim(6.0, 1.0, 0.0)];
        let camera = camera(Projection::Aimed { aims: aims.into(), pixel_fov: 0.0 });
        let rays = [DVec3::NEG_X, DVec3::Y, DVec3::Z, DVec3::new(1.0, 1.0, 0.0).normalize()];
        for (film, ray) in [[0.5, 0.5], [1.9, 0.0], [0.0, 1.0], [2.0, 2.0]].into_iter().zip(rays) {
            assert!(close(camera.direction([2, 2], film), ray), "{film:?}");
        }
        assert_eq!(camera.corners([2, 2]), [5.0 * DVec3::X; 4]);
    }

    #[test]
    fn parallel_rays_start_on_the_sensor_plane() {
        let camera = camera(Projection::Orthographic { height: 3.0 });
        for film in [[20.0, 10.0], [0.0, 7.0]] {
            assert!(close(camera.direction([40, 20], film), DVec3::NEG_X));
        }
        assert!(close(camera.origin([40, 20], [20.0, 10.0]), DVec3::new(5.0, 0.0, 0.0)));
        assert!(close(camera.origin([40, 20], [20.0, 0.0]), DVec3::new(5.0, 1.5, 0.0)));
        assert!(close(camera.origin([40, 20], [0.0, 10.0]), DVec3::new(5.0, 0.0, 3.0)));
        let shifted = Camera { principal_point: [0.25, 1.0], ..camera };
        assert!(close(shifted.origin([40, 20], [10.0, 20.0]), DVec3::new(5.0, 0.0, 0.0)));
        assert!(close(shifted.corners([40, 20])[1], DVec3::new(5.0, 3.0, -4.5)));
    }
}
