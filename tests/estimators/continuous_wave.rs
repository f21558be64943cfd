//! Multipath error of a continuous-wave sensor: light that goes from wall to wall of a corner arrives late, so the corner seems to be
//! farther away than it is. The error agrees with that of the oracle.

use std::f64::consts::TAU;

use glam::DVec3;
use taugate::internals::generate::parts::{add, camera, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::image::depth;
use taugate::internals::scene::{LightKind, Scene};
use taugate::internals::settings::frequencies::Frequencies;
use taugate::internals::settings::{Emitters, Estimator};
use taugate_oracle::path_tracer;

use super::cells::{renderer, seeds, settings, threshold};

const MEGAHERTZ: f64 = 20.0;
const SIZE: [u32; 2] = [24, 16];
const CELL: u32 = 8;
const CELLS: usize = (SIZE[0] / CELL * SIZE[1] / CELL) as usize;
const MAX_DEPTH: u32 = 5;

/// Two white walls that meet at a right angle, 2.5 m in front of the camera. A lamp at the pinhole lights them.
fn corner() -> Scene {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    let (edge, up) = (DVec3::new(0.0, -1.0, -2.5), 2.0 * DVec3::Y);
    for side in [-1.5, 1.5] {
        add(&mut scene, "wall", white, quad(edge, DVec3::new(side, 0.0, 1.5), up, [1.0; 2]));
    }
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 40f64.to_radians(), SIZE);
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    scene
}

/// The modulated light of each cell in each render: amplitude times cosine and sine of the phase.
struct Modulation(Vec<[[f64; 2]; CELLS]>);

impl Modulation {
    /// Depth of a cell in metres, and its standard error. The depth is computed from the mean over all renders, so it has no
    /// bias. The error comes from the spread perpendicular to the mean.
    fn depth(&self, cell: usize) -> (f64, f64) {
        let n = self.0.len() as f64;
        let of = |k: usize| self.0.iter().map(|render| render[cell][k]).sum::<f64>() / n;
        let (cosine, sine) = (of(0), of(1));
        let across = |[c, s]: [f64; 2]| (cosine * s - sine * c) / (cosine * cosine + sine * sine);
        let variance = self.0.iter().map(|render| across(render[cell]).powi(2)).sum::<f64>() / (n * (n - 1.0));
        let per_radian = 0.5 * Frequencies::period(MEGAHERTZ) / TAU;
        (per_radian * sine.atan2(cosine).rem_euclid(TAU), per_radian * variance.sqrt())
    }
}

/// Adds the value of a pixel to the mean of its cell.
fn add_pixel(cells: &mut [[f64; 2]; CELLS], pixel: usize, value: [f64; 2]) {
    let (x, y) = (pixel as u32 % SIZE[0] / CELL, pixel as u32 / SIZE[0] / CELL);
    let cell = &mut cells[(y * (SIZE[0] / CELL) + x) as usize];
    (0..2).for_each(|k| cell[k] += value[k] / f64::from(CELL * CELL));
}

fn rendered(estimator: Estimator) -> Modulation {
    let frequencies = Frequencies::new(vec![MEGAHERTZ]).unwrap();
    let settings = settings(estimator, SIZE).max_depth(MAX_DEPTH).responses(frequencies.clone()).build().unwrap();
    let mut renderer = renderer(&corner(), &settings);
    let render = |seed| {
        renderer.restart(300 + seed, frequencies.clone()).unwrap();
        renderer.iterate(8).unwrap();
        let mut cells = [[0.0; 2]; CELLS];
        for (pixel, echo) in
            depth::echoes(renderer.responses().unwrap().unwrap(), &frequencies, 0).into_iter().enumerate()
        {
            let (sine, cosine) = f64::from(echo.phase).sin_cos();
            add_pixel(&mut cells, pixel, [cosine, sine].map(|x| x * f64::from(echo.amplitude)));
        }
        cells
    };
    Modulation((0..seeds()).map(render).collect())
}

/// The oracle has no modulated sensor. It sorts light into gates of 5 cm, and all light of a gate gets the phase of its middle.
fn oracle(max_depth: u32) -> Modulation {
    const WIDTH: f64 = 0.05;
    let bins: Vec<(f64, f64)> = (20..320).map(|i| (f64::from(i) * WIDTH, f64::from(i + 1) * WIDTH)).collect();
    let period = Frequencies::period(MEGAHERTZ);
    let scene = corner();
    let render = |seed| {
        let (camera, emitters, bins) = (0, Emitters::Scene, bins.clone());
        let s = path_tracer::Settings { camera, resolution: SIZE, spp: 32, seed, max_depth, bins, emitters };
        let film = path_tracer::render(&scene, &s);
        let mut cells = [[0.0; 2]; CELLS];
        for (pixels, (lo, _)) in film.bins.iter().zip(&s.bins) {
            let (sine, cosine) = (TAU * (lo + 0.5 * WIDTH) / period).sin_cos();
            for (pixel, light) in pixels.iter().enumerate() {
                add_pixel(&mut cells, pixel, [cosine * light.mean[1], sine * light.mean[1]]);
            }
        }
        cells
    };
    Modulation((0..u64::from(seeds())).map(render).collect())
}

#[test]
fn the_multipath_error_in_a_corner_is_that_of_the_oracle() {
    let (whole, direct) = (oracle(MAX_DEPTH), oracle(2));
    // Light that only one wall reflects gives the true depth: 2.5 m at the edge, less on the walls.
    let far = (0..CELLS).map(|cell| direct.depth(cell).0).fold(0.0, f64::max);
    assert!((2.2..2.5).contains(&far), "{far}");
    for estimator in [Estimator::Pt, Estimator::Bdpt, Estimator::Lcs] {
        let found = rendered(estimator);
        let mut rejected = 0;
        for cell in 0..CELLS {
            let [(here, error), (there, spread), (alone, _)] = [&found, &whole, &direct].map(|m| m.depth(cell));
            eprintln!(
                "{estimator}, cell {cell}: {here:.4} m +- {error:.4}, oracle {there:.4} +- {spread:.4}, direct {alone:.4}"
            );
            let limit = threshold(CELLS) * error.hypot(spread);
            assert!((here - there).abs() < limit, "{estimator}, cell {cell}: {here} and {there} +- {limit}");
            // Negative control: no light goes from wall to wall.
            rejected += usize::from((here - alone).abs() > limit);
            assert!(here > alone + 0.02, "{estimator}, cell {cell}: {here} and {alone}");
        }
        assert_eq!(rejected, CELLS, "{estimator}: the true depth passes");
    }
}
