//! The parsed file: JSON, buffers, names for messages, and the warnings about ignored features.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::Path;

use ::gltf::json::Root;

use super::{Checked, light, material, resolve};

pub const MAX_NODES: usize = 1_000_000;

/// Whether taugate reads the extension. Any other extension gives a warning in `extensionsUsed`, an error in
/// `extensionsRequired`.
fn is_read(extension: &str) -> bool {
    extension == light::EXTENSION || material::EXTENSIONS.contains(&extension)
}

/// A glTF file with its buffers in memory. Nothing in `root` is trusted: callers use `get` for look-ups and checked arithmetic.
pub struct Document<'a> {
    pub root: Root,
    buffers: Vec<Cow<'a, [u8]>>,
}

/// The bytes of a buffer view; they lie inside their buffer.
pub struct View<'a> {
    pub bytes: &'a [u8],
    pub stride: Option<usize>,
}

impl<'a> Document<'a> {
    pub fn open(bytes: &'a [u8], folder: &Path) -> Checked<Self> {
        let (json, bin) = resolve::split_container(bytes)?;
        let root: Root = ::gltf::json::deserialize::from_slice(json)
            .map_err(|e| format!("is not valid glTF 2.0 ({}); re-export it", printable(&e.to_string(), 200)))?;
        let asset = &root.asset;
        let is_readable =
            asset.min_version.as_ref().map_or(asset.version.starts_with("2."), |min_version| min_version == "2.0");
        if !is_readable {
            let version = printable(asset.min_version.as_ref().unwrap_or(&asset.version), 20);
            return Err(format!("is glTF version {version}; re-export it as glTF 2.0"));
        }
        if root.nodes.len() > MAX_NODES {
            return Err(format!("has more than {MAX_NODES} nodes; merge meshes before exporting"));
        }
        let buffers = resolve::buffers(&root, bin, folder)?;
        Ok(Self { root, buffers })
    }

    /// Refuses a file that requires an extension which taugate does not read; warns about optional extensions of that kind.
    pub fn check_extensions(&self, warnings: &mut Warnings) -> Checked<()> {
        if let Some(name) = self.root.extensions_required.iter().find(|name| !is_read(name)) {
            let remedy = match name.as_str() {
                "KHR_draco_mesh_compression" => "re-export without Draco compression",
                "EXT_meshopt_compression" | "KHR_meshopt_compression" => "re-export without meshopt compression",
                "KHR_mesh_quantization" => "re-export without quantization (gltfpack: -noq)",
                "KHR_texture_basisu" | "EXT_texture_webp" | "EXT_texture_avif" => "re-export with PNG or JPEG textures",
                _ => "re-export without it",
            };
            return Err(format!(
                "requires the extension {}, which taugate does not read; {remedy}",
                printable(name, 80)
            ));
        }
        let mut unread: Vec<String> = Vec::new();
        for name in self.root.extensions_used.iter().filter(|name| !is_read(name)) {
            let name = printable(name, 80);
            if unread.len() < 20 && !unread.contains(&name) {
                warnings.push(format!("the extension {name} is not read"));
                unread.push(name);
            }
        }
        Ok(())
    }

    /// Warns about fog, which is described in the extras of scenes and not rendered yet.
    pub fn warn_of_media(&self, warnings: &mut Warnings) {
        #[derive(serde::Deserialize)]
        struct SceneExtras {
            medium: Option<serde::de::IgnoredAny>,
        }
        let extras = self.root.scenes.iter().filter_map(|scene| scene.extras.as_ref());
        if extras.filter_map(|e| serde_json::from_str::<SceneExtras>(e.get()).ok()).any(|e| e.medium.is_some()) {
            warnings
                .push("the medium (fog) of the scene is not rendered yet; surfaces are shown as in clear air".into());
        }
    }

    /// The bytes of buffer view `index`; `what` names the object that refers to it in messages.
    pub fn view(&self, index: usize, what: &str) -> Checked<View<'_>> {
        let view = (self.root.buffer_views.get(index))
            .ok_or_else(|| format!("{what} refers to bufferView {index}, which does not exist; re-export the file"))?;
        let number = view.buffer.value();
        let buffer = self.buffers.get(number).ok_or_else(|| {
            format!("bufferView {index} ({what}) refers to buffer {number}, which does not exist; re-export the file")
        })?;
        let start = view.byte_offset.unwrap_or_default().0;
        let bytes = (start.checked_add(view.byte_length.0))
            .and_then(|end| buffer.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?))
            .ok_or_else(|| {
                format!("bufferView {index} ({what}) reaches beyond the end of buffer {number}; re-export the file")
            })?;
        Ok(View { bytes, stride: view.byte_stride.map(|stride| stride.0) })
    }

    /// The node's name; `node 17` if node 17 has no name.
    pub fn node_name(&self, index: usize) -> String {
        label(self.root.nodes.get(index).and_then(|node| node.name.as_deref()), "node", index)
    }
}

/// A name for messages and look-up: the name in the file, otherwise kind and index.
pub fn label(name: Option<&str>, kind: &str, index: usize) -> String {
    match name {
        Some(name) if !name.is_empty() => printable(name, 120),
        _ => format!("{kind} {index}"),
    }
}

/// The first `limit` characters of `text`, with control characters replaced: names come from the file and go to a terminal.
pub fn printable(text: &str, limit: usize) -> String {
    text.chars().take(limit).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

/// `value` if it is a finite number, otherwise an error that names `what`.
pub fn finite(value: f32, what: &str) -> Checked<f32> {
    if value.is_finite() { Ok(value) } else { Err(format!("{what} is not a finite number; correct it and re-export")) }
}

/// Warnings about features of the file that are ignored.
#[derive(Default)]
pub struct Warnings {
    pub list: Vec<String>,
    seen: BTreeSet<&'static str>,
}

impl Warnings {
    pub fn push(&mut self, message: String) {
        self.list.push(message);
    }

    /// Adds a warning unless `key` already has one: a feature gives one sentence, however many materials use it.
    pub fn once(&mut self, key: &'static str, message: impl FnOnce() -> String) {
        if self.seen.insert(key) {
            self.list.push(message());
        }
    }
}
