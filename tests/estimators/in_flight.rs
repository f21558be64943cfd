//! Two iterations in flight: the light of the next iteration is traced while the device traces the sensor subpaths of this one. The
//! image keeps its bits.

use std::sync::mpsc::channel;
use std::time::Duration;

use super::cells::{is_long, settings};
use super::drive::open;
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::Drive;
use taugate::internals::job::iterations::begin;
use taugate::internals::render::schedule::{Following, Planned, Schedule};
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::scene::{Medium, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Settings};

const GATE: Gate = Gate { lo: 7.0, hi: 12.0 };
const SIZE: [u32; 2] = [20, 14];
const DRIVES: [Drive; 2] = [Drive::CPU, Drive::CARD];

fn renderer(drive: Drive, in_flight: u32, scene: &Scene, settings: &Settings) -> Renderer {
    let tuning = Tuning { tile: Some(150), in_flight: Some(in_flight), ..Tuning::default() };
    Renderer::with_tuning(&open(drive), scene, settings, tuning).unwrap_or_else(|e| panic!("{e}"))
}

fn bits(renderer: &Renderer) -> Vec<u32> {
    let film = renderer.film();
    let responses = renderer.responses();
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
    let s = renderer.stats();
    let counts = [s.samples, s.closest_rays, s.shadow_rays, s.inside_gate, s.light_paths, s.scattered_vertices];
    (bits(renderer), counts)
}

#[test]
fn the_image_and_the_counts_do_not_depend_on_the_number_in_flight() {
    let room = build(Kind::Zoo(Light::Area));
    let foggy =
        Scene { media: vec![Medium { sigma_s: [0.1; 3], ..Medium::default() }], ..build(Kind::Zoo(Light::Beam)) };
    let of = |estimator: Estimator| settings(estimator, SIZE).gate(GATE);
    let gates = || of(Estimator::Lcs).responses(Gates::new(GATE, 20).unwrap());
    let whole = Schedule::whole(Budget::Spp(8));
    let shard = Schedule::Budget { budget: Budget::Spp(12), shard: Shard::new(1, 2).unwrap(), before: 0.0 };
    let cases = [
        (&room, of(Estimator::Lcs), &whole),
        (&room, of(Estimator::LcsPaper), &shard),
        (&room, of(Estimator::Bdpt), &whole),
        (&room, gates(), &whole),
        (&foggy, of(Estimator::Lcs), &whole),
    ];
    // Long runs test all cases.
    let tested = if is_long() { 0..5 } else { 3..4 };
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

/// If phase 3 waited for the device while the light of the next iteration needs it, this render would not end.
#[test]
fn trees_are_built_while_sensor_subpaths_are_traced() {
    for drive in DRIVES {
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            let settings = settings(Estimator::Lcs, SIZE).gate(GATE).build().unwrap();
            let tuning = Tuning { tile: Some(150), in_flight: Some(2), holds_for_light: true, ..Tuning::default() };
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
    let after = |number, samples| Planned { number, samples, after_gap: false };
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
