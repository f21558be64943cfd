//! Scanning sensors: pixels that look at points of a wall, in the light that a laser spot on the wall sends around a corner.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;
use taugate::internals::generate::parts::{add, diffuse, light, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::scan_table::Scan;
use taugate::internals::render::{MemoryPlan, PreparedScene, Renderer};
use taugate::internals::scan::{Measurement, PreparedScan};
use taugate::internals::scene::{Aim, Camera, LightKind, Medium, Projection, Scene};
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Responses, Settings};

use super::cells::{Cells, device, renderer, settings, threshold};

/// Albedo of the wall.
const WALL: f32 = 0.7;
/// Albedo of the object.
const OBJECT: f32 = 0.5;
/// Power of the laser in watts.
const POWER: f32 = 3.0;
const LASER: DVec3 = DVec3::new(3.0, 0.5, 2.0);
const SENSOR: DVec3 = DVec3::new(3.0, -0.5, 2.5);
/// Point of the wall that the laser lights.
const LIT: DVec3 = DVec3::new(0.2, 0.3, 0.0);
/// Points of the wall that the sensor sees. The first one is lit.
const SEEN: [DVec3; 3] = [DVec3::new(0.2, 0.3, 0.0), DVec3::new(-0.4, 0.1, 0.0), DVec3::new(0.5, -0.6, 0.0)];
/// Travel times between the first and the last point on the wall, in metres. Light arrives from 2.0 m to 3.3 m.
const GATES: [(f64, f64); 4] = [(1.9, 2.1), (2.1, 2.3), (2.3, 2.35), (2.5, 4.0)];

/// A wall, z = 0, and an object of 1 m x 1 m that faces it at a distance of 1 m. The sensor looks at `points`. For each
/// point, travel times leave out `uncounted` metres.
fn scene(lit: DVec3, points: &[DVec3], uncounted: impl Fn(DVec3) -> f64) -> Scene {
    let mut scene = Scene::default();
    let wall = material(&mut scene, diffuse("wall", [WALL; 3]));
    let object = material(&mut scene, diffuse("object", [OBJECT; 3]));
    add(&mut scene, "wall", wall, quad(DVec3::new(-1.0, -1.0, 0.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0; 2]));
    add(&mut scene, "object", object, quad(DVec3::new(-0.5, -0.5, 1.0), DVec3::Y, DVec3::X, [1.0; 2]));
    let kind = LightKind::Beam { power: [POWER; 3], radius: 0.0 };
    light(&mut scene, "laser", LASER, (lit - LASER).normalize(), kind);
    scene.add_camera(sensor(points, uncounted));
    scene
}

fn sensor(points: &[DVec3], uncounted: impl Fn(DVec3) -> f64) -> Camera {
    let aims: Vec<Aim> = points.iter().map(|&point| Aim { point, uncounted: uncounted(point) }).collect();
    let projection = Projection::Aimed { aims: aims.into(), pixel_fov: 0.0 };
    Camera { projection, ..Camera::looking_at("sensor", SENSOR, points[0], 1.0, [points.len() as u32, 1]) }
}

/// Distance from the laser to the wall plus distance from the wall to the sensor.
fn length_of_ends(lit: DVec3, seen: DVec3) -> f64 {
    LASER.distance(lit) + SENSOR.distance(seen)
}

/// Radiance in the gate [lo, hi) at the point `seen` of the wall, after one reflection by the object: a quadrature over the object. The
/// lit point has the radiant intensity POWER * WALL / pi * cos(theta), in W/sr.
fn radiance(seen: DVec3, (lo, hi): (f64, f64)) -> f64 {
    const STEPS: u32 = 1000;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS) - 0.5;
    let mut sum = 0.0;
    for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
        let point = DVec3::new(at(i), at(j), 1.0);
        let (a, b) = (point - LIT, point - seen);
        if (lo..hi).contains(&(a.length() + b.length())) {
            // The planes are parallel, so both cosines of a segment are its z over its length.
            let form = |d: DVec3| d.z * d.z / d.length().powi(4);
            sum += form(a) * form(b);
        }
    }
    let albedos = f64::from(WALL * OBJECT * WALL) / PI.powi(3);
    f64::from(POWER) * albedos * sum / f64::from(STEPS * STEPS)
}

