//! Fingerprints: 16 hexadecimal digits for everything that a result depends on.

mod hash;
#[cfg(test)]
mod sources;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::files::read_error;

pub use hash::Hash;

/// Number of bytes of a file that are read at a time.
const PART: u64 = 1 << 20;

/// Fingerprint of the contents of files, in their order: 16 hexadecimal digits.
pub fn of_files(paths: &[PathBuf]) -> Result<String> {
    let mut hash = Hash::new();
    let mut part = Vec::with_capacity(PART as usize);
    for path in paths {
        let fail = |e| read_error(Path::new(path), e);
        let mut file = File::open(path).map_err(fail)?;
        loop {
            part.clear();
            let length = file.by_ref().take(PART).read_to_end(&mut part).map_err(fail)?;
            // The empty part at the end separates the files.
            hash = hash.with(&part);
            if length == 0 {
                break;
            }
        }
    }
    Ok(hash.digits())
}

/// Fingerprint of this renderer: 16 hexadecimal digits for its version and for the code, without comments, that determines an
/// image. The build script computes it. With equal settings, renderers with equal fingerprints give images with the same expected
/// value. Other renderers may not.
pub const RENDERER: &str = env!("TAUGATE_RENDERER");

#[cfg(test)]
mod tests;
