//! What the program, the viewer and the Python module do with a scene. Nothing here prints.

pub mod feasible;
pub mod iterations;
pub mod memory;
pub mod ready;
pub mod sums;
