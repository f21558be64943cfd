//! The image has the same bits however the host drives the device. On a graphics card the host waits rarely and allocates nothing
//! per iteration.

use super::cells::{is_long, settings};
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::{Device, Drive};
use taugate::internals::image::film::Film;
use taugate::internals::render::schedule::{Following, Planned};
use taugate::internals::render::{PreparedScene, Renderer, StrategyImage, StrategyImages, Tuning, probe};
use taugate::internals::scene::{Medium, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Sampling, Settings, UseEllipsoids};

const SIZE: [u32; 2] = [20, 14];
const GATE: Gate = Gate { lo: 7.0, hi: 12.0 };
const SAMPLES: [u32; 3] = [2, 3, 2];
/// Paths per tile, so few that an iteration has several tiles. With `None`, the renderer adapts tiles and bounces per submit to
/// the time that they take.
const TILE: Option<usize> = Some(150);
/// Drives that differ from `Drive::CPU` or `Drive::CARD` in one property each.
const HALVES: [Drive; 4] = [
    Drive { maps_memory: false, ..Drive::CPU },
    Drive { waits_per_bounce: false, ..Drive::CPU },
    Drive { in_flight: 2, ..Drive::CPU },
    Drive { in_flight: 1, ..Drive::CARD },
];

pub fn open(drive: Drive) -> Device {
    Device::open_with_drive(None, Some(drive)).expect("these tests need a Vulkan device: run ./setup.sh")
}

fn renderer(device: &Device, scene: &Scene, settings: &Settings, tile: Option<usize>) -> Renderer {
    let tuning = Tuning { tile, ..Tuning::default() };
    let mut renderer = Renderer::with_tuning(device, scene, settings, tuning).unwrap_or_else(|e| panic!("{e}"));
    renderer.restart(5, GATE).unwrap();
    renderer
}

