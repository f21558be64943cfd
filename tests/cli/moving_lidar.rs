//! Point clouds of a LiDAR that moves, or sees objects move. Needs a device.

use std::path::Path;

use crate::lidar::{WALL, read, run, write_scene};
use crate::{fails, folder, names, taugate};

#[test]
fn objects_move_inside_the_animations_and_have_velocities() {
    let here = folder();
    let here = here.path();
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let turn = std::fs::read_to_string(scenes.join("street-turn.toml")).unwrap();
    let turn = turn.replace("street", &format!("{}/street", scenes.display())).replace("steps = 1800", "steps = 4");
    std::fs::write(here.join("turn.toml"), &turn).unwrap();
    std::fs::copy(scenes.join("street.glb"), here.join("street.glb")).unwrap();
    for (arguments, part) in [
        (&["turn.toml", "--at", "1.93s"][..], "the last shot is fired at 2.005 s of the animations, which end at 2 s"),
        (
            &["street.glb", "--aov", "velocity", "--resolution", "8x8", "--at", "1s"],
            "the velocity is a layer of scans: leave it out of --aov",
        ),
        (&["turn.toml", "--shutter", "0..1ms"], "a scan has no shutter"),
    ] {
        fails(
            here,
            &[&["render"], arguments, &["-o", if part.contains("layer") { "x.exr" } else { "x.npy" }]].concat(),
            2,
            part,
        );
    }
    assert!(!names(here).iter().any(|name| name.starts_with('x')));
    // The other car is 12 m nearer than in the file.
    run(here, &["render", "turn.toml", "-o", "moving.npy", "-q"]);
    let toml = turn.replace("[input]\nat = \"1s\"", "");
    std::fs::write(here.join("without.toml"), toml).unwrap();
    run(here, &["render", "without.toml", "-o", "without.npy", "-q"]);
    let bytes = |name: &str| std::fs::read(here.join(name)).unwrap();
    assert!(bytes("moving.npy") != bytes("without.npy"));

    // Ahead, the other car comes at 17 m/s, and this one drives at 10 m/s: the first shots see it.
    let ahead = turn.replace("azimuth = [0, 360], steps = 4", "azimuth = [-4, -2], steps = 4").replace("100ms", "1ms");
    std::fs::write(here.join("ahead.toml"), ahead).unwrap();
    run(here, &["render", "ahead.toml", "--aov", "depth,object,velocity", "-o", "ahead.npy", "-q"]);
    run(here, &["lidar", "ahead.npy", "-o", "ahead-cloud.npy"]);
    let cloud = read(&here.join("ahead-cloud.npy"));
    let velocities: Vec<f32> = cloud.iter().map(|point| point.velocity).filter(|v| !v.is_nan()).collect();
    let close = |wanted: f32| velocities.iter().filter(|v| (**v - wanted).abs() < 0.3).count();
    assert!(close(-27.0) > 0 && close(-10.0) > 0, "{velocities:?}");

    // The light has the velocities of its surfaces, also without the layer. An echo of a car and of the street behind it has both.
    run(here, &["render", "ahead.toml", "--doppler", "30m/s", "-o", "light.npy", "-q"]);
    run(here, &["lidar", "light.npy", "-o", "light-cloud.npy"]);
    let of_light = read(&here.join("light-cloud.npy"));
    assert_eq!(of_light.len(), cloud.len());
    let sharp = || of_light.iter().zip(&cloud).filter(|(light, _)| light.deviation < 0.3);
    let differ = sharp().filter(|(light, surface)| (light.velocity - surface.velocity).abs() > 0.3).count();
    assert!(
        sharp().count() > cloud.len() / 2 && differ <= 2,
        "{} of {} points, {differ} differ",
        sharp().count(),
        cloud.len()
    );
    // Two sweeps of an FMCW sensor tell ranges and velocities.
    for (name, sweep) in [("rising", "10us"), ("falling", "-10us")] {
        let chirp = format!("905nm,50GHz,{sweep}");
        let array = format!("{name}.npy");
        run(here, &["render", "ahead.toml", "--fmcw", &chirp, "--aov", "depth,object", "-o", &array, "-q"]);
    }
    run(here, &["lidar", "rising.npy", "--falling", "falling.npy", "-o", "fmcw.npy"]);
    let fmcw = read(&here.join("fmcw.npy"));
    let near =
        |wanted: f32| fmcw.iter().filter(|point| (point.velocity - wanted).abs() < 0.5 && point.object > 0).count();
    assert!(near(-27.0) > 0 && near(-10.0) > cloud.len() / 2, "{} and {} of {}", near(-27.0), near(-10.0), fmcw.len());
    for (arguments, part) in [
        (&["rising.npy", "--falling", "rising.npy"][..], "has the same sweep"),
        (&["rising.npy", "--falling", "light.npy"], "light.npy: is no scan of an FMCW sensor"),
        (&["light.npy", "--falling", "rising.npy"], "light.npy: is no scan of an FMCW sensor"),
    ] {
        fails(here, &[&["lidar"], arguments, &["-o", "x.las"]].concat(), 2, part);
    }
    // The light of the scan is still light: a detector counts it.
    run(here, &["lidar", "light.npy", "-o", "noisy.npy", "--photons", "1e6"]);
    assert!(read(&here.join("noisy.npy")).iter().any(|point| (point.velocity + 27.0).abs() < 0.3));
    run(here, &["detect", "light.npy", "-o", "counts.npy", "--photons", "1e6"]);
}

