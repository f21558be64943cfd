//! Reads materials, and collects the textures that they use.

use std::collections::HashMap;

use ::gltf::json;
use ::gltf::json::material::AlphaMode as JsonAlphaMode;
use ::gltf::json::texture::Info;
use ::gltf::json::validation::Checked::{Invalid, Valid};

use super::document::{Document, Warnings, finite, label};
use super::material_extension::{Clearcoat, SpecularGlossiness, read};
use super::node::Worlds;
use super::texture::{Channels, Textures};
use super::texture_use::{TextureUse, UvMapping, add_all, as_info};
use super::{Checked, retroreflector, thin_glass};
use crate::scene::{AlphaMode, Image, Material};

/// All materials of the file in its order, and the textures that they use.
pub struct Materials {
    pub materials: Vec<Material>,
    pub textures: Textures,
    /// By material of the file: the texture coordinates of its meshes.
    uv_mappings: Vec<UvMapping>,
    /// Factors outside [0, 1], which were clamped: property, material and value.
    limited: Vec<String>,
    /// Index of the glTF default material once a primitive needs it.
    default: Option<u32>,
    /// Materials of which there is a copy without a normal map, and the index of this copy.
    flat: HashMap<u32, u32>,
}

impl Materials {
    /// The material of a primitive, and its texture coordinates. `what` names the primitive in messages.
    pub fn of(&mut self, index: Option<usize>, what: &str) -> Checked<(u32, UvMapping)> {
        let Some(index) = index else {
            let default = *self.default.get_or_insert_with(|| {
                self.materials.push(default_material());
                self.materials.len() as u32 - 1
            });
            return Ok((default, UvMapping::default()));
        };
        match self.uv_mappings.get(index) {
            Some(mapping) => Ok((index as u32, *mapping)),
            None => Err(format!("{what} refers to material {index}, which does not exist; re-export the file")),
        }
    }

    /// Whether meshes with this material need tangents.
    pub fn is_bumped(&self, index: u32) -> bool {
        self.materials.get(index as usize).is_some_and(|material| material.normal_texture.is_some())
    }

    /// Index of a copy of material `index` without its normal map. Adds the copy on the first call.
    pub fn without_normal_map(&mut self, index: u32) -> u32 {
        *self.flat.entry(index).or_insert_with(|| {
            self.materials.push(Material { normal_texture: None, ..self.materials[index as usize].clone() });
            self.materials.len() as u32 - 1
        })
    }

    /// Whether meshes with this material need texture coordinates.
    pub fn is_textured(&self, index: u32) -> bool {
        self.materials.get(index as usize).is_some_and(|material| material.textures().next().is_some())
    }
}

/// For each material of the file, whether a mesh of a visible node has it.
pub fn used(doc: &Document, worlds: &Worlds) -> Vec<bool> {
    let mut is_used = vec![false; doc.root.materials.len()];
    let mut is_counted = vec![false; doc.root.meshes.len()];
    for (index, _) in worlds.visible() {
        let number = doc.root.nodes.get(index).and_then(|node| node.mesh).map(|mesh| mesh.value());
        let Some((mesh, is_counted)) = number.and_then(|n| Some((doc.root.meshes.get(n)?, is_counted.get_mut(n)?)))
        else {
            continue;
        };
        // Many nodes may share a mesh of many primitives.
        if std::mem::replace(is_counted, true) {
            continue;
        }
        for material in mesh.primitives.iter().filter_map(|primitive| primitive.material) {
            if let Some(is_used) = is_used.get_mut(material.value()) {
                *is_used = true;
            }
        }
    }
    is_used
}

