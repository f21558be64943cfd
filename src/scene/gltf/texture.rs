//! Reads textures: their sampler, and the image that they show.

use std::collections::HashMap;

use ::gltf::json;
use ::gltf::json::texture::{MagFilter, WrappingMode};
use ::gltf::json::validation::Checked::{Invalid, Valid};
use glam::DAffine2;
use serde_json::Value;

use super::Checked;
use super::document::{Document, Warnings};
use super::root::Root;
use crate::scene::{Texture, Wrap};

/// The extension that gives a texture a WebP image.
const WEBP: &str = "EXT_texture_webp";
/// Extensions that give a texture an image in a format that taugate does not read, and the remedy.
const UNREAD: [(&str, &str); 3] =
    [("KHR_texture_basisu", FROM_KTX2), ("EXT_texture_avif", FROM_AVIF), ("MSFT_texture_dds", FROM_OTHERS)];

/// Remedies for images in formats that taugate does not read.
pub const FROM_KTX2: &str =
    "install KTX-Software and convert the file: npx @gltf-transform/cli ktxdecompress IN.glb OUT.glb";
pub const FROM_AVIF: &str = "convert the file: npx @gltf-transform/cli png --formats avif IN.glb OUT.glb";
pub const FROM_OTHERS: &str = "re-export with PNG, JPEG or WebP textures";

/// What the channels of a texture mean to the material.
#[derive(Debug, Clone, Copy)]
pub enum Channels {
    /// The renderer reads them as the file stores them.
    Stored,
    /// Alpha multiplies this glossiness. The texels are converted to those of a metallic-roughness texture: green is 1 minus the
    /// glossiness, blue is white.
    Glossiness(f32),
}

/// An image that a material uses.
pub struct ImageUse {
    /// Index of the glTF image.
    pub index: usize,
    pub channels: Channels,
    /// Its first user, for messages: `the baseColorTexture of material ...`.
    pub what: String,
}

/// The textures that materials use, and the images of these textures.
pub struct Textures {
    pub list: Vec<Texture>,
    /// The source of each [`crate::scene::Image`].
    pub images: Vec<ImageUse>,
    /// Maps the glTF index of a texture, its transform and its index into `images` to an index into `list`.
    texture_of: HashMap<(usize, [u64; 6], u32), u32>,
    /// Maps the glTF index of an image and the bits of its [`Channels::Glossiness`] to an index into `images`.
    image_of: HashMap<(usize, Option<u32>), u32>,
    /// For each glTF image, the first glTF image with the same data.
    first_alike: Vec<usize>,
}

impl Textures {
    pub fn new(doc: &Document) -> Textures {
        Textures {
            list: vec![],
            images: vec![],
            texture_of: HashMap::new(),
            image_of: HashMap::new(),
            first_alike: first_alike(&doc.root),
        }
    }

    /// Index into `list` of the glTF texture `source` with this transform. The first use adds the texture to `list`. `what` names
    /// the user in messages.
    pub fn add(
        &mut self,
        doc: &Document,
        source: usize,
        transform: DAffine2,
        channels: Channels,
        what: &str,
        warnings: &mut Warnings,
    ) -> Checked<u32> {
        let texture = (doc.root.textures.get(source))
            .ok_or_else(|| format!("{what} refers to texture {source}, which does not exist; re-export the file"))?;
        let number = self.first_alike[image_index(doc, source, texture, what, warnings)?];
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
        let image = self.image(number, channels, what);
        let key = (source, transform.to_cols_array().map(f64::to_bits), image);
        Ok(*self.texture_of.entry(key).or_insert_with(|| {
            self.list.push(Texture { image, wrap, linear, transform });
            self.list.len() as u32 - 1
        }))
    }

    /// Index into `images` of the glTF image `index`. The first use adds it to `images`.
    fn image(&mut self, index: usize, channels: Channels, what: &str) -> u32 {
        let glossiness = match channels {
            Channels::Stored => None,
            Channels::Glossiness(factor) => Some(factor.to_bits()),
        };
        *self.image_of.entry((index, glossiness)).or_insert_with(|| {
            self.images.push(ImageUse { index, channels, what: what.into() });
            self.images.len() as u32 - 1
        })
    }
}

/// The glTF index of the image that the texture with index `source` shows: its WebP image if it has one, otherwise its PNG or
/// JPEG image. Fails if there is no such image.
fn image_index(
    doc: &Document,
    source: usize,
    texture: &json::Texture,
    what: &str,
    warnings: &mut Warnings,
) -> Checked<usize> {
    let extension = |name: &str| texture.extensions.as_ref().and_then(|extensions| extensions.others.get(name));
    let webp = extension(WEBP).and_then(|webp| webp.get("source")).and_then(Value::as_u64);
    let unread = UNREAD.iter().find(|(name, _)| extension(name).is_some());
    let index = webp.map_or(texture.source.value(), |index| usize::try_from(index).unwrap_or(usize::MAX));
    if index >= doc.root.images.len() {
        let remedy = unread.map_or(FROM_OTHERS, |(_, remedy)| *remedy);
        return Err(format!("texture {source} ({what}) has no PNG, JPEG or WebP image; {remedy}"));
    }
    if let (None, Some((name, _))) = (webp, unread) {
        warnings.once("texture formats", || {
            format!("textures with {name} show their PNG or JPEG image instead (first: {what})")
        });
    }
    Ok(index)
}

/// For each glTF image, the index of the first image that refers to the same bytes or the same URI.
fn first_alike(root: &Root) -> Vec<usize> {
    #[derive(PartialEq, Eq, Hash)]
    enum Data<'a> {
        /// Buffer, offset and length.
        Bytes(usize, u64, u64),
        Uri(&'a str),
        Unknown(usize),
    }
    let mut first = HashMap::new();
    let alike = root.images.iter().enumerate().map(|(index, image)| {
        let view = image.buffer_view.as_ref().and_then(|view| root.buffer_views.get(view.value()));
        let data = match (view, &image.uri) {
            (Some(view), _) => {
                Data::Bytes(view.buffer.value(), view.byte_offset.unwrap_or_default().0, view.byte_length.0)
            }
            (None, Some(uri)) if image.buffer_view.is_none() => Data::Uri(uri),
            _ => Data::Unknown(index),
        };
        *first.entry(data).or_insert(index)
    });
    alike.collect()
}
