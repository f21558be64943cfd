//! Scans of a wall, on the command line.

use std::path::Path;

use crate::{fails, folder, names, taugate};

const CONFOCAL: &str =
    "points = { corner = [-0.4, 0.4, 0], across = [0.8, 0, 0], down = [0, -0.8, 0], count = [3, 2] }";
// Both spellings of keys are allowed.
const EXHAUSTIVE: &str =
    "laser_points = [[0, 0, 0], [0.3, 0, 0]]\nsensor-points = [[0, 0, 0], [0.1, 0.2, 0], [0.3, 0, 0]]";

fn write(folder: &Path, name: &str, scan: &str, more: &str) {
    let text = format!(
        "scene = 'letter.glb'\n[scan]\nlaser = [2, 0, 1.5]\n{scan}\n[gate]\ngates = '1.9m..2.9m/5'\n[render]\nspp = 64\n{more}"
    );
    std::fs::write(folder.join(name), text).unwrap();
}

/// The values of an array, whatever its shape.
fn read(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect()
}

fn description(folder: &Path, name: &str) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn a_scan_is_an_array_of_gates_and_points() {
    let here = folder();
    let here = here.path();
    let run = |arguments: &[&str]| {
        let output = taugate(here, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["generate", "hidden-letter", "-o", "letter.glb"]);
    write(here, "confocal.toml", CONFOCAL, "");
    run(&["render", "confocal.toml", "-o", "c.npy", "--variance", "-q"]);
    let confocal = read(&here.join("c.npy"));
    assert!(confocal.len() == 30 && confocal.iter().sum::<f32>() > 0.0);
    assert!(confocal.iter().all(|x| x.is_finite() && *x >= 0.0));
    assert_eq!(read(&here.join("c.variance.npy")).len(), 30);
    let about = description(here, "c.json");
    assert_eq!(about["shape"], serde_json::json!([5, 6]));
    assert_eq!(about["laser_grid"], serde_json::json!([3, 2]));
    assert_eq!((&about["start_opl"], &about["temporal_bins"]), (&1.9.into(), &5.into()));
    assert_eq!((about["laser_points"].as_array().unwrap().len(), &about["measured_laser_points"]), (6, &6.into()));

    // The settings in the description measure the array again.
    std::fs::write(here.join("again.toml"), about["settings"].as_str().unwrap()).unwrap();
    run(&["render", "again.toml", "-o", "d.npy", "-q"]);
    assert!(read(&here.join("d.npy")) == confocal);

    // Where laser and sensor aim at the same point, both scans measure the same.
    write(here, "all.toml", EXHAUSTIVE, "");
    write(here, "same.toml", "points = [[0, 0, 0], [0.3, 0, 0]]", "");
    run(&["render", "all.toml", "-o", "all.npy", "--spp", "2000", "-q"]);
    run(&["render", "same.toml", "-o", "same.npy", "--spp", "2000", "-q"]);
    assert_eq!(description(here, "all.json")["shape"], serde_json::json!([5, 2, 3]));
    let [all, same] = ["all.npy", "same.npy"].map(|name| read(&here.join(name)));
    let total = |values: &[f32], stride: usize, at: usize| (0..5).map(|k| values[k * stride + at]).sum::<f32>();
    for (in_all, in_same) in [(0, 0), (5, 1)] {
        let [a, b] = [total(&all, 6, in_all), total(&same, 2, in_same)];
        assert!((a / b - 1.0).abs() < 0.03, "{a} {b}");
    }

    // A detector counts the photons of each pair of points. Its array has the shape of the scan.
    for (scan, light) in [("c", &confocal), ("all", &all)] {
        let (name, brightest) = (format!("{scan}.npy"), light.iter().fold(0.0, |a: f32, &b| a.max(b)));
        let detect = ["detect", &name, "--pulses", "1000", "-o", "counts.npy", "--photons"];
        let photons = 1e3 / brightest;
        run(&[&detect[..], &[&photons.to_string()[..]]].concat());
        let counts = read(&here.join("counts.npy"));
        assert_eq!(counts.len(), light.len());
        for (count, x) in counts.iter().zip(light) {
            let mean = 1e3 * photons * x;
            assert!((count - mean).abs() <= 6.0 * mean.sqrt() && count.fract() == 0.0, "{scan}: {count} {mean}");
        }
        let [counts, of_light] = [description(here, "counts.json"), description(here, &format!("{scan}.json"))];
        assert_eq!(counts["unit"], "counts over all pulses");
        for key in ["axes", "shape", "responses", "laser_points"] {
            assert!(counts[key] == of_light[key] && !counts[key].is_null(), "{key}");
        }
        let first = [&detect[..], &["1e9", "--first-photon", "--jitter", "10ps", "--background", "0.1"]].concat();
        run(&first);
        // Each pair of points counts at most one photon per pulse.
        let (counts, pairs) = (read(&here.join("counts.npy")), light.len() / 5);
        assert!(
            (0..pairs).all(|pair| total(&counts, pairs, pair) <= 1000.0) && counts.iter().any(|&count| count > 0.0)
        );
        run(&[&detect[..5], &["mono.npy", "--photons", "1", "--mono"]].concat());
        fails(here, &[&detect[..], &["1", "--background", "day.exr"]].concat(), 2, "but the light is a scan");
        fails(here, &["detect", "counts.npy", "-o", "x.npy", "--photons", "1"], 2, "holds counts of a detector");
        // The array of three sensor points has the shape of an image.
        for (array, remedy) in
            [(&name[..], "give it to taugate detect, or read it"), ("counts.npy", "read it in Python")]
        {
            fails(here, &["histogram", array], 2, &format!("it is a scan, and no array of images; {remedy}"));
            fails(here, &["compare", array, array], 2, "it is a scan");
        }
    }
}

/// A scan may have more points than an image may have columns.
#[test]
fn a_scan_has_as_many_points_as_its_table_allows() {
    let here = folder();
    let here = here.path();
    assert!(taugate(here, &["generate", "hidden-letter", "-o", "letter.glb"]).status.success());
    let grid = "{ corner = [-0.4, 0.4, 0], across = [0.8, 0, 0], down = [0, -0.8, 0], count = [200, 100] }";
    write(here, "many.toml", &format!("laser-points = [[0, 0, 0]]\nsensor-points = {grid}"), "light-paths = 100");
    let output = taugate(here, &["render", "many.toml", "-o", "m.npy", "--spp", "1", "-q"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let light = read(&here.join("m.npy"));
    let of_points = |from: usize, to: usize| {
        (0..5).flat_map(|gate| &light[20_000 * gate + from..20_000 * gate + to]).filter(|x| **x > 0.0).count()
    };
    let [before, beyond] = [of_points(0, 16_384), of_points(16_384, 20_000)];
    assert!(light.len() == 100_000 && before > 1000 && beyond > 200, "{before} {beyond}");
}

/// A LiDAR in front of the wall: each beam sees the wall at its distance.
#[test]
fn a_lidar_measures_distances() {
    let here = folder();
    let here = here.path();
    assert!(taugate(here, &["generate", "hidden-letter", "-o", "letter.glb"]).status.success());
    let directions = "points = { forward = [-2, 0, -1.5], azimuth = [-10, 10], elevation = [-4, 4], count = [3, 1] }";
    write(here, "lidar.toml", &format!("divergence = 0.1\npixel-fov = 0.1\n{directions}"), "max-depth = 2");
    let output = taugate(here, &["render", "lidar.toml", "--gates", "3m..8m/500", "-o", "l.npy", "-q"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (light, about) = (read(&here.join("l.npy")), description(here, "l.json"));
    for beam in 0..3 {
        let point: Vec<f64> = serde_json::from_value(about["laser_points"][beam].clone()).unwrap();
        // The wall is z = 0, and the laser stands at z = 1.5.
        let distance = 1.5 / (1.5 - point[2]);
        let of_beam = |gate: &usize| light[3 * gate + beam];
        let brightest = (0..500).max_by(|a, b| of_beam(a).total_cmp(&of_beam(b))).unwrap();
        let seen = 0.5 * (3.0 + 0.01 * (brightest as f64 + 0.5));
        assert!((seen - distance).abs() < 0.008, "beam {beam}: {seen} m instead of {distance} m");
    }
}

#[test]
fn mistakes_in_a_scan_are_explained() {
    let here = folder();
    let here = here.path();
    assert!(taugate(here, &["generate", "hidden-letter", "-o", "letter.glb"]).status.success());
    write(here, "good.toml", CONFOCAL, "");
    write(here, "none.toml", "", "");
    write(here, "off.toml", "points = [[0, 0, 0], [0, 0, 0.2]]", "");
    write(here, "beside.toml", "points = [[0, 0, 0], [0, 3, 0]]", "");
    write(here, "camera.toml", CONFOCAL, "[camera]\nfov = 30");
    write(here, "lamp.toml", CONFOCAL, "[emitter]\nlamp = [[0, 0, 1, 5]]");
    write(here, "gap.toml", &CONFOCAL.replace("[3, 2]", "[1, 1]"), "");
    let toml = std::fs::read_to_string(here.join("gap.toml")).unwrap();
    std::fs::write(here.join("gap.toml"), toml.replace("gates = '1.9m..2.9m/5'", "response = 'gap.csv'")).unwrap();
    // All light of this scan falls into the gap of the response.
    std::fs::write(here.join("gap.csv"), "tau_m,weight\n0,1\n0.01,0\n900,0\n900.1,1\n").unwrap();
    write(here, "late.toml", &CONFOCAL.replace("[3, 2]", "[1, 1]"), "max-depth = 3");
    let before = names(here);
    let table: [(&str, &[&str], &str); 13] = [
        ("none.toml", &[], "needs points"),
        ("off.toml", &[], "1 of 2 points of the sensor are not on a surface; the first is [0, 0, 0.2]"),
        ("beside.toml", &[], "there is no surface there"),
        ("camera.toml", &[], "cannot have a camera"),
        ("lamp.toml", &[], "cannot have lights"),
        ("late.toml", &["-q"], "meet no light"),
        ("gap.toml", &["-q"], "meets no light"),
        ("good.toml", &["--png", "x.png"], "cannot have --png"),
        ("good.toml", &["--frames", "0..2"], "cannot have --frames"),
        ("good.toml", &["--gif", "x.gif"], "cannot have --gif"),
        ("good.toml", &["--contact-sheet", "x.png"], "cannot have --contact-sheet"),
        ("good.toml", &["--fps", "5"], "cannot have --fps"),
        ("good.toml", &["-o", "y.exr"], "write -o OUT.npy"),
    ];
    for (file, arguments, part) in table {
        fails(here, &[&["render", file, "-o", "x.npy"], arguments].concat(), 2, part);
        assert_eq!(names(here), before, "{file} {arguments:?}");
    }
}

/// The beams of a LiDAR know what they hit first: the records of `--aov` beside the array.
#[test]
fn a_lidar_has_layers_of_its_beams() {
    let here = folder();
    let here = here.path();
    let run = |arguments: &[&str]| {
        let output = taugate(here, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["generate", "hidden-letter", "-o", "letter.glb"]);
    // Straight towards the wall z = 0, and away from it.
    let beams = |forward: &str| {
        format!(
            "scene = 'letter.glb'\n[scan]\nlaser = [0.5, 0.25, 0.9]\ndivergence = 0.5\npixel-fov = 0.5\nends = 'included'\n\
             points = {{ forward = {forward}, azimuth = [0, 10], elevation = [0, 5], count = [2, 1] }}\n\
             [gate]\ngates = '1m..3m/5'\nforce = true\n[render]\nmax-depth = 2\nspp = 4\n"
        )
    };
    std::fs::write(here.join("wall.toml"), beams("[0, 0, -1]")).unwrap();
    run(&["render", "wall.toml", "-o", "w.npy", "--aov", "depth,normal,object", "-q"]);
    let about = description(here, "w.json");
    assert_eq!(about["aov"], serde_json::json!(["range", "normal", "object_id"]));
    let bytes = std::fs::read(here.join("w.aov.npy")).unwrap();
    let records = &bytes[bytes.len() - 40..];
    let word = |at: usize| <[u8; 4]>::try_from(&records[4 * at..4 * at + 4]).unwrap();
    let number = |at: usize| f64::from(f32::from_le_bytes(word(at)));
    // A single row is in the middle: 2.5 degrees up. The second beam goes 10 degrees to the right.
    let along = |azimuth: f64| 0.9 / (azimuth.to_radians().cos() * 2.5f64.to_radians().cos());
    for (beam, azimuth) in [(0, 0.0), (5, 10.0)] {
        assert!((number(beam) - along(azimuth)).abs() < 1e-4, "{} {}", number(beam), along(azimuth));
        assert_eq!([1, 2, 3].map(|k| number(beam + k)), [0.0, 0.0, 1.0]);
        let name = &about["objects"][u32::from_le_bytes(word(beam + 4)).to_string()];
        assert_eq!(name, "wall", "{about}");
    }

    // A later scan without layers leaves none behind. No message speaks of images, in which scans have no layers.
    run(&["render", "wall.toml", "-o", "w.npy", "-q"]);
    assert!(!here.join("w.aov.npy").exists() && description(here, "w.json")["aov"].is_null());
    fails(
        here,
        &["render", "wall.toml", "-o", "w.npy", "--aov", "arrival"],
        2,
        "its histograms show when light arrives",
    );
    fails(here, &["render", "wall.toml", "-o", "w.exr", "--aov", "depth"], 2, "a scan is one array: write -o OUT.npy");
}