/// Reads all materials. Those that no mesh has, see [`used`], get no textures, and their mistakes are no errors.
pub fn load(doc: &Document, is_used: &[bool], warnings: &mut Warnings) -> Checked<Materials> {
    let mut out = Materials {
        materials: vec![],
        textures: Textures::new(doc),
        uv_mappings: vec![],
        limited: vec![],
        default: None,
        flat: HashMap::new(),
    };
    for (index, material) in doc.root.materials.iter().enumerate() {
        let (material, uv_mapping) = match out.material(doc, index, material, is_used[index], warnings) {
            Err(why) if !is_used[index] => {
                warnings.once("unused materials", || format!("a material that no mesh has is left out: {why}"));
                (default_material(), UvMapping::default())
            }
            material => material?,
        };
        out.materials.push(material);
        out.uv_mappings.push(uv_mapping);
    }
    out.warn_of_limits(warnings);
    Ok(out)
}

/// Maximum number of clamped factors that the warning lists.
const MAX_LISTED: usize = 8;

/// The material that glTF prescribes for a primitive without one.
fn default_material() -> Material {
    let rough_metal = Material::metal("default", [1.0; 3], 1.0);
    Material { double_sided: false, ..rough_metal }
}

impl Materials {
    fn material(
        &mut self,
        doc: &Document,
        index: usize,
        source: &json::Material,
        is_used: bool,
        warnings: &mut Warnings,
    ) -> Checked<(Material, UvMapping)> {
        let name = label(source.name.as_deref(), "material", index);
        let ext = source.extensions.clone().unwrap_or_default();
        let limited = &mut self.limited;
        let mut unit = |value: f32, what: &str| -> Checked<f32> {
            let what = format!("{what} of material `{name}`");
            let inside = finite(value, &format!("the {what}"))?.clamp(0.0, 1.0);
            // Clamping -0 to 0 does not change the image, so it gives no warning.
            if inside != value {
                limited.push(format!("{what} ({value})"));
            }
            Ok(inside)
        };
        let pbr = &source.pbr_metallic_roughness;
        let glossy: Option<SpecularGlossiness> = read(&ext.others, "KHR_materials_pbrSpecularGlossiness", &name)?;
        // glTF forbids KHR_materials_pbrSpecularGlossiness together with these three extensions.
        let specular = ext.specular.filter(|_| glossy.is_none()).unwrap_or_default();
        let transmission = ext.transmission.filter(|_| glossy.is_none()).unwrap_or_default();
        let mut ior = ext.ior.filter(|_| glossy.is_none()).unwrap_or_default().ior.0;
        let clearcoat: Clearcoat = read(&ext.others, "KHR_materials_clearcoat", &name)?.unwrap_or_default();
        let (mut base_color, color_slot) = match &glossy {
            Some(glossy) => (glossy.diffuse_factor, "diffuseFactor"),
            None => (pbr.base_color_factor.0, "baseColorFactor"),
        };
        for value in &mut base_color {
            *value = unit(*value, color_slot)?;
        }
        let [mut metallic, mut roughness, reflected, transmitted, coated, coat_roughness] = [
            unit(pbr.metallic_factor.0, "metallicFactor")?,
            unit(pbr.roughness_factor.0, "roughnessFactor")?,
            unit(specular.specular_factor.0, "specularFactor")?,
            unit(transmission.transmission_factor.0, "transmissionFactor")?,
            unit(clearcoat.clearcoat_factor, "clearcoatFactor")?,
            unit(clearcoat.clearcoat_roughness_factor, "clearcoatRoughnessFactor")?,
        ];
        let strength = ext.emissive_strength.unwrap_or_default().emissive_strength.0;
        let emission = source.emissive_factor.0.map(|factor| factor * strength);
        if !emission.iter().chain([&strength]).all(|value| value.is_finite() && *value >= 0.0) {
            return Err(format!(
                "the emission of material `{name}` is negative or not finite; correct it and re-export"
            ));
        }
        let (mut specular_color, specular_key) = match &glossy {
            Some(glossy) => (glossy.specular_factor, "specularFactor"),
            None => (specular.specular_color_factor.0, "specularColorFactor"),
        };
        if !specular_color.iter().all(|value| value.is_finite() && *value >= 0.0) {
            return Err(format!(
                "the {specular_key} of material `{name}` is negative or not finite; correct it and re-export"
            ));
        }
        // The extension gives 0 the meaning of a reflectance of 1 at all angles.
        if ior == 0.0 {
            ior = SpecularGlossiness::IOR;
        }
        if !(ior.is_finite() && ior >= 1.0) {
            return Err(format!(
                "the ior of material `{name}` is {ior}, but must be at least 1; set it to e.g. 1.5 and re-export"
            ));
        }
        let alpha_mode = match source.alpha_mode {
            Valid(JsonAlphaMode::Opaque) => AlphaMode::Opaque,
            Valid(JsonAlphaMode::Blend) => AlphaMode::Blend,
            Valid(JsonAlphaMode::Mask) => {
                let cutoff = source.alpha_cutoff.unwrap_or_default().0;
                AlphaMode::Mask(finite(cutoff, &format!("the alphaCutoff of material `{name}`"))?)
            }
            Invalid => return Err(format!("the alphaMode of material `{name}` is unknown; re-export the file")),
        };

        let mut ignored = |is_used: bool, what: &'static str| {
            if is_used {
                warnings.once(what, || format!("{what} (first: material `{name}`)"));
            }
        };
        ignored(
            coated > 0.0 && !is_same_map(&clearcoat, source),
            "clear coats have the normals of the surface under them, although the file gives them others",
        );
        let brightest = |color: [f32; 3]| color.into_iter().fold(0.0, f32::max);
        ignored(
            coated > 0.0 && brightest(emission) > 0.0,
            "clear coats do not dim the light of lamps under them; if the lamps are too bright, lower the emission",
        );
        let has_specular_texture = specular.specular_texture.is_some() || specular.specular_color_texture.is_some();
        let has_plain_gloss = reflected == 1.0 && specular_color == [1.0; 3] && !has_specular_texture;
        let has_glass = transmitted > 0.0 && (metallic < 1.0 || pbr.metallic_roughness_texture.is_some());
        ignored(
            has_glass && !has_plain_gloss,
            "glass reflects as its index of refraction says, whatever its specular factors are; set the ior to change it",
        );

