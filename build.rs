//! Computes the digest of the sources that determine images, and passes it to the compiler as `TAUGATE_RENDERER`.

#[path = "src/image/fingerprint/hash.rs"]
mod hash;
#[path = "src/image/fingerprint/sources.rs"]
mod sources;

use std::path::Path;

fn main() {
    let root = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets the folder of the package");
    let version = std::env::var("CARGO_PKG_VERSION").expect("cargo sets the version of the package");
    // Cargo searches the folders, so new files are found too.
    sources::DECIDE.iter().for_each(|folder| println!("cargo::rerun-if-changed={folder}"));
    println!("cargo::rerun-if-changed=build.rs");
    let digits = sources::digest(Path::new(&root), &version).expect("the sources can be read");
    println!("cargo::rustc-env=TAUGATE_RENDERER={digits}");
}