fn scan_settings(estimator: Estimator, points: &[DVec3]) -> Settings {
    settings(estimator, [points.len() as u32, 1]).max_depth(4).light_paths(4000).build().unwrap()
}

#[test]
fn a_wall_has_the_radiance_of_the_closed_form() {
    for estimator in [Estimator::Bdpt, Estimator::LcsPaper, Estimator::Lcs] {
        let mut whole =
            renderer(&scene(LIT, &SEEN, |seen| length_of_ends(LIT, seen)), &scan_settings(estimator, &SEEN));
        for (g, gate) in GATES.into_iter().enumerate() {
            let cells = Cells::measure(&mut whole, Gate { lo: gate.0, hi: gate.1 }, 1, 1, 1000, 7 + 100 * g as u32);
            let wrong = |shift: f64| {
                let z = |i: usize| {
                    let truth = radiance(SEEN[i], (gate.0 + shift, gate.1 + shift));
                    ((cells.mean(i) - truth).abs() - 1e-3 * truth) / cells.variance(i).sqrt()
                };
                (0..3).filter(|&i| z(i) > threshold(3 * GATES.len())).collect::<Vec<_>>()
            };
            eprintln!("{estimator} {gate:?}: {} against {}", cells.mean(1), radiance(SEEN[1], gate));
            assert!(wrong(0.0).is_empty(), "{estimator} {gate:?}: points {:?}", wrong(0.0));
            // Negative control: travel times that are 3 cm longer.
            assert!(!wrong(0.03).is_empty(), "{estimator} {gate:?}");
        }
    }
}

#[test]
fn ways_to_the_wall_count_unless_they_are_left_out() {
    let settings = scan_settings(Estimator::Lcs, &SEEN[..1]);
    let mut uncounted = renderer(&scene(LIT, &SEEN[..1], |seen| length_of_ends(LIT, seen)), &settings);
    let mut counted = renderer(&scene(LIT, &SEEN[..1], |_| 0.0), &settings);
    let (lo, hi) = (GATES[1].0, GATES[1].1);
    let ends = length_of_ends(LIT, SEEN[0]);
    let without = Cells::measure(&mut uncounted, Gate { lo, hi }, 1, 1, 400, 1);
    let with = Cells::measure(&mut counted, Gate { lo: lo + ends, hi: hi + ends }, 1, 1, 400, 1);
    let difference = (without.mean(0) - with.mean(0)).abs();
    assert!(difference < 1e-3 * with.mean(0), "{} {}", without.mean(0), with.mean(0));
}

/// A LiDAR above a floor: light goes to the floor and straight back. The cone of the laser and the field of view are so narrow that the
/// floor is a plane of one distance.
#[test]
fn a_lidar_sees_what_its_laser_lights() {
    let seen = SEEN[0];
    let (distance, axis) = (LASER.distance(seen), (seen - LASER).normalize());
    let (half, power) = (0.05f64.to_radians(), 2.0);
    let intensity = power / (2.0 * PI * (1.0 - half.cos()));
    let truth = f64::from(WALL) / PI * intensity * -axis.z / distance.powi(2);
    for pixel_fov in [0.0, half] {
        let mut scene = scene(seen, &[seen], |_| 0.0);
        scene.lights[0].kind = LightKind::spot([intensity as f32; 3], half as f32, half as f32);
        scene.cameras[0].transform.translation = LASER;
        let aim = Aim { point: seen, uncounted: 0.0 };
        scene.cameras[0].projection = Projection::Aimed { aims: [aim].into(), pixel_fov };
        for estimator in Estimator::ALL {
            let settings = scan_settings(estimator, &[seen]).change().max_depth(2).light_paths(100);
            let gate = |lo: f64| Gate { lo, hi: lo + 0.02 };
            let settings = settings.gate(gate(2.0 * distance - 0.01)).build().unwrap();
            let mut renderer = renderer(&scene, &settings);
            renderer.iterate(64).unwrap();
            let mean = f64::from(renderer.film().mean()[0]);
            assert!((mean / truth - 1.0).abs() < 2e-3, "{estimator}, {pixel_fov}: {mean} against {truth}");
            renderer.restart(2, gate(2.0 * distance + 0.01)).unwrap();
            renderer.iterate(64).unwrap();
            assert!(f64::from(renderer.film().mean()[0]) < 0.2 * truth, "{estimator}: light arrives late");
        }
    }
}

