//! Sources of bytes: the GLB container, `data:` URIs, and files beside the scene.

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::compressed::is_fallback;
use super::document::printable;
use super::root::Root;
use super::{Checked, lists, text};

/// Maximum size of a file or a buffer in bytes.
pub const MAX_BYTES: u64 = 1 << 30;
/// Maximum size of all buffers together in bytes: many buffers may name the same file.
pub const MAX_TOTAL_BYTES: u64 = 4 << 30;

/// The folders from which a scene may read files.
#[derive(Debug, Clone, Copy)]
pub struct Folders<'a> {
    of_scene: &'a Path,
    /// Folders that the user allows as well.
    allowed: &'a [PathBuf],
}

impl<'a> Folders<'a> {
    /// The folder of the file `scene`, and those that the user allows.
    pub fn new(scene: &'a Path, allowed: &'a [PathBuf]) -> Folders<'a> {
        let folder = scene.parent().filter(|folder| !folder.as_os_str().is_empty());
        Folders { of_scene: folder.unwrap_or(Path::new(".")), allowed }
    }
}

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The JSON chunk, and the BIN chunk of a GLB that has one. The parser of the `gltf` crate is not used: it underflows on short
/// lengths.
pub fn split_container(bytes: &[u8]) -> Checked<(&[u8], Option<&[u8]>)> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        return Ok((unpadded(text), None));
    };
    let truncated = || "is a truncated GLB file; copy or export it again".to_string();
    let (version, rest) = u32_le(rest).ok_or_else(truncated)?;
    if version != 2 {
        return Err(format!("is GLB version {version}; re-export it as glTF 2.0"));
    }
    let (length, rest) = u32_le(rest).ok_or_else(truncated)?;
    let mut rest = (length as usize).checked_sub(12).and_then(|length| rest.get(..length)).ok_or_else(truncated)?;
    let (mut json, mut bin) = (None, None);
    while !rest.is_empty() {
        let (length, after) = u32_le(rest).ok_or_else(truncated)?;
        let (kind, after) = u32_le(after).ok_or_else(truncated)?;
        let (chunk, after) = after.split_at_checked(length as usize).ok_or_else(truncated)?;
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if json.is_some() && bin.is_none() => bin = Some(chunk),
            _ if json.is_none() => return Err("is a GLB file that does not begin with JSON; re-export it".into()),
            _ => {}
        }
        rest = after;
    }
    Ok((unpadded(json.ok_or_else(truncated)?), bin))
}

/// `json` without NUL bytes at its end: some exporters pad the chunk with them instead of spaces.
fn unpadded(json: &[u8]) -> &[u8] {
    let end = json.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    &json[..end]
}

fn u32_le(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (head, rest) = bytes.split_first_chunk::<4>()?;
    Some((u32::from_le_bytes(*head), rest))
}

/// All buffers of the file, each cut to its `byteLength`. `None` for a buffer without data: a placeholder for data that is compressed
/// in another buffer.
pub fn buffers<'a>(root: &Root, bin: Option<&'a [u8]>, folders: Folders) -> Checked<Vec<Option<Cow<'a, [u8]>>>> {
    let mut total = 0u64;
    let mut buffers = Vec::with_capacity(root.buffers.len());
    for (index, buffer) in root.buffers.iter().enumerate() {
        let bin = bin.filter(|_| index == 0);
        if is_fallback(buffer) || (buffer.uri.is_none() && bin.is_none()) {
            buffers.push(None);
            continue;
        }
        let length = buffer.byte_length.0;
        total = total.saturating_add(length);
        if length > MAX_BYTES {
            return Err(format!("buffer {index} is larger than 1 GiB; split the scene"));
        }
        if total > MAX_TOTAL_BYTES {
            return Err("the buffers are larger than 4 GiB in total; split the scene".into());
        }
        let bytes = match &buffer.uri {
            Some(uri) => Cow::Owned(uri_bytes(uri, folders, &format!("buffer {index}"))?),
            None => Cow::Borrowed(bin.unwrap_or_default()),
        };
        let bytes = cut(bytes, length as usize).ok_or_else(|| {
            format!("buffer {index} should have {length} bytes but its data is shorter; copy or export the file again")
        })?;
        buffers.push(Some(bytes));
    }
    Ok(buffers)
}

/// The contents of the files that the buffers and images of a scene name. A file that cannot be read gives an empty entry; an
/// unreadable scene gives an empty list.
pub fn external(bytes: &[u8], folders: Folders) -> Vec<Vec<u8>> {
    external_uris(bytes).iter().map(|uri| uri_bytes(uri, folders, "the scene").unwrap_or_default()).collect()
}

/// The paths of the files that [`external`] reads. A file that may not be read is left out.
pub fn external_paths(bytes: &[u8], folders: Folders) -> Vec<PathBuf> {
    let uris = external_uris(bytes);
    uris.iter().filter_map(|uri| Some(folders.of_scene.join(relative_name(uri, folders).ok()?))).collect()
}

fn external_uris(bytes: &[u8]) -> Vec<String> {
    let json = split_container(bytes).ok().map(|(json, _)| json).filter(|json| lists::check(json).is_ok());
    let json = json.and_then(|json| text::normalised(json).ok());
    let Some(root) = json.and_then(|json| serde_json::from_slice::<Root>(&json).ok()) else { return vec![] };
    let buffers = root.buffers.into_iter().filter_map(|buffer| buffer.uri);
    let images = root.images.into_iter().filter_map(|image| image.uri);
    buffers.chain(images).filter(|uri| !is_data(uri)).collect()
}

/// Whether the URI contains its data.
pub fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

