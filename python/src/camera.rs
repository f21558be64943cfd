//! The camera of a render as matrices.

use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use taugate::internals::scene::{Camera, Scene, Vignetting};
use taugate::internals::settings::Settings;
use taugate::internals::settings::lens::LensDistortion;

/// The data of the Python class `Camera`.
#[pyclass(frozen, get_all, module = "taugate._native")]
#[derive(Clone, Serialize, Deserialize)]
pub struct View {
    name: String,
    /// World from camera space, row by row; the camera looks along -Z, and +Y is up.
    world_from_camera: [[f64; 4]; 4],
    /// Vertical field of view in radians, of a perspective camera.
    yfov: Option<f64>,
    /// In metres, of an orthographic camera.
    view_height: Option<f64>,
    principal_point: [f64; 2],
    /// Width of a pixel over its height.
    pixel_aspect: f64,
    /// Coefficients of the lens in the order of OpenCV: none, four of a fisheye, or eight.
    distortion: Vec<f64>,
    /// Diameter of the aperture in metres; `None` for a pinhole.
    aperture: Option<f64>,
    /// Distance of the plane in focus in metres; `None` for infinity, and for a pinhole.
    focus: Option<f64>,
    blades: u32,
    has_cos4: bool,
    /// Angles in degrees, and shares of the light; none without a table.
    vignetting: Vec<[f64; 2]>,
    /// Of the whole image.
    resolution: [u32; 2],
    /// x0, x1, y0, y1.
    crop: [u32; 4],
}

impl View {
    pub fn of(scene: &Scene, settings: &Settings) -> PyResult<View> {
        let Camera { name, transform, projection, principal_point, lens, .. } = &scene.cameras[settings.camera()];
        let crop = settings.crop();
        let vignetting = match &lens.vignetting {
            Vignetting::Table(rows) => rows.iter().map(|&[angle, share]| [angle.to_degrees(), share]).collect(),
            Vignetting::None | Vignetting::Cos4 => vec![],
        };
        Ok(View {
            name: name.clone(),
            world_from_camera: glam::DMat4::from(*transform).transpose().to_cols_array_2d(),
            yfov: projection.yfov(),
            view_height: projection.view_height(),
            principal_point: *principal_point,
            pixel_aspect: lens.pixel_aspect,
            distortion: LensDistortion(lens.distortion).coefficients(),
            aperture: lens.aperture.map(|aperture| aperture.diameter),
            focus: lens.aperture.map(|aperture| aperture.focus).filter(|focus| focus.is_finite()),
            blades: lens.aperture.map_or(0, |aperture| aperture.blades),
            has_cos4: lens.vignetting == Vignetting::Cos4,
            vignetting,
            resolution: settings.resolution(),
            crop: [crop.x0, crop.x1, crop.y0, crop.y1],
        })
    }
}
