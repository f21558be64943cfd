//! Retroreflectors from `extras.retroreflector` of materials.

use ::gltf::json::Extras;
use serde::Deserialize;

use super::Checked;
use super::document::{Warnings, printable};
use super::extras::{member, warn_of_foreign};
use crate::scene::Retroreflector;

/// The form of `extras.retroreflector`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Json {
    share: f32,
    angle: f32,
}

/// The retroreflector in the extras of the material `name`. `None`, with a warning, if their `retroreflector` has neither a share nor
/// an angle. The scene checks the range of both numbers.
pub fn read(extras: &Extras, name: &str, warnings: &mut Warnings) -> Checked<Option<Retroreflector>> {
    let Some(value) = member(extras, "retroreflector") else { return Ok(None) };
    if value.get("share").is_none() && value.get("angle").is_none() {
        warn_of_foreign("retroreflector", &format!("material `{name}`"), "an object with share and angle", warnings);
        return Ok(None);
    }
    let wrong = |why: &str| {
        format!(
            "extras.retroreflector of material `{name}` cannot be read ({}); write {{\"share\": 0.3, \"angle\": 0.5}}",
            printable(why, 200)
        )
    };
    let Json { share, angle } = serde_json::from_value(value).map_err(|e| wrong(&e.to_string()))?;
    Ok(Some(Retroreflector { share, angle }))
}
