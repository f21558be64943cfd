//! Fingerprints: 16 hexadecimal digits for everything that a result depends on.

mod hash;
#[cfg(test)]
mod sources;

pub use hash::Hash;

/// Fingerprint of this renderer: 16 hexadecimal digits for its version and for the code, without comments, that determines an
/// image. The build script computes it. Images from renderers with equal fingerprints differ only by noise; otherwise they may
/// differ by more.
pub const RENDERER: &str = env!("TAUGATE_RENDERER");

#[cfg(test)]
mod tests;
