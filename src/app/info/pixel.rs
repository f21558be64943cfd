//! `taugate info --pixel`: the object that a pixel shows.

use serde::Serialize;
use taugate::internals::gpu::Device;
use taugate::internals::render::{FirstSurface, PreparedScene, first_surfaces};
use taugate::internals::scene::Scene;
use taugate::internals::settings::values::Pixel;
use taugate::internals::settings::{Crop, Settings};
use taugate::{Error, Result};

/// What the centre of a pixel shows.
#[derive(Serialize)]
pub struct Shown {
    pub column: u32,
    pub row: u32,
    /// None if there is no surface.
    pub object: Option<Object>,
}

/// The object at the centre of a pixel, and the point on it.
#[derive(Serialize)]
pub struct Object {
    pub node: String,
    pub mesh: String,
    pub material: String,
    /// Length of the camera ray, from the pinhole or the sensor plane to the point.
    pub distance_metres: f64,
    /// Distance along the axis of the camera.
    pub axial_metres: f64,
    /// The point in world space, in metres.
    pub position: [f64; 3],
    pub normal: [f32; 3],
}

/// The settings with a crop of this pixel alone. Fails if the pixel is outside the image.
pub fn crop_to(settings: &Settings, Pixel([x, y]): Pixel) -> Result<Settings> {
    let [width, height] = settings.resolution();
    if x >= width || y >= height {
        return Err(Error::settings(format!(
            "--pixel {x},{y} is outside the image of {width}x{height}; columns are 0 to {}, rows 0 to {}",
            width - 1,
            height - 1
        )));
    }
    settings.change().crop(Crop { x0: x, x1: x + 1, y0: y, y1: y + 1 }).build()
}

/// The object in the pixel. `settings` come from [`crop_to`].
pub fn shown(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Shown> {
    let Crop { x0: column, y0: row, .. } = settings.crop();
    let mut object = None;
    first_surfaces(device, scene, settings, prepared, &mut |_, surface| {
        object = Some(describe(scene, settings, [column, row], surface));
    })?;
    Ok(Shown { column, row, object })
}

fn describe(scene: &Scene, settings: &Settings, [column, row]: [u32; 2], surface: FirstSurface) -> Object {
    let instance = &scene.instances[surface.instance as usize];
    let mesh = &scene.meshes[instance.mesh as usize];
    let camera = &scene.cameras[settings.camera()];
    let distance = f64::from(surface.distance);
    let film = [f64::from(column) + 0.5, f64::from(row) + 0.5];
    let origin = camera.origin(settings.resolution(), film);
    let ray = camera.direction(settings.resolution(), film);
    let forward = camera.direction([1, 1], camera.principal_point);
    Object {
        node: instance.node.clone(),
        mesh: mesh.name.clone(),
        material: scene.materials[mesh.material as usize].name.clone(),
        distance_metres: distance,
        axial_metres: distance * ray.dot(forward),
        position: (origin + distance * ray).to_array(),
        normal: surface.normal,
    }
}
