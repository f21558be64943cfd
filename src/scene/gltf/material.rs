//! Reads materials, and collects the textures that they use.

use ::gltf::json;
use ::gltf::json::extensions::texture::{Info as TextureExtensions, TextureTransform};
use ::gltf::json::material::AlphaMode as JsonAlphaMode;
use ::gltf::json::texture::Info;
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::{DAffine2, DMat2, DVec2};

use super::Checked;
use super::document::{Document, Warnings, finite, label};
use super::texture::Textures;
use crate::scene::{AlphaMode, Material};

/// All materials of the file in its order, and the textures that they use.
pub struct Materials {
    pub materials: Vec<Material>,
    pub textures: Textures,
    /// By material: the texture coordinates of its meshes.
    uv_mappings: Vec<UvMapping>,
    /// Factors outside [0, 1], which were clamped: property, material and value.
    limited: Vec<String>,
    /// Index of the glTF default material once a primitive needs it.
    default: Option<u32>,
}

/// The texture coordinates that a material needs.
#[derive(Debug, Clone, Copy, Default)]
pub struct UvMapping {
    /// The number of the set: TEXCOORD_0, TEXCOORD_1 and so on.
    pub set: u32,
    /// KHR_texture_transform.
    pub transform: Option<DAffine2>,
}

impl Materials {
    /// The material of a primitive, and its texture coordinates. `what` names the primitive in messages.
    pub fn of(&mut self, index: Option<usize>, what: &str) -> Checked<(u32, UvMapping)> {
        let Some(index) = index else {
            let default = *self.default.get_or_insert_with(|| {
                self.materials.push(default_material());
                self.uv_mappings.push(UvMapping::default());
                self.materials.len() as u32 - 1
            });
            return Ok((default, UvMapping::default()));
        };
        match self.uv_mappings.get(index) {
            Some(mapping) if self.default != Some(index as u32) => Ok((index as u32, *mapping)),
            _ => Err(format!("{what} refers to material {index}, which does not exist; re-export the file")),
        }
    }

    /// Whether meshes with this material need tangents.
    pub fn is_bumped(&self, index: u32) -> bool {
        self.materials.get(index as usize).is_some_and(|material| material.normal_texture.is_some())
    }

    /// Whether meshes with this material need texture coordinates.
    pub fn is_textured(&self, index: u32) -> bool {
        self.materials.get(index as usize).is_some_and(|material| material.textures().next().is_some())
    }
}

