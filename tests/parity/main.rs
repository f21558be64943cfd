//! The functions of `shaders/shared/` run on the device and are compared with f64 on the host: most directly, the others through a
//! function that calls them (`functions.rs` lists these).

#[path = "../common/device.rs"]
mod device;
#[path = "../common/shader_function.rs"]
mod shader_function;
#[path = "../common/statistics.rs"]
mod statistics;

mod bsdf;
mod bsdf_edges;
mod bsdf_parts;
mod bsdf_sample;
mod bsdf_slopes;
mod bump;
mod camera;
mod ellipsoid;
mod emitter;
mod functions;
mod grid;
mod importance;
mod lens;
mod lightcone;
mod materials;
mod math;
mod medium;
mod pairs;
mod phase;
mod point;
mod receiver;
mod rough_glass;
mod scatter;
mod shell_edge;
mod sky;
mod sobol;
mod texels;
mod texture;
mod trace;
mod values;
mod vertex;
mod watertight;
mod weights;
