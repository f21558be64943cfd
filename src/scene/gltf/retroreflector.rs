//! Retroreflectors from `extras.retroreflector` of materials.

use ::gltf::json::Extras;
use serde::Deserialize;
use serde_json::Value;

use super::Checked;
use super::document::printable;
use crate::scene::Retroreflector;

/// The form of `extras.retroreflector`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Json {
    share: f32,
    angle: f32,
}

/// The retroreflector in the extras of the material `name`. `None` if the extras have no `retroreflector`, because other
/// programs use extras too. The scene checks the range of both numbers.
pub fn read(extras: &Extras, name: &str) -> Checked<Option<Retroreflector>> {
    #[derive(Deserialize)]
    struct WithRetroreflector {
        retroreflector: Option<Value>,
    }
    let extras = extras.as_ref().and_then(|extras| serde_json::from_str::<WithRetroreflector>(extras.get()).ok());
    let Some(value) = extras.and_then(|extras| extras.retroreflector) else { return Ok(None) };
    let wrong = |why: &str| {
        format!(
            "extras.retroreflector of material `{name}` cannot be read ({}); write {{\"share\": 0.3, \"angle\": 0.5}}",
            printable(why, 200)
        )
    };
    if !value.is_object() {
        return Err(wrong("it is no object"));
    }
    let Json { share, angle } = serde_json::from_value(value).map_err(|e| wrong(&e.to_string()))?;
    Ok(Some(Retroreflector { share, angle }))
}
