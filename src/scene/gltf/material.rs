//! Reads materials, and the textures and images that they use.

use std::collections::HashMap;

use ::gltf::json;
use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode as JsonAlphaMode;
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::{DAffine2, DMat2, DVec2};

use super::Checked;
use super::document::{Document, Warnings, finite, label};
use crate::scene::{AlphaMode, Material, Texture, Wrap};

/// Extensions of materials and textures that this file reads.
pub const EXTENSIONS: [&str; 5] = [
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_texture_transform",
];

/// All materials of the file in its order, and those textures and images that taugate reads.
#[derive(Default)]
pub struct Materials {
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    /// The glTF index of each [`crate::scene::Image`].
    pub images: Vec<usize>,
    /// By material: the transform of its meshes' texture coordinates by KHR_texture_transform.
    uv_transforms: Vec<Option<DAffine2>>,
    /// From the glTF index of a texture to an index into `textures`.
    texture_of: HashMap<usize, u32>,
    /// From the glTF index of an image to an index into `images`.
    image_of: HashMap<usize, u32>,
    /// Factors outside [0, 1], which were clamped: property, material and value.
    limited: Vec<String>,
    /// Index of the glTF default material once a primitive needs it.
    default: Option<u32>,
}

impl Materials {
    /// The material of a primitive, and the transform of its texture coordinates. `what` names the primitive in messages.
    pub fn of(&mut self, index: Option<usize>, what: &str) -> Checked<(u32, Option<DAffine2>)> {
        let Some(index) = index else {
            let default = *self.default.get_or_insert_with(|| {
                self.materials.push(default_material());
                self.uv_transforms.push(None);
                self.materials.len() as u32 - 1
            });
            return Ok((default, None));
        };
        match self.uv_transforms.get(index) {
            Some(transform) if self.default != Some(index as u32) => Ok((index as u32, *transform)),
            _ => Err(format!("{what} refers to material {index}, which does not exist; re-export the file")),
        }
    }

    /// Whether meshes with this material need texture coordinates.
    pub fn is_textured(&self, index: u32) -> bool {
        self.materials
            .get(index as usize)
            .is_some_and(|material| material.base_color_texture.is_some() || material.emission_texture.is_some())
    }
}

pub fn load(doc: &Document, warnings: &mut Warnings) -> Checked<Materials> {
    let mut out = Materials::default();
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
        let [metallic, roughness, reflected, transmitted] = [
            unit(pbr.metallic_factor.0, "metallicFactor")?,
            unit(pbr.roughness_factor.0, "roughnessFactor")?,
            unit(specular.specular_factor.0, "specularFactor")?,
            unit(transmission.transmission_factor.0, "transmissionFactor")?,
        ];
        let strength = ext.emissive_strength.unwrap_or_default().emissive_strength.0;
        let emission = source.emissive_factor.0.map(|factor| factor * strength);
        if !emission.iter().chain([&strength]).all(|value| value.is_finite() && *value >= 0.0) {
            return Err(format!(
                "the emission of material `{name}` is negative or not finite; correct it and re-export"
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
        ignored(source.normal_texture.is_some(), "normal textures");
        ignored(pbr.metallic_roughness_texture.is_some(), "metallic-roughness textures");
        ignored(specular.specular_texture.is_some(), "specular textures");
        ignored(specular.specular_color_texture.is_some(), "specular colour textures");
        ignored(specular.specular_color_factor.0 != [1.0; 3], "specular colours");
        ignored(transmission.transmission_texture.is_some(), "transmission textures");

        let (base_color_texture, emission_texture) = self.color_textures(doc, &name, source, warnings)?;
        Ok(Material {
            base_color,
            base_color_texture,
            metallic,
            roughness,
            emission,
            emission_texture,
            specular: reflected,
            ior,
            transmission: transmitted,
            alpha_mode,
            double_sided: source.double_sided,
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

    /// Reads the base colour and emission textures of a material, and stores the transform that they share.
    fn color_textures(
        &mut self,
        doc: &Document,
        name: &str,
        source: &json::Material,
        warnings: &mut Warnings,
    ) -> Checked<(Option<u32>, Option<u32>)> {
        let mut transforms = Vec::new();
        let mut read = |info: &Option<Info>, slot: &str| -> Checked<Option<u32>> {
            let Some(info) = info else { return Ok(None) };
            let what = format!("the {slot} of material `{name}`");
            let transform = info.extensions.as_ref().and_then(|ext| ext.texture_transform.as_ref());
            if transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord) != 0 {
                warnings.once("texture coordinate sets", || {
                    format!("textures with a texture coordinate set other than 0 are not read (first: {what})")
                });
                return Ok(None);
            }
            transforms.push(transform.map_or(Ok(DAffine2::IDENTITY), |transform| affine(transform, &what))?);
            self.texture(doc, info.index.value(), &what).map(Some)
        };
        let base_color = read(&source.pbr_metallic_roughness.base_color_texture, "baseColorTexture")?;
        // The texture would multiply a black emission.
        let is_emissive = source.emissive_factor.0 != [0.0; 3];
        let emission = if is_emissive { read(&source.emissive_texture, "emissiveTexture")? } else { None };

        let first = transforms.first().copied().unwrap_or_default();
        let is_shared = transforms.iter().all(|transform| *transform == first);
        if !is_shared {
            warnings.once("texture transforms", || {
                format!("texture transforms that differ within a material are not applied (first: material `{name}`)")
            });
        }
        self.uv_transforms.push((is_shared && first != DAffine2::IDENTITY).then_some(first));
        Ok((base_color, emission))
    }

    /// Index into `textures` of the glTF texture `source`, which is added on first use.
    fn texture(&mut self, doc: &Document, source: usize, what: &str) -> Checked<u32> {
        if let Some(&known) = self.texture_of.get(&source) {
            return Ok(known);
        }
        let texture = (doc.root.textures.get(source))
            .ok_or_else(|| format!("{what} refers to texture {source}, which does not exist; re-export the file"))?;
        let number = texture.source.value();
        if number >= doc.root.images.len() {
            return Err(format!(
                "texture {source} ({what}) has no PNG or JPEG image; re-export with PNG or JPEG textures"
            ));
        }
        let mut wrap = [Wrap::Repeat; 2];
        let mut linear = true;
        if let Some(index) = texture.sampler {
            let sampler = doc.root.samplers.get(index.value()).ok_or_else(|| {
                format!(
                    "texture {source} ({what}) refers to sampler {}, which does not exist; re-export the file",
                    index.value()
                )
            })?;
            for (wrap, mode) in wrap.iter_mut().zip([&sampler.wrap_s, &sampler.wrap_t]) {
                *wrap = match mode {
                    Valid(WrappingMode::Repeat) => Wrap::Repeat,
                    Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
                    Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
                    Invalid => {
                        return Err(format!(
                            "the sampler of texture {source} ({what}) has an unknown wrap mode; re-export the file"
                        ));
                    }
                };
            }
            linear = sampler.mag_filter != Some(Valid(MagFilter::Nearest));
        }
        let image = *self.image_of.entry(number).or_insert_with(|| {
            self.images.push(number);
            self.images.len() as u32 - 1
        });
        self.textures.push(Texture { image, wrap, linear });
        self.texture_of.insert(source, self.textures.len() as u32 - 1);
        Ok(self.textures.len() as u32 - 1)
    }
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
