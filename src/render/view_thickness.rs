//! Optical thickness of the media between the sensor and the surfaces in view. Media inside of meshes do not count.

use super::first_surface::first_surfaces;
use super::prepared_scene::PreparedScene;
use super::probe::small;
use crate::error::Result;
use crate::gpu::Device;
use crate::scene::{Scene, optical_thickness};
use crate::settings::Settings;

/// Optical thickness along camera rays, each up to its first surface, as a mean over the channels; infinite if a ray goes on forever in
/// a medium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewThickness {
    /// Along the ray in the centre of the view.
    pub centre: f64,
    pub least: f64,
    pub greatest: f64,
    /// Fraction of the light that goes straight through the centre of the view, as a mean over the channels.
    pub transmitted: f64,
}

/// Traces one ray per pixel of a small image of the same crop as `settings`. Fails if the scene does not fit the device.
pub fn view_thickness(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<ViewThickness> {
    let settings = small(settings);
    let crop = settings.crop();
    let (width, height) = (crop.width() as usize, crop.height() as usize);
    let mut lengths = vec![f64::INFINITY; width * height];
    first_surfaces(device, scene, &settings, prepared, &mut |pixel, surface| {
        lengths[pixel] = surface.distance.into();
    })?;
    let camera = &scene.cameras[settings.camera()];
    let thickness = |(pixel, &length): (usize, &f64)| {
        let film =
            [f64::from(crop.x0) + (pixel % width) as f64 + 0.5, f64::from(crop.y0) + (pixel / width) as f64 + 0.5];
        let resolution = settings.resolution();
        let (origin, direction) = (camera.origin(resolution, film), camera.direction(resolution, film));
        optical_thickness(&scene.media, origin, direction, length)
    };
    let mean = |values: [f64; 3]| values.iter().sum::<f64>() / 3.0;
    let centre = height / 2 * width + width / 2;
    let transmitted = mean(thickness((centre, &lengths[centre])).map(|depth| (-depth).exp()));
    let all: Vec<f64> = lengths.iter().enumerate().map(|ray| mean(thickness(ray))).collect();
    Ok(ViewThickness {
        transmitted,
        centre: all[centre],
        least: all.iter().copied().fold(f64::INFINITY, f64::min),
        greatest: all.iter().copied().fold(0.0, f64::max),
    })
}
