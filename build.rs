//! Passes the digest of the sources that decide an image to the compiler.

#[path = "src/image/fingerprint/hash.rs"]
mod hash;
#[path = "src/image/fingerprint/sources.rs"]
mod sources;

use std::path::Path;

fn main() {
    let root = std::env::var("CARGO_MANIFEST_DIR").expect("cargo says where the package is");
    let version = std::env::var("CARGO_PKG_VERSION").expect("cargo says which version this is");
    // Cargo looks through the folders, so that a new file counts too.
    sources::DECIDE.iter().for_each(|folder| println!("cargo::rerun-if-changed={folder}"));
    println!("cargo::rerun-if-changed=build.rs");
    let digits = sources::digest(Path::new(&root), &version).expect("the sources can be read");
    println!("cargo::rustc-env=TAUGATE_RENDERER={digits}");
}
