//! The textures of one material: the texture coordinates that they share, and the transform of each.

use ::gltf::json::extensions::texture::{Info as TextureExtensions, TextureTransform};
use ::gltf::json::material::NormalTexture;
use ::gltf::json::texture::Info;
use glam::{DAffine2, DMat2, DVec2};

use super::Checked;
use super::document::{Document, Warnings};
use super::texture::{Channels, Textures};

/// The texture coordinates that a material needs.
#[derive(Debug, Clone, Copy, Default)]
pub struct UvMapping {
    /// The number of the set: TEXCOORD_0, TEXCOORD_1 and so on.
    pub set: u32,
    /// Applied to the coordinates of the meshes. The textures apply their own transforms to the result.
    pub transform: Option<DAffine2>,
}

/// A reference of a material to a texture.
pub struct TextureUse {
    /// Index of the glTF texture.
    index: usize,
    set: u32,
    /// KHR_texture_transform.
    transform: DAffine2,
    channels: Channels,
    /// The user in messages: `the baseColorTexture of material ...`.
    what: String,
}

impl TextureUse {
    /// `slot` is the key of the reference in the file.
    pub fn new(info: &Info, channels: Channels, slot: &str, material: &str) -> Checked<TextureUse> {
        let what = format!("the {slot} of material `{material}`");
        let transform = info.extensions.as_ref().and_then(|ext| ext.texture_transform.as_ref());
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
        let transform = transform.map_or(Ok(DAffine2::IDENTITY), |transform| affine(transform, &what))?;
        Ok(TextureUse { index: info.index.value(), set, transform, channels, what })
    }
}

/// The reference of `material` to its normal map, without the scale.
pub fn as_info(normal: &NormalTexture, material: &str) -> Checked<Info> {
    let transform = normal.extensions.as_ref().and_then(|extensions| extensions.others.get("KHR_texture_transform"));
    let transform = transform.map(|transform| serde_json::from_value(transform.clone())).transpose().map_err(|e| {
        format!(
            "the KHR_texture_transform of the normalTexture of material `{material}` is invalid: {e}; correct it and re-export"
        )
    })?;
    let extensions = TextureExtensions { texture_transform: transform, ..TextureExtensions::default() };
    let (index, tex_coord) = (normal.index, normal.tex_coord);
    Ok(Info { index, tex_coord, extensions: Some(extensions), extras: Default::default() })
}

/// Adds the textures of material `name`; returns their indices into `textures.list`, and the coordinates that its meshes need.
/// `normal` is the index of the normal map in `uses`. Tangents follow the coordinates of the meshes, so the meshes get the
/// coordinates of the normal map.
pub fn add_all<const N: usize>(
    mut uses: [Option<TextureUse>; N],
    normal: usize,
    name: &str,
    doc: &Document,
    textures: &mut Textures,
    warnings: &mut Warnings,
) -> Checked<([Option<u32>; N], UvMapping)> {
    let set = uses.iter().flatten().next().map_or(0, |first| first.set);
    for slot in &mut uses {
        if let Some(other) = slot.take_if(|texture| texture.set != set) {
            warnings.once("texture coordinate sets", || {
                format!(
                    "textures with another texture coordinate set than the first texture of the material are not read \
                     (first: {})",
                    other.what
                )
            });
        }
    }
    let transforms = || uses.iter().flatten().map(|texture| texture.transform);
    let of_meshes = uses[normal].as_ref().map(|map| map.transform).or_else(|| transforms().next()).unwrap_or_default();
    // If the transform of the meshes cannot be inverted, each texture applies its own transform. Equal transforms need no inverse.
    let fits = transforms().all(|transform| is_moderate(&relative(transform, of_meshes)));
    let of_meshes = if fits { of_meshes } else { DAffine2::IDENTITY };
    if !transforms().all(|transform| is_moderate(&relative(transform, of_meshes))) {
        return Err(format!(
            "the texture transforms of material `{name}` differ by more than a factor of {MAX_TRANSFORM}; use smaller scales \
             and offsets, and re-export"
        ));
    }
    let mut indices = [None; N];
    for (index, texture) in indices.iter_mut().zip(&uses) {
        if let Some(TextureUse { index: source, transform, channels, what, .. }) = texture {
            let own = relative(*transform, of_meshes);
            *index = Some(textures.add(doc, *source, own, *channels, what, warnings)?);
        }
    }
    let transform = (of_meshes != DAffine2::IDENTITY).then_some(of_meshes);
    Ok((indices, UvMapping { set, transform }))
}

/// Maximum entry of a transform that a texture applies itself. The device computes it in f32.
const MAX_TRANSFORM: f64 = 1e6;

fn is_moderate(transform: &DAffine2) -> bool {
    transform.to_cols_array().iter().all(|entry| entry.abs() <= MAX_TRANSFORM)
}

/// The transform from coordinates after `first` to coordinates after `transform`.
fn relative(transform: DAffine2, first: DAffine2) -> DAffine2 {
    if transform == first { DAffine2::IDENTITY } else { transform * first.inverse() }
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
