//! The images of several gates have the same bits whether the host keeps them or the device.

use std::time::Duration;

use super::cells::settings;
use super::drive::open;
use super::in_flight::iterate_for;
use taugate::internals::generate::zoo::Light;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::{Device, Drive};
use taugate::internals::image::accumulation::{About, Accumulation, file};
use taugate::internals::image::layers::Layers;
use taugate::internals::job::iterations::begin;
use taugate::internals::render::schedule::Schedule;
use taugate::internals::render::{Renderer, Tuning};
use taugate::internals::scene::{Medium, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Edge, Estimator, Response, Responses, Sampling, Settings, SettingsBuilder};

const SIZE: [u32; 2] = [20, 14];
const GATE: Gate = Gate { lo: 7.0, hi: 12.0 };

fn gates(gate: Gate, count: u32) -> Responses {
    Gates::new(gate, count).unwrap().into()
}

fn of(estimator: Estimator) -> SettingsBuilder {
    settings(estimator, SIZE).responses(gates(GATE, 20)).sampling(Sampling::Adaptive)
}

/// A renderer with variances whose images are on the device or on the host. The device must compute with 64 bits.
fn renderer(device: &Device, scene: &Scene, settings: &Settings, on_device: bool) -> Renderer {
    let tuning = Tuning { tile: Some(150), device_film: Some(on_device), ..Tuning::default() };
    let mut renderer = Renderer::with_tuning(device, scene, settings, tuning).unwrap_or_else(|e| panic!("{e}"));
    renderer.estimate_response_variance();
    assert_eq!(renderer.may_lose_images(), !on_device);
    renderer
}

/// Whether the device computes with 64 bits. SwiftShader does not.
fn has_f64(device: &Device) -> bool {
    let has = device.info().has_f64;
    if !has {
        eprintln!("skipped: {} does not compute with 64 bits", device.info().name);
    }
    has
}

/// The bits of the images of all gates, their variances, their sum and its variance.
fn bits(renderer: &Renderer) -> Vec<u32> {
    let (film, all) = (renderer.film(), renderer.responses().unwrap().expect("there are several gates"));
    let images = (0..all.responses()).flat_map(|k| [all.mean(k), all.variance_of_mean(k)]);
    let lit = (0..all.responses()).filter(|&k| all.mean(k).iter().any(|&x| x > 0.0)).count();
    assert!(lit > 3, "light in {lit} gates proves nothing");
    images.chain([film.mean(), film.variance_of_mean()]).flatten().map(f32::to_bits).collect()
}

fn render(renderer: &mut Renderer, schedule: &Schedule) -> Vec<u32> {
    while let Some(samples) = begin(renderer, schedule, Duration::ZERO) {
        renderer.iterate(samples).unwrap_or_else(|e| panic!("{e}"));
    }
    bits(renderer)
}

#[test]
fn images_on_the_device_have_the_same_bits() {
    let room = build(Kind::Zoo(Light::Area));
    let foggy =
        Scene { media: vec![Medium { sigma_s: [0.1; 3], ..Medium::default() }], ..build(Kind::Zoo(Light::Beam)) };
    let from_16m = |width| gates(Gate { lo: 16.0, hi: 16.0 + 20.0 * width }, 20);
    let cases = [
        (Drive::CPU, &room, of(Estimator::Lcs)),
        (Drive::CARD, &room, of(Estimator::Lcs)),
        // Gates so thin that queries use trees.
        (Drive::CARD, &room, of(Estimator::Lcs).responses(gates(Gate { lo: 8.0, hi: 8.4 }, 20))),
        (Drive::CARD, &foggy, of(Estimator::Bdpt)),
        // Light of photons, through water; samples that stop at thin glass.
        (Drive::CARD, &build(Kind::Pool), of(Estimator::Lcs).responses(gates(Gate { lo: 3.0, hi: 18.0 }, 20))),
        (Drive::CARD, &build(Kind::Windscreen), of(Estimator::Bdpt).responses(from_16m(2.0))),
    ];
    for (case, (drive, scene, settings)) in cases.into_iter().enumerate() {
        let device = open(drive);
        if !has_f64(&device) {
            return;
        }
        let settings = settings.build().unwrap();
        let schedule = Schedule::whole(Budget::Spp(9));
        let [expected, found] =
            [false, true].map(|on_device| render(&mut renderer(&device, scene, &settings, on_device), &schedule));
        assert!(expected == found, "case {case}: the bits differ");
    }
}

