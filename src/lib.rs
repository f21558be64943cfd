//! taugate renders what a time-gated sensor sees: of all the light in a scene, only the photons whose total
//! travel time falls inside a gate.
//!
//! Data goes one way: a glTF file becomes a [`scene::Scene`] of plain arrays, the scene becomes a bounding volume
//! hierarchy on the device, and [`render`] runs Algorithm 1 of "Light-Cone Shell Queries for Scalable Time-Gated
//! Rendering": light subpaths, two trees over their vertices, sensor subpaths, queries, connections, film.
//! `docs/ARCHITECTURE.md` is the map, `docs/PAPER.md` says which function implements which equation.

pub mod agreement;
pub mod batches;
pub mod bench;
pub mod bvh;
pub mod error;
pub mod experiment;
pub mod exr_file;
pub mod files;
pub mod film;
pub mod fingerprint;
pub mod generate;
pub mod gpu;
pub mod lightcone;
pub mod metrics;
pub mod oracle;
pub mod png_file;
pub mod render;
pub mod resolve;
pub mod scene;
pub mod schedule;
pub mod settings;
pub mod statistics;
pub mod units;
pub mod values;

pub use error::Error;