pub fn load(doc: &Document, warnings: &mut Warnings) -> Checked<Materials> {
    let mut out = Materials {
        materials: vec![],
        textures: Textures::new(doc),
        uv_mappings: vec![],
        limited: vec![],
        default: None,
    };
    for (index, material) in doc.root.materials.iter().enumerate() {
        let material = out.material(doc, index, material, warnings)?;
        out.materials.push(material);
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
        warnings: &mut Warnings,
    ) -> Checked<Material> {
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
        let mut base_color = pbr.base_color_factor.0;
        for value in &mut base_color {
            *value = unit(*value, "baseColorFactor")?;
        }
        let specular = ext.specular.unwrap_or_default();
        let transmission = ext.transmission.unwrap_or_default();
        let clearcoat = Clearcoat::read(&ext.others, &name)?;
        let [metallic, roughness, reflected, transmitted, coated, coat_roughness] = [
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
        let specular_color = specular.specular_color_factor.0;
        if !specular_color.iter().all(|value| value.is_finite() && *value >= 0.0) {
            return Err(format!(
                "the specularColorFactor of material `{name}` is negative or not finite; correct it and re-export"
            ));
        }
        let ior = ext.ior.unwrap_or_default().ior.0;
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
                warnings.once(what, || format!("{what} are not read (first: material `{name}`)"));
            }
        };
        ignored(specular.specular_texture.is_some(), "specular textures");
        ignored(specular.specular_color_texture.is_some(), "specular colour textures");
        let has_coat = coated > 0.0;
        ignored(has_coat && clearcoat.clearcoat_texture.is_some(), "textures of the strength of clear coats");
        ignored(
            has_coat && clearcoat.clearcoat_roughness_texture.is_some(),
            "textures of the roughness of clear coats",
        );
        ignored(has_coat && clearcoat.clearcoat_normal_texture.is_some(), "normal maps of clear coats");
        ignored(transmission.transmission_texture.is_some(), "transmission textures");

        let normal_scale = source.normal_texture.as_ref().map_or(1.0, |info| info.scale);
        let normal_scale = finite(normal_scale, &format!("the scale of the normalTexture of material `{name}`"))?;
        let [base_color_texture, emission_texture, surface_texture, normal_texture] =
            self.read_textures(doc, &name, source, warnings)?;
        Ok(Material {
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
            specular_color,
            ior,
            transmission: transmitted,
            clearcoat: coated,
            clearcoat_roughness: coat_roughness,
            alpha_mode,
            double_sided: source.double_sided,
            interior: None,
            name,
        })
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

    /// Reads the textures of a material: base colour, emission, metalness with roughness, and normal map. Stores the texture
    /// coordinates that they share.
    fn read_textures(
        &mut self,
        doc: &Document,
        name: &str,
        source: &json::Material,
        warnings: &mut Warnings,
    ) -> Checked<[Option<u32>; 4]> {
        let mut transforms = Vec::new();
        let mut shared_set = None;
        let mut read = |info: &Option<Info>, slot: &str| -> Checked<Option<u32>> {
            let Some(info) = info else { return Ok(None) };
            let what = format!("the {slot} of material `{name}`");
            let transform = info.extensions.as_ref().and_then(|ext| ext.texture_transform.as_ref());
            let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
            if set != *shared_set.get_or_insert(set) {
                warnings.once("texture coordinate sets", || {
                    format!(
                        "textures with another texture coordinate set than the first texture of the material are not read \
                         (first: {what})"
                    )
                });
                return Ok(None);
            }
            transforms.push(transform.map_or(Ok(DAffine2::IDENTITY), |transform| affine(transform, &what))?);
            self.textures.add(doc, info.index.value(), &what, warnings).map(Some)
        };
        let base_color = read(&source.pbr_metallic_roughness.base_color_texture, "baseColorTexture")?;
        // A texture does not change a black emission, because both are multiplied.
        let is_emissive = source.emissive_factor.0 != [0.0; 3];
        let emission = if is_emissive { read(&source.emissive_texture, "emissiveTexture")? } else { None };
        let surface = read(&source.pbr_metallic_roughness.metallic_roughness_texture, "metallicRoughnessTexture")?;

        let normal = read(&source.normal_texture.as_ref().map(as_info), "normalTexture")?;

        let first = transforms.first().copied().unwrap_or_default();
        let is_shared = transforms.iter().all(|transform| *transform == first);
        if !is_shared {
            warnings.once("texture transforms", || {
                format!("texture transforms that differ within a material are not applied (first: material `{name}`)")
            });
        }
        let transform = (is_shared && first != DAffine2::IDENTITY).then_some(first);
        self.uv_mappings.push(UvMapping { set: shared_set.unwrap_or(0), transform });
        Ok([base_color, emission, surface, normal])
    }
}

/// KHR_materials_clearcoat of a material.
#[derive(Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_roughness_factor: f32,
    clearcoat_texture: Option<serde_json::Value>,
    clearcoat_roughness_texture: Option<serde_json::Value>,
    clearcoat_normal_texture: Option<serde_json::Value>,
}

impl Clearcoat {
    /// Without the extension, there is no clear coat.
    fn read(extensions: &serde_json::Map<String, serde_json::Value>, name: &str) -> Checked<Clearcoat> {
        let Some(value) = extensions.get("KHR_materials_clearcoat") else { return Ok(Clearcoat::default()) };
        serde_json::from_value(value.clone()).map_err(|e| {
            format!("the KHR_materials_clearcoat of material `{name}` is invalid: {e}; correct it and re-export")
        })
    }
}

/// The reference to a normal map, without its scale.
fn as_info(normal: &json::material::NormalTexture) -> Info {
    let extensions = normal.extensions.as_ref().map(|ext| TextureExtensions {
        texture_transform: (ext.others.get("KHR_texture_transform"))
            .and_then(|transform| serde_json::from_value(transform.clone()).ok()),
        ..TextureExtensions::default()
    });
    Info { index: normal.index, tex_coord: normal.tex_coord, extensions, extras: Default::default() }
}

/// The affine map of KHR_texture_transform: scale, then rotation, then offset. The rotation is counter-clockwise as seen in the
/// image, whose v axis points down.
fn affine(transform: &TextureTransform, what: &str) -> Checked<DAffine2> {
    let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
    let [x, y] = transform.scale.0.map(f64::from);
    let matrix = DMat2::from_cols(DVec2::new(cos, -sin) * x, DVec2::new(sin, cos) * y);
    let affine = DAffine2::from_mat2_translation(matrix, DVec2::from(transform.offset.0.map(f64::from)));
    if !affine.is_finite() {
        return Err(format!("the texture transform of {what} is not finite; correct it and re-export"));
    }
    Ok(affine)
}
