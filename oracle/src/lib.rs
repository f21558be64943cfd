//! A second implementation of the renderer's mathematics, slow but simple, in f64.
//!
//! Tests compare the renderer with this crate, so the two share only plain data such as [`taugate::Scene`] and a generator of random
//! numbers. [`path_tracer`] is another algorithm, [`lightcone`] a second version of the paper's equations. Closed forms that the
//! program needs too are in `taugate::internals::self_check`.

pub mod bsdf;
mod bump;
mod camera;
mod emitter;
mod flight;
pub mod fog;
pub mod geometry;
pub mod ggx;
pub mod lightcone;
pub mod media;
pub mod path_tracer;
pub mod phase;
pub mod texture;
mod world;

/// The values of red, green and blue. The compiler inlines it, also where it does not inline `array::map`.
#[inline]
fn rgb(channel: impl Fn(usize) -> f64) -> [f64; 3] {
    [channel(0), channel(1), channel(2)]
}
