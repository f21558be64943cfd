//! Light that passes smooth glass or mirrors both before and after it is scattered: photons and merging. Closed forms.

mod limits;
mod media;
mod mirrors;
mod orders;

use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3};
use taugate::internals::generate::parts::{add, camera, diffuse, glass, light, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::render::Tuning;
use taugate::internals::scene::{Aim, LightKind, Material, Projection, Scene};
use taugate::internals::settings::frequencies::Frequencies;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Estimator, Merge, Responses};

use super::cells::{Cells, pool, renderer, seeds, settings, threshold, tuned};

const INDEX: f64 = 1.5;
const WALL: f64 = 4.0;
const INTENSITY: f64 = 10.0;
const ALBEDO: f64 = 0.8;
const THICKNESS: f64 = 0.05;
/// Half of the view in radians, and pixels along each side.
const HALF_VIEW: f64 = 0.05;
const SIDE: u32 = 32;

/// Fresnel reflectance of one face for light without polarisation.
fn face(sine: f64) -> f64 {
    let (c, t) = ((1.0 - sine * sine).sqrt(), (1.0 - (sine / INDEX).powi(2)).sqrt());
    let s = ((c - INDEX * t) / (c + INDEX * t)).powi(2);
    let p = ((INDEX * c - t) / (INDEX * c + t)).powi(2);
    0.5 * (s + p)
}

/// Radiance and travel time of the light that passes a parallel slab to the wall and back, seen at this angle from the axis. Lamp and
/// pinhole are at the same point.
fn behind_slab(angle: f64) -> (f64, f64) {
    let (sine, cosine) = angle.max(1e-6).sin_cos();
    let sine_inside = sine / INDEX;
    let cosine_inside = (1.0 - sine_inside * sine_inside).sqrt();
    let free = WALL - THICKNESS;
    let rho = free * sine / cosine + THICKNESS * sine_inside / cosine_inside;
    let rho_per_angle = free / (cosine * cosine) + THICKNESS * cosine / (INDEX * cosine_inside.powi(3));
    let passed = (1.0 - face(sine)).powi(2);
    let irradiance = INTENSITY * passed * sine / (rho * rho_per_angle);
    (ALBEDO / PI * irradiance * passed, 2.0 * (free / cosine + INDEX * THICKNESS / cosine_inside))
}

/// A wall, a slab of glass 1 m before a camera, and a lamp at the camera.
fn slab() -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("wall", [ALBEDO as f32; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-8.0, -8.0, -WALL), 16.0 * DVec3::X, 16.0 * DVec3::Y, [1.0; 2]));
    let pane = material(&mut scene, glass("pane"));
    add(&mut scene, "pane", pane, cuboid(DVec3::new(-0.15, -0.15, -1.0 - THICKNESS), DVec3::new(0.15, 0.15, -1.0)));
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY as f32; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 2.0 * HALF_VIEW, [SIDE, SIDE]);
    scene
}

/// Mean of the closed form over the pixels of the view, times the weight of its travel time.
fn truth(weight: impl Fn(f64) -> f64) -> f64 {
    mean_over_view(behind_slab, weight)
}

/// As [`truth`], of a function from the angle to radiance and travel time.
fn mean_over_view(of: impl Fn(f64) -> (f64, f64), weight: impl Fn(f64) -> f64) -> f64 {
    let steps = 8 * SIDE;
    let at = |k: u32| HALF_VIEW.tan() * (2.0 * (f64::from(k) + 0.5) / f64::from(steps) - 1.0);
    let mut sum = 0.0;
    for (row, column) in (0..steps).flat_map(|row| (0..steps).map(move |column| (row, column))) {
        let (radiance, tau) = of(at(row).hypot(at(column)).atan());
        sum += radiance * weight(tau);
    }
    sum / f64::from(steps * steps)
}

#[test]
fn a_wall_behind_a_slab_is_seen_through_it() {
    let scene = slab();
    let gate = Gate { lo: 8.04, hi: 8.08 };
    let truth = truth(|tau| if gate.contains(tau) { 1.0 } else { 0.0 });
    for estimator in [Estimator::Bdpt, Estimator::Pt] {
        finds("slab", &scene, estimator, gate, truth);
    }
    let off = settings(Estimator::Bdpt, [SIDE, SIDE]).merge(Merge::Off).build().unwrap();
    assert_eq!(Cells::measure(&mut renderer(&scene, &off), gate, 4, 2, 4, 10).whole().0, 0.0);
}

