//! The same mathematics again: slow, f64, obviously right. For tests only.
//!
//! The renderer is judged by what stands here, so nothing is shared with it beyond the [`crate::scene::Scene`]: [`sphere`]
//! is a closed form, [`path_tracer`] another algorithm, [`lightcone`] the paper's equations once more.

pub mod bsdf;
mod emitter;
pub mod geometry;
pub mod ggx;
pub mod lightcone;
pub mod path_tracer;
pub mod sphere;
pub mod texture;
mod world;
