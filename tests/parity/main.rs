//! Level 2: every function of `shaders/shared/` that holds a formula, run on the device against f64.

#[path = "../common/shader_function.rs"]
mod shader_function;
#[path = "../common/statistics.rs"]
mod statistics;

mod lightcone;
mod math;
mod shell_edge;
mod values;
