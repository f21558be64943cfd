//! Buffer views that EXT_meshopt_compression or KHR_meshopt_compression compresses.

use std::collections::HashMap;
use std::sync::OnceLock;

use ::gltf::json::buffer::View;
use serde::Deserialize;

use super::Checked;
use super::document::Document;
use super::meshopt::{self, Filter, Mode};
use super::resolve::{MAX_BYTES, MAX_TOTAL_BYTES};
use super::root::Root;

const EXTENSIONS: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// The extension's object in a buffer view.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Source {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: usize,
    count: u64,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

/// A compressed buffer view. It is decoded on first use. If nothing reads the view, it costs no time and its damage is no error.
pub struct Compressed {
    source: Source,
    decoded: OnceLock<Checked<Vec<u8>>>,
}

/// The compressed buffer views of a file, by their index. Fails if one is too large, or its size, mode or filter is not valid.
pub fn views(root: &Root) -> Checked<HashMap<usize, Compressed>> {
    let mut total = 0u64;
    let mut views = HashMap::new();
    for (index, view) in root.buffer_views.iter().enumerate() {
        let Some(source) = source(view, index)? else { continue };
        let size = source.count.checked_mul(source.byte_stride as u64);
        if size != Some(view.byte_length.0) {
            return Err(format!(
                "bufferView {index} has {} bytes, but is compressed from {} elements of {} bytes; re-export the file",
                view.byte_length.0, source.count, source.byte_stride
            ));
        }
        total = total.saturating_add(view.byte_length.0);
        if view.byte_length.0 > MAX_BYTES || total > MAX_TOTAL_BYTES {
            return Err(format!(
                "bufferView {index} has too much data: at most 1 GiB per view and 4 GiB in total are decompressed; split the scene"
            ));
        }
        if !meshopt::is_valid(source.mode, source.filter, source.count as usize, source.byte_stride) {
            return Err(format!(
                "bufferView {index} cannot be compressed in mode {:?} with filter {:?}, {} elements of {} bytes; re-export the file",
                source.mode, source.filter, source.count, source.byte_stride
            ));
        }
        views.insert(index, Compressed { source, decoded: OnceLock::new() });
    }
    Ok(views)
}

fn source(view: &View, index: usize) -> Checked<Option<Source>> {
    let Some(extensions) = &view.extensions else { return Ok(None) };
    let object = EXTENSIONS.iter().find_map(|name| extensions.others.get(*name));
    object
        .map(Source::deserialize)
        .transpose()
        .map_err(|e| format!("the compression of bufferView {index} cannot be read ({e}); re-export the file"))
}

/// Whether a buffer is only a placeholder for data that is compressed in another buffer.
pub fn is_fallback(buffer: &::gltf::json::Buffer) -> bool {
    let extensions = buffer.extensions.as_ref().map(|extensions| &extensions.others);
    let tag = |name: &&str| extensions?.get(*name)?.get("fallback")?.as_bool();
    EXTENSIONS.iter().find_map(tag) == Some(true)
}

impl Compressed {
    /// The decompressed bytes. `name` names the buffer view in messages.
    pub fn bytes(&self, doc: &Document, name: &str) -> Checked<&[u8]> {
        let decode = || {
            let Source { buffer, byte_offset, byte_length, byte_stride, count, mode, filter } = self.source;
            let stream = doc.slice(buffer, byte_offset, byte_length, name)?;
            meshopt::decode(mode, filter, count as usize, byte_stride, stream).ok_or_else(|| {
                format!("{name} has damaged meshopt data; compress the file again, or export it without compression")
            })
        };
        self.decoded.get_or_init(decode).as_deref().map_err(Clone::clone)
    }
}
