//! Thin glass: `extras.thin` and `extras.thickness` of materials that transmit light.

use ::gltf::json::Extras;
use serde_json::Value;

use super::document::Warnings;
use super::extras::{member, warn_of_foreign};
use crate::scene::Material;

/// Largest thickness in metres that counts as one.
const MAX_THICKNESS: f64 = 1e6;
/// Thickness in metres from which it was probably given in millimetres.
const THICK: f64 = 0.5;

/// Sets whether the glass of `material` is thin, and its thickness, if the extras say so. Other programs use extras too, so a value of
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
}