/// The bits of the image, and the statistics that do not depend on timing.
fn result(drive: Drive, scene: &Scene, settings: &Settings, tile: Option<usize>) -> (Vec<u32>, [u64; 7]) {
    let device = open(drive);
    let mut renderer = renderer(&device, scene, settings, tile);
    for (samples, next) in SAMPLES.into_iter().zip([1, 2, 3]) {
        let planned = |&samples: &u32| Following::Iteration(Planned { number: next, samples, after_gap: None });
        renderer.announce(SAMPLES.get(next as usize).map_or(Following::Nothing, planned));
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    let works_beside = renderer.stats().beside_seconds > 0.0;
    assert_eq!(works_beside, drive.in_flight == 2, "{drive:?}");
    let mean = renderer.film().mean();
    assert!(mean.iter().any(|&x| x > 0.0), "a black image proves nothing");
    let s = renderer.stats();
    let counts =
        [s.samples, s.closest_rays, s.light_rays, s.shadow_rays, s.shade_points, s.live_candidates, s.inside_gate];
    (mean.iter().map(|x| x.to_bits()).collect(), counts)
}

fn assert_same(scene: &Scene, settings: &Settings, drives: &[Drive]) {
    let expected = result(Drive::CPU, scene, settings, TILE);
    for &drive in drives {
        let found = result(drive, scene, settings, TILE);
        let (estimator, sampling) = (settings.estimator(), settings.sampling());
        assert!(found.0 == expected.0, "{estimator:?}, {sampling}, {drive:?}: the bits differ");
        assert_eq!(found.1, expected.1, "{estimator:?}, {sampling}, {drive:?}");
    }
}

#[test]
fn a_card_renders_the_same_bits() {
    let scene = build(Kind::Zoo(Light::Area));
    // `lcs` resamples its queries, and `lcs-paper` does not. The host divides the searches of `epc` into submits.
    let different = [Estimator::LcsPaper, Estimator::Lcs, Estimator::Epc];
    for &estimator in if is_long() { &Estimator::ALL[..] } else { &different } {
        // Long runs test both ways to sample with all estimators.
        let samplings = [Sampling::Adaptive, Sampling::Uniform];
        for &sampling in if is_long() || estimator == Estimator::Lcs { &samplings[..] } else { &samplings[..1] } {
            assert_same(&scene, &settings(estimator, SIZE).sampling(sampling).build().unwrap(), &[Drive::CARD]);
        }
    }
}

#[test]
#[ignore = "takes ten seconds; a room with an area light is tested always"]
fn lights_without_area_are_the_same_bits_too() {
    for light in [Light::Punctual, Light::Beam] {
        assert_same(&build(Kind::Zoo(light)), &settings(Estimator::Bdpt, SIZE).build().unwrap(), &[Drive::CARD]);
    }
    assert_same(&build(Kind::Zoo(Light::Beam)), &settings(Estimator::Lcs, SIZE).build().unwrap(), &HALVES);
    // In fog, events on the beam have kernels and splats of their own.
    let fog = Medium { sigma_s: [0.1; 3], ..Medium::default() };
    let foggy = Scene { media: vec![fog], ..build(Kind::Zoo(Light::Beam)) };
    assert_same(&foggy, &settings(Estimator::Lcs, SIZE).build().unwrap(), &[Drive::CARD]);
}

#[test]
#[ignore = "takes ten seconds; `lcs` and `epc` are tested always"]
fn ellipsoidal_connections_of_lcs_are_the_same_bits_too() {
    let settings = settings(Estimator::Lcs, SIZE).ellipsoids(UseEllipsoids::On).build().unwrap();
    assert_same(&build(Kind::Zoo(Light::Punctual)), &settings, &[Drive::CARD]);
}

#[test]
fn light_paths_of_several_batches_and_submits_are_the_same_bits() {
    let scene = build(Kind::CornellBox);
    let settings = settings(Estimator::Lcs, SIZE).light_paths(70_000).splat_paths(20_000).build().unwrap();
    let expected = result(Drive::CPU, &scene, &settings, TILE);
    for tile in [TILE, None] {
        assert!(expected == result(Drive::CARD, &scene, &settings, tile), "tiles of {tile:?}");
    }
}

#[test]
fn a_card_waits_once_per_tile_and_allocates_nothing() {
    let device = open(Drive::CARD);
    let scene = build(Kind::Zoo(Light::Area));
    // The host divides the searches of `epc` into submits.
    for estimator in Estimator::ALL.into_iter().filter(|&estimator| estimator != Estimator::Epc) {
        let settings = settings(estimator, SIZE).max_depth(16).build().unwrap();
        let mut renderer = renderer(&device, &scene, &settings, TILE);
        renderer.iterate(2).unwrap_or_else(|e| panic!("{e}"));
        let (allocations, waits) = (device.allocations(), renderer.stats().waits);
        for _ in 0..4 {
            renderer.iterate(2).unwrap_or_else(|e| panic!("{e}"));
        }
        // An iteration takes two samples of 280 pixels: four tiles of at most 75 pixels. It waits once per tile, once for tracing
        // the light subpaths, and once for reading their vertices back.
        assert_eq!(renderer.stats().waits - waits, 4 * (4 + 2), "{estimator:?}");
        assert_eq!(device.allocations(), allocations, "{estimator:?}");
    }
}

/// The numbers are explained in [`a_card_waits_once_per_tile_and_allocates_nothing`].
#[test]
fn a_card_waits_once_per_tile_with_many_gates() {
    let device = open(Drive::CARD);
    let scene = build(Kind::Zoo(Light::Area));
    let gates = Gates::new(GATE, 20).unwrap();
    for estimator in [Estimator::Lcs, Estimator::Bdpt] {
        let settings = settings(estimator, SIZE).responses(gates).max_depth(16).build().unwrap();
        let tuning = Tuning { tile: TILE, ..Tuning::default() };
        let mut renderer = Renderer::with_tuning(&device, &scene, &settings, tuning).unwrap_or_else(|e| panic!("{e}"));
        (0..4).for_each(|_| renderer.iterate(2).unwrap_or_else(|e| panic!("{e}")));
        assert_eq!(renderer.stats().waits, 4 * (4 + 2), "{estimator:?}");
    }
}

#[test]
#[ignore = "takes ten seconds; the images are tested always"]
fn what_is_observed_is_the_same_on_a_card() {
    let scene = build(Kind::Zoo(Light::Punctual));
    let settings = settings(Estimator::Lcs, SIZE).gate(GATE).max_depth(6).light_paths(500).build().unwrap();
    let prepared = PreparedScene::new(&scene, &settings).unwrap_or_else(|e| panic!("{e}"));
    let observed = |drive: Drive| {
        let device = open(drive);
        let mut strategies = StrategyImages::new(&device, &scene, &settings, &prepared).unwrap();
        strategies.iterate(2).unwrap_or_else(|e| panic!("{e}"));
        let bits = |film: &Film| film.mean().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let image = |part: &StrategyImage| (part.s, part.t, bits(&part.weighted), bits(&part.unweighted));
        let times = probe(&device, &scene, &settings, &prepared).unwrap_or_else(|e| panic!("{e}"));
        assert!(times.range().is_some(), "the probe found no light");
        let times = [5.0, 50.0, 95.0].map(|percent| times.percentile(percent));
        (strategies.images().iter().map(image).collect::<Vec<_>>(), times)
    };
    assert!(observed(Drive::CPU) == observed(Drive::CARD));
}
