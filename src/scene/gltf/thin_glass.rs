//! Glass: `extras.thin`, `extras.thickness` and `extras.group_ior` of materials that transmit light.

use ::gltf::json::Extras;
use serde_json::Value;

use super::document::Warnings;
use super::extras::{member, warn_of_foreign};
use crate::scene::Material;

/// Largest thickness in metres that counts as one.
const MAX_THICKNESS: f64 = 1e6;
/// Thickness in metres from which it was probably given in millimetres.
const THICK: f64 = 0.5;

/// Whether a group index is possible.
fn is_index(index: &f64) -> bool {
    (1.0..=5.0).contains(index)
}

/// Sets whether the glass of `material` is thin, its thickness, and its group index, if the extras say so. Other programs use extras too, so a value of
/// another kind is left out with a warning.
pub fn read(extras: &Extras, material: &mut Material, warnings: &mut Warnings) {
    if material.transmission == 0.0 {
        return;
    }
    let of = format!("material `{}`", material.name);
    match member(extras, "thin") {
        Some(Value::Bool(thin)) => material.thin = Some(thin),
        Some(_) => warn_of_foreign("thin", &of, "true or false", warnings),
        None => {}
    }
    match member(extras, "thickness")
        .map(|value| value.as_f64().filter(|metres| (0.0..=MAX_THICKNESS).contains(metres)))
    {
        Some(Some(metres)) => {
            material.thickness = metres as f32;
            if metres > THICK {
                warnings.once("thick sheets", || {
                    format!("extras.thickness is in metres, so light in thin glass of {metres} m is late by metres; give thicknesses in metres (first: {of})")
                });
            }
        }
        Some(None) => warn_of_foreign("thickness", &of, "a number of metres from 0 on", warnings),
        None => {}
    }
    match member(extras, "group_ior")
        .or_else(|| member(extras, "group-ior"))
        .map(|value| value.as_f64().filter(is_index))
    {
        Some(Some(index)) => material.group_ior = Some(index as f32),
        Some(None) => warn_of_foreign("group_ior", &of, "a number from 1 to 5", warnings),
        None => {}
    }
}
