//! A digest of the sources that determine an image. The build script uses it; in this crate only the unit tests do.

use std::path::{Path, PathBuf};

use super::hash::Hash;

/// Folders whose code determines an image, for given settings and scene bytes.
pub const DECIDE: [&str; 13] = [
    "shaders",
    "src/bvh",
    "src/estimators",
    "src/gpu",
    "src/image",
    "src/input",
    "src/job",
    "src/lightcone",
    "src/render",
    "src/scan",
    "src/scene",
    "src/settings",
    "src/wgsl",
];

/// 16 hexadecimal digits for the version and the code in [`DECIDE`] below `root`. It ignores comments, white space and unit
/// tests.
pub fn digest(root: &Path, version: &str) -> std::io::Result<String> {
    let mut files = vec![];
    for folder in DECIDE {
        collect(&root.join(folder), folder, &mut files)?;
    }
    files.sort();
    let mut hash = Hash::new().with(version.as_bytes());
    for (name, path) in files {
        hash = hash.with(name.as_bytes()).with(code(&std::fs::read_to_string(path)?).as_bytes());
    }
    Ok(hash.digits())
}

/// Collects all Rust and WGSL files in `folder` and below, with their names relative to the root. Names contain `/` on every
/// system.
fn collect(folder: &Path, name: &str, files: &mut Vec<(String, PathBuf)>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let own = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = format!("{name}/{own}");
        // Editors leave hidden files behind.
        if own.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            collect(&path, &name, files)?;
        } else if own != "tests.rs" && (own.ends_with(".rs") || own.ends_with(".wgsl")) {
            files.push((name, path));
        }
    }
    Ok(())
}

/// The Rust or WGSL code of a file without comments, without white space outside strings, and without the unit tests at its end.
fn code(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let (kept, length) = match first {
            '"' => (true, string_length(rest, "\"", true)),
            'r' if raw_quote(rest).is_some_and(|_| !ends_in_word(&out)) => {
                let hashes = raw_quote(rest).unwrap_or_default();
                let open = hashes + 1;
                (true, open + string_length(&rest[open..], &format!("\"{}", "#".repeat(hashes)), false))
            }
            '\'' if rest.starts_with("'\"'") => (true, 3),
            '\'' if rest.starts_with("'\\") => (true, 3),
            '/' if rest.starts_with("//") => (false, rest.find('\n').unwrap_or(rest.len())),
            '/' if rest.starts_with("/*") => (false, block_length(rest)),
            _ => (!first.is_whitespace(), first.len_utf8()),
        };
        if kept {
            out.push_str(&rest[..length]);
        }
        rest = &rest[length..];
    }
    if let Some(tests) = out.find("#[cfg(test)]modtests") {
        out.truncate(tests);
    }
    out
}

fn ends_in_word(text: &str) -> bool {
    text.ends_with(|c: char| c.is_alphanumeric() || c == '_')
}

/// The number of `#` if `text` begins with the opening of a raw string.
fn raw_quote(text: &str) -> Option<usize> {
    let after = text.strip_prefix('r')?;
    let hashes = after.len() - after.trim_start_matches('#').len();
    after[hashes..].starts_with('"').then_some(hashes)
}

/// Length in bytes of a string literal that begins with a quotation mark and ends with `close`.
fn string_length(text: &str, close: &str, escapes: bool) -> usize {
    let mut at = 1;
    while at < text.len() && !text[at..].starts_with(close) {
        let skip = if escapes && text[at..].starts_with('\\') { 2 } else { 1 };
        at += text[at..].chars().take(skip).map(char::len_utf8).sum::<usize>();
    }
    (at + close.len()).min(text.len())
}

/// Length in bytes of a block comment. Block comments nest in both languages.
fn block_length(text: &str) -> usize {
    let (mut at, mut depth) = (0, 0);
    while at < text.len() {
        let (step, change) = match &text.as_bytes()[at..] {
            [b'/', b'*', ..] => (2, 1),
            [b'*', b'/', ..] => (2, -1),
            _ => (1, 0),
        };
        (at, depth) = (at + step, depth + change);
        if depth == 0 {
            break;
        }
    }
    at
}
