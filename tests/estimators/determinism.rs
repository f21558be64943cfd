//! The same seed gives the same bits when a render is repeated, cropped, or run with other tile and workgroup sizes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::cells::{is_long, renderer, settings, tuned};
use taugate::internals::generate::{Kind, build};
use taugate::internals::job::iterations::begin;
use taugate::internals::render::schedule::{Following, Lengths, Planned, Schedule, samples_before};
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Crop, Edge, Estimator, Response, Responses, Sampling};

const SIZE: [u32; 2] = [40, 24];
const GATE: Gate = Gate { lo: 8.0, hi: 9.0 };
const ESTIMATORS: [Estimator; 5] = Estimator::ALL;

fn image(mut renderer: Renderer, seed: u32) -> Vec<u32> {
    renderer.restart(seed, GATE).unwrap();
    for samples in [2, 3] {
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    let mean = renderer.film().mean();
    assert!(mean.iter().any(|&x| x > 0.0), "a black image proves nothing");
    mean.iter().map(|x| x.to_bits()).collect()
}

/// `devices --check` renders with workgroups of 32.
#[test]
fn rerun_tile_and_workgroup_give_the_same_bits() {
    let scene = build(Kind::ClutteredRoom { triangles: 5_000 });
    let usual = Tuning::default();
    let adaptive = [Estimator::Pt, Estimator::Lcs].map(|estimator| (estimator, Sampling::Adaptive));
    for (estimator, sampling) in ESTIMATORS.map(|estimator| (estimator, Sampling::Uniform)).into_iter().chain(adaptive)
    {
        // Long runs test all estimators and both ways to sample.
        if (estimator, sampling) != (Estimator::Lcs, Sampling::Adaptive) && !is_long() {
            continue;
        }
        let settings = settings(estimator, SIZE).sampling(sampling).build().unwrap();
        let first = image(renderer(&scene, &settings), 5);
        assert!(first == image(renderer(&scene, &settings), 5), "{estimator:?}, {sampling}: the second render differs");
        assert!(
            first != image(renderer(&scene, &settings), 6),
            "{estimator:?}, {sampling}: seed 6 gives the same image"
        );
        for (name, tuning) in [
            ("tile of 100 paths", Tuning { tile: Some(100), ..usual }),
            ("workgroups of 256", Tuning { workgroup: 256, tile: Some(1000), ..usual }),
        ] {
            assert!(first == image(tuned(&scene, &settings, tuning), 5), "{estimator:?}, {sampling}: {name}");
        }
    }
}

#[test]
fn a_crop_is_a_part_of_the_whole_image() {
    let scene = build(Kind::CornellBox);
    for estimator in ESTIMATORS {
        let settings = settings(estimator, SIZE).build().unwrap();
        let whole = image(renderer(&scene, &settings), 5);
        let cropped = settings.change().crop(Crop { x0: 7, y0: 3, x1: 30, y1: 17 }).build().unwrap();
        let part = image(renderer(&scene, &cropped), 5);
        let width = cropped.crop().width() as usize;
        for (i, pixel) in part.chunks_exact(3).enumerate() {
            let (x, y) = (7 + i % width, 3 + i / width);
            let at = (y * SIZE[0] as usize + x) * 3;
            assert_eq!(pixel, &whole[at..at + 3], "{estimator:?}: pixel {x}, {y}");
        }
    }
}

#[test]
fn each_iteration_adds_its_samples() {
    let scene = build(Kind::CornellBox);
    let settings = settings(Estimator::LcsPaper, SIZE).build().unwrap();
    let mut renderer = renderer(&scene, &settings);
    renderer.restart(9, GATE).unwrap();
    renderer.iterate(2).unwrap_or_else(|e| panic!("{e}"));
    let two = renderer.film().mean();
    renderer.iterate(2).unwrap_or_else(|e| panic!("{e}"));
    let four = renderer.film().mean();
    assert_ne!(two, four);
    assert_eq!(renderer.film().samples(), 4);
}

/// Abandons an iteration after ever longer times, until it is completed, and calls `visit` after each attempt that failed. Returns
/// their number.
fn abandon_until_complete(renderer: &mut Renderer, visit: impl Fn(&Renderer)) -> i32 {
    for abandoned in 0.. {
        let stop = Arc::new(AtomicBool::new(false));
        let later = std::thread::spawn({
            let stop = stop.clone();
            move || {
                std::thread::sleep(Duration::from_millis(1).mul_f64(1.4f64.powi(abandoned)));
                stop.store(true, Ordering::Relaxed);
            }
        });
        let is_complete = renderer.iterate_unless(4, &stop).unwrap();
        later.join().unwrap();
        if is_complete {
            return abandoned;
        }
        visit(renderer);
    }
    unreachable!("the attempts have no end")
}

#[test]
fn an_abandoned_iteration_leaves_no_trace() {
    let scene = build(Kind::ClutteredRoom { triangles: 5_000 });
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let settings = settings(estimator, [96, 64]).build().unwrap();
        let [mut whole, mut other] = [(); 2].map(|()| renderer(&scene, &settings));
        for renderer in [&mut whole, &mut other] {
            renderer.restart(5, GATE).unwrap();
            renderer.iterate(2).unwrap();
        }
        whole.iterate(4).unwrap();
        let abandoned = abandon_until_complete(&mut other, |other| assert_eq!(other.film().iterations(), 1));
        assert!(abandoned > 3, "{estimator:?}: only {abandoned} iterations were abandoned");
        let bits = |renderer: &Renderer| renderer.film().mean().iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
        assert!(bits(&whole) == bits(&other), "{estimator:?}: the image has other bits");
        let counts = |renderer: &Renderer| {
            let stats = renderer.stats();
            [
                stats.samples,
                stats.closest_rays,
                stats.shade_points,
                stats.candidates,
                stats.live_candidates,
                stats.shadow_rays,
            ]
        };
        assert_eq!(counts(&whole), counts(&other), "{estimator:?}");
    }
}

