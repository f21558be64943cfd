//! Cameras.

use ::gltf::json::Extras;
use ::gltf::json::camera::{Orthographic, Perspective};
use serde::Deserialize;

use super::Checked;
use super::document::{DistinctNames, Document, finite, printable};
use super::node::{Worlds, rigid};
use crate::scene::{Camera, Projection};

/// One camera per node of the scene with a camera, in the order of the nodes.
pub fn load(doc: &Document, worlds: &Worlds) -> Checked<Vec<Camera>> {
    let mut cameras = Vec::new();
    let mut names = DistinctNames::default();
    for (index, world) in worlds.iter() {
        let Some(node) = doc.root.nodes.get(index) else { continue };
        let Some(number) = node.camera.map(|camera| camera.value()) else { continue };
        let source = doc.root.cameras.get(number).ok_or_else(|| {
            format!(
                "node `{}` refers to camera {number}, which does not exist; re-export the file",
                doc.node_name(index)
            )
        })?;
        let own = [&node.name, &source.name].into_iter().flatten().find(|name| !name.is_empty());
        let name = own.map_or_else(|| format!("camera {number}"), |name| printable(name, 120));
        let (projection, aspect) = match (&source.perspective, &source.orthographic) {
            (Some(source), _) => perspective(source, &name)?,
            (None, Some(source)) => orthographic(source, &name)?,
            (None, None) => {
                return Err(format!(
                    "camera `{name}` is neither perspective nor orthographic; correct it and re-export"
                ));
            }
        };
        let transform = rigid(&world).ok_or_else(|| {
            format!("the node of camera `{name}` is scaled to nothing; set its scale to 1 and re-export")
        })?;
        cameras.push(Camera {
            name: names.distinct(name),
            transform,
            projection,
            aspect,
            resolution: resolution(&source.extras),
            principal_point: principal_point(&source.extras).unwrap_or(Camera::CENTRED),
        });
    }
    Ok(cameras)
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

/// `width` and `height`, if the extras have both as positive integers. Other programs use extras too, so anything else is not an
/// error.
fn resolution(extras: &Extras) -> Option<[u32; 2]> {
    #[derive(Deserialize)]
    struct Size {
        width: u32,
        height: u32,
    }
    let size: Size = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    (size.width > 0 && size.height > 0).then_some([size.width, size.height])
}

/// `principal_point`, if the extras have it as two numbers: see [`Camera::principal_point`].
fn principal_point(extras: &Extras) -> Option<[f64; 2]> {
    #[derive(Deserialize)]
    struct Film {
        principal_point: [f64; 2],
    }
    let film: Film = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    Some(film.principal_point)
}
