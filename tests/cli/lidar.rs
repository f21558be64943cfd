//! Point clouds of a LiDAR as a user makes them: a wall in clear air, behind a pane, in fog and under water. Needs a device.

use std::path::Path;

use glam::DVec3;
use taugate::internals::generate::glb;
use taugate::internals::generate::parts::{add, diffuse, glass, material};
use taugate::internals::generate::shapes::{cuboid, quad};
use taugate::internals::scene::{Material, Scene};

use crate::{fails, folder, names, taugate};

const LASER: DVec3 = DVec3::new(0.3, 0.2, 0.1);
/// Distance of the wall from the origin.
pub const WALL: f64 = 10.07;
const ALBEDO: f64 = 0.4;
const CHANNELS: [[f64; 2]; 2] = [[10.0, 1.0], [-5.0, -1.0]];
const STEPS: usize = 24;

/// A wall, a pane before it if `has_pane`, and the scan `lidar.toml` of a spinning LiDAR with these `gates`.
pub fn write_scene(folder: &Path, has_pane: bool, gates: &str) {
    let mut scene = Scene::default();
    let mut plane = |name: &str, look, distance: f64| {
        let look = material(&mut scene, look);
        let corner = DVec3::new(-9.0, -9.0, -distance);
        add(&mut scene, name, look, quad(corner, DVec3::X * 18.0, DVec3::Y * 18.0, [1.0; 2]));
    };
    plane("wall", diffuse("grey", [ALBEDO as f32; 3]), WALL);
    if has_pane {
        plane("pane", glass("pane"), 4.0);
    }
    std::fs::write(folder.join("scene.glb"), glb::write(&scene)).unwrap();
    let channels = CHANNELS.map(|[elevation, offset]| format!("{elevation},{offset}\n")).concat();
    std::fs::write(folder.join("channels.csv"), channels).unwrap();
    let text = format!(
        "scene = 'scene.glb'\n[scan]\nlaser = [0.3, 0.2, 0.1]\ndivergence = 0.1\npixel-fov = 0.1\nends = 'included'\nduration = '100ms'\n\
         points = {{channels = 'channels.csv', forward = [0, 0, -1], azimuth = [0, 360], steps = {STEPS}}}\n[gate]\ngates = '{gates}'\n[render]\nmax-depth = 2\nspp = 64\n"
    );
    std::fs::write(folder.join("lidar.toml"), text).unwrap();
}

