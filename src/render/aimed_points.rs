//! Checks that the points of a scan lie on the surfaces that its laser and its sensor see.

use std::iter::repeat_n;
use std::sync::Arc;

use super::first_surface::{FirstSurface, first_surfaces};
use super::prepared_scene::PreparedScene;
use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::scene::{Aim, Camera, Projection, Scene};
use crate::settings::{MAX_SIDE, Settings};

/// Maximum distance between a point of a scan and the surface there, relative to the distance from the laser or the sensor.
const MAX_GAP: f64 = 1e-3;

/// Calls `visit` with the number of each aimed ray of `camera` that hits a surface, and with the surface, as [`first_surfaces`] does.
///
/// # Panics
/// If the camera is not [`Projection::Aimed`].
pub fn aimed_surfaces(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    camera: &Camera,
    visit: &mut impl FnMut(usize, FirstSurface),
) -> Result<()> {
    let Projection::Aimed { aims, pixel_fov } = &camera.projection else { panic!("the camera aims at points") };
    // The points fill the rows of an image, and copies of the last one fill its last row.
    let rows = aims.len().div_ceil(MAX_SIDE as usize);
    let columns = aims.len().div_ceil(rows);
    let last = *aims.last().expect("the camera aims at a point");
    let filled: Arc<[Aim]> = aims.iter().copied().chain(repeat_n(last, rows * columns - aims.len())).collect();
    let projection = Projection::Aimed { aims: filled, pixel_fov: *pixel_fov };
    let mut scene = scene.clone();
    let index = scene.add_camera(Camera { projection, ..camera.clone() });
    let settings = settings.change().camera(index).resolution([columns, rows].map(|n| n as u32)).crop(None).build()?;
    let prepared = PreparedScene::new(&scene, &settings)?;
    first_surfaces(device, &scene, &settings, &prepared, &mut |pixel, surface| {
        if pixel < aims.len() {
            visit(pixel, surface);
        }
    })
}

/// Fails if a point of the aimed `camera` does not lie on the first surface in its direction. Travel times would then begin or
/// end at another point. `who` is the laser or the sensor, for the message.
///
/// # Panics
/// If the camera is not [`crate::scene::Projection::Aimed`].
pub fn check_aimed_points(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    who: &str,
    camera: &Camera,
) -> Result<()> {
    let aims = camera.projection.aims().expect("the camera of a scan has points");
    let mut distances = vec![f64::INFINITY; aims.len()];
    aimed_surfaces(device, scene, settings, camera, &mut |point, surface| distances[point] = surface.distance.into())?;
    let place = camera.transform.translation;
    let is_off = |(aim, distance): &(&Aim, f64)| {
        let wanted = aim.point.distance(place);
        (distance - wanted).abs() > MAX_GAP * wanted
    };
    let off: Vec<_> = aims.iter().zip(distances).filter(is_off).collect();
    let Some((aim, distance)) = off.first() else { return Ok(()) };
    let found = match distance.is_finite() {
        true => format!("the first surface there is {distance:.4} m from the {who}"),
        false => "there is no surface there".into(),
    };
    Err(Error::settings(format!(
        "{} of {} points of the {who} are not on a surface; the first is {}, {:.4} m from the {who}, but {found}; move the points to \
         the wall, or let travel times contain the ways to the wall (account_first_and_last_bounces = true)",
        off.len(),
        aims.len(),
        aim.point,
        aim.point.distance(place)
    )))
}
