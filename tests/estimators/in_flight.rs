//! Two iterations in flight: while the device traces the sensor subpaths of an iteration, the light of the next one is traced, the image
//! of the one before is added to the film, and the samples of the next one are chosen. The image keeps its bits.

use std::io::Cursor;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use super::cells::{is_long, settings};
use super::drive::open;
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::Drive;
use taugate::internals::image::accumulation::{About, Accumulation, file};
use taugate::internals::image::layers::Layers;
use taugate::internals::job::iterations::begin;
use taugate::internals::render::schedule::{Following, Lengths, Planned, Schedule};
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::scene::{Medium, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Sampling, Settings};

const GATE: Gate = Gate { lo: 7.0, hi: 12.0 };
const SIZE: [u32; 2] = [20, 14];
const DRIVES: [Drive; 2] = [Drive::CPU, Drive::CARD];

fn renderer(drive: Drive, in_flight: u32, scene: &Scene, settings: &Settings) -> Renderer {
    let tuning = Tuning { tile: Some(150), in_flight: Some(in_flight), ..Tuning::default() };
    Renderer::with_tuning(&open(drive), scene, settings, tuning).unwrap_or_else(|e| panic!("{e}"))
}

fn adaptive() -> Settings {
    settings(Estimator::Lcs, SIZE).gate(GATE).sampling(Sampling::Adaptive).build().unwrap()
}

fn bits(renderer: &Renderer) -> Vec<u32> {
    let film = renderer.film();
    let responses = renderer.responses().unwrap();
    let images = responses.iter().flat_map(|all| (0..all.responses()).map(|k| all.mean(k)));
    let all = images.chain([film.mean(), film.variance_of_mean()]).flatten();
    let bits: Vec<u32> = all.map(f32::to_bits).collect();
    assert!(film.mean().iter().any(|&x| x > 0.0), "a black image proves nothing");
    bits
}

/// The bits of a render of `schedule`, and the counts of its work.
fn render(renderer: &mut Renderer, schedule: &Schedule) -> (Vec<u32>, [u64; 6]) {
    while let Some(samples) = begin(renderer, schedule, Duration::ZERO) {
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    (bits(renderer), counts(renderer))
}

fn counts(renderer: &Renderer) -> [u64; 6] {
    let s = renderer.stats();
    [s.samples, s.closest_rays, s.shadow_rays, s.inside_gate, s.light_paths, s.scattered_vertices]
}

#[test]
fn the_image_and_the_counts_do_not_depend_on_the_number_in_flight() {
    let room = build(Kind::Zoo(Light::Area));
    let foggy =
        Scene { media: vec![Medium { sigma_s: [0.1; 3], ..Medium::default() }], ..build(Kind::Zoo(Light::Beam)) };
    let of = |estimator: Estimator| settings(estimator, SIZE).gate(GATE).sampling(Sampling::Adaptive);
    let gates = || of(Estimator::Lcs).responses(Gates::new(GATE, 20).unwrap());
    // Adaptive samples are chosen beside another iteration from the fourth one on.
    let whole = Schedule::whole(Budget::Spp(11));
    let shard = Schedule::Budget {
        budget: Budget::Spp(24),
        shard: Shard::new(1, 2).unwrap(),
        before: 0.0,
        lengths: Lengths::Growing,
    };
    let cases = [
        (&room, of(Estimator::Lcs), &whole),
        (&room, of(Estimator::LcsPaper).sampling(Sampling::Uniform), &shard),
        (&room, of(Estimator::Pt), &shard),
        (&room, of(Estimator::Bdpt), &whole),
        (&room, gates(), &whole),
        (&foggy, of(Estimator::Lcs), &whole),
    ];
    // Long runs test all cases.
    let tested = if is_long() { 0..6 } else { 4..5 };
    for (case, (scene, settings, schedule)) in cases.into_iter().enumerate().skip(tested.start).take(tested.len()) {
        let settings = settings.build().unwrap();
        for drive in DRIVES {
            let result = |in_flight| {
                let mut renderer = renderer(drive, in_flight, scene, &settings);
                let result = render(&mut renderer, schedule);
                assert_eq!(renderer.stats().beside_seconds > 0.0, in_flight == 2);
                result
            };
            assert!(result(1) == result(2), "case {case}, {drive:?}");
        }
    }
}

/// This render would not end if phase 3 waited for the device while the light of the next iteration needs it, or if the image of the
/// iteration before were added to the film later.
#[test]
fn trees_are_built_and_images_added_while_sensor_subpaths_are_traced() {
    for (drive, sampling) in [(Drive::CPU, Sampling::Adaptive), (Drive::CARD, Sampling::Uniform)] {
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            let settings = adaptive().change().sampling(sampling).build().unwrap();
            let tuning = Tuning { tile: Some(150), in_flight: Some(2), holds_for_host: true, ..Tuning::default() };
            let mut renderer =
                Renderer::with_tuning(&open(drive), &build(Kind::Zoo(Light::Area)), &settings, tuning).unwrap();
            sender.send(render(&mut renderer, &Schedule::whole(Budget::Spp(8))))
        });
        receiver.recv_timeout(Duration::from_secs(300)).unwrap_or_else(|_| panic!("{drive:?}: a tile waits for ever"));
    }
}