pub fn run(folder: &Path, arguments: &[&str]) {
    let output = taugate(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The fields of a point in a `.npy` file of a cloud.
#[derive(Debug)]
pub struct Point {
    pub position: DVec3,
    pub intensity: f64,
    pub echoes: [u8; 2],
    pub time: f64,
    pub channel: u16,
    pub object: u32,
    pub velocity: f32,
    pub deviation: f32,
}

pub fn read(path: &Path) -> Vec<Point> {
    let bytes = std::fs::read(path).unwrap();
    let begin = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let point = |record: &[u8]| {
        let f64_at = |at: usize| f64::from_le_bytes(record[at..at + 8].try_into().unwrap());
        Point {
            position: DVec3::new(f64_at(0), f64_at(8), f64_at(16)),
            intensity: f32::from_le_bytes(record[24..28].try_into().unwrap()).into(),
            echoes: [record[28], record[29]],
            time: f64_at(30),
            channel: u16::from_le_bytes([record[38], record[39]]),
            object: u32::from_le_bytes(record[40..44].try_into().unwrap()),
            velocity: f32::from_le_bytes(record[44..48].try_into().unwrap()),
            deviation: f32::from_le_bytes(record[48..52].try_into().unwrap()),
        }
    };
    bytes[begin..].chunks_exact(52).map(point).collect()
}

/// Where the shots that meet the wall meet it, with their channels and times, in order.
fn hits() -> Vec<(DVec3, usize, f64)> {
    let mut hits = vec![];
    for step in 0..STEPS {
        for (channel, [elevation, offset]) in CHANNELS.into_iter().enumerate() {
            let part = step as f64 / STEPS as f64;
            let (sine, cosine) = elevation.to_radians().sin_cos();
            let azimuth = (360.0 * part + offset).to_radians();
            let direction = DVec3::new(cosine * azimuth.sin(), sine, -cosine * azimuth.cos());
            let hit = LASER + direction * ((-WALL - LASER.z) / direction.z);
            if direction.z < 0.0 && hit.x.abs().max(hit.y.abs()) < 9.0 {
                hits.push((hit, channel, part / 10.0));
            }
        }
    }
    hits
}

#[test]
fn a_cloud_has_the_points_of_the_wall() {
    for has_pane in [false, true] {
        let here = folder();
        let here = here.path();
        write_scene(here, has_pane, "2m..42m/400");
        run(here, &["render", "lidar.toml", "--aov", "depth,object", "-o", "scan.npy", "-q"]);
        run(here, &["lidar", "scan.npy", "-o", "cloud.npy"]);
        let (cloud, hits) = (read(&here.join("cloud.npy")), hits());
        assert_eq!(cloud.len(), hits.len(), "{cloud:?}");
        let mut ratio = 0.0;
        for (point, (hit, channel, time)) in cloud.iter().zip(&hits) {
            assert!(point.position.distance(*hit) < 1e-3, "{point:?} {hit}");
            assert_eq!((point.echoes, usize::from(point.channel)), ([1, 1], *channel));
            assert!((point.time - time).abs() < 1e-12 && point.object > 0);
            let range = hit.distance(LASER);
            let cosine = (WALL + LASER.z) / range;
            ratio += point.intensity / (ALBEDO * cosine / range.powi(2)) / hits.len() as f64;
        }
        // The pane takes some light there and back, and clear air takes none.
        match has_pane {
            false => assert!((ratio - 1.0).abs() < 0.02, "{ratio}"),
            true => assert!(ratio < 0.9 && ratio > 0.7, "{ratio}"),
        }

        // A medium in which light is slower changes nothing.
        run(
            here,
            &["render", "lidar.toml", "--medium-group-ior", "1.4", "--aov", "depth,object", "-o", "scan.npy", "-q"],
        );
        run(here, &["lidar", "scan.npy", "-o", "slow.npy"]);
        let slow = read(&here.join("slow.npy"));
        assert!(slow.len() == cloud.len() && slow.iter().all(|point| point.object > 0), "{slow:?}");

        // Without layers, the bins of 5 cm in range decide.
        run(here, &["render", "lidar.toml", "-o", "scan.npy", "-q"]);
        run(here, &["lidar", "scan.npy", "-o", "bins.npy"]);
        let errors: Vec<f64> = read(&here.join("bins.npy"))
            .iter()
            .zip(&hits)
            .map(|(point, (hit, ..))| point.position.distance(*hit))
            .collect();
        assert!(errors.len() == hits.len() && errors.iter().all(|error| *error < 0.05), "{errors:?}");
        assert!(errors.iter().any(|error| *error > 1e-3));
    }
}

#[test]
fn fog_returns_before_the_wall_and_a_detector_adds_noise() {
    let here = folder();
    let here = here.path();
    write_scene(here, false, "4m..42m/380");
    let about = taugate(here, &["info", "lidar.toml", "--visibility", "40m"]);
    let about = String::from_utf8(about.stdout).unwrap();
    // No thin gate is suggested: most light is that of fog before the lens.
    assert!(about.contains("\nlight ") && !about.contains("\ntry "), "{about}");
    run(here, &["render", "lidar.toml", "--visibility", "40m", "--aov", "depth,object", "-o", "fog.npy", "-q"]);
    run(here, &["lidar", "fog.npy", "-o", "fog-cloud.npy", "--threshold", "0.02"]);
    let cloud = read(&here.join("fog-cloud.npy"));
    let first = cloud.iter().find(|point| point.echoes[1] > 1).expect("a shot with two echoes");
    assert!(first.echoes[0] == 1 && first.position.distance(LASER) < 3.0 && first.object == 0, "{first:?}");
    let of_wall = cloud.iter().filter(|point| point.object > 0);
    assert!(of_wall.clone().all(|point| point.echoes[0] > 1 && (point.position.z + WALL).abs() < 1e-3));
    assert!(of_wall.count() > 4);
    run(here, &["lidar", "fog.npy", "-o", "one.npy", "--threshold", "0.02", "--max-echoes", "1"]);
    assert!(read(&here.join("one.npy")).iter().all(|point| point.echoes == [1, 1] && point.object == 0));

    write_scene(here, false, "4m..42m/380");
    run(here, &["render", "lidar.toml", "-o", "clear.npy", "-q"]);
    run(here, &["lidar", "clear.npy", "-o", "clear-cloud.npy"]);
    run(here, &["detect", "clear.npy", "-o", "counts.npy", "--photons", "1e4", "--pulses", "100"]);
    run(here, &["lidar", "counts.npy", "-o", "counts-cloud.npy"]);
    let sum = |name: &str| read(&here.join(name)).iter().map(|point| point.intensity).sum::<f64>();
    let ratio = sum("counts-cloud.npy") / sum("clear-cloud.npy");
    assert!((ratio - 1.0).abs() < 0.05 && ratio != 1.0, "{ratio}");
    // In one step, the points are the same.
    run(here, &["lidar", "clear.npy", "-o", "one-step.npy", "--photons", "1e4", "--pulses", "100"]);
    assert!(std::fs::read(here.join("one-step.npy")).unwrap() == std::fs::read(here.join("counts-cloud.npy")).unwrap());
    // Daylight is light too: it makes echoes where there is nothing, unless they must be bright.
    let noisy = ["lidar", "clear.npy", "-o", "noisy.npy", "--photons", "1e3", "--background", "1e8"];
    run(here, &noisy);
    let all = read(&here.join("noisy.npy")).len();
    run(here, &[&noisy[..], &["--min-intensity", "1e-3"]].concat());
    let bright = read(&here.join("noisy.npy")).len();
    assert!(all > 3 * bright && bright > 4, "{all} and {bright} points");
    // On average, it adds nothing to the intensity.
    let bright =
        ["lidar", "clear.npy", "-o", "bright.npy", "--photons", "1e4", "--pulses", "100", "--min-intensity", "1e-3"];
    run(here, &[&bright[..], &["--background", "1e7"]].concat());
    let ratio = sum("bright.npy") / sum("clear-cloud.npy");
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// A LiDAR looks down at rough water: its surface returns light, and then the bed does, delayed by the group index of water.
#[test]
fn water_returns_two_echoes() {
    const HEIGHT: f64 = 6.0;
    const DEPTH: f64 = 3.0;
    const IOR: f64 = 1.33;
    const GROUP_IOR: f64 = 1.36;
    // From the vertical, in degrees.
    let tilts = [8.0f64, 12.0, 16.0];
    let here = folder();
    let here = here.path();
    let mut scene = Scene::default();
    let bed = material(&mut scene, diffuse("bed", [0.5; 3]));
    let look = Material { roughness: 0.3, ior: IOR as f32, group_ior: Some(GROUP_IOR as f32), ..glass("water") };
    let water = material(&mut scene, look);
    add(&mut scene, "water", water, cuboid(DVec3::new(-9.0, -DEPTH - 0.2, -9.0), DVec3::new(9.0, 0.0, 9.0)));
    let corner = DVec3::new(-9.1, -DEPTH, -9.1);
    add(&mut scene, "bed", bed, quad(corner, DVec3::Z * 18.2, DVec3::X * 18.2, [1.0; 2]));
    std::fs::write(here.join("scene.glb"), glb::write(&scene)).unwrap();
    let text = format!(
        "scene = 'scene.glb'\n[scan]\nlaser = [0, {HEIGHT}, 0]\ndivergence = 0.2\npixel-fov = 0.2\nends = 'included'\n\
         points = {{forward = [1, 0, 0], azimuth = [0, 0], elevation = [{}, {}], count = [1, 3]}}\n\
         [gate]\ngates = '4m..26m/440'\n[render]\nmax-depth = 4\nspp = 256\nestimator = 'bdpt'\n",
        tilts[0] - 90.0,
        tilts[2] - 90.0
    );
    std::fs::write(here.join("lidar.toml"), text).unwrap();
    run(here, &["render", "lidar.toml", "--aov", "depth,object", "-o", "scan.npy", "-q"]);
    run(here, &["lidar", "scan.npy", "-o", "cloud.npy", "--threshold", "0.003"]);
    let cloud = read(&here.join("cloud.npy"));
    assert_eq!(cloud.iter().map(|point| point.echoes).collect::<Vec<_>>(), [[1, 2], [2, 2]].repeat(3));
    let laser = DVec3::new(0.0, HEIGHT, 0.0);
    // The first row is the highest.
    for (echoes, tilt) in cloud.chunks_exact(2).zip(tilts.map(f64::to_radians).into_iter().rev()) {
        let ranges = [0, 1].map(|k: usize| echoes[k].position.distance(laser));
        let of_surface = HEIGHT / tilt.cos();
        let of_bed = |index: f64| of_surface + index * DEPTH / (1.0 - (tilt.sin() / IOR).powi(2)).sqrt();
        assert!((ranges[0] - of_surface).abs() < 1e-3 && echoes[0].object > 0, "{echoes:?}");
        assert!((ranges[1] - of_bed(GROUP_IOR)).abs() < 0.03, "{ranges:?}, not {}", of_bed(GROUP_IOR));
        assert!((ranges[1] - of_bed(IOR)).abs() > 0.05);
    }
}

#[test]
fn mistakes_are_named_and_leave_no_file() {
    let here = folder();
    let here = here.path();
    write_scene(here, false, "4m..42m/38");
    run(here, &["render", "lidar.toml", "-o", "scan.npy", "-q"]);
    let text = std::fs::read_to_string(here.join("lidar.toml")).unwrap();
    std::fs::write(here.join("thin.toml"), text.replace("divergence = 0.1\npixel-fov = 0.1\n", "")).unwrap();
    run(here, &["render", "thin.toml", "--max-depth", "4", "--spp", "1", "--force", "-o", "thin.npy", "-q"]);
    fails(here, &["render", "lidar.toml", "--doppler", "9m/s", "-o", "x.npy"], 2, "choose the moment with --at");
    run(here, &["detect", "scan.npy", "-o", "counts.npy", "--photons", "1e4"]);
    run(here, &["render", "lidar.toml", "--fmcw", "1550nm,1GHz,10us", "-o", "beats.npy", "-q"]);
    let other = ["--fmcw", "1550nm,1GHz,-10us", "--sigma-a", "0.01"];
    run(here, &[&["render", "lidar.toml", "-o", "others.npy", "-q"], &other[..]].concat());
    run(here, &["render", "lidar.toml", "--repeat", "50m", "-o", "pulsed.npy", "-q"]);
    run(here, &["render", "lidar.toml", "--aov", "depth", "-o", "layers.npy", "-q"]);
    std::fs::remove_file(here.join("layers.aov.npy")).unwrap();
    let json = std::fs::read_to_string(here.join("scan.json")).unwrap();
    let changed = json.replace("\"bin_width_opl\": 1.0", "\"bin_width_opl\": 2.0");
    assert!(changed != json);
    std::fs::copy(here.join("scan.npy"), here.join("changed.npy")).unwrap();
    std::fs::write(here.join("changed.json"), changed).unwrap();
    let json = std::fs::read_to_string(here.join("beats.json")).unwrap();
    std::fs::copy(here.join("beats.npy"), here.join("unset.npy")).unwrap();
    std::fs::write(here.join("unset.json"), json.replace("\"settings\"", "\"old settings\"")).unwrap();
    let table: [(&[&str], &str); 21] = [
        (&["counts.npy", "-o", "x.ply", "--photons", "1e4"], "holds the counts of a detector already"),
        (&["beats.npy", "-o", "x.ply", "--photons", "1e4"], "leave out --photons"),
        (&["beats.npy", "-o", "x.ply", "--falling", "scan.npy"], "measure it with --fmcw"),
        (&["scan.npy", "-o", "x.ply", "--pulses", "5"], "--photons"),
        (&["scan.npy", "-o", "x.ply", "--photons", "0"], "raise --photons or --efficiency"),
        (&["scan.npy", "-o", "x.ply", "--photons", "1", "--efficiency", "2"], "--efficiency is 2"),
        (&["scan.npy", "-o", "x.ply", "--photons", "1", "--background", "-1"], "--background is -1"),
        (&["scan.npy", "-o", "x.xyz"], "must end in .ply, .las, .laz or .npy"),
        (&["scan.npy", "-o", "scan.npy"], "would replace the scan"),
        (&["scan.npy", "-o", "x.ply", "--max-echoes", "9"], "from 1 to 8"),
        (&["scan.npy", "-o", "x.ply", "--threshold", "1"], "above 0 and below 1"),
        (&["scan.npy", "-o", "x.ply", "--min-intensity", "-1"], "0 or more"),
        (&["scan.npy", "-o", "x.ply", "--detection", "best"], "constant-fraction"),
        (&["scene.glb", "-o", "x.ply"], "is no scan"),
        (&["thin.npy", "-o", "x.ply"], "give its laser a divergence"),
        (&["nothing.npy", "-o", "x.ply"], "nothing.npy"),
        (&["layers.npy", "-o", "x.ply"], "layers.aov.npy: is missing, but belongs to layers.npy"),
        (&["changed.npy", "-o", "x.ply"], "has a JSON file that was changed"),
        (&["unset.npy", "-o", "x.ply"], "has a JSON file that was changed"),
        (&["pulsed.npy", "-o", "x.ply"], "measure it again without --repeat"),
        (&["beats.npy", "-o", "x.ply", "--falling", "others.npy"], "other settings than the first one"),
    ];
    for (arguments, part) in table {
        fails(here, &[&["lidar"], arguments].concat(), 2, part);
    }
    assert!(!names(here).iter().any(|name| name.starts_with('x')));
}
