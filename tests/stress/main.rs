//! Numerical stress: scenes of any scale and position, gates of a few f32 steps, convergence, accumulation, index checks.
//!
//! Some tests always run. This runs the others: `cargo test --release --test stress -- --ignored --skip helper --nocapture`

#[path = "../estimators/cells.rs"]
#[allow(dead_code, reason = "shared with the estimators' tests")]
mod cells;
#[path = "../common/device.rs"]
mod device;
#[path = "../common/shader_function.rs"]
#[allow(dead_code, reason = "shared with the parity tests")]
mod shader_function;

mod accumulation;
mod checks;
mod coplanar;
mod fog;
mod gates;
mod partition;
mod sampling;
mod scale;
mod thin;
mod thin_trees;
mod wall;

use taugate::internals::render::Renderer;
use taugate::internals::settings::units::Gate;

/// Mean image of `iterations` iterations with `samples` samples per pixel each.
fn image(renderer: &mut Renderer, seed: u32, gate: Gate, iterations: u32, samples: u32) -> Vec<f32> {
    renderer.restart(seed, gate).unwrap();
    for _ in 0..iterations {
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    renderer.film().mean()
}

fn sum(image: &[f32]) -> f64 {
    image.iter().map(|&x| f64::from(x)).sum()
}
