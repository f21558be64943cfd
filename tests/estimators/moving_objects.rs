//! A LiDAR scans while a wall drives towards it: range and radial velocity of each shot against geometry.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use taugate::internals::generate::glb::{self, Motion};
use taugate::internals::generate::parts::{add, diffuse, material};
use taugate::internals::generate::shapes::quad;
use taugate::internals::scene::Scene;
use taugate::{Job, ReadyScan};

use super::cells::device;

/// Distance of the wall in metres at the start of the animation, and its speed in m/s.
const DISTANCE: f64 = 4.0;
const SPEED: f64 = 14.0;
/// Number of shots in a row, and the directions of the first and the last one in degrees.
const SHOTS: usize = 12;
const AZIMUTH: [f64; 2] = [-30.0, 25.0];
/// Time of the first shot in the animation, and of the scan, in seconds.
const AT: f64 = 0.02;
const DURATION: f64 = 0.12;
/// Speed of the LiDAR in m/s, to the right and forward.
const DRIVE: [f64; 2] = [3.0, 9.0];
const BINS: usize = 4000;
/// First and last optical path of the waveforms in metres.
const RANGE: [f64; 2] = [1.0, 13.0];

fn write(folder: &Path, drives: bool, duration: &str) -> std::path::PathBuf {
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    let far = DVec3::new(-50.0, -50.0, 0.0);
    add(&mut scene, "wall", white, quad(far, 100.0 * DVec3::X, 100.0 * DVec3::Y, [1.0; 2]));
    let places = [0.0, 0.2].map(|time| [0.0, 0.0, -(DISTANCE - SPEED * time) as f32]);
    let motion = Motion { node: "wall", times: vec![0.0, 0.2], positions: places.to_vec() };
    std::fs::write(folder.join("scene.glb"), glb::write_moving(&scene, Some(&motion))).unwrap();
    // Times of the poses begin elsewhere than those of the animation.
    let row = |time: f64| format!("{},{},0,{},0,0,0,1\n", 7.0 + time, DRIVE[0] * time, -DRIVE[1] * time);
    std::fs::write(folder.join("poses.csv"), row(0.0) + &row(0.2)).unwrap();
    let trajectory = if drives { "trajectory = 'poses.csv'" } else { "" };
    let path = folder.join("scan.toml");
    let text = format!(
        "scene = 'scene.glb'\n[scan]\nlaser = [0, 0, 0]\ndivergence = 0.002\npixel-fov = 0.002\nends = 'included'\n{duration}\n{trajectory}\n\
         points = {{forward = [0, 0, -1], azimuth = {AZIMUTH:?}, elevation = [0, 0], count = [{SHOTS}, 1]}}\n\
         [gate]\ngates = '{}m..{}m/{BINS}'\n",
        RANGE[0], RANGE[1]
    );
    std::fs::write(&path, text).unwrap();
    path
}

/// The range of each shot, and how many renders they took. Checks range and velocity of the surfaces that the layers show.
fn ranges(path: &Path, depth: &str, drives: Option<bool>) -> (Vec<f64>, usize) {
    let at = AT.to_string();
    let flags =
        [("at", &*at), ("max-depth", depth), ("spp", "16"), ("estimator", "bdpt"), ("aov", "depth,object,velocity")];
    let job = Job::open_with(path, flags).unwrap();
    let mut scan = job.prepare_scan(&device()).unwrap_or_else(|e| panic!("{e}"));
    let mut renders = 0;
    scan.run(&Arc::default(), |_| renders += 1).unwrap();
    let layers = scan.layers().unwrap().unwrap();
    for (shot, hit) in layers.hits.iter().enumerate() {
        let azimuth = azimuth(shot);
        let approach = SPEED + if drives == Some(true) { DRIVE[1] } else { 0.0 };
        let aside = if drives == Some(true) { DRIVE[0] } else { 0.0 };
        let velocity = -approach * azimuth.cos() - aside * azimuth.sin();
        assert!(
            (f64::from(hit.velocity) - velocity).abs() < 0.02,
            "shot {shot}: {} m/s, expected {velocity}",
            hit.velocity
        );
        let range = expected(shot, drives.is_some(), drives == Some(true));
        assert!((f64::from(hit.range) - range).abs() < 1e-4 && hit.object == 1, "shot {shot}: {hit:?}");
    }
    assert_eq!(layers.objects[&1], "wall");
    (waveform_ranges(scan), renders)
}