/// The slab's scene, `scale` times as large and moved. The wall looks the same.
fn slab_at(scale: f64, shift: DVec3) -> Scene {
    let mut scene = slab();
    let to = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), DQuat::IDENTITY, shift);
    scene.instances.iter_mut().for_each(|instance| instance.transform = to * instance.transform);
    scene.lights[0].position = to.transform_point3(scene.lights[0].position);
    scene.lights[0].kind = LightKind::Point { intensity: [(INTENSITY * scale * scale) as f32; 3] };
    scene.cameras[0].transform.translation = to.transform_point3(scene.cameras[0].transform.translation);
    scene
}

#[test]
fn a_slab_of_any_size_and_far_away_is_seen_through() {
    for (scale, shift) in [(1e-3, 0.0), (1e6, 0.0), (1.0, 1e4)] {
        let scene = slab_at(scale, DVec3::new(shift, -shift, shift));
        let gate = Gate { lo: 8.04 * scale, hi: 8.08 * scale };
        let inside = |tau: f64| if gate.contains(tau * scale) { 1.0 } else { 0.0 };
        finds(&format!("scale {scale}, shift {shift}"), &scene, Estimator::Bdpt, gate, truth(inside));
    }
}

/// Light that is corrected to the first order in the radius r comes too early by up to r^2 / (2 d), where d is the distance of its source:
/// here 0.03 mm. Per metre of travel time, this much light comes from the wall.
const EARLY: f64 = 3e-5;
const RATE: f64 = 10.7;

/// The bins of a histogram divide the time in which light comes through the slab. A continuous-wave sensor sees it at any time.
#[test]
fn several_responses_divide_the_light_behind_a_slab() {
    let bins = Responses::from(Gates::new(Gate { lo: 8.05, hi: 8.065 }, 5).unwrap());
    let waves = Responses::from(Frequencies::new(vec![50.0]).unwrap());
    let scene = slab();
    for responses in [bins, waves] {
        let s = settings(Estimator::Lcs, [SIDE, SIDE]).light_paths(200).responses(responses.clone()).build().unwrap();
        let mut renderer = renderer(&scene, &s);
        let mut batches = vec![vec![]; responses.len() + 1];
        for seed in 0..seeds() {
            renderer.restart(400 + seed, responses.clone()).unwrap();
            (0..4).for_each(|_| renderer.iterate(2).unwrap());
            let film = renderer.responses().unwrap().expect("there are several responses");
            let images = (0..responses.len()).map(|k| film.mean(k)).chain([renderer.film().mean()]);
            batches
                .iter_mut()
                .zip(images)
                .for_each(|(batch, image)| batch.push(pool(&image, SIDE as usize, SIDE as usize)[0]));
        }
        let all = |tau: f64| responses.iter().map(|response| response.weight(tau)).sum();
        let single = responses.iter().map(|response| truth(|tau| response.weight(tau)));
        for ((found, variance), truth) in Cells::grey(batches).averages().into_iter().zip(single.chain([truth(all)])) {
            let error = variance.sqrt();
            eprintln!("{found:.6} +- {error:.1e}, expected {truth:.6}");
            let off = |truth: f64| ((found - truth).abs() - 5e-3 * truth.abs() - EARLY * RATE).max(0.0);
            let limit = threshold(11) * error.max(1e-9);
            assert!(off(truth) < limit, "{found} +- {error}, not {truth}");
            assert!(off(1.1 * truth) > limit, "{found} +- {error} could be {}", 1.1 * truth);
        }
    }
}

fn mean(scene: &Scene, estimator: Estimator, gate: Gate, first_seed: u32) -> (f64, f64) {
    let s = settings(estimator, [SIDE, SIDE]).light_paths(200).build().unwrap();
    Cells::measure(&mut renderer(scene, &s), gate, 4, 2, 16, first_seed).whole()
}

