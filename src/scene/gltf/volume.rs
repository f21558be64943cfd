//! KHR_materials_volume: the thickness of thin glass, and absorption inside of glass.

use ::gltf::json;

use super::Checked;
use super::document::Warnings;
use super::material_extension::read;
use crate::scene::MAX_COEFFICIENT;

/// The extension. Thickness textures are not read: the mesh itself says how long light travels inside of a solid, and thin glass has the
/// same thickness everywhere.
#[derive(serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Volume {
    thickness_factor: f32,
    attenuation_distance: Option<f64>,
    attenuation_color: [f64; 3],
}

impl Default for Volume {
    fn default() -> Volume {
        Volume { thickness_factor: 0.0, attenuation_distance: None, attenuation_color: [1.0; 3] }
    }
}

/// Thickness in units of the mesh, and absorption coefficients per metre inside of meshes of a material that transmits light; `None` if
/// nothing is absorbed. `name` names the material. `has_thickness`: whether its extras give a thickness.
pub fn read_volume(
    source: &json::Material,
    name: &str,
    has_thickness: bool,
    warnings: &mut Warnings,
) -> Checked<(f32, Option<[f64; 3]>)> {
    let others = source.extensions.as_ref().map(|extensions| &extensions.others);
    let volume = others.map(|others| read::<Volume>(others, "KHR_materials_volume", name)).transpose()?.flatten();
    let Some(Volume { thickness_factor, attenuation_distance, attenuation_color }) = volume else {
        return Ok((0.0, None));
    };
    if !(thickness_factor.is_finite() && thickness_factor >= 0.0) {
        return Err(format!("the thicknessFactor of material `{name}` is {thickness_factor}; it must be 0 or more"));
    }
    if !attenuation_color.iter().all(|x| (0.0..=1.0).contains(x)) {
        return Err(format!("the attenuationColor of material `{name}` is not from 0 to 1; correct it and re-export"));
    }
    // The default distance is infinite.
    let Some(distance) = attenuation_distance else { return Ok((thickness_factor, None)) };
    if distance <= 0.0 {
        return Err(format!("the attenuationDistance of material `{name}` is {distance}; it must be above 0"));
    }
    if attenuation_color == [1.0; 3] {
        return Ok((thickness_factor, None));
    }
    if thickness_factor == 0.0 && !has_thickness {
        warnings.once("thin walls", || {
            format!(
                "materials of KHR_materials_volume with a thicknessFactor of 0 absorb nothing, because glTF calls them thin; set it \
                 above 0 to colour the glass (first: material `{name}`)"
            )
        });
        return Ok((thickness_factor, None));
    }
    let absorption = attenuation_color.map(|color| (-color.ln() / distance).clamp(0.0, MAX_COEFFICIENT));
    Ok((thickness_factor, Some(absorption)))
}
