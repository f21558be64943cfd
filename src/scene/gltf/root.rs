//! The top level of glTF's JSON.

use ::gltf::json::extensions::root::Root as Extensions;
use ::gltf::json::extensions::scene::khr_lights_punctual::Light;
use ::gltf::json::texture::Sampler;
use ::gltf::json::{
    Accessor, Asset, Buffer, Camera, Extras, Image, Index, Material, Mesh, Node, Skin, Texture, buffer::View,
};
use serde::Deserialize;
use serde_json::value::RawValue;

use super::document::{DistinctNames, label};

/// The lists that taugate reads, with the elements of the `gltf` crate. The crate's own `Root` also parses parts that taugate
/// does not read, so it refuses some valid files: animations that target pointers, and scenes without nodes.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Root {
    pub asset: Asset,
    #[serde(default)]
    pub scene: Option<Index<Scene>>,
    #[serde(default)]
    pub scenes: Vec<Scene>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub skins: Vec<Skin>,
    #[serde(default)]
    pub cameras: Vec<Camera>,
    #[serde(default)]
    pub materials: Vec<Material>,
    #[serde(default)]
    pub textures: Vec<Texture>,
    #[serde(default)]
    pub samplers: Vec<Sampler>,
    #[serde(default)]
    pub images: Vec<Image>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    pub buffer_views: Vec<View>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
    /// Only played animations are parsed: as [`serde_json::Value`] they would take up to 90 times the memory of their text.
    #[serde(default)]
    pub animations: Vec<Box<RawValue>>,
    #[serde(default)]
    pub extensions: Option<Extensions>,
    #[serde(default)]
    pub extensions_used: Vec<String>,
    #[serde(default)]
    pub extensions_required: Vec<String>,
}

/// A glTF scene. Unlike the crate's struct, it may be empty.
#[derive(Deserialize)]
pub struct Scene {
    #[serde(default)]
    pub nodes: Vec<Index<Node>>,
    #[serde(default)]
    pub extras: Extras,
}

impl Root {
    /// The lights of KHR_lights_punctual; nodes refer to them.
    pub fn lights(&self) -> &[Light] {
        let extension = self.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        extension.map_or(&[], |extension| &extension.lights)
    }

    /// The labels of the animations, in the order of the file. If several animations are called `walk`, the second is `walk#2`.
    pub fn animation_labels(&self) -> Vec<String> {
        #[derive(Deserialize)]
        struct Named {
            name: String,
        }
        let name = |json: &RawValue| Some(serde_json::from_str::<Named>(json.get()).ok()?.name);
        let animations = self.animations.iter().enumerate();
        let mut names = DistinctNames::default();
        animations.map(|(number, json)| names.distinct(label(name(json).as_deref(), "animation", number))).collect()
    }
}
