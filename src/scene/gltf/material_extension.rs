//! Extensions of materials that the `gltf` crate does not parse.

use ::gltf::json::material::NormalTexture;
use ::gltf::json::texture::Info;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::Checked;
use super::texture::Channels;
use super::texture_use::TextureUse;

/// KHR_materials_clearcoat. By default there is no clear coat.
#[derive(Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Clearcoat {
    pub clearcoat_factor: f32,
    pub clearcoat_texture: Option<Info>,
    pub clearcoat_roughness_factor: f32,
    pub clearcoat_roughness_texture: Option<Info>,
    pub clearcoat_normal_texture: Option<NormalTexture>,
}

/// KHR_materials_pbrSpecularGlossiness, which replaces the metallic-roughness values of a material.
#[derive(serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct SpecularGlossiness {
    pub diffuse_factor: [f32; 4],
    /// sRGB colour and linear alpha.
    pub diffuse_texture: Option<Info>,
    /// Reflectance at normal incidence.
    pub specular_factor: [f32; 3],
    /// 1 - roughness.
    pub glossiness_factor: f32,
    /// The sRGB colour multiplies `specular_factor`; the linear alpha multiplies `glossiness_factor`.
    pub specular_glossiness_texture: Option<Info>,
}

impl Default for SpecularGlossiness {
    fn default() -> SpecularGlossiness {
        SpecularGlossiness {
            diffuse_factor: [1.0; 4],
            diffuse_texture: None,
            specular_factor: [1.0; 3],
            glossiness_factor: 1.0,
            specular_glossiness_texture: None,
        }
    }
}

impl SpecularGlossiness {
    /// Index of refraction of the coat. Its reflectance at normal incidence is almost 1, so that a specular colour of at most 1
    /// can set any reflectance. glTF-Transform converts materials in the same way.
    pub const IOR: f32 = 1000.0;

    /// The specularColorFactor of KHR_materials_specular with which a coat of index [`Self::IOR`] reflects `specular`.
    pub fn specular_color(specular: [f32; 3]) -> [f32; 3] {
        let white = ((Self::IOR - 1.0) / (Self::IOR + 1.0)).powi(2);
        specular.map(|factor| factor / white)
    }

    /// The textures of base colour, of roughness, and of specular colour. A texture that multiplies a factor of 0 is left out.
    pub fn textures(&self, glossiness: f32, specular: &[f32; 3], material: &str) -> Checked<[Option<TextureUse>; 3]> {
        let read = |info: Option<&Info>, channels: Channels, slot: &str| {
            info.map(|info| TextureUse::new(info, channels, slot, material)).transpose()
        };
        let (texture, slot) = (self.specular_glossiness_texture.as_ref(), "specularGlossinessTexture");
        Ok([
            read(self.diffuse_texture.as_ref(), Channels::Stored, "diffuseTexture")?,
            read(texture.filter(|_| glossiness > 0.0), Channels::Glossiness(glossiness), slot)?,
            read(texture.filter(|_| *specular != [0.0; 3]), Channels::Stored, slot)?,
        ])
    }
}

/// The extension `extension` of the material `material`, if it has one.
pub fn read<T: DeserializeOwned>(
    extensions: &Map<String, Value>,
    extension: &str,
    material: &str,
) -> Checked<Option<T>> {
    let Some(value) = extensions.get(extension) else { return Ok(None) };
    (serde_json::from_value(value.clone()).map(Some))
        .map_err(|e| format!("the {extension} of material `{material}` is invalid: {e}; correct it and re-export"))
}
