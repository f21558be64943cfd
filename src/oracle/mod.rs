//! A second implementation of the renderer's mathematics, slow but simple, in f64. It serves tests, and `self_check` uses
//! [`sphere`], [`fog`] and [`phase`].
//!
//! Tests compare the renderer with this module, so the two share only plain data such as [`crate::scene::Scene`]. [`sphere`] is a
//! closed form, [`path_tracer`] another algorithm, [`lightcone`] a second version of the paper's equations.

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
pub mod sphere;
pub mod texture;
mod world;

/// The values of red, green and blue. The compiler inlines it, also where it does not inline `array::map`.
#[inline]
fn rgb(channel: impl Fn(usize) -> f64) -> [f64; 3] {
    [channel(0), channel(1), channel(2)]
}
