//! The camera of a plan: its place, its view, and the glass around it.

use glam::DVec3;

use super::Plan;
use crate::scene::{Aim, Aperture, Camera, Distortion, Vignetting};

/// The kind of camera that the kernels are compiled for.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct CameraKind {
    /// Whether the camera rays are parallel.
    pub is_orthographic: bool,
    /// Number of aimed rays.
    pub aims: usize,
    pub has_distortion: bool,
    pub has_fisheye: bool,
    pub has_aperture: bool,
    pub has_cos4: bool,
    pub has_vignetting_table: bool,
}

impl CameraKind {
    pub fn of(camera: &Camera) -> CameraKind {
        let aims = camera.projection.aims().map_or(0, <[Aim]>::len);
        CameraKind {
            is_orthographic: camera.projection.is_orthographic(),
            aims,
            has_distortion: matches!(camera.lens.distortion, Distortion::Rational { .. }),
            has_fisheye: matches!(camera.lens.distortion, Distortion::Fisheye(_)),
            has_aperture: camera.lens.aperture.is_some(),
            has_cos4: camera.lens.vignetting == Vignetting::Cos4,
            has_vignetting_table: matches!(camera.lens.vignetting, Vignetting::Table(_)),
        }
    }

    /// Values of the WGSL `override` constants that depend on the kind alone.
    pub fn constants(self) -> [(&'static str, bool); 7] {
        [
            ("HAS_ORTHOGRAPHIC", self.is_orthographic),
            ("HAS_AIMS", self.aims > 0),
            ("HAS_DISTORTION", self.has_distortion),
            ("HAS_FISHEYE", self.has_fisheye),
            ("HAS_APERTURE", self.has_aperture),
            ("HAS_COS4", self.has_cos4),
            ("HAS_VIGNETTING_TABLE", self.has_vignetting_table),
        ]
    }
}

impl Plan {
    /// Whether [`Plan::set_camera`] can replace the camera by this one. Both must be of one kind, with equally many aimed rays. The new one must be near the one that the scene was prepared for (see `RenderSpace::sensor`).
    pub fn takes(&self, camera: &Camera) -> bool {
        CameraKind::of(camera) == self.camera_kind && self.space.sensor(camera.transform.translation).is_some()
    }

    /// Replaces the camera by one that [`Plan::takes`]; the film keeps its size.
    pub fn set_camera(&mut self, camera: &Camera) {
        let is_taken = self.aim(camera);
        debug_assert!(is_taken, "the caller asks `takes` first");
        self.set(self.frame.seed, self.responses.clone());
    }

    /// Sets the camera's position, axes and view in the frame. Returns false and changes nothing if the camera is too far away.
    pub(super) fn aim(&mut self, camera: &Camera) -> bool {
        let Some(sensor) = self.space.sensor(camera.transform.translation) else { return false };
        self.distortion = camera.lens.distortion;
        let frame = &mut self.frame;
        frame.sensor = sensor.to_array();
        frame.sensor_solid = self.solids.material_at(sensor);
        let axis = |v: DVec3| camera.transform.transform_vector3(v).normalize().as_vec3().to_array();
        (frame.right, frame.up, frame.forward) = (axis(DVec3::X), axis(DVec3::Y), axis(DVec3::NEG_Z));
        let [width, height] = match self.camera_kind.aims {
            0 => [frame.width, frame.height].map(f64::from),
            _ => [1.0; 2],
        };
        let half_height = match self.camera_kind.is_orthographic {
            false => camera.projection.half_height(),
            true => self.space.length(camera.projection.half_height()),
        };
        let extent = [half_height * width / height * camera.lens.pixel_aspect, half_height];
        frame.extent = extent.map(|x| x as f32);
        frame.pixel_area = (4.0 * extent[0] * extent[1] / (width * height)) as f32;
        let [x, y] = camera.principal_point;
        frame.principal_offset = [(x - 0.5) * width, (y - 0.5) * height].map(|pixels| pixels as f32);
        let [radial, rest] = coefficients(&camera.lens.distortion);
        (frame.lens_radial, frame.lens_rest) = (radial.map(|k| k as f32), rest.map(|k| k as f32));
        frame.lens_limit = camera.lens_limit([frame.width, frame.height]).map_or(0.0, |limit| limit as f32);
        frame.vignetting = vignetting_rows(&camera.lens.vignetting);
        self.sensor_corners = camera.corners([frame.width, frame.height]).map(|corner| self.space.point(corner));
        self.uncounted =
            camera.projection.aims().unwrap_or_default().iter().map(|aim| aim.uncounted).fold(0.0, f64::max);
        (frame.lens_radius, frame.inverse_focus, frame.blades) = (0.0, 0.0, 0);
        if let Some(Aperture { diameter, focus, blades }) = camera.lens.aperture {
            frame.lens_radius = self.space.length(0.5 * diameter) as f32;
            frame.inverse_focus = (1.0 / self.space.length(focus)) as f32;
            frame.blades = blades;
            // A path may be shorter than through the centre of the lens, once because it begins nearer, once by its delay.
            self.uncounted = diameter;
        }
        true
    }
}

/// The rows of a vignetting as [`Frame`](crate::wgsl::layout::Frame) has them, two angles and shares per vector. The last row is repeated
/// at larger angles.
fn vignetting_rows(vignetting: &Vignetting) -> [[f32; 4]; Vignetting::MAX_ROWS / 2] {
    let Vignetting::Table(rows) = vignetting else { return [[0.0; 4]; Vignetting::MAX_ROWS / 2] };
    let row = |index: usize| {
        let beyond = index.saturating_sub(rows.len() - 1);
        let [angle, share] = rows[index - beyond];
        [(angle + beyond as f64) as f32, share as f32]
    };
    std::array::from_fn(|pair| {
        let [[a, b], [c, d]] = [row(2 * pair), row(2 * pair + 1)];
        [a, b, c, d]
    })
}

/// The coefficients as [`Frame`](crate::wgsl::layout::Frame) has them.
fn coefficients(distortion: &Distortion) -> [[f64; 4]; 2] {
    match *distortion {
        Distortion::None => [[0.0; 4]; 2],
        Distortion::Rational { radial: [k1, k2, k3, k4, k5, k6], tangential: [p1, p2] } => {
            [[k1, k2, k3, k4], [k5, k6, p1, p2]]
        }
        Distortion::Fisheye(k) => [k, [0.0; 4]],
    }
}
