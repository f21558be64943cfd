//! taugate renders the image of a time-gated sensor: it shows only the photons whose total travel time falls inside a
//! gate.
//!
//! A [`Job`] is a scene with its settings. It comes from a file, or from a [`Scene`] and [`Settings`] of a program. [`Job::prepare`]
//! checks it and puts the scene on a Vulkan [`Device`]; [`ReadyJob::run`] renders as `taugate render` does. [`compare`] measures the
//! error of an image against a reference. A program that builds its scene from arrays, `examples/render_gate.rs`:
//!
//! ```
#![doc = include_str!("../examples/render_gate.rs")]
//! ```
//!
//! A program that renders files, and continues after it was stopped, `examples/render_file.rs`:
//!
//! ```no_run
#![doc = include_str!("../examples/render_file.rs")]
//! ```
//!
//! [`Job::prepare_scan`] measures a scan. [`Job::frames`] opens the frames of a sequence, and [`Job::prepare_after`] prepares one after
//! the other.
//!
//! A [`Renderer`] is the level below: it adds single iterations to a [`Film`].
//!
//! Lengths are in metres. Travel times are metres of optical path; the speed of light is 1. The method is Algorithm 1 of the
//! paper "Light-Cone Shell Queries for Scalable Time-Gated Rendering". `docs/ARCHITECTURE.md` describes the sources, and
//! `docs/PAPER.md` lists the function for each equation.

// Files that define types of the API warn about missing docs. The other modules are not part of the API.
mod bench;
mod bvh;
mod compare;
mod detector;
mod error;
mod estimators;
mod files;
mod free_memory;
mod generate;
mod gpu;
mod image;
mod input;
mod job;
mod lidar;
mod lightcone;
mod printable;
mod render;
mod scan;
mod scene;
mod self_check;
mod settings;
mod tev;
mod threads;
mod wgsl;

pub use glam;

pub use compare::metrics::{Comparison, compare};
pub use error::{Error, ErrorKind, Result, SettingsError};
pub use gpu::{Device, DeviceInfo, DeviceKind};
pub use image::exr_file::write_film as write_exr;
pub use image::film::Film;
pub use image::response_film::ResponseFilm;
pub use job::iterations::End;
pub use job::ready_job::{Progress, ReadyJob};
pub use job::ready_scan::ReadyScan;
pub use job::{Frame, Job};
pub use render::Renderer;
pub use scene::gltf::load as load_scene;
pub use scene::{
    Aim, AlphaMode, Aperture, Camera, DensityGrid, Distortion, GridFilter, Image, Instance, Lens, Light, LightKind,
    Material, Medium, Mesh, PhaseFunction, Projection, Retroreflector, Scene, SkyImage, Texture, UnusableCamera,
    Velocities, Wrap,
};
pub use settings::SettingsBuilder;
pub use settings::frequencies::Frequencies;
pub use settings::gates::Gates;
pub use settings::units::Gate;
pub use settings::{
    Budget, Crop, Edge, Emitters, Estimator, Importance, Merge, Rays, Response, Responses, Sampling, Settings,
    Strategies, UseEllipsoids,
};

/// All modules, for the program, the tests and the benches of this package, and for the other packages of this workspace. They are
/// not part of the API and may change at any time.
#[doc(hidden)]
pub mod internals {
    macro_rules! modules {
        ($($name:ident),* $(,)?) => { $(pub mod $name { pub use crate::$name::*; })* };
    }
    modules! {
        bench, bvh, compare, detector, files, generate, gpu, image, input, job, lidar, lightcone, printable, render, scan, scene, self_check, settings, tev, threads, wgsl,
    }
}