/// Light that was traced for an iteration that does not come, or for another gate, is not used.
#[test]
fn light_of_another_iteration_is_not_used() {
    let scene = build(Kind::Zoo(Light::Area));
    let settings = settings(Estimator::Lcs, SIZE).gate(GATE).build().unwrap();
    let mut renderers = [1, 2].map(|in_flight| renderer(Drive::CARD, in_flight, &scene, &settings));
    let step = |renderer: &mut Renderer, samples: u32, next: Planned| {
        renderer.announce(Following::Perhaps(next));
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    };
    let after = |number, samples| Planned { number, samples, after_gap: None };
    let [expected, found] = renderers.each_mut().map(|renderer| {
        // Fewer samples than announced, then another iteration, then another gate and another seed.
        step(renderer, 2, after(1, 4));
        step(renderer, 3, after(7, 2));
        step(renderer, 2, after(3, 2));
        let mut all = bits(renderer);
        renderer.restart(9, Gate { lo: 8.0, hi: 10.0 }).unwrap();
        step(renderer, 2, after(1, 2));
        step(renderer, 2, after(2, 2));
        all.extend(bits(renderer));
        all
    });
    assert!(expected == found);
}

/// The sums of a render, from a file.
fn stored(renderer: &Renderer, settings: &Settings) -> Accumulation {
    let about = renderer.about(&About::new(settings, String::new(), &[], String::new(), Shard::ALL), 1.0);
    let (layers, adaptive) = (Layers::default(), renderer.adaptive_state());
    let (film, responses) = (renderer.film(), renderer.responses().unwrap());
    let mut bytes = Cursor::new(vec![]);
    file::write_to(
        &mut bytes,
        file::Parts { about: &about, film, responses, adaptive: adaptive.as_ref(), layers: &layers },
    )
    .unwrap();
    file::read_from(&mut bytes).unwrap()
}

#[test]
fn a_render_that_goes_on_has_the_same_bits() {
    let (scene, settings) = (build(Kind::Zoo(Light::Area)), adaptive());
    let whole = Schedule::whole(Budget::Spp(16));
    let expected = render(&mut renderer(Drive::CPU, 1, &scene, &settings), &whole).0;
    for (drive, in_flight, first) in
        [(Drive::CPU, 1, 8), (Drive::CARD, 2, 8), (Drive::CARD, 2, 4), (Drive::CARD, 2, 10)]
    {
        let mut one = renderer(drive, in_flight, &scene, &settings);
        render(&mut one, &Schedule::whole(Budget::Spp(first)));
        let mut other = renderer(drive, in_flight, &scene, &settings);
        other.iterate(2).unwrap();
        other.resume(stored(&one, &settings)).unwrap();
        assert!(render(&mut other, &whole).0 == expected, "{in_flight} in flight, {first} samples first");
    }
}

/// Seconds that an iteration takes, as far as the schedule knows, and the budget.
const SECONDS: [f64; 2] = [1.0, 6.2];

#[test]
fn a_budget_of_seconds_keeps_whole_iterations() {
    let (scene, settings) = (build(Kind::Zoo(Light::Area)), adaptive());
    let schedule = Schedule::whole(Budget::Seconds(SECONDS[1]));
    let [expected, found] = [1, 2].map(|in_flight| {
        let mut renderer = renderer(Drive::CARD, in_flight, &scene, &settings);
        let mut iterations = 0;
        while let Some(samples) =
            begin(&mut renderer, &schedule, Duration::from_secs_f64(SECONDS[0] * f64::from(iterations)))
        {
            assert!(matches!(renderer.following(), Following::Perhaps(_)));
            renderer.iterate(samples).unwrap();
            iterations += 1;
            assert_eq!(renderer.rendered().iterations, iterations);
        }
        assert_eq!((iterations, renderer.film().iterations(), renderer.film().samples()), (6, 6, 12));
        let samples = renderer.samples_of_pixels();
        assert!(samples.iter().sum::<u32>().abs_diff(12 * SIZE[0] * SIZE[1]) <= 8);
        (bits(&renderer), samples)
    });
    assert!(expected == found);
    let whole = Schedule::whole(Budget::Spp(12));
    assert!(render(&mut renderer(Drive::CPU, 1, &scene, &settings), &whole).0 == found.0);
}

/// Renders an iteration that is abandoned after this time. Returns whether it was completed.
pub fn iterate_for(renderer: &mut Renderer, samples: u32, time: Duration) -> bool {
    let stop = Arc::new(AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(time);
            stop.store(true, Ordering::Relaxed);
        });
        renderer.iterate_unless(samples, &stop).unwrap()
    })
}

#[test]
fn an_abandoned_iteration_leaves_no_trace_in_the_others() {
    let (scene, settings) = (build(Kind::Zoo(Light::Area)), adaptive());
    let whole = Schedule::whole(Budget::Spp(16));
    let expected = render(&mut renderer(Drive::CARD, 1, &scene, &settings), &whole);
    let mut renderer = renderer(Drive::CARD, 2, &scene, &settings);
    let (mut abandoned, mut pause) = (0, Duration::from_micros(100));
    while let Some(samples) = begin(&mut renderer, &whole, Duration::ZERO) {
        let before = renderer.rendered();
        if iterate_for(&mut renderer, samples, pause) {
            pause = pause.div_f64(4.0);
        } else {
            (abandoned, pause) = (abandoned + 1, pause.mul_f64(1.5));
            assert_eq!(renderer.rendered(), before);
            assert_eq!(renderer.film().iterations(), before.iterations);
        }
    }
    assert!(abandoned > 12, "only {abandoned} iterations were abandoned");
    assert!((bits(&renderer), expected.1) == (expected.0, counts(&renderer)));
}
