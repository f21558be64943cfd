//! Lights of KHR_lights_punctual, and beams from `extras.emitter`.

use std::f32::consts::FRAC_PI_2;

use ::gltf::json::Extras;
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::{DAffine3, DVec3};
use serde_json::Value;

use super::Checked;
use super::document::{Document, Warnings};
use super::extras::{member, warn_of_foreign};
use super::node::Worlds;
use crate::scene::{Light, LightKind};

/// A brighter point or spot light in a file from Blender gives a warning. In W/sr, this is a lamp of 6,300 W, which is rare. In
/// candela, it is a lamp of 9 W in Blender's user interface, where the default is 10 W or more.
const TOO_BRIGHT: f32 = 500.0;

/// As [`TOO_BRIGHT`], for suns. In W/m^2, it is more than the sunlight outside of the atmosphere, 1,361 W/m^2. In lux, it is a sun of
/// strength 2.2 in Blender's user interface.
const TOO_SUNNY: f32 = 1500.0;

/// The lights and beams of the nodes in the scene, in the order of the nodes, and [`crate::scene::Scene::lights_off`].
pub fn load(doc: &Document, worlds: &Worlds, warnings: &mut Warnings) -> Checked<(Vec<Light>, Vec<String>)> {
    let (mut lights, mut off) = (Vec::new(), Vec::new());
    let mut add = |kind: LightKind, world: &DAffine3, name: &str, warnings: &mut Warnings| {
        let (light, is_off) = place(kind, world, name);
        lights.push(light);
        if is_off {
            off.push(name.to_string());
            warnings.once("flattened lights", || {
                format!("lights whose node is scaled to nothing have no direction and are off (first: node `{name}`)")
            });
        }
    };
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
            add(punctual(light, &name)?, &world, &name, warnings);
        }
        if let Some(kind) = beam(&node.extras, &name, warnings)? {
            add(kind, &world, &name, warnings);
        }
    }
    Ok((lights, off))
}

/// The light, and whether it is off because the transform of its node leaves it no direction. This may be so for a moment of an
/// animation.
fn place(kind: LightKind, world: &DAffine3, name: &str) -> (Light, bool) {
    let direction = (-world.matrix3.z_axis).try_normalize();
    let is_off = direction.is_none() && !matches!(kind, LightKind::Point { .. });
    let kind = if is_off { kind.off() } else { kind };
    let direction = direction.unwrap_or(DVec3::NEG_Z);
    (Light { node: name.into(), position: world.translation, direction, kind }, is_off)
}

fn punctual(light: &JsonLight, name: &str) -> Checked<LightKind> {
    let intensity = light.color.map(|channel| channel * light.intensity);
    let mut factors = intensity.iter().chain(&light.color).chain([&light.intensity]);
    if !factors.all(|value| value.is_finite() && *value >= 0.0) {
        return Err(format!(
            "the light of node `{name}` has a negative or non-finite intensity; correct it and re-export"
        ));
    }
    let is_off = intensity == [0.0; 3];
    match light.type_ {
        Valid(Type::Point) => Ok(LightKind::Point { intensity }),
        Valid(Type::Directional) => Ok(LightKind::Directional { irradiance: intensity }),
        Valid(Type::Spot) => {
            let cone = light.spot.as_ref().map(|spot| [spot.inner_cone_angle, spot.outer_cone_angle]);
            let is_valid =
                |[inner, outer]: [f32; 2]| inner >= 0.0 && inner <= outer && outer > 0.0 && outer <= FRAC_PI_2;
            match cone {
                Some([inner, outer]) if is_valid([inner, outer]) => Ok(LightKind::spot(intensity, inner, outer)),
                // A light that is off needs no cone.
                _ if is_off => Ok(LightKind::Point { intensity }),
                None => Err(format!("the spot light of node `{name}` has no cone angles; re-export the file")),
                Some(_) => Err(format!(
                    "the spot light of node `{name}` must have 0 <= innerConeAngle <= outerConeAngle <= pi/2; correct it and re-export"
                )),
            }
        }
        Invalid if is_off => Ok(LightKind::Point { intensity }),
        Invalid => Err(format!("the light of node `{name}` has an unknown type; use point, spot or directional")),
    }
}

/// The beam in the extras of a node; `None` if they have no beam.
fn beam(extras: &Extras, name: &str, warnings: &mut Warnings) -> Checked<Option<LightKind>> {
    let Some(emitter) = member(extras, "emitter") else { return Ok(None) };
    if emitter.get("type").and_then(Value::as_str) != Some("collimated_beam") {
        warn_of_foreign("emitter", &format!("node `{name}`"), "an object of the type collimated_beam", warnings);
        return Ok(None);
    }
    let malformed = |why: &str| {
        Err(format!(
            "extras.emitter of node `{name}` {why}; write {{\"type\": \"collimated_beam\", \"radius\": 0.01, \"power\": [1, 1, 1]}}"
        ))
    };
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
