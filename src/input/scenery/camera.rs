//! The camera: `--camera auto`, and the flags that place a camera.

use glam::{DAffine3, DVec3};

use super::calibration::{self, Calibration};
use crate::error::{Error, Result};
use crate::input::resolve::find_camera;
use crate::input::rows;
use crate::scene::build::{look, look_upright};
use crate::scene::{Aperture, Camera, Lens, Projection, Scene, Vignetting};
use crate::settings::check_resolution;
use crate::settings::lens::{ApertureDiameter, Focus, LensDistortion, VignettingChoice};
use crate::settings::numbers::{Fov, Height, Numbers};
use crate::settings::table::CameraTable;
use crate::settings::values::Resolution;

/// Name of a camera that frames the whole scene.
pub(in crate::input) const AUTO: &str = "auto";
/// Name of a camera that the user places in a scene without cameras.
const LOOK: &str = "look";
/// Vertical field of view of these two cameras, unless they are orthographic.
const DEFAULT_FOV: Fov = Fov(40.0);
/// Direction from the scene to the automatic camera. The front of a glTF model faces +Z. From 25 degrees to the right and 20
/// degrees above, three sides of a box are visible, and no plane along two axes is seen edge-on.
const TO_CAMERA: DVec3 = DVec3::new(0.397_131, 0.342_020, 0.851_651);
/// Part of the image that the scene fills with the automatic camera: at 1, a corner of the scene's box would touch the border of
/// the image.
const FILLED: f64 = 0.95;
/// A scene that is smaller than this, in metres, counts as a point.
const MIN_SIZE: f64 = 1e-12;

/// Places the camera that `table` describes and returns its index in the scene.
pub(super) fn apply(table: &mut CameraTable, scene: &mut Scene, notes: &mut Vec<String>) -> Result<usize> {
    let is_calibrated = read_calibration(table, notes)?;
    let index = match chosen(table, scene, notes)? {
        Some(index) => index,
        None => make(table, scene)?,
    };
    let transform = aim(table, &scene.cameras[index].transform, scene)?;
    let camera = &mut scene.cameras[index];
    camera.transform = transform;
    if let Some(projection) = projection(table) {
        camera.projection = projection;
    }
    if let Some(Numbers(point)) = table.principal_point {
        camera.principal_point = point;
    }
    apply_lens(table, camera, is_calibrated)?;
    camera.check()?;
    Ok(index)
}

/// Replaces `calibration` by the settings that its file gives. Returns whether there was one.
fn read_calibration(table: &mut CameraTable, notes: &mut Vec<String>) -> Result<bool> {
    let Some(path) = table.calibration.take() else { return Ok(false) };
    let Calibration { matrix: [fx, fy, cx, cy], distortion, size } = calibration::read(&path)?;
    // A smaller image of the same camera has smaller pixels, whose coordinates begin at the corner of the image.
    let scale = match (size, table.resolution) {
        (Some(size), Some(Resolution(wanted))) if wanted != size => {
            let [[w, h], [to_w, to_h]] = [size, wanted];
            notes.push(format!(
                "the calibration is for images of {w}x{h}; its camera matrix was scaled to --resolution {to_w}x{to_h}"
            ));
            [f64::from(to_w) / f64::from(w), f64::from(to_h) / f64::from(h)]
        }
        _ => [1.0; 2],
    };
    if let Some(size) = size {
        table.resolution.get_or_insert(Resolution(size));
    }
    let centre = |c: f64, scale: f64| (c + 0.5) * scale - 0.5;
    let [x, y] = scale;
    table.camera_matrix = Some(Numbers([fx * x, fy * y, centre(cx, x), centre(cy, y)]));
    table.distortion = Some(distortion);
    Ok(true)
}

