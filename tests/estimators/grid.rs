//! Density grids: the estimators against homogeneous media and against the oracle, which samples grids by another algorithm.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::generate::zoo::{Light, zoo};
use taugate::internals::scene::{DensityGrid, GridFilter, Medium, PhaseFunction, Scene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::units::Gate;

use super::agreement::{assert_none, feature_against_oracle, whole_images};
use super::cells::{renderer, settings};

const BOX: [DVec3; 2] = [DVec3::new(-0.8, 0.3, -0.9), DVec3::new(0.9, 2.0, 0.7)];

fn room(media: Vec<Medium>) -> Scene {
    Scene { media, ..zoo(Light::Area) }
}

fn fog(bounds: [DVec3; 2], density: f64) -> Medium {
    let phase = PhaseFunction::HenyeyGreenstein { g: 0.5 };
    let [sigma_s, sigma_a] = [[0.6, 0.5, 0.4], [0.1, 0.05, 0.0]].map(|sigma| sigma.map(|x: f64| density * x));
    Medium { sigma_s, sigma_a, phase, bounds: Some(bounds), ..Medium::default() }
}

fn grid(resolution: [u32; 3], density: Vec<f32>, filter: GridFilter) -> Medium {
    let grid = DensityGrid { resolution, density, bounds: BOX, transform: DAffine3::IDENTITY, filter };
    Medium { bounds: None, grid: Some(grid), ..fog(BOX, 1.0) }
}

/// Means of images through abutting gates and without a gate.
fn means(scene: &Scene, estimator: Estimator) -> [f64; 3] {
    let s = settings(estimator, [24, 16]).max_depth(6).build().unwrap();
    let mut renderer = renderer(scene, &s);
    [[5.0, 5.8], [5.8, 6.6], [0.0, f64::INFINITY]].map(|[lo, hi]| {
        renderer.restart(8, Gate { lo, hi }).unwrap();
        (0..4).for_each(|_| renderer.iterate(8).unwrap());
        let mean = renderer.film().mean();
        mean.iter().map(|&x| f64::from(x)).sum::<f64>() / mean.len() as f64
    })
}

fn largest_difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.into_iter().zip(b).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
}

/// Flights use the same random numbers with and without a grid, so the images differ by rounding alone.
#[test]
fn equal_voxels_are_homogeneous_fog() {
    for (filter, estimator) in [(GridFilter::Linear, Estimator::Lcs), (GridFilter::Nearest, Estimator::Bdpt)] {
        let homogeneous = means(&room(vec![fog(BOX, 0.8)]), estimator);
        let equal = |density: f32| means(&room(vec![grid([9, 7, 12], vec![density; 9 * 7 * 12], filter)]), estimator);
        let difference = largest_difference(equal(0.8), homogeneous);
        eprintln!("{filter:?}: {difference:.1e}");
        assert!(difference < 1e-4, "{filter:?}: {difference}");
        assert!(largest_difference(equal(0.82), homogeneous) > 1e-3, "{filter:?}");
    }
}

/// `lcs` would make other random choices, because it chooses candidates by the mean density of a grid.
#[test]
fn a_grid_of_two_halves_is_two_boxes() {
    let [lo, hi] = BOX;
    let middle = 0.5 * (lo.x + hi.x);
    let left = fog([lo, DVec3::new(middle, hi.y, hi.z)], 0.4);
    let right = fog([DVec3::new(middle, lo.y, lo.z), hi], 1.6);
    let boxes = means(&room(vec![left, right]), Estimator::Bdpt);
    let halves =
        |density: [f32; 2]| means(&room(vec![grid([2, 1, 1], density.to_vec(), GridFilter::Nearest)]), Estimator::Bdpt);
    let difference = largest_difference(halves([0.4, 1.6]), boxes);
    eprintln!("{difference:.1e}");
    assert!(difference < 1e-4, "{difference}");
    assert!(largest_difference(halves([0.42, 1.6]), boxes) > 1e-3);
}

/// A turned cloud with holes in thin fog.
fn cloud() -> Scene {
    let mut pcg = Pcg::new(6);
    let [nx, ny, nz] = [11, 6, 9];
    let density = (0..nx * ny * nz).map(|i| if i % nx < 4 { 0.0 } else { (4.0 * pcg.uniform() - 1.0).max(0.0) as f32 });
    let mut cloud = grid([nx, ny, nz], density.collect(), GridFilter::Linear);
    if let Some(grid) = &mut cloud.grid {
        grid.transform = DAffine3::from_rotation_y(0.5);
    }
    let thin = Medium { bounds: None, ..fog(BOX, 0.1) };
    room(vec![thin, cloud])
}

#[test]
fn a_cloud_agrees_with_the_oracle() {
    assert_none(feature_against_oracle("cloud", &cloud(), &[(5.0, 6.0), (0.0, f64::INFINITY)], [24, 16]));
}

/// The long version, with smaller errors: `cargo test --release --test estimators -- --ignored --nocapture images_of_a_cloud`
#[test]
#[ignore = "takes minutes"]
fn whole_images_of_a_cloud_agree_with_the_oracle() {
    whole_images("cloud", &cloud(), 5.0);
}
