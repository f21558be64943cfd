//! Cameras.

use ::gltf::json::Extras;
use ::gltf::json::camera::{Camera as JsonCamera, Orthographic, Perspective};
use glam::DAffine3;
use serde_json::Value;

use super::Checked;
use super::document::{DistinctNames, Document, Warnings, finite, printable};
use super::extras::{member, warn_of_foreign};
use super::node::{Worlds, rigid};
use crate::scene::check::check_camera;
use crate::scene::{Camera, Lens, Projection, UnusableCamera};

/// One camera per node of the scene with a camera, in the order of the nodes. Cameras that cannot be used are in a list of their own:
/// a render with another camera does not need them, and a moving camera may be unusable for a moment.
pub fn load(doc: &Document, worlds: &Worlds, warnings: &mut Warnings) -> (Vec<Camera>, Vec<UnusableCamera>) {
    let (mut cameras, mut unusable) = (Vec::new(), Vec::new());
    let mut names = DistinctNames::default();
    for (index, world) in worlds.iter() {
        let Some(node) = doc.root.nodes.get(index) else { continue };
        let Some(number) = node.camera.map(|camera| camera.value()) else { continue };
        let source = doc.root.cameras.get(number);
        let own = [&node.name, &source.and_then(|source| source.name.clone())];
        let own = own.into_iter().flatten().find(|name| !name.is_empty());
        let name = names.distinct(own.map_or_else(|| format!("camera {number}"), |name| printable(name, 120)));
        let camera = source
            .ok_or_else(|| {
                format!("camera `{name}` refers to camera {number}, which does not exist; re-export the file")
            })
            .and_then(|source| camera(source, name.clone(), &world, warnings));
        match camera {
            Ok(camera) => cameras.push(camera),
            Err(why) => {
                warnings.once("unusable cameras", || format!("a camera is left out: {why}"));
                unusable.push(UnusableCamera { name, why });
            }
        }
    }
    (cameras, unusable)
}

/// The camera `source` of a node with the transform `world`.
fn camera(source: &JsonCamera, name: String, world: &DAffine3, warnings: &mut Warnings) -> Checked<Camera> {
    let (projection, aspect) = match (&source.perspective, &source.orthographic) {
        (Some(source), _) => perspective(source, &name)?,
        (None, Some(source)) => orthographic(source, &name)?,
        (None, None) => {
            return Err(format!("camera `{name}` is neither perspective nor orthographic; correct it and re-export"));
        }
    };
    let transform = rigid(world)
        .ok_or_else(|| format!("the node of camera `{name}` is scaled to nothing; set its scale to 1 and re-export"))?;
    let resolution = resolution(&source.extras, &name, warnings);
    let principal_point = principal_point(&source.extras, &name, warnings).unwrap_or(Camera::CENTRED);
    let camera = Camera { name, transform, projection, aspect, resolution, principal_point, lens: Lens::PINHOLE };
    check_camera(&camera)?;
    Ok(camera)
}

/// Projection and aspect ratio of a perspective camera.
fn perspective(source: &Perspective, name: &str) -> Checked<(Projection, Option<f64>)> {
    let yfov = f64::from(finite(source.yfov, &format!("the yfov of camera `{name}`"))?);
    if !(yfov > 0.0 && yfov < std::f64::consts::PI) {
        return Err(format!(
            "the yfov of camera `{name}` is {yfov}, but must be between 0 and pi; correct it and re-export"
        ));
    }
    let aspect = source.aspect_ratio.map(f64::from);
    if aspect.is_some_and(|aspect| !(aspect.is_finite() && aspect > 0.0)) {
        return Err(format!("the aspectRatio of camera `{name}` must be positive; correct it and re-export"));
    }
    Ok((Projection::Perspective { yfov }, aspect))
}

/// Projection and aspect ratio of an orthographic camera. Its magnifications are half the width and half the height of the view
/// in metres. The scale of the node does not count (glTF 2.0, section 3.10.2).
fn orthographic(source: &Orthographic, name: &str) -> Checked<(Projection, Option<f64>)> {
    let [half_width, half_height] = [("xmag", source.xmag), ("ymag", source.ymag)].map(|(key, value)| {
        let of = format!("the {key} of camera `{name}`");
        match f64::from(finite(value, &of)?) {
            value if value > 0.0 => Ok(value),
            value => Err(format!("{of} is {value}, but must be above 0; correct it and re-export")),
        }
    });
    let [half_width, half_height] = [half_width?, half_height?];
    Ok((Projection::Orthographic { height: 2.0 * half_height }, Some(half_width / half_height)))
}

/// `width` and `height`, if the extras have both as positive integers.
fn resolution(extras: &Extras, name: &str, warnings: &mut Warnings) -> Option<[u32; 2]> {
    let [width, height] = ["width", "height"].map(|key| member(extras, key));
    if width.is_none() && height.is_none() {
        return None;
    }
    let pixels = |value: &Value| u32::try_from(value.as_u64()?).ok().filter(|pixels| *pixels > 0);
    let size = width.as_ref().and_then(pixels).zip(height.as_ref().and_then(pixels));
    if size.is_none() {
        let key = if width.is_some() { "width" } else { "height" };
        warn_of_foreign(key, &format!("camera `{name}`"), "a number of pixels, like the other side", warnings);
    }
    size.map(<[u32; 2]>::from)
}

/// `principal_point`, if the extras have it as two numbers: see [`Camera::principal_point`].
fn principal_point(extras: &Extras, name: &str, warnings: &mut Warnings) -> Option<[f64; 2]> {
    let value = member(extras, "principal_point")?;
    let point = value.as_array().filter(|list| list.len() == 2).and_then(|list| list[0].as_f64().zip(list[1].as_f64()));
    if point.is_none() {
        warn_of_foreign("principal_point", &format!("camera `{name}`"), "a list of two numbers", warnings);
    }
    point.map(<[f64; 2]>::from)
}
