//! The camera of a plan: its place, its view, and the glass around it.

use glam::DVec3;

use super::Plan;
use crate::scene::{Aim, Camera};

/// The kind of camera that the kernels are compiled for.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct CameraKind {
    /// Whether the camera rays are parallel.
    pub is_orthographic: bool,
    /// Number of aimed rays.
    pub aims: usize,
}

impl CameraKind {
    pub fn of(camera: &Camera) -> CameraKind {
        let aims = camera.projection.aims().map_or(0, <[Aim]>::len);
        CameraKind { is_orthographic: camera.projection.is_orthographic(), aims }
    }

    /// Values of the WGSL `override` constants that depend on the kind alone.
    pub fn constants(self) -> [(&'static str, bool); 2] {
        [("HAS_ORTHOGRAPHIC", self.is_orthographic), ("HAS_AIMS", self.aims > 0)]
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
        let extent = [half_height * width / height, half_height];
        frame.extent = extent.map(|x| x as f32);
        frame.pixel_area = (4.0 * extent[0] * extent[1] / (width * height)) as f32;
        let [x, y] = camera.principal_point;
        frame.principal_offset = [(x - 0.5) * width, (y - 0.5) * height].map(|pixels| pixels as f32);
        self.sensor_corners = camera.corners([frame.width, frame.height]).map(|corner| self.space.point(corner));
        self.omitted = camera.projection.aims().unwrap_or_default().iter().map(|aim| aim.omitted).fold(0.0, f64::max);
        true
    }
}
