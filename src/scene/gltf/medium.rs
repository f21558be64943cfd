//! Media from `extras.medium` of the scene, and of materials whose meshes enclose a medium.

use ::gltf::json::Extras;
use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;

use super::document::{Document, Warnings, label, printable};
use super::extras::{member, warn_of_foreign};
use super::{Checked, volume};
use crate::scene::{MAX_COEFFICIENT, Material, Medium, PhaseFunction};

/// The form of `extras.medium`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Json {
    #[serde(rename = "type")]
    kind: Option<String>,
    #[serde(alias = "sigma-s")]
    sigma_s: Option<Value>,
    #[serde(alias = "sigma-a")]
    sigma_a: Option<Value>,
    phase: Option<JsonPhase>,
    ior: Option<f32>,
    #[serde(alias = "group-ior")]
    group_ior: Option<f32>,
    bounds: Option<[[f64; 3]; 2]>,
    /// For people; not read.
    #[serde(rename = "note")]
    _note: Option<Value>,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case", deny_unknown_fields)]
enum JsonPhase {
    Isotropic,
    Hg {
        g: f64,
    },
    #[serde(alias = "double_hg")]
    DoubleHg {
        g: [f64; 2],
        weight: f64,
    },
    Draine {
        g: f64,
        g_draine: f64,
        alpha: f64,
        weight_draine: f64,
    },
    Rayleigh,
    Table {
        cosines: Vec<f64>,
        values: Vec<f64>,
    },
}

/// The medium of the default scene, if its extras describe one.
pub fn load(doc: &Document, warnings: &mut Warnings) -> Checked<Vec<Medium>> {
    let index = doc.root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = doc.root.scenes.get(index) else { return Ok(vec![]) };
    let medium = read(&scene.extras, "the scene", warnings)?;
    Ok(medium.into_iter().collect())
}

/// Adds the media inside the meshes of each material: the medium of its extras, and the absorption of KHR_materials_volume. If a
/// material has both, their absorption adds up. `materials` begins with the materials of the file, in its order. `is_used`: whether
/// a mesh has the material; the others get no media.
pub fn add_interiors(
    doc: &Document,
    is_used: &[bool],
    materials: &mut [Material],
    warnings: &mut Warnings,
) -> Checked<()> {
    for (index, (source, material)) in doc.root.materials.iter().zip(materials).enumerate() {
        if !is_used[index] {
            continue;
        }
        let name = label(source.name.as_deref(), "material", index);
        material.interior = read(&source.extras, &format!("material `{name}`"), warnings)?;
        // A volume without transmission is not visible.
        if material.transmission == 0.0 {
            continue;
        }
        let (thickness, absorption) = volume::read_volume(source, &name, material.thickness > 0.0, warnings)?;
        material.volume_thickness = thickness;
        if let Some(absorption) = absorption {
            let sigma_a = &mut material.interior.get_or_insert_default().sigma_a;
            *sigma_a = [0, 1, 2].map(|k| (sigma_a[k] + absorption[k]).min(MAX_COEFFICIENT));
        }
    }
    Ok(())
}

/// The medium that `json`, an object in the form of `extras.medium`, describes. `of` names its owner in messages. Fails with one
/// sentence if the object is not a medium.
pub fn from_json(json: &str, of: &str) -> Checked<Medium> {
    let extras = RawValue::from_string(format!("{{\"medium\": {json}}}")).map_err(|e| e.to_string())?;
    let medium = read(&Some(extras), of, &mut Warnings::default())?;
    medium.ok_or_else(|| format!("the medium of {of} is not an object with sigma_s or sigma_a"))
}

/// The medium in `extras`. `None`, with a warning, if their `medium` has no coefficient of taugate. `of` names the owner of the extras
/// in messages.
fn read(extras: &Extras, of: &str, warnings: &mut Warnings) -> Checked<Option<Medium>> {
    let Some(medium) = member(extras, "medium") else { return Ok(None) };
    if !["sigma_s", "sigma-s", "sigma_a", "sigma-a"].iter().any(|key| medium.get(key).is_some()) {
        warn_of_foreign("medium", of, "an object with sigma_s or sigma_a", warnings);
        return Ok(None);
    }
    let wrong = |why: String| {
        Err(format!(
            "extras.medium of {of} {why}; write {{\"sigma_s\": 0.02, \"sigma_a\": 0.001, \"phase\": {{\"type\": \"hg\", \"g\": 0.8}}}}"
        ))
    };
    // The parser would read a list as an object.
    if medium.get("phase").is_some_and(Value::is_array) {
        return wrong("has a phase that is no object".into());
    }
    let json: Json = match serde_json::from_value(medium) {
        Ok(json) => json,
        Err(e) => return wrong(format!("cannot be read ({})", printable(&e.to_string(), 200))),
    };
    if let Some(kind) = json.kind.filter(|kind| kind != "homogeneous") {
        return wrong(format!("has the type `{}` instead of `homogeneous`", printable(&kind, 40)));
    }
    let (Some(sigma_s), Some(sigma_a)) = (rgb(json.sigma_s), rgb(json.sigma_a)) else {
        return wrong("has a sigma_s or sigma_a that is neither one number nor three".into());
    };
    Ok(Some(Medium {
        sigma_s,
        sigma_a,
        phase: json.phase.map_or(PhaseFunction::Isotropic, JsonPhase::convert),
        ior: json.ior.unwrap_or(1.0),
        group_ior: json.group_ior.or(json.ior).unwrap_or(1.0),
        bounds: json.bounds.map(|corners| corners.map(DVec3::from)),
        grid: None,
    }))
}

/// One number for all channels, or three; 0 without a value.
fn rgb(value: Option<Value>) -> Option<[f64; 3]> {
    match value {
        None => Some([0.0; 3]),
        Some(Value::Array(channels)) => {
            let channels = channels.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>()?;
            channels.try_into().ok()
        }
        Some(number) => number.as_f64().map(|x| [x; 3]),
    }
}

impl JsonPhase {
    fn convert(self) -> PhaseFunction {
        match self {
            JsonPhase::Isotropic => PhaseFunction::Isotropic,
            JsonPhase::Hg { g } => PhaseFunction::HenyeyGreenstein { g },
            JsonPhase::DoubleHg { g, weight } => PhaseFunction::DoubleHenyeyGreenstein { g, weight },
            JsonPhase::Draine { g, g_draine, alpha, weight_draine } => {
                PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine }
            }
            JsonPhase::Rayleigh => PhaseFunction::Rayleigh,
            JsonPhase::Table { cosines, values } => PhaseFunction::Table { cosines, values },
        }
    }
}
