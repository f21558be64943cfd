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

/// Gates of [`images`].
const GATES: [[f64; 2]; 3] = [[5.0, 5.8], [5.8, 6.6], [0.0, f64::INFINITY]];

/// Values of images by `bdpt` through abutting gates and without a gate. `lcs` would make other random choices after each rounding,
/// because the order of its light vertices may change.
fn images(scene: &Scene) -> Vec<f32> {
    let s = settings(Estimator::Bdpt, [24, 16]).max_depth(6).build().unwrap();
    let mut renderer = renderer(scene, &s);
    let mut image = |[lo, hi]: [f64; 2]| {
        renderer.restart(8, Gate { lo, hi }).unwrap();
        (0..4).for_each(|_| renderer.iterate(8).unwrap());
        renderer.film().mean()
    };
    GATES.into_iter().flat_map(&mut image).collect()
}

/// Fraction of the lit values with a relative difference above 1e-4.
fn share_that_differs(a: &[f32], b: &[f32]) -> f64 {
    let lit = || a.iter().zip(b).filter(|(a, b)| a.max(**b) > 0.0);
    lit().filter(|(a, b)| (*a - *b).abs() > 1e-4 * a.max(**b)).count() as f64 / lit().count() as f64
}

/// Two versions of a medium give the same image except for rounding, which seldom changes a random choice. So the mean of the image
/// is the same in each gate. A third medium, whose density is a few per cent higher, gives another image.
fn assert_only_rounding(name: &str, image: &[f32], same: &[f32], other: &[f32]) {
    let (rounding, control) = (share_that_differs(image, same), share_that_differs(image, other));
    eprintln!("{name}: {rounding:.1e} of the values differ, {control:.2} with another density");
    assert!(rounding < 0.02, "{name}: {rounding}");
    assert!(control > 0.5, "{name}: {control}");
    let mean = |image: &[f32], gate: usize| {
        let part = image.chunks(image.len() / GATES.len()).nth(gate).expect("one image per gate");
        part.iter().map(|&x| f64::from(x)).sum::<f64>()
    };
    for (i, gate) in GATES.iter().enumerate() {
        let ratio = mean(same, i) / mean(image, i);
        eprintln!("{name} {gate:?}: the means differ by {:.1e}", ratio - 1.0);
        assert!((ratio - 1.0).abs() < 3e-3, "{name} {gate:?}: {ratio}");
    }
}

/// Flights use the same random numbers with and without a grid.
#[test]
#[ignore = "takes ten seconds; a cloud is compared with the oracle always"]
fn equal_voxels_are_homogeneous_fog() {
    let homogeneous = images(&room(vec![fog(BOX, 0.8)]));
    for filter in [GridFilter::Linear, GridFilter::Nearest] {
        let equal = |density: f32| images(&room(vec![grid([9, 7, 12], vec![density; 9 * 7 * 12], filter)]));
        assert_only_rounding(&format!("{filter:?}"), &homogeneous, &equal(0.8), &equal(0.82));
    }
}

#[test]
#[ignore = "takes ten seconds; a cloud is compared with the oracle always"]
fn a_grid_of_two_halves_is_two_boxes() {
    let [lo, hi] = BOX;
    let middle = 0.5 * (lo.x + hi.x);
    let left = fog([lo, DVec3::new(middle, hi.y, hi.z)], 0.4);
    let right = fog([DVec3::new(middle, lo.y, lo.z), hi], 1.6);
    let halves = |density: [f32; 2]| images(&room(vec![grid([2, 1, 1], density.to_vec(), GridFilter::Nearest)]));
    let boxes = images(&room(vec![left, right]));
    assert_only_rounding("halves", &boxes, &halves([0.4, 1.6]), &halves([0.42, 1.6]));
}

/// A rotated cloud with holes, surrounded by thin fog.
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
