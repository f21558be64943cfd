//! Adds the user's camera and lights to the scene of a file, replaces its media, and makes surfaces double-sided if the user wants
//! that. Most glTF files have neither a camera nor a light. Such a scene gets a camera that sees the whole scene, and a headlamp.

mod calibration;
mod camera;
mod grid;
mod lights;
mod medium;
mod phase;
mod radiance_hdr;
mod scan;
mod sky_image;

pub(super) use camera::AUTO;

use crate::error::Result;
use crate::input::experiment::Experiment;
use crate::scene::Scene;
use crate::settings::ThinGlass;

/// Adds the camera and the lights of `experiment`, or its scan, to a scene that was just loaded. Moves the scene's own camera if
/// the user places it. Replaces the scene's media if the user gives media. Makes all surfaces double-sided, or all
/// glass thin or solid, if the user wants that. Call it once per scene, before [`super::resolve::resolve`].
///
/// Choices that depend on the scene, such as the place of an automatic camera, are written into `experiment`. So the experiment
/// renders the same image later, even if the rules for these choices have changed.
///
/// Returns notes for the user, one sentence each, about choices that this function made. Fails if a camera has no direction, if a
/// light, a medium or the scan is not valid, or if a name is unknown.
pub fn apply(experiment: &mut Experiment, scene: &mut Scene) -> Result<Vec<String>> {
    let mut notes = vec![];
    apply_to_surfaces(experiment, scene);
    medium::apply(&experiment.medium, scene)?;
    if let Some(table) = experiment.scan.clone() {
        scan::apply(&table, experiment, scene)?;
        return Ok(notes);
    }
    let camera = camera::apply(&mut experiment.camera, scene, &mut notes)?;
    lights::apply(experiment, scene, camera, &mut notes)?;
    Ok(notes)
}

/// Makes all surfaces double-sided, or all glass thin or solid, if the user wants that.
pub fn apply_to_surfaces(experiment: &Experiment, scene: &mut Scene) {
    if experiment.input.double_sided == Some(true) {
        scene.materials.iter_mut().for_each(|material| material.double_sided = true);
    }
    if let Some(choice @ (ThinGlass::All | ThinGlass::None)) = experiment.input.thin_glass {
        scene.materials.iter_mut().for_each(|material| material.thin = Some(choice == ThinGlass::All));
    }
}

#[cfg(test)]
mod tests;
