//! A spinning LiDAR that drives and turns while it scans a room: the range of each shot against geometry.

use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use taugate::internals::generate::parts::{add, diffuse, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::scan_table::Scan;
use taugate::internals::scan::{Measurement, PreparedScan};
use taugate::internals::scene::Scene;
use taugate::internals::settings::gates::Gates;
use taugate::internals::settings::units::Gate;
use taugate::internals::settings::{Budget, Estimator, Responses};

use super::cells::{device, settings};

/// Corners of the room.
const LOW: DVec3 = DVec3::new(-2.0, -1.0, -3.0);
const HIGH: DVec3 = DVec3::new(2.5, 1.5, 2.0);
/// Where the LiDAR stands in the frame of the car.
const MOUNT: DVec3 = DVec3::new(0.1, 0.4, -0.2);
const CHANNELS: [[f64; 2]; 3] = [[10.0, 1.5], [0.0, -1.5], [-7.0, 0.0]];
const STEPS: u32 = 10;
/// Duration of a turn in seconds, and the time of its first shot.
const DURATION: f64 = 0.1;
const BEGIN: f64 = 2.02;
/// Range of the gates and their number: 1.25 mm of depth each.
const RANGE: Gate = Gate { lo: 1.0, hi: 11.0 };
const BINS: u32 = 4000;

/// The pose of the car at a time: it drives at 12 m/s, which is 1.2 m in a turn, and turns about all axes.
fn pose(time: f64) -> (DVec3, DQuat) {
    let t = time - 2.0;
    let axis = DVec3::new(0.2, 1.0, -0.1).normalize();
    (DVec3::new(0.3, 0.0, 0.6 - 12.0 * t), DQuat::from_axis_angle(axis, 5.0 * t))
}

/// The scan, read from files as a user writes them.
fn scan(folder: &Path) -> Scan {
    let write = |name: &str, text: String| std::fs::write(folder.join(name), text).unwrap();
    let rows = |rows: Vec<String>| rows.join("\n");
    write("channels.csv", rows(CHANNELS.iter().map(|[elevation, offset]| format!("{elevation},{offset}")).collect()));
    let row = |time: f64| {
        let (p, q) = pose(time);
        format!("{time},{},{},{},{},{},{},{}", p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    };
    write("poses.csv", rows([2.0, 2.05, 2.15].map(row).into()));
    write(
        "scan.toml",
        format!(
            "[scan]\nlaser = {MOUNT}\ndivergence = 0.002\npixel-fov = 0.002\nends = 'included'\nduration = '{DURATION}s'\nbegin = '{BEGIN}s'\n\
             points = {{channels = 'channels.csv', forward = [0, 0, -1], azimuth = [0, 360], steps = {STEPS}}}\ntrajectory = 'poses.csv'"
        ),
    );
    let experiment = Experiment::read(&folder.join("scan.toml")).unwrap();
    assert_eq!(experiment.input_files().len(), 2, "the files of the scan count as inputs");
    experiment.scan.unwrap().scan().unwrap()
}

/// Distance along a unit direction from a point in the room to its walls.
fn to_wall(from: DVec3, direction: DVec3) -> f64 {
    let axis = |k: usize| (if direction[k] > 0.0 { HIGH[k] } else { LOW[k] } - from[k]) / direction[k];
    (0..3).map(axis).fold(f64::INFINITY, f64::min)
}

/// The range of shot `number` if the pose is that of a time which is `late` seconds later.
fn expected(number: usize, late: f64) -> f64 {
    let (step, channel) = (number / CHANNELS.len(), number % CHANNELS.len());
    let turn = step as f64 / f64::from(STEPS);
    let (position, rotation) = pose(BEGIN + DURATION * turn + late);
    let [elevation, offset] = CHANNELS[channel].map(f64::to_radians);
    let azimuth = 2.0 * std::f64::consts::PI * turn + offset;
    // Forward is -Z, and the azimuth turns towards +X.
    let direction = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), -azimuth.cos() * elevation.cos());
    to_wall(position + rotation * MOUNT, rotation * direction)
}