        let normal_scale = source.normal_texture.as_ref().map_or(1.0, |info| info.scale);
        let normal_scale = finite(normal_scale, &format!("the scale of the normalTexture of material `{name}`"))?;
        let used = |info: &Option<Info>, slot: &str| {
            let texture = info.as_ref().map(|info| TextureUse::new(info, Channels::Stored, slot, &name));
            texture.transpose()
        };
        // A texture that multiplies a factor of 0 has no effect.
        let of = |factor: f32, info: &Option<Info>, slot: &str| if factor > 0.0 { used(info, slot) } else { Ok(None) };
        let mut uses = [
            // Three of these are replaced by those of KHR_materials_pbrSpecularGlossiness.
            used(&pbr.base_color_texture, "baseColorTexture")?,
            of(brightest(emission), &source.emissive_texture, "emissiveTexture")?,
            used(&pbr.metallic_roughness_texture, "metallicRoughnessTexture")?,
            used(&source.normal_texture.as_ref().map(|map| as_info(map, &name)).transpose()?, "normalTexture")?,
            of(reflected, &specular.specular_texture, "specularTexture")?,
            of(reflected * brightest(specular_color), &specular.specular_color_texture, "specularColorTexture")?,
            of(coated, &clearcoat.clearcoat_texture, "clearcoatTexture")?,
            of(coated * coat_roughness, &clearcoat.clearcoat_roughness_texture, "clearcoatRoughnessTexture")?,
            of(transmitted, &transmission.transmission_texture, "transmissionTexture")?,
        ];
        if let Some(glossy) = &glossy {
            let glossiness = unit(glossy.glossiness_factor, "glossinessFactor")?;
            for value in &mut specular_color {
                *value = unit(*value, "specularFactor")?;
            }
            [uses[0], uses[2], uses[5]] = glossy.textures(glossiness, &specular_color, &name)?;
            metallic = 0.0;
            roughness = 1.0 - glossiness;
            specular_color = SpecularGlossiness::specular_color(specular_color);
            ior = SpecularGlossiness::IOR;
        }
        if !is_used {
            uses = Default::default();
        }
        let (textures, uv_mapping) = add_all(uses, 3, &name, doc, &mut self.textures, warnings)?;
        let [base_color_texture, emission_texture, surface_texture, normal_texture, ..] = textures;
        if glossy.is_some() && surface_texture.is_some() {
            // The texture contains the factor.
            roughness = 1.0;
        }
        let [.., specular_texture, specular_color_texture, clearcoat_texture, _, _] = textures;
        let [.., clearcoat_roughness_texture, transmission_texture] = textures;
        let retroreflector = match is_used {
            true => retroreflector::read(&source.extras, &name, warnings)?,
            false => None,
        };
        let mut material = Material {
            base_color,
            base_color_texture,
            metallic,
            roughness,
            surface_texture,
            normal_texture,
            // A scale of 1000 already tilts every normal as far as taugate allows.
            normal_scale: normal_scale.clamp(-1000.0, 1000.0),
            emission,
            emission_texture,
            specular: reflected,
            specular_texture,
            specular_color,
            specular_color_texture,
            ior,
            group_ior: None,
            transmission: transmitted,
            transmission_texture,
            clearcoat: coated,
            clearcoat_texture,
            clearcoat_roughness: coat_roughness,
            clearcoat_roughness_texture,
            alpha_mode,
            double_sided: source.double_sided,
            retroreflector,
            interior: None,
            thin: None,
            thickness: 0.0,
            volume_thickness: 0.0,
            name,
        };
        thin_glass::read(&source.extras, &mut material, warnings);
        Ok((material, uv_mapping))
    }

    fn warn_of_limits(&self, warnings: &mut Warnings) {
        if self.limited.is_empty() {
            return;
        }
        let listed = self.limited[..self.limited.len().min(MAX_LISTED)].join(", ");
        let rest = match self.limited.len().saturating_sub(MAX_LISTED) {
            0 => String::new(),
            n => format!(", and {n} more"),
        };
        warnings.push(format!("factors outside [0, 1] are clamped: {listed}{rest}"));
    }
}

