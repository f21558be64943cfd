//! The lights: `--headlamp`, `--lamp`, `--sky` and `[[light]]`.

use std::collections::HashSet;
use std::f64::consts::PI;

use glam::DVec3;

use super::camera::centre;
use super::sky_image;
use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::responses::is_steady;
use crate::scene::{Instance, Light, LightKind, Scene};
use crate::settings::numbers::{Headlamp, Numbers};
use crate::settings::sky::{Sky, SkyScale};
use crate::settings::table::EmitterTable;
use crate::settings::units::number;

/// Name of the point light at the camera.
const HEADLAMP: &str = "headlamp";
/// Name of the sky.
const SKY: &str = "sky";
/// Minimum distance for the automatic intensity of the headlamp, relative to the diagonal of the scene. It matters for a camera
/// inside the scene.
const MIN_DISTANCE: f64 = 0.25;

/// Adds the lights of `experiment` to the scene. `camera` is the index of the camera that carries the headlamp.
pub(super) fn apply(
    experiment: &mut Experiment,
    scene: &mut Scene,
    camera: usize,
    notes: &mut Vec<String>,
) -> Result<()> {
    for (i, table) in experiment.light.iter().enumerate() {
        let light = table.light(i + 1).map_err(|message| Error::settings(format!("[[light]] {}: {message}", i + 1)))?;
        scene.lights.push(light);
    }
    let lamps = experiment.emitter.lamp.iter().flat_map(|lamps| &lamps.0);
    for (i, &Numbers([x, y, z, intensity])) in lamps.enumerate() {
        let lamp = point(format!("lamp-{}", i + 1), DVec3::new(x, y, z), intensity);
        lamp.check().map_err(|message| Error::settings(format!("--lamp: {message}")))?;
        scene.lights.push(lamp);
    }

    add_sky(&experiment.emitter, scene)?;
    make_distant_names_distinct(scene);

    let table = &mut experiment.emitter;
    let wanted = table.headlamp.is_some() || table.headlamp_offset.is_some();
    let has_lamp = has_lamp(scene, is_steady(&experiment.gate));
    if !wanted && (has_lamp || has_bright_surface(scene)) {
        // A note so far says that the scene has no camera. Such a scene is probably a model whose surfaces are not meant to light it.
        if !has_lamp && !notes.is_empty() {
            notes.push("the only light comes from surfaces that emit; if the picture is dark, add --headlamp".into());
        }
        return Ok(());
    }
    let transform = scene.cameras[camera].transform;
    let Numbers(offset) = table.headlamp_offset.unwrap_or(Numbers([0.0; 3]));
    let position = transform.transform_point3(offset.into());
    let intensity = match table.headlamp {
        Some(Headlamp::Intensity(intensity)) => intensity,
        Some(Headlamp::Auto) | None => automatic_intensity(scene, position),
    };
    table.headlamp = Some(Headlamp::Intensity(intensity));
    let lamp = point(HEADLAMP.into(), position, intensity);
    lamp.check().map_err(|message| Error::settings(format!("--headlamp: {message}")))?;
    scene.lights.push(lamp);
    if !wanted {
        notes.push(format!(
            "the scene has no light that can be rendered, so a headlamp of {} W/sr shines from the camera; --headlamp sets its \
             intensity, and --lamp X,Y,Z,INTENSITY adds other lights",
            number(intensity)
        ));
    }
    Ok(())
}

/// Adds the sky of `--sky`, and reads its image.
fn add_sky(table: &EmitterTable, scene: &mut Scene) -> Result<()> {
    let scale = match (&table.sky, table.sky_scale) {
        (None, None) => return Ok(()),
        (None, Some(_)) => return Err(Error::advice("--sky-scale is for the sky: ", "add --sky")),
        (Some(_), scale) => scale.map_or(1.0, |SkyScale(factor)| factor),
    };
    let radiance = match &table.sky {
        Some(Sky::Radiance(rgb)) => rgb.map(|channel| (channel * scale) as f32),
        Some(Sky::Image(path)) => {
            scene.sky = Some(sky_image::read(path, scale as f32)?);
            [scale as f32; 3]
        }
        None => return Ok(()),
    };
    let kind = LightKind::Sky { radiance };
    let light = Light { node: SKY.into(), position: DVec3::ZERO, direction: DVec3::NEG_Y, kind };
    light.check().map_err(|message| Error::settings(format!("--sky: {message}")))?;
    scene.lights.push(light);
    Ok(())
}

/// Adds a number to the name of a sun or a sky if another emitter has the same name, as in `lamp#2`. A gated render leaves suns and
/// skies out by name, and must keep the other emitter.
fn make_distant_names_distinct(scene: &mut Scene) {
    let Scene { lights, instances, .. } = &*scene;
    if !lights.iter().any(|light| light.kind.is_distant()) {
        return;
    }
    let positioned = lights.iter().filter(|light| !light.kind.is_distant()).map(|light| &light.node);
    let surfaces = instances.iter().filter(|instance| is_bright(emission(scene, instance))).map(|one| &one.node);
    let mut names: HashSet<String> = positioned.chain(surfaces).cloned().collect();
    // Suns first, so that the sky gets another name than they have. Suns of one name keep one name.
    for is_sky in [false, true] {
        let mut taken = names.clone();
        let is_next = |light: &&mut Light| light.kind.is_distant() && light.kind.is_sky() == is_sky;
        for light in scene.lights.iter_mut().filter(is_next) {
            let own = light.node.clone();
            let mut number = 1;
            while names.contains(&light.node) {
                number += 1;
                light.node = format!("{own}#{number}");
            }
            taken.insert(light.node.clone());
        }
        names = taken;
    }
}

fn point(node: String, position: DVec3, intensity: f64) -> Light {
    Light { node, position, direction: DVec3::NEG_Z, kind: LightKind::Point { intensity: [intensity as f32; 3] } }
}

/// Whether a light of the scene, other than a surface, emits light that can be rendered. With a gate, suns and skies cannot be
/// rendered. A lamp that is off only at the moment of this scene counts.
fn has_lamp(scene: &Scene, is_steady: bool) -> bool {
    !scene.lights_off.is_empty()
        || scene.lights.iter().any(|light| (is_steady || !light.kind.is_distant()) && is_bright(light.kind.strength()))
}

fn has_bright_surface(scene: &Scene) -> bool {
    scene.instances.iter().any(|instance| is_bright(emission(scene, instance)))
}

fn emission(scene: &Scene, instance: &Instance) -> [f32; 3] {
    scene.materials[scene.meshes[instance.mesh as usize].material as usize].emission
}

/// Automatic radiant intensity in W / sr of a headlamp at `position`: pi d^2, where d is the distance to the scene's centre, but at
/// least [`MIN_DISTANCE`] times the scene's diagonal. A white surface that faces the lamp at distance d has radiance 1. The value is
/// rounded to three digits, so that it is easy to repeat.
fn automatic_intensity(scene: &Scene, position: DVec3) -> f64 {
    let distance = position.distance(centre(scene)).max(MIN_DISTANCE * scene.diagonal());
    let intensity = PI * distance * distance;
    // A scene that is a single point, or of an extreme size, still needs a valid intensity.
    let intensity = if distance > 0.0 { intensity.clamp(1e-30, 1e30) } else { 1.0 };
    format!("{intensity:.2e}").parse().unwrap_or(intensity)
}

fn is_bright(rgb: [f32; 3]) -> bool {
    rgb.iter().any(|&channel| channel > 0.0)
}