fn cut(bytes: Cow<'_, [u8]>, length: usize) -> Option<Cow<'_, [u8]>> {
    match bytes {
        Cow::Borrowed(bytes) => bytes.get(..length).map(Cow::Borrowed),
        Cow::Owned(bytes) if bytes.len() < length => None,
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Some(Cow::Owned(bytes))
        }
    }
}

/// The bytes of a `data:` URI, or of the file that a relative URI names. `what` names the object that refers to the URI in
/// messages.
pub fn uri_bytes(uri: &str, folders: Folders, what: &str) -> Checked<Vec<u8>> {
    if is_data(uri) {
        let (head, data) =
            uri.split_once(',').ok_or_else(|| format!("the data URI of {what} has no comma; re-export"))?;
        if !head.to_ascii_lowercase().ends_with(";base64") {
            return Err(format!("the data URI of {what} is not base64; re-export the file as .glb"));
        }
        return BASE64
            .decode(data)
            .map_err(|e| format!("the data URI of {what} is not valid base64 ({e}); re-export the file as .glb"));
    }
    let shown = printable(uri, 120);
    let name = relative_name(uri, folders).map_err(|why| {
        format!("{what} refers to `{shown}`, which {why}; put the file beside the scene, or re-export as .glb")
    })?;
    let missing = |e: std::io::Error| {
        format!("{what} refers to `{shown}`, which cannot be opened ({e}); put the file beside the scene")
    };
    // Canonical paths resolve symbolic links, which may lead out of the folder.
    let base = folders.of_scene.canonicalize().map_err(missing)?;
    let target = base.join(name).canonicalize().map_err(missing)?;
    let is_allowed = |folder: &PathBuf| folder.canonicalize().is_ok_and(|folder| target.starts_with(folder));
    if !target.starts_with(&base) && !folders.allowed.iter().any(is_allowed) {
        return Err(format!(
            "{what} refers to `{shown}`, which lies outside the folder of the scene; copy the file into it, or allow the folder of \
             the file with --allow-path DIR"
        ));
    }
    read_file(&target).map_err(|why| format!("{what} refers to `{shown}`, which {why}"))
}

/// The file name of a relative URI, or the reason why it is refused.
fn relative_name(uri: &str, folders: Folders) -> Checked<String> {
    let name = percent_decode(uri);
    let scheme_end = name.find(|c: char| !c.is_ascii_alphanumeric() && !"+-.".contains(c));
    if scheme_end.is_some_and(|end| end > 0 && name[end..].starts_with(':')) {
        return Err("has a scheme or a drive letter".into());
    }
    if name.is_empty() || name.contains('\0') {
        return Err("is empty or has a NUL character".into());
    }
    if name.starts_with('/') || name.contains('\\') {
        return Err("is an absolute path or has a backslash".into());
    }
    if folders.allowed.is_empty() && name.split('/').any(|part| part == "..") {
        return Err("leaves the folder of the scene (--allow-path DIR allows files under DIR)".into());
    }
    Ok(name)
}

/// `uri` with its percent escapes decoded once. A `%` that begins no escape stands for itself, because some exporters write names as
/// they are. So does every `%` of a URI whose escapes are not UTF-8.
fn percent_decode(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, after @ ..] = rest {
        let (byte, after) = match (first, after) {
            (b'%', [high, low, after @ ..]) => match (hex(*high), hex(*low)) {
                (Some(high), Some(low)) => (high << 4 | low, after),
                _ => (b'%', &rest[1..]),
            },
            _ => (*first, after),
        };
        bytes.push(byte);
        rest = after;
    }
    String::from_utf8(bytes).unwrap_or_else(|_| uri.into())
}

fn hex(digit: u8) -> Option<u8> {
    (digit as char).to_digit(16).map(|value| value as u8)
}

/// Reads a regular file of at most [`MAX_BYTES`] bytes. The error completes a sentence that begins with the name of the file.
pub fn read_file(path: &Path) -> Checked<Vec<u8>> {
    let failed = |e: std::io::Error| format!("cannot be read ({e}); check the path and its permissions");
    let meta = path.metadata().map_err(failed)?;
    if !meta.is_file() {
        return Err("is not a regular file; give the path of a .glb or .gltf file".into());
    }
    if meta.len() > MAX_BYTES {
        return Err("is larger than 1 GiB; split the scene".into());
    }
    let mut bytes = Vec::with_capacity(meta.len() as usize);
    File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err("is larger than 1 GiB; split the scene".into());
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name_of(uri: &str) -> Checked<String> {
        relative_name(uri, Folders::new(Path::new("a.gltf"), &[]))
    }

    #[test]
    fn percent_escapes_decode_once() {
        assert_eq!(name_of("a%20b/c.bin").unwrap(), "a b/c.bin");
        assert_eq!(name_of("%252e%252e/c").unwrap(), "%2e%2e/c");
        assert_eq!(name_of("a..b/...c").unwrap(), "a..b/...c");
        for raw in ["50%.png", "50%_grey%20.png", "a%", "a%f", "a%zz", "%", "a%FFb%20c"] {
            let decoded = if raw.contains("FF") { raw.into() } else { raw.replace("%20", " ") };
            assert_eq!(name_of(raw).unwrap(), decoded, "{raw}");
        }
    }

    #[test]
    fn names_that_could_leave_the_folder_are_refused() {
        let hostile = [
            "",
            "/a",
            "%2fa",
            "//host/a",
            "\\\\host\\a",
            "a\\b",
            "..",
            "../a",
            "a/../b",
            "%2e%2e/a",
            "C:a",
            "c:/a",
            "%43:/a",
            "file:///a",
            "http://a/b",
            "a%00b",
            "50%/%2e%2e/a",
        ];
        for uri in hostile {
            assert!(name_of(uri).is_err(), "{uri}");
        }
    }
}
