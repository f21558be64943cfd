//! Lenses of calibrated cameras: pixels that are not square, and distortion.

#![warn(missing_docs)]

use glam::{DMat2, DVec2, DVec3, dvec2};

use super::check::Checked;
use super::vignetting::Vignetting;

/// How the image of a perspective camera differs from that of a pinhole with square pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Lens {
    /// Width of a pixel over its height, > 0: fy / fx of an intrinsic matrix.
    pub pixel_aspect: f64,
    /// Where the lens moves the points of the image.
    pub distortion: Distortion,
    /// Its aperture; `None` for a pinhole, whose image is sharp at all distances.
    pub aperture: Option<Aperture>,
    /// How much of the light reaches the border of the image.
    pub vignetting: Vignetting,
}

/// The aperture of a thin lens. A pixel measures the mean radiance of the rays from all points of the aperture to the point in focus.
/// Travel times are those of rays through the centre of the lens, because a lens delays all rays of a point in focus alike: the path from the
/// point l of the aperture counts for |P - c| - |P - l| more, with the centre c and the point in focus P of its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Diameter in metres, > 0.
    pub diameter: f64,
    /// Distance of the plane in focus from the lens along the view, in metres, > 0. It may be infinite.
    pub focus: f64,
    /// Number of blades, at least 3: the aperture is a regular polygon whose corners lie on the circle of this diameter. 0: a disc.
    pub blades: u32,
}

/// Where a lens moves the points of the image, as OpenCV defines it. A point P in front of the camera, with X to the right, Y down and
/// Z along the view, has the pinhole image (x, y) = (X / Z, Y / Z). The lens moves this image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// The pinhole.
    None,
    /// The rational model. With f = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), the image is at
    /// x f + 2 p1 x y + p2 (r^2 + 2 x^2) and y f + p1 (r^2 + 2 y^2) + 2 p2 x y.
    Rational {
        /// k1 to k6.
        radial: [f64; 6],
        /// p1 and p2.
        tangential: [f64; 2],
    },
    /// The fisheye of Kannala and Brandt: k1 to k4. A direction has the angle a to the view. Its image lies at the distance
    /// a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) from the principal point. Angles may exceed 90 degrees.
    Fisheye([f64; 4]),
}

/// Maximum number of blades of an aperture.
const MAX_BLADES: u32 = 64;
/// Number of Newton steps that invert a lens, as in `shared/lens.wgsl`.
const STEPS: usize = 10;
/// Maximum error of the inverse, in focal lengths.
const MAX_ERROR: f64 = 1e-7;
/// Maximum angle to the view that a fisheye sees, in radians: 175 degrees.
const MAX_ANGLE: f64 = 3.054;
/// Number of points along each side of the image, and along a radius, at which a lens is checked.
const CHECKED: usize = 48;

impl Lens {
    /// No lens.
    pub const PINHOLE: Lens =
        Lens { pixel_aspect: 1.0, distortion: Distortion::None, aperture: None, vignetting: Vignetting::None };
}

impl Aperture {
    /// Whether a lens with this distortion can have this aperture. The error is a clause that follows the name of the camera.
    pub(super) fn check(&self, distortion: &Distortion) -> Checked {
        let Aperture { diameter, focus, blades } = *self;
        if !(diameter > 0.0 && diameter.is_finite() && focus > 0.0) {
            return Err(format!(
                "has an aperture of {diameter} m with the focus at {focus} m; use a positive diameter, and a positive focus"
            ));
        }
        if !(blades == 0 || (3..=MAX_BLADES).contains(&blades)) {
            return Err(format!("has an aperture of {blades} blades; use 3 to {MAX_BLADES}, or 0 for a disc"));
        }
        if diameter > focus {
            return Err(format!(
                "has its focus, at {focus} m, nearer than the width of its aperture, {diameter} m; focus farther away"
            ));
        }
        if matches!(distortion, Distortion::Fisheye(_)) {
            return Err(
                "has a fisheye lens with an aperture, which taugate does not know; leave the aperture out".into()
            );
        }
        Ok(())
    }
}

impl Distortion {
    /// The image of a direction, in focal lengths from the principal point, x to the right and y down. `to`: X to the right, Y down, Z
    /// along the view; its length does not matter. `None` if a lens that is no fisheye does not see it because Z <= 0.
    pub fn image(&self, to: DVec3) -> Option<DVec2> {
        match self {
            Distortion::Fisheye(_) => {
                let aside = to.truncate();
                let angle = aside.length().atan2(to.z);
                let direction = aside.try_normalize().unwrap_or(DVec2::ZERO);
                Some(self.distance_of(angle)[0] * direction)
            }
            _ if to.z <= 0.0 => None,
            Distortion::None => Some(to.truncate() / to.z),
            Distortion::Rational { .. } => Some(self.distort(to.truncate() / to.z).0),
        }
    }

