//! Fingerprints: sixteen digits for everything that a result depends on.

mod hash;
#[cfg(test)]
mod sources;

pub use hash::Hash;

/// Sixteen digits for this renderer: its version and the code that decides an image, without comments. The build script computes
/// them. Images of renderers with equal digits differ by noise alone; with different digits they may differ by more.
pub const RENDERER: &str = env!("TAUGATE_RENDERER");

#[cfg(test)]
mod tests;
