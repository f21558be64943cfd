//! What taugate does with each glTF extension.

use super::document::{Document, Warnings, printable};
use super::{Checked, texture};

/// What taugate does with an extension.
#[derive(Clone, Copy)]
enum Treatment {
    /// The image shows it.
    Read,
    /// The image does not depend on it. Animations that use it give a warning of their own.
    Harmless,
    /// The scene is rendered without it, even if the file requires it. The sentence says what the image shows instead.
    Without(&'static str),
    /// A file that requires it is refused, with this remedy. If the extension is optional, it gives a warning.
    Refused(&'static str),
}

use Treatment::{Harmless, Read, Refused, Without};

/// Every extension that is known to taugate. A file that requires any other extension is refused; an optional one gives a warning.
#[rustfmt::skip]
const EXTENSIONS: &[(&str, Treatment)] = &[
    ("ADOBE_materials_clearcoat_specular", Without("clear coats reflect as usual")),
    ("ADOBE_materials_clearcoat_tint", Without("clear coats have no colour")),
    ("ADOBE_materials_thin_transparency", Without("the material is drawn without it")),
    ("AGI_articulations", Harmless),
    ("AGI_stk_metadata", Harmless),
    ("CESIUM_primitive_outline", Harmless),
    ("EXT_instance_features", Harmless),
    ("EXT_lights_ies", Without("lamps shine without their measured distribution")),
    ("EXT_lights_image_based", Without("the environment map does not light the scene")),
    ("EXT_mesh_features", Harmless),
    ("EXT_mesh_gpu_instancing", Read),
    ("EXT_mesh_manifold", Harmless),
    ("EXT_meshopt_compression", Read),
    ("EXT_structural_metadata", Harmless),
    ("EXT_texture_avif", Refused(texture::FROM_AVIF)),
    ("EXT_texture_webp", Read),
    ("FB_geometry_metadata", Harmless),
    ("GODOT_single_root", Harmless),
    ("GRIFFEL_bim_data", Harmless),
    ("KHR_animation_pointer", Harmless),
    ("KHR_audio_emitter", Harmless),
    ("KHR_collision_shapes", Harmless),
    ("KHR_draco_mesh_compression", Read),
    ("KHR_gaussian_splatting", Without("splats are left out")),
    ("KHR_interactivity", Harmless),
    ("KHR_lights_punctual", Read),
    ("KHR_materials_anisotropy", Without("highlights are round")),
    ("KHR_materials_clearcoat", Read),
    ("KHR_materials_diffuse_transmission", Without("no light passes through the material")),
    ("KHR_materials_dispersion", Without("all colours are refracted alike")),
    ("KHR_materials_emissive_strength", Read),
    ("KHR_materials_ior", Read),
    ("KHR_materials_iridescence", Without("highlights have the plain colour")),
    ("KHR_materials_pbrSpecularGlossiness", Read),
    ("KHR_materials_sheen", Without("materials have no sheen")),
    ("KHR_materials_specular", Read),
    ("KHR_materials_subsurface", Without("light does not spread below the surface")),
    ("KHR_materials_transmission", Read),
    ("KHR_materials_unlit", Without("the material is an ordinary surface of its base colour, lit by the lamps")),
    ("KHR_materials_variants", Harmless),
    ("KHR_materials_volume", Read),
    ("KHR_mesh_quantization", Read),
    ("KHR_meshopt_compression", Read),
    ("KHR_node_hoverability", Harmless),
    ("KHR_node_selectability", Harmless),
    ("KHR_node_visibility", Read),
    ("KHR_physics_rigid_bodies", Harmless),
    ("KHR_texture_basisu", Refused(texture::FROM_KTX2)),
    ("KHR_texture_transform", Read),
    ("KHR_xmp", Harmless),
    ("KHR_xmp_json_ld", Harmless),
    // Nodes and materials have their highest level of detail; the lower levels are not part of the scene.
    ("MSFT_lod", Harmless),
    ("MSFT_packing_normalRoughnessMetallic", Harmless),
    ("MSFT_packing_occlusionRoughnessMetallic", Harmless),
    ("MSFT_texture_dds", Refused(texture::FROM_OTHERS)),
    ("VRM", Harmless),
    ("VRMC_node_constraint", Harmless),
    ("VRMC_springBone", Harmless),
    ("VRMC_vrm", Harmless),
];

/// Whether taugate reads the extension `name`.
pub fn is_read(name: &[u8]) -> bool {
    EXTENSIONS.iter().any(|(known, treatment)| known.as_bytes() == name && matches!(treatment, Read))
}

/// Maximum number of extensions that get a warning: a hostile file may name any number of them.
const MAX_WARNINGS: usize = 20;

/// Refuses a file that requires an extension that is [`Refused`] or not in the list. Warns about every other extension that is not
/// read and not harmless.
pub fn check(doc: &Document, warnings: &mut Warnings) -> Checked<()> {
    let (required, used) = (&doc.root.extensions_required, &doc.root.extensions_used);
    let mut seen: Vec<&str> = Vec::new();
    for (name, is_required) in required.iter().map(|name| (name, true)).chain(used.iter().map(|name| (name, false))) {
        let treatment = EXTENSIONS.iter().find(|(known, _)| known == name).map(|(_, treatment)| *treatment);
        let shown = printable(name, 80);
        let warning = match (treatment.unwrap_or(Refused("re-export without it")), is_required) {
            (Read | Harmless, _) => continue,
            (Refused(remedy), true) => {
                return Err(format!("requires the extension {shown}, which taugate does not read; {remedy}"));
            }
            (Refused(_), false) => format!("the extension {shown} is not read"),
            (Without(shows), _) => format!("the extension {shown} is not read: {shows}"),
        };
        if seen.len() < MAX_WARNINGS && !seen.contains(&name.as_str()) {
            seen.push(name);
            warnings.push(warning);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_sorted_and_names_each_extension_once() {
        assert!(EXTENSIONS.is_sorted_by(|a, b| a.0 < b.0));
    }
}
