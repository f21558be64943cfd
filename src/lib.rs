//! taugate renders the image of a time-gated sensor: it shows only the photons whose total travel time falls inside a
//! gate.
//!
//! A [`Scene`] is built from arrays or, with [`load_scene`], read from a glTF file. [`Settings`] choose camera, gate and
//! estimator. A [`Renderer`] adds iterations to a [`Film`] on a Vulkan [`Device`]; [`Renderer::render`] runs as many as
//! `taugate render` does. [`write_exr`] writes the images, and [`compare`] measures the error against a reference. A complete
//! program, `examples/render_gate.rs`:
//!
//! ```
#![doc = include_str!("../examples/render_gate.rs")]
//! ```
//!
//! Lengths are in metres. Travel times are metres of optical path; the speed of light is 1. The method is Algorithm 1 of the
//! paper "Light-Cone Shell Queries for Scalable Time-Gated Rendering". `docs/ARCHITECTURE.md` describes the sources, and
//! `docs/PAPER.md` lists the function for each equation.

#![warn(missing_docs)]

// These modules are not part of the API. Files that define types of the API warn about missing docs themselves.
#[allow(missing_docs)]
mod bench;
#[allow(missing_docs)]
mod bvh;
#[allow(missing_docs)]
mod compare;
mod detector;
#[allow(missing_docs)]
mod error;
#[allow(missing_docs)]
mod estimators;
#[allow(missing_docs)]
mod files;
#[allow(missing_docs)]
mod free_memory;
#[allow(missing_docs)]
mod generate;
#[allow(missing_docs)]
mod gpu;
#[allow(missing_docs)]
mod image;
#[allow(missing_docs)]
mod input;
#[allow(missing_docs)]
mod job;
#[allow(missing_docs)]
mod lightcone;
#[allow(missing_docs)]
mod printable;
#[allow(missing_docs)]
mod render;
#[allow(missing_docs)]
mod scan;
#[allow(missing_docs)]
mod scene;
#[allow(missing_docs)]
mod self_check;
#[allow(missing_docs)]
mod settings;
#[allow(missing_docs)]
mod tev;
mod threads;
#[allow(missing_docs)]
mod wgsl;

pub use glam;

pub use compare::metrics::{Comparison, compare};
pub use error::{Error, ErrorKind, Result};
pub use gpu::{Device, DeviceInfo, DeviceKind};
pub use image::exr_file::write_film as write_exr;
pub use image::film::Film;
pub use image::response_film::ResponseFilm;
pub use render::Renderer;
pub use scene::gltf::load as load_scene;
pub use scene::{
    Aim, AlphaMode, Camera, DensityGrid, GridFilter, Image, Instance, Light, LightKind, Material, Medium, Mesh,
    PhaseFunction, Projection, Retroreflector, Scene, SkyImage, Texture, UnusableCamera, Wrap,
};
pub use settings::SettingsBuilder;
pub use settings::frequencies::Frequencies;
pub use settings::gates::Gates;
pub use settings::units::Gate;
pub use settings::{
    Budget, Crop, Edge, Emitters, Estimator, Importance, Response, Responses, Sampling, Settings, Strategies,
    UseEllipsoids,
};

/// All modules, for the program, the tests and the benches of this package, and for the other packages of this workspace. They are
/// not part of the API and may change at any time.
#[doc(hidden)]
#[allow(missing_docs)]
pub mod internals {
    macro_rules! modules {
        ($($name:ident),* $(,)?) => { $(pub mod $name { pub use crate::$name::*; })* };
    }
    modules! {
        bench, bvh, compare, detector, error, estimators, files, generate, gpu, image, input, job, lightcone, printable, render, scan, scene, self_check, settings, tev, threads, wgsl,
    }
}