#[test]
fn the_device_keeps_ascending_gates_with_sharp_edges_alone() {
    let (device, scene) = (open(Drive::CARD), build(Kind::CornellBox));
    if !has_f64(&device) {
        return;
    }
    let is_kept = |responses: Responses, size| {
        let settings = settings(Estimator::Bdpt, size).responses(responses).build().unwrap();
        !Renderer::new(&device, &scene, &settings).unwrap().may_lose_images()
    };
    let thin = || gates(GATE, 4);
    assert!(is_kept(thin(), [32, 32]));
    // One thread adds the light of a pixel.
    assert!(!is_kept(thin(), [32, 31]));
    // Three numbers of 8 bytes per gate and pixel.
    let fits = device.info().largest_buffer() >= 24 * 4096 * 64 * 32;
    assert_eq!(is_kept(gates(GATE, 4096), [64, 32]), fits);
    let of_two = |second: f64, edge| {
        let gate = |name: &str, lo: f64| Response::new(name, Gate { lo, hi: lo + 2.0 }, edge);
        Responses::new(vec![gate("first", 7.0), gate("second", second)]).unwrap()
    };
    assert!(is_kept(of_two(9.0, Edge::Sharp), [32, 32]));
    assert!(!is_kept(of_two(8.0, Edge::Sharp), [32, 32]), "gates that overlap");
    assert!(!is_kept(of_two(6.0, Edge::Sharp), [32, 32]), "gates that descend");
    assert!(!is_kept(of_two(9.5, Edge::Gauss(0.1)), [32, 32]), "soft gates");
}

/// The sums of a render, from a file.
fn stored(renderer: &Renderer, settings: &Settings) -> Accumulation {
    let about = renderer.about(&About::new(settings, String::new(), &[], String::new(), Shard::ALL), 1.0);
    let (layers, adaptive) = (Layers::default(), renderer.adaptive_state());
    let (film, responses) = (renderer.film(), renderer.responses().unwrap());
    let mut bytes = std::io::Cursor::new(vec![]);
    let parts = file::Parts { about: &about, film, responses, adaptive: adaptive.as_ref(), layers: &layers };
    file::write_to(&mut bytes, parts).unwrap();
    file::read_from(&mut bytes).unwrap()
}

#[test]
fn a_render_goes_on_and_begins_again() {
    let (device, scene, settings) = (open(Drive::CARD), build(Kind::Zoo(Light::Area)), of(Estimator::Lcs));
    if !has_f64(&device) {
        return;
    }
    let settings = settings.build().unwrap();
    let [few, all] = [4, 9].map(|spp| Schedule::whole(Budget::Spp(spp)));
    let expected = render(&mut renderer(&device, &scene, &settings, false), &all);
    let [mut first, mut second] = [(); 2].map(|()| renderer(&device, &scene, &settings, true));
    render(&mut first, &few);
    second.resume(stored(&first, &settings)).unwrap();
    assert!(render(&mut second, &all) == expected, "after a file of sums");
    assert!(render(&mut first, &all) == expected, "after a look at the images");
    second.restart(settings.seed(), settings.responses().clone()).unwrap();
    assert!(render(&mut second, &all) == expected, "after another beginning");
}

#[test]
fn an_abandoned_iteration_leaves_no_trace() {
    let (device, scene, settings) = (open(Drive::CARD), build(Kind::Zoo(Light::Area)), of(Estimator::Lcs));
    if !has_f64(&device) {
        return;
    }
    let settings = settings.build().unwrap();
    let all = Schedule::whole(Budget::Spp(9));
    let expected = render(&mut renderer(&device, &scene, &settings, false), &all);
    let mut renderer = renderer(&device, &scene, &settings, true);
    let (mut abandoned, mut pause) = (0, Duration::from_micros(100));
    while let Some(samples) = begin(&mut renderer, &all, Duration::ZERO) {
        let is_complete = iterate_for(&mut renderer, samples, pause);
        if !is_complete {
            abandoned += 1;
        }
        pause = if is_complete { pause.div_f64(4.0) } else { pause.mul_f64(1.5) };
    }
    assert!(abandoned > 4, "only {abandoned} iterations were abandoned");
    assert!(bits(&renderer) == expected);
}