#[test]
fn a_longer_render_begins_with_the_bits_of_a_shorter_one() {
    let scene = build(Kind::CornellBox);
    for (estimator, sampling) in [(Estimator::Lcs, Sampling::Adaptive), (Estimator::Bdpt, Sampling::Uniform)] {
        let film = |budget: Budget, iterations: u32| {
            let settings = settings(estimator, SIZE).gate(GATE).budget(budget).sampling(sampling).build().unwrap();
            let mut renderer = renderer(&scene, &settings);
            if budget == Budget::Spp(24) {
                renderer.render(budget).unwrap_or_else(|e| panic!("{e}"));
                assert_eq!(renderer.film().iterations(), iterations);
            }
            while renderer.film().iterations() < iterations {
                let next = Schedule::whole(budget).next(renderer.rendered(), 1.0).unwrap();
                renderer.iterate(next.samples).unwrap_or_else(|e| panic!("{e}"));
            }
            let film = renderer.film();
            assert_eq!(film.samples(), 24, "not eight iterations of 2 samples and two of 4");
            [film.mean(), film.variance_of_mean()].map(|image| image.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        };
        let short = film(Budget::Spp(24), 10);
        assert!(short.iter().all(|image| image.iter().any(|&bits| bits > 0)), "a black image proves nothing");
        assert!(short == film(Budget::Spp(1000), 10), "{estimator:?}: more samples");
        assert!(short == film(Budget::Seconds(1e6), 10), "{estimator:?}: a budget of seconds");
    }
}

/// Several tiles of an abandoned iteration are in the images of its responses, and are removed from them.
#[test]
#[ignore = "takes ten seconds; an abandoned iteration of one gate is tested always"]
fn a_render_of_responses_survives_abandoned_iterations() {
    let scene = build(Kind::ClutteredRoom { triangles: 5_000 });
    let gates: Responses = Gates::new(Gate { lo: 8.0, hi: 10.0 }, 4).unwrap().into();
    let gauss = Responses::new(vec![Response::new("gauss", GATE, Edge::Gauss(0.1))]).unwrap();
    for responses in [gates, gauss] {
        let settings = settings(Estimator::Lcs, [96, 64]).responses(responses).build().unwrap();
        let [mut whole, mut other] = [(); 2].map(|()| renderer(&scene, &settings));
        for renderer in [&mut whole, &mut other] {
            renderer.iterate(2).unwrap();
        }
        let abandoned = abandon_until_complete(&mut other, |other| assert_eq!(other.film().iterations(), 1));
        assert!(abandoned > 3, "only {abandoned} iterations were abandoned");
        whole.iterate(4).unwrap();
        assert!(whole.film().mean() == other.film().mean(), "the image has other bits");
        let images = |renderer: &Renderer| {
            renderer.responses().unwrap().map(|film| (0..film.responses()).map(|k| film.mean(k)).collect::<Vec<_>>())
        };
        assert!(images(&whole) == images(&other), "the images of the gates have other bits");
    }
}

#[test]
fn an_iteration_is_announced_when_the_one_before_begins() {
    let settings = settings(Estimator::Bdpt, [8, 8]).gate(GATE).build().unwrap();
    let mut renderer = renderer(&build(Kind::CornellBox), &settings);
    let shard = Shard::new(1, 2).unwrap();
    let (mut announced, mut iterations) = (vec![], vec![]);
    let schedule = Schedule::Budget { budget: Budget::Spp(21), shard, before: 0.0, lengths: Lengths::Growing };
    while let Some(samples) = begin(&mut renderer, &schedule, Duration::ZERO) {
        let number = renderer.rendered().end;
        let after_gap = Some(samples_before(number) as u32);
        iterations.push(Following::Iteration(Planned { number, samples, after_gap }));
        announced.push(renderer.following());
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(renderer.following(), Following::Unknown, "an iteration without an announcement");
    }
    iterations.push(Following::Nothing);
    assert_eq!(announced, iterations[1..]);
    assert_eq!(renderer.film().samples(), 9, "iterations 1, 3, 5 and 7 of 2 samples, and 9 of 1");
}
