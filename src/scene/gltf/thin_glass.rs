//! Thin glass: `extras.thin` and `extras.thickness` of materials that transmit light.

use ::gltf::json::Extras;
use serde_json::{Map, Value};

use super::document::{Warnings, printable};
use crate::scene::Material;

/// Sets whether the glass of `material` is thin, and its thickness, if the extras say so. Other programs use extras too, so a value of
/// another kind is left out with a warning.
pub fn read(extras: &Extras, material: &mut Material, warnings: &mut Warnings) {
    if material.transmission == 0.0 {
        return;
    }
    let Some(extras) = extras.as_ref().and_then(|extras| serde_json::from_str::<Map<String, Value>>(extras.get()).ok())
    else {
        return;
    };
    let mut ignored = |key: &str, wanted: &str| {
        let value = printable(&extras[key].to_string(), 40);
        warnings.push(format!("extras.{key} of material `{}` is {value}, not {wanted}; it is ignored", material.name));
    };
    match extras.get("thin") {
        Some(Value::Bool(thin)) => material.thin = Some(*thin),
        Some(_) => ignored("thin", "true or false"),
        None => {}
    }
    match extras.get("thickness").map(|value| (value.as_f64(), value)) {
        Some((Some(metres), _)) if (0.0..=1e6).contains(&metres) => material.thickness = metres as f32,
        Some(_) => ignored("thickness", "a number of metres from 0 on"),
        None => {}
    }
}