/// Sets the emission of materials to 0 if their texture leaves nothing of it. So they do not count as lamps, of which a scene needs
/// at least one.
pub fn darken(materials: &mut Materials, images: &[Image]) {
    // Whether an image has red, green and blue above 0. Materials may share an image.
    let mut known: HashMap<u32, [bool; 3]> = HashMap::new();
    for material in &mut materials.materials {
        let texture = material.emission_texture.and_then(|index| materials.textures.list.get(index as usize));
        let Some((number, image)) = texture.and_then(|t| Some((t.image, images.get(t.image as usize)?))) else {
            continue;
        };
        let shines =
            known.entry(number).or_insert_with(|| [0, 1, 2].map(|k| image.rgba.iter().any(|rgba| rgba[k] > 0)));
        if (0..3).all(|k| material.emission[k] == 0.0 || !shines[k]) {
            (material.emission, material.emission_texture) = ([0.0; 3], None);
        }
    }
}

/// Whether the clear coat and the surface under it have the same normal map, or none.
fn is_same_map(clearcoat: &Clearcoat, source: &json::Material) -> bool {
    let key = |map: &json::material::NormalTexture| {
        (map.index.value(), map.tex_coord, map.scale.to_bits(), map.extensions.as_ref().map(|ext| ext.others.clone()))
    };
    clearcoat.clearcoat_normal_texture.as_ref().map(key) == source.normal_texture.as_ref().map(key)
}