/// After the laser and the sensor turned, a renderer gives the same bits as a new renderer.
#[test]
fn a_turned_laser_gives_the_bits_of_a_new_render() {
    let settings = scan_settings(Estimator::Lcs, &SEEN);
    let settings = settings.change().gate(Gate { lo: GATES[0].0, hi: GATES[2].1 }).build().unwrap();
    let lit = DVec3::new(-0.3, -0.2, 0.0);
    let [first, second] = [LIT, lit].map(|lit| scene(lit, &SEEN, |seen| length_of_ends(lit, seen)));
    let render = |renderer: &mut Renderer| {
        renderer.iterate(32).unwrap();
        renderer.film().mean()
    };
    let new = render(&mut renderer(&second, &settings));

    let mut prepared = PreparedScene::new(&first, &settings).unwrap();
    let mut turned = Renderer::from_prepared(&device(), &first, &settings, &prepared).unwrap();
    let before = render(&mut turned);
    assert!(prepared.follow(&second, &settings).unwrap());
    turned.set_lights(&prepared).unwrap();
    assert!(turned.set_camera(&second.cameras[0]).unwrap());
    let after = render(&mut turned);
    assert!(new.iter().any(|&x| x > 0.0) && after == new && before != new);

    // A renderer cannot follow a scene with one more lamp.
    let mut more = second.clone();
    light(&mut more, "lamp", DVec3::Z, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    assert!(!prepared.follow(&more, &settings).unwrap());
    // Another number of points needs another film.
    assert!(!turned.set_camera(&sensor(&SEEN[..2], |_| 0.0)).unwrap());
}

/// Light goes from the laser to a point of the wall and on to the sensor. If neither way counts, its travel time is 0. The bug:
/// rounding made the travel time of some pixels negative, and a gate that began at 0 left them out.
#[test]
fn a_gate_that_begins_at_0_keeps_the_direct_return() {
    let points: Vec<DVec3> =
        (0..64).map(|i| DVec3::new(f64::from(i % 8), f64::from(i / 8), 0.0) / 8.1 - 0.43).collect();
    let points: Vec<DVec3> = points.into_iter().map(|p| DVec3 { z: 0.0, ..p }).collect();
    let lit_by_cone = |uncounted: &dyn Fn(DVec3) -> f64| {
        let mut scene = scene(DVec3::ZERO, &points, uncounted);
        scene.lights[0].kind = LightKind::spot([1.0; 3], 0.4, 0.4);
        scene
    };
    for estimator in [Estimator::Bdpt, Estimator::Lcs] {
        let settings = || scan_settings(estimator, &points).change().max_depth(2).light_paths(100);
        let mut counted = renderer(&lit_by_cone(&|_| 0.0), &settings().build().unwrap());
        counted.iterate(4).unwrap();
        let truth = counted.film().mean();
        assert!(truth.iter().all(|&x| x > 0.0));
        let kinds =
            [Responses::from(Gate { lo: 0.0, hi: 1.0 }), Gates::new(Gate { lo: 0.0, hi: 1.0 }, 10).unwrap().into()];
        for responses in kinds {
            let settings = settings().responses(responses).build().unwrap();
            let mut uncounted = renderer(&lit_by_cone(&|seen| length_of_ends(seen, seen)), &settings);
            uncounted.iterate(4).unwrap();
            // All of it is in the first gate.
            let first = uncounted.responses().unwrap().map_or_else(|| uncounted.film().mean(), |film| film.mean(0));
            let lost = truth.iter().zip(&first).filter(|(a, b)| (*a - *b).abs() > 1e-3 * **a).count() / 3;
            assert_eq!(lost, 0, "{estimator}, {} gates: {lost} of 64 pixels lose light", settings.responses().len());
        }
    }
}

/// A LiDAR of 4 x 3 beams in front of a wall: the light that comes straight back.
const BEAMS: &str = "[scan]\nlaser = [0.1, 0.2, 0.9]\ndivergence = 4\npixel-fov = 4\n\
                     points = {forward = [0, 0, -1], azimuth = [-30, 30], elevation = [-20, 20], count = [4, 3]}";

/// The beams of a LiDAR share a render. Each has the bits of a render of its own, also in fog, in one gate and in many.
#[test]
fn beams_that_share_a_render_have_the_bits_of_single_beams() {
    let scan = Experiment::parse(BEAMS).unwrap().scan.unwrap().scan().unwrap();
    let fog = Medium { sigma_s: [0.1; 3], sigma_a: [0.01; 3], ..Medium::default() };
    let many: Responses = Gates::new(Gate { lo: 1.0, hi: 8.0 }, 20).unwrap().into();
    let one: Responses = Gate { lo: 1.5, hi: 8.0 }.into();
    for (media, responses) in [(vec![], many.clone()), (vec![], one), (vec![fog], many)] {
        for estimator in [Estimator::Lcs, Estimator::Bdpt] {
            let mut scene = scene(LIT, &[LIT], |_| 0.0);
            (scene.lights, scene.cameras, scene.media) = (vec![scan.light(0)], vec![scan.camera(0)], media.clone());
            let settings = settings(estimator, [1, 1]).max_depth(2).seed(7).budget(Budget::Spp(64));
            let settings = settings.responses(responses.clone()).build().unwrap();
            let prepared = PreparedScan::new(&scan, scene.clone(), &settings, None).unwrap();
            let mut measurement = Measurement::new(&device(), scan.clone(), prepared, true).unwrap();
            let mut renders = 0;
            measurement.run(false, &Arc::default(), |_| renders += 1).unwrap();
            assert!(renders == 1 && measurement.is_whole(), "one render has all beams");
            let together = measurement.into_arrays();

            let single = |number: usize, seed: u32| {
                let mut scene = scene.clone();
                (scene.lights[0], scene.cameras[0]) = (scan.light(number), scan.camera(number));
                let settings = settings.change().seed(seed).build().unwrap();
                let prepared = PreparedScene::new(&scene, &settings).unwrap().with_own_lasers(&[seed]);
                let memory = MemoryPlan::new(&scene, &settings, &prepared, Some(device().info())).unwrap();
                let mut renderer = Renderer::from_memory_plan(&device(), memory, &scene, &prepared).unwrap();
                (0..4).for_each(|_| renderer.iterate(16).unwrap());
                let all =
                    renderer.responses().unwrap().map_or(renderer.film().mean(), |film| film.means_of(0).collect());
                all.chunks_exact(3).map(|rgb| rgb.iter().sum::<f32>() * (1.0 / 3.0)).collect::<Vec<f32>>()
            };
            for number in 0..12 {
                let beam: Vec<f32> = together.means.iter().skip(number).step_by(12).copied().collect();
                assert!(beam.iter().any(|&x| x > 0.0), "beam {number} is dark");
                let seed = Scan::seed(7, number);
                assert_eq!(beam, single(number, seed), "{estimator}, beam {number}");
                // Negative controls: another seed, and the next beam.
                assert_ne!(beam, single(number, seed + 1));
                assert_ne!(beam, single((number + 1) % 12, seed));
            }
        }
    }
}
