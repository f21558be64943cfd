//! taugate renders what a time-gated sensor sees: of all the light in a scene, only the photons whose total
//! travel time falls inside a gate.
//!
//! Data goes one way: a glTF file becomes a [`scene::Scene`] of plain arrays, the scene becomes a bounding volume
//! hierarchy on the device, and [`render`] runs Algorithm 1 of "Light-Cone Shell Queries for Scalable Time-Gated
//! Rendering": light subpaths, two trees over their vertices, sensor subpaths, queries, connections, film.
//! `docs/ARCHITECTURE.md` is the map, `docs/PAPER.md` says which function implements which equation.

pub mod bench;
pub mod bvh;
pub mod compare;
pub mod error;
pub mod estimators;
pub mod files;
pub mod generate;
pub mod gpu;
pub mod image;
pub mod input;
pub mod lightcone;
pub mod oracle;
pub mod render;
pub mod scene;
pub mod self_check;
pub mod settings;
pub mod wgsl;

pub use error::Error;
