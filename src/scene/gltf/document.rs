//! The parsed file: JSON, buffers, names for messages, and the warnings about the file.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use super::compressed::{self, Compressed};
use super::draco::DracoMeshes;
use super::resolve::Folders;
use super::root::Root;
use super::{Checked, lists, morph, resolve, text};
use crate::printable::is_command;

/// A glTF file with its buffers in memory. Nothing in `root` is trusted: callers use `get` for look-ups and checked arithmetic.
pub struct Document<'a> {
    pub root: Root,
    /// `None` for a buffer without data of its own.
    buffers: Vec<Option<Cow<'a, [u8]>>>,
    /// Number of bytes of all buffers together.
    pub buffer_bytes: u64,
    /// By buffer view.
    compressed: HashMap<usize, Compressed>,
    pub draco: DracoMeshes,
    /// Index of the first mesh with a morph target that moves colours or texture coordinates. This motion is ignored.
    pub first_mesh_morphing_colors: Option<usize>,
}

/// The bytes of a buffer view, decompressed if the view is compressed.
pub struct View<'a> {
    pub bytes: &'a [u8],
    pub stride: Option<usize>,
}

impl<'a> Document<'a> {
    pub fn open(bytes: &'a [u8], folders: Folders) -> Checked<Self> {
        let (json, bin) = resolve::split_container(bytes)?;
        lists::check(json)?;
        let json = &*text::normalised(json)?;
        let root: Root = serde_json::from_slice(json).map_err(|e| {
            // The JSON of glTF 1.0 has another structure, so the parser fails before the version can be checked.
            if is_gltf_1(json) {
                return "is glTF version 1.0; re-export it as glTF 2.0".into();
            }
            format!("is not valid glTF 2.0 ({}); re-export it", printable(&e.to_string(), 200))
        })?;
        let asset = &root.asset;
        let is_readable =
            asset.min_version.as_ref().map_or(asset.version.starts_with("2."), |min_version| min_version == "2.0");
        if !is_readable {
            let version = printable(asset.min_version.as_ref().unwrap_or(&asset.version), 20);
            return Err(format!("is glTF version {version}; re-export it as glTF 2.0"));
        }
        let buffers = resolve::buffers(&root, bin, folders)?;
        let buffer_bytes = buffers.iter().flatten().map(|buffer| buffer.len() as u64).sum();
        let compressed = compressed::views(&root)?;
        let draco = DracoMeshes::find(&root)?;
        let has_targets =
            root.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|primitive| primitive.targets.is_some());
        let first_mesh_morphing_colors = if has_targets { morph::first_with_colors(json) } else { None };
        Ok(Self { root, buffers, buffer_bytes, compressed, draco, first_mesh_morphing_colors })
    }

    /// The bytes of buffer view `index`; `what` names the object that refers to it in messages.
    pub fn view(&self, index: usize, what: &str) -> Checked<View<'_>> {
        let view = (self.root.buffer_views.get(index))
            .ok_or_else(|| format!("{what} refers to bufferView {index}, which does not exist; re-export the file"))?;
        let name = format!("bufferView {index} ({what})");
        let bytes = match self.compressed.get(&index) {
            Some(compressed) => compressed.bytes(self, &name)?,
            None => {
                self.slice(view.buffer.value(), view.byte_offset.unwrap_or_default().0, view.byte_length.0, &name)?
            }
        };
        Ok(View { bytes, stride: view.byte_stride.map(|stride| stride.0) })
    }

    /// `length` bytes of buffer `number` from `start`. In messages, `name` names the object that refers to the bytes.
    pub fn slice(&self, number: usize, start: u64, length: u64, name: &str) -> Checked<&[u8]> {
        let buffer = self
            .buffers
            .get(number)
            .ok_or_else(|| format!("{name} refers to buffer {number}, which does not exist; re-export the file"))?;
        let buffer = buffer
            .as_ref()
            .ok_or_else(|| format!("{name} refers to buffer {number}, which has no data; re-export the file"))?;
        (start.checked_add(length))
            .and_then(|end| buffer.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?))
            .ok_or_else(|| format!("{name} reaches beyond the end of buffer {number}; re-export the file"))
    }

    /// The node's name; `node 17` if node 17 has no name.
    pub fn node_name(&self, index: usize) -> String {
        label(self.root.nodes.get(index).and_then(|node| node.name.as_deref()), "node", index)
    }
}

/// Whether JSON that is not glTF 2.0 says that it is glTF 1.
fn is_gltf_1(json: &[u8]) -> bool {
    #[derive(serde::Deserialize)]
    struct Asset {
        version: serde_json::Value,
    }
    #[derive(serde::Deserialize)]
    struct Header {
        asset: Asset,
    }
    // Some early exporters wrote the version as a number.
    serde_json::from_slice::<Header>(json).is_ok_and(|Header { asset: Asset { version } }| {
        version == 1 || version.as_str().is_some_and(|version| version.starts_with("1."))
    })
}

/// A name for messages and look-up: the name in the file, otherwise kind and index.
pub fn label(name: Option<&str>, kind: &str, index: usize) -> String {
    match name {
        Some(name) if !name.is_empty() => printable(name, 120),
        _ => format!("{kind} {index}"),
    }
}

/// The names of all objects of a kind so far. Each has the last number that was tried after it, or 1 if none was tried.
#[derive(Default)]
pub struct DistinctNames(HashMap<String, u32>);

impl DistinctNames {
    /// Returns `name`, with a number if an earlier object has that name: `eye`, `eye#2`, `eye#3`.
    pub fn distinct(&mut self, name: String) -> String {
        let mut own = name.clone();
        while self.0.contains_key(&own) {
            let count = self.0.entry(name.clone()).or_default();
            *count += 1;
            own = format!("{name}#{count}");
        }
        self.0.insert(own.clone(), 1);
        own
    }
}

/// The first `limit` characters of `text`. Characters that may control a terminal are replaced, because names come from the file
/// and go to a terminal.
pub fn printable(text: &str, limit: usize) -> String {
    text.chars().take(limit).map(|c| if is_command(c) { '\u{fffd}' } else { c }).collect()
}

/// `value` if it is a finite number, otherwise an error that names `what`.
pub fn finite(value: f32, what: &str) -> Checked<f32> {
    if value.is_finite() { Ok(value) } else { Err(format!("{what} is not a finite number; correct it and re-export")) }
}

/// Warnings about features of the file that are ignored, changed or doubtful.
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