/// Gives `camera` the lens of `table`, if it has one.
fn apply_lens(table: &CameraTable, camera: &mut Camera, is_calibrated: bool) -> Result<()> {
    if let Some(LensDistortion(distortion)) = table.distortion {
        camera.lens.distortion = distortion;
    }
    camera.lens.aperture = match (table.aperture, table.focus, table.blades) {
        (Some(ApertureDiameter(diameter)), Some(Focus(focus)), blades) => {
            Some(Aperture { diameter, focus, blades: blades.unwrap_or(0) })
        }
        (Some(_), None, _) => {
            return Err(Error::advice(
                "an aperture is in focus at one distance: ",
                "give --focus too, in metres, or inf",
            ));
        }
        (None, None, None) => camera.lens.aperture,
        (None, ..) => {
            return Err(Error::advice("--focus and --blades belong to an aperture: ", "give --aperture too, like 8mm"));
        }
    };
    match &table.vignetting {
        None => {}
        Some(VignettingChoice::Cos4) => camera.lens.vignetting = Vignetting::Cos4,
        Some(VignettingChoice::Table(path)) => {
            let rows = rows::read(path, ["angle", "share"], "an angle in degrees and a share of the light", "10,0.95");
            let rows = rows.map_err(Error::settings)?;
            camera.lens.vignetting =
                Vignetting::Table(rows.into_iter().map(|[degrees, share]| [degrees.to_radians(), share]).collect());
        }
    }
    let Some(Numbers([fx, fy, cx, cy])) = table.camera_matrix else { return Ok(()) };
    let setting = if is_calibrated { "--calibration" } else { "--camera-matrix" };
    let Some([width, height]) = table.resolution.map(|Resolution(size)| size).or(camera.resolution) else {
        return Err(Error::advice(
            format!("{setting} is in pixels, and the size of the image is not known: "),
            "give the --resolution of the calibrated images",
        ));
    };
    check_resolution("--resolution", [width, height])?;
    let [w, h] = [width, height].map(f64::from);
    let angle = 2.0 * (0.5 * h / fy).atan();
    if !(fx > 0.0 && fy > 0.0 && angle > 0.0) {
        return Err(Error::advice(
            format!("{setting} has the focal lengths {fx} and {fy}: "),
            "give positive focal lengths in pixels, in the order fx,fy,cx,cy",
        ));
    }
    camera.projection = Projection::Perspective { yfov: angle };
    camera.lens.pixel_aspect = fy / fx;
    camera.principal_point = [(cx + 0.5) / w, (cy + 0.5) / h];
    Ok(())
}

/// The view that the user gave, if any.
fn projection(table: &CameraTable) -> Option<Projection> {
    match (table.ortho, table.fov) {
        (Some(Height(height)), _) => Some(Projection::Orthographic { height }),
        (None, Some(Fov(degrees))) => Some(Projection::Perspective { yfov: degrees.to_radians() }),
        (None, None) => None,
    }
}

/// Index of the camera that the user chose, or of the first camera. `None` if a new camera must be made.
fn chosen(table: &CameraTable, scene: &Scene, notes: &mut Vec<String>) -> Result<Option<usize>> {
    let is_placed = table.look_from.is_some() || table.look_at.is_some();
    match table.camera.as_deref() {
        Some(AUTO) => Ok(None),
        // A printed experiment names the camera that it placed, but the scene's file does not have this camera.
        Some(LOOK) if is_placed && find_camera(LOOK, scene).is_err() => Ok(None),
        Some(name) => find_camera(name, scene).map(Some),
        None if !scene.cameras.is_empty() => Ok(Some(0)),
        None if !is_placed && let Some(camera) = scene.unusable_cameras.first() => {
            Err(Error::settings(format!("{}, or place another camera with --camera auto or --look-from", camera.why)))
        }
        None => {
            if !is_placed {
                notes.push(
                    "the scene has no camera, so a camera was placed that sees all of it from outside (--camera auto); \
                     --look-from and --look-at place it elsewhere, for example inside a room"
                        .into(),
                );
            }
            Ok(None)
        }
    }
}