/// A car that drives towards the wall, and turns: each shot has its own place, and the time in the trajectory.
#[test]
fn a_cloud_from_a_car_is_skewed() {
    let here = folder();
    let here = here.path();
    write_scene(here, false, "2m..42m/400");
    let text = std::fs::read_to_string(here.join("lidar.toml")).unwrap();
    std::fs::write(here.join("car.toml"), text.replace("ends =", "trajectory = 'poses.csv'\nends =")).unwrap();
    std::fs::write(here.join("poses.csv"), "1,0,0,0,0,0,0,1\n1.1,0,0,-1,0,0,0,1\n").unwrap();
    run(here, &["render", "car.toml", "-o", "car.npy", "-q"]);
    run(here, &["lidar", "car.npy", "-o", "car-cloud.npy"]);
    let cloud = read(&here.join("car-cloud.npy"));
    // All points lie on the wall, though the LiDAR comes a metre closer.
    assert!(cloud.len() > 10 && cloud.iter().all(|point| (point.position.z + WALL).abs() < 0.06), "{cloud:?}");
    let last = cloud.last().unwrap();
    assert!(last.time > 1.09 && last.channel < 2 && last.object == 0, "{last:?}");
    // Without the trajectory, the last points would be a metre behind the wall.
    let mut about: serde_json::Value = serde_json::from_slice(&std::fs::read(here.join("car.json")).unwrap()).unwrap();
    let still = vec![about["laser"].clone(); about["laser_points"].as_array().unwrap().len()];
    about["laser_places"] = still.into();
    std::fs::write(here.join("car.json"), about.to_string()).unwrap();
    run(here, &["lidar", "car.npy", "-o", "wrong.npy"]);
    let wrong = read(&here.join("wrong.npy"));
    assert!((wrong.last().unwrap().position.z + WALL).abs() > 0.06);
}

/// A LiDAR on the other car of the street: the trajectory is that of the car.
#[test]
fn a_trajectory_comes_from_an_animated_node() {
    let here = folder();
    let here = here.path();
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/street.glb");
    std::fs::copy(street, here.join("street.glb")).unwrap();
    let output = taugate(here, &["info", "street.glb", "--poses", "car=poses.csv"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("poses of 'car' from 0 s to 2 s"), "{said}");
    let text = std::fs::read_to_string(here.join("poses.csv")).unwrap();
    let row = |line: &str| line.split(',').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let rows: Vec<_> = text.lines().skip(1).map(row).collect();
    assert_eq!((rows.len(), rows[480][0]), (481, 2.0));
    // 17 m/s along the street.
    let speed = (rows[480][3] - rows[0][3]) / 2.0;
    assert!((speed.abs() - 17.0).abs() < 0.1 && rows[240][1] == rows[0][1], "{speed} m/s");
    let scan = "scene = 'street.glb'\n[scan]\nlaser = [0, 1.5, 0]\nduration = '100ms'\ntrajectory = 'poses.csv'\nbegin = '0.5s'\n\
                divergence = 0.1\npixel-fov = 0.1\npoints = {forward = [0, 0, 1], azimuth = [-2, 2], elevation = [-1, 1], count = [3, 1]}\n\
                [gate]\ngates = '1m..80m/79'\n[render]\nspp = 2\nmax-depth = 2\n";
    std::fs::write(here.join("scan.toml"), scan).unwrap();
    run(here, &["render", "scan.toml", "--force", "-o", "scan.npy", "-q"]);
    for (flags, message) in [
        (&["street.glb", "--poses", "nobody=x.csv"][..], "has no node 'nobody'"),
        (&["street.glb", "--poses", "car"], "write it like car=poses.csv"),
        (&["street.glb", "--poses", "car=x.txt"], "write it like car=poses.csv"),
        (&["street.glb", "--animation", "none", "--poses", "car=x.csv"], "has no animations"),
    ] {
        fails(here, &[&["info"], flags].concat(), 2, message);
    }
    assert!(!names(here).iter().any(|name| name.starts_with('x')));
}