    /// A vector in the direction that has this image; see [`Distortion::image`].
    pub fn direction(&self, image: DVec2) -> DVec3 {
        match self {
            Distortion::None => image.extend(1.0),
            Distortion::Rational { .. } => self.undistort(image).extend(1.0),
            Distortion::Fisheye(_) => {
                let distance = image.length();
                let angle = self.angle_of(distance);
                let aside = image.try_normalize().unwrap_or(DVec2::ZERO);
                (angle.sin() * aside).extend(angle.cos())
            }
        }
    }

    /// The image of a pinhole's image `p`, and its derivative.
    fn distort(&self, p: DVec2) -> (DVec2, DMat2) {
        let Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } = *self else {
            return (p, DMat2::IDENTITY);
        };
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let factor = above / below;
        // The derivative of the factor by r^2.
        let slope = (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) - factor * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6))) / below;
        let shift = dvec2(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        let mixed = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y);
        let dx = dvec2(factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed);
        let dy = dvec2(mixed, factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x);
        (factor * p + shift, DMat2::from_cols(dx, dy))
    }

    /// The pinhole's image that the lens moves to `q`.
    fn undistort(&self, q: DVec2) -> DVec2 {
        (0..STEPS).fold(q, |p, _| {
            let (found, derivative) = self.distort(p);
            p - derivative.inverse() * (found - q)
        })
    }

    /// Distance of a fisheye's image from the principal point at the angle `a` to the view, and its derivative.
    fn distance_of(&self, a: f64) -> [f64; 2] {
        let Distortion::Fisheye([k1, k2, k3, k4]) = *self else { return [a.tan(), 1.0] };
        let a2 = a * a;
        let factor = 1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)));
        let slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
        [a * factor, slope]
    }

    fn angle_of(&self, distance: f64) -> f64 {
        (0..STEPS).fold(distance, |angle, _| {
            let [found, slope] = self.distance_of(angle);
            angle - (found - distance) / slope
        })
    }

    /// The largest tangent of the angle to the view in the image (for a fisheye: the largest angle, in radians), with some room. `corners`:
    /// the upper left and the lower right corner of the image, in the unit of [`Distortion::image`]. Fails if two points of the scene
    /// could have one image there. The error is a clause that follows the name of the camera.
    pub(crate) fn limit(&self, [lo, hi]: [DVec2; 2]) -> Checked<f64> {
        let folded = || {
            Err("has a lens distortion that folds inside the image: two directions have one pixel there, or none has it; check the \
                 coefficients and their order (k1, k2, p1, p2, k3, ...), and that the camera matrix belongs to this resolution"
                .to_string())
        };
        let mut limit: f64 = 0.0;
        for (row, column) in (0..=CHECKED).flat_map(|row| (0..=CHECKED).map(move |column| (row, column))) {
            let image = lo + (hi - lo) * dvec2(column as f64, row as f64) / CHECKED as f64;
            let (found, reach) = match self {
                Distortion::None => return Ok(f64::MAX),
                Distortion::Rational { .. } => {
                    let p = self.undistort(image);
                    (self.distort(p).0, p.length())
                }
                Distortion::Fisheye(_) => {
                    let angle = self.angle_of(image.length());
                    let distance = self.distance_of(angle)[0];
                    (image.try_normalize().unwrap_or(DVec2::ZERO) * distance, angle)
                }
            };
            let is_right = (found - image).length() <= MAX_ERROR * (1.0 + image.length()) && reach >= 0.0;
            if !is_right {
                return folded();
            }
            limit = limit.max(reach);
        }
        if matches!(self, Distortion::Fisheye(_)) && limit > MAX_ANGLE {
            return Err(format!(
                "has a fisheye lens that sees {:.0} degrees from its axis; the most is 175, so use a smaller image circle",
                limit.to_degrees()
            ));
        }
        let limit = 1.001 * limit;
        let turns = (0..CHECKED).map(|k| DVec2::from_angle(k as f64 / CHECKED as f64 * std::f64::consts::TAU));
        for (turn, k) in turns.flat_map(|turn| (0..=CHECKED).map(move |k| (turn, k))) {
            let reach = limit * k as f64 / CHECKED as f64;
            let spread = match self {
                Distortion::Fisheye(_) => self.distance_of(reach)[1],
                _ => self.distort(reach * turn).1.determinant(),
            };
            if spread.is_nan() || spread <= 0.0 {
                return folded();
            }
        }
        Ok(limit)
    }

    /// Whether all coefficients are finite.
    pub(super) fn is_finite(&self) -> bool {
        match self {
            Distortion::None => true,
            Distortion::Rational { radial, tangential } => radial.iter().chain(tangential).all(|k| k.is_finite()),
            Distortion::Fisheye(k) => k.iter().all(|k| k.is_finite()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Strong barrel distortion with all coefficients, as of a wide lens.
    const WIDE: Distortion =
        Distortion::Rational { radial: [-0.28, 0.09, -0.012, 0.02, -0.01, 0.001], tangential: [1.2e-3, -8e-4] };
    const FISHEYE: Distortion = Distortion::Fisheye([0.03, -0.012, 0.004, -0.0007]);

    /// Values that OpenCV's definition gives, worked out by hand for simple coefficients.
    #[test]
    fn the_models_are_those_of_opencv() {
        let radial = |k: [f64; 6]| Distortion::Rational { radial: k, tangential: [0.0; 2] };
        let to = DVec3::new(1.0, 2.0, 2.0);
        // x = 0.5, y = 1, r^2 = 1.25.
        let image = |lens: Distortion| lens.image(to).unwrap();
        let close = |a: DVec2, b: [f64; 2]| assert!((a - DVec2::from(b)).length() < 1e-12, "{a} instead of {b:?}");
        close(image(Distortion::None), [0.5, 1.0]);
        close(image(radial([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])), [0.5 * 1.125, 1.125]);
        close(image(radial([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])), [0.5 * 1.15625, 1.15625]);
        close(image(radial([0.0, 0.0, 0.0, 0.2, 0.0, 0.0])), [0.5 / 1.25, 1.0 / 1.25]);
        let tangential = Distortion::Rational { radial: [0.0; 6], tangential: [0.1, 0.2] };
        close(image(tangential), [0.5 + 0.2 * 0.5 + 0.2 * 1.75, 1.0 + 0.1 * 3.25 + 0.4 * 0.5]);
        // 60 degrees to the right: a = pi / 3.
        let a = std::f64::consts::FRAC_PI_3;
        let right = Distortion::Fisheye([0.1, 0.0, 0.0, 0.0]).image(DVec3::new(3f64.sqrt(), 0.0, 1.0)).unwrap();
        close(right, [a * (1.0 + 0.1 * a * a), 0.0]);
        assert!(Distortion::None.image(-to).is_none() && WIDE.image(-to).is_none() && FISHEYE.image(-to).is_some());
    }

    #[test]
    fn a_direction_has_the_image_that_it_was_found_from() {
        for lens in [Distortion::None, WIDE, FISHEYE] {
            let limit = lens.limit([dvec2(-0.7, -0.5), dvec2(0.8, 0.6)]).unwrap();
            assert!(limit > 0.6, "{limit}");
            for image in [dvec2(-0.7, -0.5), dvec2(0.8, 0.6), dvec2(0.1, -0.3), DVec2::ZERO] {
                let found = lens.image(7.0 * lens.direction(image)).unwrap();
                assert!((found - image).length() < 1e-12, "{lens:?}: {found} instead of {image}");
            }
        }
        // Behind the camera: 120 degrees.
        let behind = FISHEYE.direction(dvec2(0.0, 2.1));
        assert!(behind.z < 0.0 && behind.y > 0.0 && (behind.length() - 1.0).abs() < 1e-12, "{behind}");
    }

    #[test]
    fn the_derivative_is_that_of_differences() {
        let (p, h) = (dvec2(0.4, -0.7), 1e-6);
        let (_, derivative) = WIDE.distort(p);
        let column = |step: DVec2| (WIDE.distort(p + step).0 - WIDE.distort(p - step).0) / (2.0 * h);
        let expected = DMat2::from_cols(column(dvec2(h, 0.0)), column(dvec2(0.0, h)));
        assert!((derivative - expected).to_cols_array().iter().all(|x| x.abs() < 1e-9), "{derivative} {expected}");
        let [_, slope] = FISHEYE.distance_of(1.1);
        let difference = (FISHEYE.distance_of(1.1 + h)[0] - FISHEYE.distance_of(1.1 - h)[0]) / (2.0 * h);
        assert!((slope - difference).abs() < 1e-9);
    }

    #[test]
    fn a_lens_that_folds_inside_the_image_is_refused() {
        let corners = [dvec2(-1.0, -1.0), dvec2(1.0, 1.0)];
        // x (1 - r^2 / 3) has its maximum of 2/3 at r = 1, so no direction has an image at 1.
        let folded = Distortion::Rational { radial: [-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
        assert!(folded.limit(corners).unwrap_err().contains("folds inside the image"));
        assert!(folded.limit(corners.map(|corner| 0.4 * corner)).is_ok());
        assert!(Distortion::Fisheye([-0.3, 0.0, 0.0, 0.0]).limit(corners).unwrap_err().contains("folds"));
        let whole = Distortion::Fisheye([0.0; 4]);
        assert!(whole.limit(corners.map(|corner| 2.3 * corner)).unwrap_err().contains("sees 186 degrees"));
        let nan = Distortion::Rational { radial: [f64::NAN; 6], tangential: [0.0; 2] };
        assert!(nan.limit(corners).is_err() && !nan.is_finite());
    }
}