/// Adds a camera that frames the whole scene, and completes `table` so that it describes the camera. Returns its index.
fn make(table: &mut CameraTable, scene: &mut Scene) -> Result<usize> {
    let is_auto = table.camera.as_deref() == Some(AUTO) || (table.look_from.is_none() && table.look_at.is_none());
    let name = if is_auto { AUTO } else { LOOK };
    let projection = projection(table).unwrap_or_else(|| {
        let Fov(degrees) = *table.fov.insert(DEFAULT_FOV);
        Projection::Perspective { yfov: degrees.to_radians() }
    });
    let aspect = match table.resolution {
        Some(resolution) => {
            check_resolution("--resolution", resolution.0)?;
            f64::from(resolution.0[0]) / f64::from(resolution.0[1])
        }
        None => 1.0,
    };
    let place = match projection {
        Projection::Perspective { yfov } => {
            let tangent = (0.5 * yfov).tan();
            frame(scene.bounds().unwrap_or([DVec3::ZERO; 2]), [tangent * aspect, tangent])
        }
        // So far from the centre, the whole scene is in front of the sensor plane.
        _ => centre(scene) + away(scene.diagonal()),
    };
    table.look_from.get_or_insert(Numbers(place.to_array()));
    table.look_at.get_or_insert(Numbers(centre(scene).to_array()));
    table.camera = Some(name.into());
    Ok(scene.add_camera(Camera {
        name: name.into(),
        transform: DAffine3::from_translation(place),
        projection,
        aspect: None,
        resolution: None,
        principal_point: Camera::CENTRED,
        lens: Lens::PINHOLE,
    }))
}

/// The place of a camera that looks at the centre of a box and sees the whole box, with some room around it. `tangents`: the
/// tangents of half the horizontal and half the vertical field of view.
fn frame([lo, hi]: [DVec3; 2], tangents: [f64; 2]) -> DVec3 {
    let centre = 0.5 * (lo + hi);
    let to_camera = look(DVec3::ZERO, -TO_CAMERA).matrix3.transpose();
    let distance = (0..8u32).map(|corner| {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { lo[axis] } else { hi[axis] };
        let p = to_camera * (DVec3::new(pick(0), pick(1), pick(2)) - centre);
        // In camera axes, +Z points to the camera.
        p.z + (p.x.abs() / tangents[0]).max(p.y.abs() / tangents[1]) / FILLED
    });
    let distance = distance.fold(0.0, f64::max);
    centre + away(distance)
}

/// Vector from the centre of the scene to the automatic camera, `distance` long; 1 m long if the scene is a point.
fn away(distance: f64) -> DVec3 {
    TO_CAMERA.normalize() * if distance > MIN_SIZE { distance } else { 1.0 }
}

/// Centre of the scene's bounds; the origin of the world if the scene is empty.
pub(super) fn centre(scene: &Scene) -> DVec3 {
    scene.bounds().map_or(DVec3::ZERO, |[lo, hi]| 0.5 * (lo + hi))
}

/// The transform of a camera after the flags that place it are applied to its transform `present`. If the user gave only the place
/// of the camera, writes the point at which it looks into `table`.
fn aim(table: &mut CameraTable, present: &DAffine3, scene: &Scene) -> Result<DAffine3> {
    if table.look_from.is_none() && table.look_at.is_none() && table.up.is_none() {
        return Ok(*present);
    }
    let eye = table.look_from.map_or(present.translation, |Numbers(p)| p.into());
    if table.look_from.is_some() {
        table.look_at.get_or_insert(Numbers(centre(scene).to_array()));
    }
    let direction = match table.look_at {
        Some(Numbers(target)) => DVec3::from(target) - eye,
        None => present.transform_vector3(DVec3::NEG_Z),
    };
    let Some(forward) = direction.try_normalize() else {
        let [x, y, z] = eye.to_array();
        return Err(Error::advice(
            format!("the camera stands at {x},{y},{z} and looks at the same point: "),
            "give another --look-from or --look-at",
        ));
    };
    let Some(Numbers(up)) = table.up else { return Ok(look(eye, forward)) };
    match DVec3::from(up).try_normalize() {
        Some(up) if up.cross(forward).length() > 1e-6 => Ok(look_upright(eye, forward, up)),
        Some(_) => Err(Error::advice(
            "--up points along the view, so it does not say where up is: ",
            "give another direction, such as 0,0,1 for a camera that looks straight down",
        )),
        None => Err(Error::advice("--up has no length: ", "give a direction, such as 0,1,0")),
    }
}
