//! Lights of KHR_lights_punctual, and beams from `extras.emitter`.

use std::f32::consts::FRAC_PI_2;

use ::gltf::json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::{DAffine3, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::Checked;
use super::document::{Document, Warnings};
use super::node::Worlds;
use crate::scene::{Light, LightKind};

/// A brighter point or spot light in a file from Blender gives a warning. In W/sr, this is a lamp of 6,300 W, which is rare. In
/// candela, it is a lamp of 9 W in Blender's user interface, where the default is 10 W or more.
const TOO_BRIGHT: f32 = 500.0;

/// As [`TOO_BRIGHT`], for suns. In W/m^2, it is more than the sunlight outside of the atmosphere, 1,361 W/m^2. In lux, it is a sun of
/// strength 2.2 in Blender's user interface.
const TOO_SUNNY: f32 = 1500.0;

/// The lights and beams of the nodes in the scene, in the order of the nodes.
pub fn load(doc: &Document, worlds: &Worlds, warnings: &mut Warnings) -> Checked<Vec<Light>> {
    let mut lights = Vec::new();
    let by_blender = doc.root.asset.generator.as_ref().is_some_and(|generator| generator.contains("Blender"));
    for (index, world) in worlds.visible() {
        let Some(node) = doc.root.nodes.get(index) else { continue };
        let name = doc.node_name(index);
        if let Some(light) = node.extensions.as_ref().and_then(|ext| ext.khr_lights_punctual.as_ref()) {
            let number = light.light.value();
            let light = doc.root.lights().get(number).ok_or_else(|| {
                format!("node `{name}` refers to light {number}, which does not exist; re-export the file")
            })?;
            let (limit, unit, photometric) = match light.type_ {
                Valid(Type::Directional) => (TOO_SUNNY, "W/m^2", "lux"),
                _ => (TOO_BRIGHT, "W/sr", "candela"),
            };
            if by_blender && light.intensity > limit {
                let intensity = light.intensity;
                warnings.once(photometric, || {
                    format!(
                        "the light of node `{name}` has an intensity of {intensity:.0} {unit}; Blender writes {photometric}, 683 times \
                         as much, unless Data > Lighting is set to Unitless when the scene is exported"
                    )
                });
            }
            if light.range.is_some() {
                warnings.once("range", || format!("lamps also shine beyond their range (first: node `{name}`)"));
            }
            lights.push(place(punctual(light, &name)?, &world, &name)?);
        }
        if let Some(extras) = &node.extras
            && let Some(kind) = beam(extras.get(), &name)?
        {
            lights.push(place(kind, &world, &name)?);
        }
    }
    Ok(lights)
}

fn place(kind: LightKind, world: &DAffine3, name: &str) -> Checked<Light> {
    let direction = match (-world.matrix3.z_axis).try_normalize() {
        Some(direction) => direction,
        None if matches!(kind, LightKind::Point { .. }) => DVec3::NEG_Z,
        None => {
            return Err(format!(
                "node `{name}` has a light but is scaled to nothing; set its scale to 1 and re-export"
            ));
        }
    };
    Ok(Light { node: name.into(), position: world.translation, direction, kind })
}

fn punctual(light: &JsonLight, name: &str) -> Checked<LightKind> {
    let intensity = light.color.map(|channel| channel * light.intensity);
    let mut factors = intensity.iter().chain(&light.color).chain([&light.intensity]);
    if !factors.all(|value| value.is_finite() && *value >= 0.0) {
        return Err(format!(
            "the light of node `{name}` has a negative or non-finite intensity; correct it and re-export"
        ));
    }
    match light.type_ {
        Valid(Type::Point) => Ok(LightKind::Point { intensity }),
        Valid(Type::Directional) => Ok(LightKind::Directional { irradiance: intensity }),
        Valid(Type::Spot) => {
            let spot = light
                .spot
                .as_ref()
                .ok_or_else(|| format!("the spot light of node `{name}` has no cone angles; re-export the file"))?;
            let (inner, outer) = (spot.inner_cone_angle, spot.outer_cone_angle);
            if !(inner >= 0.0 && inner <= outer && outer > 0.0 && outer <= FRAC_PI_2) {
                return Err(format!(
                    "the spot light of node `{name}` must have 0 <= innerConeAngle <= outerConeAngle <= pi/2; correct it and re-export"
                ));
            }
            Ok(LightKind::spot(intensity, inner, outer))
        }
        Invalid => Err(format!("the light of node `{name}` has an unknown type; use point, spot or directional")),
    }
}

/// The beam in the extras of a node; `None` if they have no `emitter`.
fn beam(extras: &str, name: &str) -> Checked<Option<LightKind>> {
    #[derive(Deserialize)]
    struct Extras {
        emitter: Option<Value>,
    }
    let malformed = |why: &str| {
        Err(format!(
            "extras.emitter of node `{name}` {why}; write {{\"type\": \"collimated_beam\", \"radius\": 0.01, \"power\": [1, 1, 1]}}"
        ))
    };
    let emitter = match serde_json::from_str::<Extras>(extras) {
        Ok(Extras { emitter: Some(emitter) }) => emitter,
        Ok(Extras { emitter: None }) => return Ok(None),
        Err(_) if extras.trim_start().starts_with('{') => return malformed("cannot be read"),
        Err(_) => return Ok(None),
    };
    if emitter.get("type").and_then(Value::as_str) != Some("collimated_beam") {
        return malformed("has a type other than collimated_beam");
    }
    let number = |value: &Value| {
        let value = value.as_f64()? as f32;
        (value.is_finite() && value >= 0.0).then_some(value)
    };
    let Some(radius) = emitter.get("radius").and_then(number) else {
        return malformed("has no radius >= 0");
    };
    let power = match emitter.get("power") {
        Some(Value::Array(rgb)) if rgb.len() == 3 => rgb.iter().map(number).collect::<Option<Vec<f32>>>(),
        Some(value) => number(value).map(|power| vec![power; 3]),
        None => None,
    };
    match power.as_deref() {
        Some(&[r, g, b]) => Ok(Some(LightKind::Beam { power: [r, g, b], radius })),
        _ => malformed("has no power >= 0 (one number or three)"),
    }
}