/// The mean range of the light of each shot.
fn waveform_ranges(scan: ReadyScan) -> Vec<f64> {
    let light = scan.into_arrays().0.means;
    let range = |shot: usize| {
        let bins: Vec<f64> = light.iter().skip(shot).step_by(SHOTS).map(|&x| f64::from(x)).collect();
        // A single wall: all light is one echo.
        let centre = bins.iter().enumerate().map(|(k, x)| (k as f64 + 0.5) * x).sum::<f64>() / bins.iter().sum::<f64>();
        0.5 * (RANGE[0] + centre * (RANGE[1] - RANGE[0]) / BINS as f64)
    };
    (0..SHOTS).map(range).collect()
}

fn azimuth(shot: usize) -> f64 {
    (AZIMUTH[0] + shot as f64 / (SHOTS - 1) as f64 * (AZIMUTH[1] - AZIMUTH[0])).to_radians()
}

fn expected(shot: usize, moves: bool, drives: bool) -> f64 {
    let time = DURATION * shot as f64 / SHOTS as f64;
    let wall = DISTANCE - SPEED * (AT + if moves { time } else { 0.0 });
    (wall - if drives { DRIVE[1] * time } else { 0.0 }) / azimuth(shot).cos()
}

#[test]
fn each_shot_sees_the_wall_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    for (drives, depth) in [(false, "2"), (true, "2"), (false, "3"), (true, "3")] {
        let (found, renders) = ranges(&write(folder.path(), drives, "duration = '120ms'"), depth, Some(drives));
        assert_eq!(renders, SHOTS);
        let error = |moves: bool| {
            let of_shot = |(shot, range): (usize, &f64)| (range - expected(shot, moves, drives)).abs();
            found.iter().enumerate().map(of_shot).fold(0.0, f64::max)
        };
        eprintln!("drives {drives}, depth {depth}: {:.5} m, without motion {:.3} m", error(true), error(false));
        assert!(error(true) < 1e-3 && error(false) > 1.0, "drives {drives}, depth {depth}: {found:?}");
    }
    // Without times of the shots, nothing moves.
    let (found, renders) = ranges(&write(folder.path(), false, ""), "2", None);
    assert_eq!(renders, 1);
    let is_right = |(shot, range): (usize, &f64)| (range - expected(shot, false, false)).abs() < 1e-3;
    assert!(found.iter().enumerate().all(is_right), "{found:?}");
}

/// Each bin of the waveforms has the radial velocity of its light.
#[test]
fn waveforms_have_velocities() {
    let folder = tempfile::tempdir().unwrap();
    for (drives, estimator) in [(false, "bdpt"), (true, "bdpt"), (true, "lcs")] {
        let path = write(folder.path(), drives, "duration = '120ms'");
        let at = AT.to_string();
        let flags = [("at", &*at), ("max-depth", "2"), ("spp", "16"), ("estimator", estimator), ("doppler", "30")];
        let job = Job::open_with(&path, flags).unwrap();
        let mut scan = job.prepare_scan(&device()).unwrap_or_else(|e| panic!("{e}"));
        scan.run(&Arc::default(), |_| {}).unwrap();
        let arrays = scan.into_arrays().0;
        let velocities = arrays.velocities.expect("the scan records velocities");
        let mut lit = [false; SHOTS];
        for (at, light) in arrays.means.iter().enumerate() {
            let (sin, cos) = azimuth(at % SHOTS).sin_cos();
            let [forward, aside] = if drives { [DRIVE[1], DRIVE[0]] } else { [0.0; 2] };
            let expected = -(SPEED + forward) * cos - aside * sin;
            let [mean, deviation] = [velocities[2 * at], velocities[2 * at + 1]].map(f64::from);
            assert!((*light > 0.0) == mean.is_finite());
            if *light > 0.0 {
                lit[at % SHOTS] = true;
                assert!(
                    (mean - expected).abs() < 0.02 && deviation < 0.05,
                    "{mean} +- {deviation}, not {expected} m/s"
                );
            }
        }
        assert_eq!(lit, [true; SHOTS]);
    }
}

