//! Compares the throughput of kernels on the device with scalar Rust code on the host, in alternating rounds:
//!
//!     cargo bench --bench throughput [-- TRIANGLES]
//!     cargo bench --bench throughput -- --rays FILE      # rays only; writes them to FILE, for benches/embree.py
//!
//! * Rays (the traversal of light_trace, sensor_trace and connect): camera rays, one diffuse bounce, and a shadow ray at each hit,
//!   in the cluttered room. Host: the traversal of obvhs, with the same BVH.
//! * Queries (shell_query) and queries by importance (shell_resample), in the 4D tree over light vertices of that room. Host: a
//!   scalar version of the shaders.
//! * Compaction. Host: one loop.
//!
//! The host uses all cores through rayon, except for the compaction. Results are medians of 7 rounds, with the range of the ratios.
//! At the end, the throughput of whole kernels in a render, with shading; the host has no code for them.
//!
//! `cargo test` runs every part once with small sizes, and checks that the two sides agree.

#[path = "../common/flatten.rs"]
mod flatten;

mod compaction;
mod importance;
mod kernels;
mod points;
mod queries;
mod rays;

use std::path::Path;
use std::time::Instant;

use taugate::internals::gpu::Device;

/// How much work the benches do.
#[derive(Clone, Copy)]
pub struct Sizes {
    /// Rounds of every comparison.
    rounds: usize,
    /// Triangles of the room.
    triangles: u32,
    /// Width and height in pixels of the image whose rays are traced. The images of all other benches have half of both.
    side: usize,
    /// Light vertices.
    vertices: usize,
    /// Slots to compact.
    slots: usize,
}

const FULL: Sizes = Sizes { rounds: 7, triangles: 200_000, side: 512, vertices: 200_000, slots: 1 << 20 };
const SMALL: Sizes = Sizes { rounds: 1, triangles: 2000, side: 64, vertices: 5000, slots: 1 << 12 };

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_bench = arguments.iter().any(|a| a == "--bench");
    // `cargo test` passes on its own arguments, such as names of tests.
    if !is_bench && !arguments.is_empty() {
        return;
    }
    // The first number is the triangle count.
    let triangles = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(FULL.triangles);
    let sizes = if is_bench { Sizes { triangles, ..FULL } } else { SMALL };
    let device = Device::open(None).expect("a Vulkan device");
    println!("device    {} ({})", device.info().name, device.info().driver);
    let room = rays::Room::new(sizes.triangles);
    println!("scene     {} triangles", room.triangles.len());
    let file = arguments.iter().position(|a| a == "--rays").map(|at| arguments.get(at + 1).expect("--rays FILE"));
    rays::compare(&device, &room, file.map(Path::new), sizes);
    if file.is_some() {
        return;
    }
    let (light, shade) = (points::light_vertices(&room, sizes.vertices), points::shade_points(&room, sizes.side / 2));
    for leaf_size in [1, 16] {
        queries::compare(&device, &light, &shade, leaf_size, sizes);
    }
    importance::compare(&device, &light, &shade, sizes);
    compaction::compare(&device, sizes);
    kernels::report(&device, sizes);
}

/// Runs both sides in turns. Prints millions of items per second, and the ratio of throughputs, device / host.
fn report(what: &str, count: usize, rounds: usize, mut on_device: impl FnMut(), mut on_host: impl FnMut()) {
    on_device();
    on_host();
    let (mut device, mut host) = (vec![], vec![]);
    for _ in 0..rounds {
        device.push(seconds(&mut on_device));
        host.push(seconds(&mut on_host));
    }
    let mut ratios: Vec<f64> = device.iter().zip(&host).map(|(d, h)| h / d).collect();
    ratios.sort_by(f64::total_cmp);
    println!(
        "{what:<28} device {:6.2} M/s   host {:6.2} M/s   ratio {:.2} ({:.2} to {:.2})",
        count as f64 / median(&mut device) / 1e6,
        count as f64 / median(&mut host) / 1e6,
        ratios[rounds / 2],
        ratios[0],
        ratios[rounds - 1],
    );
}

/// Fails if the shares of queries that find a vertex differ by more than rounding explains. Both sides draw the same random numbers.
fn assert_close(what: &str, device: f64, host: f64) {
    assert!((device - host).abs() < 1e-3, "{what}: {device} on the device, {host} on the host");
}

fn seconds(work: &mut impl FnMut()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