/// A wall that faces the LiDAR: its echo over that of a white target at 1 m is its albedo over the square of the distance.
#[test]
fn intensities_are_those_of_a_white_target() {
    let distance = 2.5_f64;
    // The laser is wider than the pixel, as wide as its sides, and narrower.
    for (divergence, pixel_fov) in [(0.5, 0.2), (0.5, 0.5), (0.5, 0.45), (0.2, 0.5), (0.2, 0.0)] {
        let text = format!(
            "[scan]\nlaser = [0, 0, {distance}]\npower = 3\ndivergence = {divergence}\npixel-fov = {pixel_fov}\n\
             points = {{forward = [0, 0, -1], azimuth = [0, 0], elevation = [0, 0], count = [1, 1]}}"
        );
        let scan = Experiment::parse(&text).unwrap().scan.unwrap().scan().unwrap();
        let mut scene = Scene::default();
        let grey = material(&mut scene, diffuse("grey", [0.4; 3]));
        add(&mut scene, "wall", grey, quad(DVec3::new(-1.0, -1.0, 0.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1.0; 2]));
        (scene.lights, scene.cameras) = (vec![scan.light(0)], vec![scan.camera(0)]);
        let settings = settings(Estimator::Bdpt, [1, 1]).max_depth(2).budget(Budget::Spp(4096));
        let settings = settings.gate(Gate { lo: 4.9, hi: 5.2 }).build().unwrap();
        let prepared = PreparedScan::new(&scan, scene, &settings, None).unwrap();
        let mut measurement = Measurement::new(&device(), scan.clone(), prepared, false).unwrap();
        measurement.run(false, &Arc::default(), |_| {}).unwrap();
        let intensity = f64::from(measurement.into_arrays().means[0]) / scan.white_target_at_1m().unwrap();
        let ratio = intensity * distance.powi(2) / 0.4;
        assert!((ratio - 1.0).abs() < 0.01, "{divergence} {pixel_fov}: {ratio}");
    }
}

#[test]
fn ranges_are_those_of_the_place_and_the_direction_of_each_shot() {
    let folder = tempfile::tempdir().unwrap();
    let scan = scan(folder.path());
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    add(&mut scene, "room", white, cuboid(LOW, HIGH));
    scene.materials[0].double_sided = true;
    (scene.lights, scene.cameras) = (vec![scan.light(0)], vec![scan.camera(0)]);
    let responses: Responses = Gates::new(RANGE, BINS).unwrap().into();
    let settings = settings(Estimator::Bdpt, [1, 1]).max_depth(2).budget(Budget::Spp(4)).responses(responses);
    let prepared = PreparedScan::new(&scan, scene, &settings.build().unwrap(), None).unwrap();
    let mut measurement = Measurement::new(&device(), scan.clone(), prepared, false).unwrap();
    let mut renders = 0;
    measurement.run(false, &Arc::default(), |_| renders += 1).unwrap();
    assert_eq!(renders, STEPS, "the channels of a step share a render");
    let light = measurement.into_arrays().means;

    let shots = scan.laser_points.len();
    let mut worst_when_late = 0.0_f64;
    for number in 0..shots {
        let bins: Vec<f64> = light.iter().skip(number).step_by(shots).map(|&x| f64::from(x)).collect();
        let sum: f64 = bins.iter().sum();
        let width = (RANGE.hi - RANGE.lo) / f64::from(BINS);
        let centre = bins.iter().enumerate().map(|(k, x)| (k as f64 + 0.5) * x).sum::<f64>() / sum;
        let range = 0.5 * (RANGE.lo + width * centre);
        let error = (range - expected(number, 0.0)).abs();
        assert!(error < 1e-3, "shot {number}: {range} m instead of {} m", expected(number, 0.0));
        // Poses that are half a millisecond late must be noticed.
        worst_when_late = worst_when_late.max((range - expected(number, 5e-4)).abs());
    }
    assert!(worst_when_late > 3e-3, "{worst_when_late}");
}