/// An FMCW LiDAR: a rising and a falling sweep together tell range and velocity of each shot.
#[test]
fn two_sweeps_tell_range_and_velocity() {
    let folder = tempfile::tempdir().unwrap();
    for drives in [false, true] {
        let path = write(folder.path(), drives, "duration = '120ms'");
        let apparent = |chirp: &str| {
            let at = AT.to_string();
            let flags = [("at", &*at), ("max-depth", "2"), ("spp", "16"), ("estimator", "bdpt"), ("fmcw", chirp)];
            let mut scan =
                Job::open_with(&path, flags).unwrap().prepare_scan(&device()).unwrap_or_else(|e| panic!("{e}"));
            scan.run(&Arc::default(), |_| {}).unwrap();
            waveform_ranges(scan)
        };
        let [rising, falling] = ["1550nm,200GHz,10us", "1550nm,200GHz,-10us"].map(apparent);
        // nu T / B in seconds: a surface that recedes at v seems farther by v times this.
        let coupling = 299_792_458.0 / 1550e-9 * 10e-6 / 200e9;
        for shot in 0..SHOTS {
            let (sin, cos) = azimuth(shot).sin_cos();
            let [forward, aside] = if drives { [DRIVE[1], DRIVE[0]] } else { [0.0; 2] };
            let velocity = 0.5 * (rising[shot] - falling[shot]) / coupling;
            let expected_velocity = -(SPEED + forward) * cos - aside * sin;
            assert!(
                (velocity - expected_velocity).abs() < 0.05,
                "shot {shot}: {velocity}, not {expected_velocity} m/s"
            );
            let range = 0.5 * (rising[shot] + falling[shot]);
            assert!((range - expected(shot, true, drives)).abs() < 1.5e-3, "shot {shot}: {range} m");
            assert!((rising[shot] - range).abs() > 0.05);
        }
    }
}

/// A screen before the wall is scaled to nothing in the middle of the scan. The wall keeps its number, and has no velocity.
#[test]
fn an_object_may_vanish_during_a_scan() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = Scene::default();
    let white = material(&mut scene, diffuse("white", [0.8; 3]));
    for (name, distance) in [("screen", 2.0), ("wall", 3.0)] {
        let corner = DVec3::new(-50.0, -50.0, -distance);
        add(&mut scene, name, white, quad(corner, 100.0 * DVec3::X, 100.0 * DVec3::Y, [1.0; 2]));
    }
    let sizes = vec![[1.0; 3], [0.0; 3], [0.0; 3], [1.0; 3]];
    let motion = Motion { node: "screen", times: vec![0.0, 0.05, 0.07, 0.2], positions: sizes };
    let mut bytes = glb::write_moving(&scene, Some(&motion));
    let (moves, scales) = (br#""path":"translation""#, br#""path":"scale"      "#);
    let at = bytes.windows(moves.len()).position(|window| window == moves).unwrap();
    bytes[at..at + moves.len()].copy_from_slice(scales);
    let path = write(folder.path(), false, "duration = '120ms'");
    std::fs::write(folder.path().join("scene.glb"), bytes).unwrap();
    let job = Job::open_with(&path, [("at", "0"), ("max-depth", "2"), ("spp", "4"), ("aov", "depth,object,velocity")])
        .unwrap();
    let mut scan = job.prepare_scan(&device()).unwrap_or_else(|e| panic!("{e}"));
    scan.run(&Arc::default(), |_| {}).unwrap();
    let layers = scan.layers().unwrap().unwrap();
    let objects: Vec<u32> = layers.hits.iter().map(|hit| hit.object).collect();
    assert_eq!(objects, [1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1]);
    // The screen shrinks towards the LiDAR by 40 m/s, along its axis.
    assert!((layers.hits[2].velocity + 40.0).abs() < 8.0, "{:?}", layers.hits[2]);
    assert_eq!(layers.hits[6].velocity, 0.0);
    assert_eq!((&*layers.objects[&1], &*layers.objects[&2]), ("screen", "wall"));
}