/// Asserts that `estimator` finds `truth`, and that light which is 3 % dimmer would be noticed.
fn finds(name: &str, scene: &Scene, estimator: Estimator, gate: Gate, truth: f64) {
    let (found, error) = mean(scene, estimator, gate, 300);
    eprintln!("{name}, {estimator}: {found:.6} +- {error:.1e}, expected {truth:.6}");
    let off = |truth: f64| ((found - truth).abs() - 5e-3 * truth).max(0.0) / error.max(1e-9);
    assert!(off(truth) < threshold(1), "{name}, {estimator}: {found} +- {error}, not {truth}");
    assert!(off(0.97 * truth) > threshold(1), "{name}, {estimator}: {found} +- {error} could be {}", 0.97 * truth);
}

/// A LiDAR whose cover is the slab: a laser with a divergence, and a sensor that looks along a single ray or has a field of view.
#[test]
fn a_lidar_sees_a_wall_through_its_cover() {
    let mut scene = slab();
    scene.lights[0].kind = LightKind::Spot { intensity: [INTENSITY as f32; 3], inner: 0.00199, outer: 0.002 };
    let (truth, time) = behind_slab(0.0);
    for pixel_fov in [0.0, 1e-3, 2.5e-3] {
        let aims = [Aim { point: DVec3::new(0.0, 0.0, -WALL), uncounted: 0.0 }];
        scene.cameras[0].projection = Projection::Aimed { aims: aims.into(), pixel_fov };
        let s = settings(Estimator::Bdpt, [1, 1]).light_paths(200).build().unwrap();
        let gate = Gate { lo: time - 0.01, hi: time + 0.01 };
        let (found, error) = Cells::measure(&mut renderer(&scene, &s), gate, 1, 8, 16, 600).whole();
        eprintln!("{pixel_fov}: {found:.5} +- {error:.1e}, expected {truth:.5}");
        let off = ((found - truth).abs() - 1e-2 * truth).max(0.0);
        assert!(off < threshold(2) * error && error < 0.02 * truth, "{found} +- {error}, not {truth}");
    }
}

/// Lamp and camera are 2 m above water of 1 m. The bed is below the surface of a closed block of water.
#[test]
fn the_bed_of_a_pool_is_seen_from_above() {
    let (height, depth, index, group_index) = (2.0f64, 1.0f64, 1.33f64, 1.36f32);
    let mut scene = Scene::default();
    let bed = material(&mut scene, diffuse("bed", [ALBEDO as f32; 3]));
    let corner = DVec3::new(-4.0, -4.0, -height - depth);
    add(&mut scene, "bed", bed, quad(corner, 8.0 * DVec3::X, 8.0 * DVec3::Y, [1.0; 2]));
    let water = material(&mut scene, Material { ior: index as f32, group_ior: Some(group_index), ..glass("water") });
    let below = DVec3::new(-3.0, -3.0, -height - 2.0 * depth);
    add(&mut scene, "water", water, cuboid(below, DVec3::new(3.0, 3.0, -height)));
    light(&mut scene, "lamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [INTENSITY as f32; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 1e-3, [SIDE, SIDE]);
    let reflected = ((index - 1.0) / (index + 1.0)).powi(2);
    let distance = height + depth / index;
    let irradiance = INTENSITY * (1.0 - reflected) / (distance * distance);
    let truth = ALBEDO / PI * irradiance * (1.0 - reflected) / (index * index);
    let tau = 2.0 * (height + f64::from(group_index) * depth);
    finds("pool", &scene, Estimator::Bdpt, Gate { lo: tau - 0.005, hi: tau + 0.005 }, truth);
}

/// Tiles and workgroups of any size, with one response and with several.
#[test]
fn merging_gives_the_same_bits_whatever_the_tiles() {
    let scene = slab();
    let bins = Responses::from(Gates::new(Gate { lo: 8.048, hi: 8.072 }, 8).unwrap());
    for responses in [Responses::from(Gate::OPEN), bins] {
        let s = settings(Estimator::Lcs, [SIDE, SIDE]).light_paths(200).responses(responses).build().unwrap();
        let bits = |tuning: Tuning| {
            let mut renderer = tuned(&scene, &s, tuning);
            (0..2).for_each(|_| renderer.iterate(2).unwrap());
            let image = renderer.responses().unwrap().map_or_else(|| renderer.film().mean(), |film| film.mean(2));
            image.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        let usual = bits(Tuning::default());
        assert!(usual.iter().any(|&bits| bits != 0));
        assert!(usual == bits(Tuning { tile: Some(100), workgroup: 32, observed: Some(1), ..Tuning::default() }));
    }
}
