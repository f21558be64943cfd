//! The WGSL sources of all kernels, and the host twins of their structs.

pub mod layout;

/// Expands to pairs of path (without `shaders/` and `.wgsl`) and text.
macro_rules! sources {
    ($($path:literal),* $(,)?) => { &[$(($path, include_str!(concat!("../../shaders/", $path, ".wgsl")))),*] };
}

/// Path and text of every WGSL file: first the kernels, then the modules without an entry point.
pub const SOURCES: &[(&str, &str)] = sources![
    "light_start",
    "light_trace",
    "light_splat",
    "light_mark",
    "light_keep",
    "sensor_start",
    "sensor_trace",
    "compact",
    "shell_query",
    "shell_resample",
    "connect",
    "gather",
    "resolve",
    "first_surface",
    "shared/bsdf",
    "shared/camera",
    "shared/candidate",
    "shared/connection",
    "shared/emitter",
    "shared/fog",
    "shared/frame",
    "shared/frontier",
    "shared/gate",
    "shared/guided_flight",
    "shared/importance",
    "shared/lightcone",
    "shared/material",
    "shared/math",
    "shared/medium",
    "shared/partial_sums",
    "shared/path",
    "shared/phase",
    "shared/point",
    "shared/query",
    "shared/random",
    "shared/receiver",
    "shared/resample",
    "shared/samples",
    "shared/scene",
    "shared/segment",
    "shared/shade_point",
    "shared/sky",
    "shared/slots",
    "shared/sobol",
    "shared/surface",
    "shared/texture",
    "shared/traverse",
    "shared/tree",
    "shared/vertex",
    "shared/visibility",
    "shared/walk",
    "shared/weights",
];
