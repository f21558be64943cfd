//! Photon counts from the radiance of a render, on the command line.

use taugate::internals::image::npy_read::read;

#[cfg(target_os = "linux")]
use crate::grids::npy;
use crate::{fails, folder, names, taugate};

#[test]
fn counts_have_the_mean_of_the_light() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stderr).unwrap()
    };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    let small = ["--resolution", "16x12", "--spp", "4", "-q"];
    run(&[&["render", "box.glb", "--gates", "5m..8m/3", "-o", "light.npy", "-o", "light.exr"], &small[..]].concat());
    run(&[&["render", "box.glb", "--gate", "5m..8m", "-o", "gate.exr"], &small[..]].concat());
    run(&[&["render", "box.glb", "-o", "day.exr"], &small[..]].concat());
    let sum = |name: &str| read(&here.path().join(name)).unwrap().values.iter().map(|&x| f64::from(x)).sum::<f64>();

    let message =
        run(&["detect", "light.npy", "-o", "counts.npy", "--photons", "1000", "--pulses", "50", "--efficiency", "0.5"]);
    assert!(message.contains("counts.npy, counts.json: "), "{message}");
    let expected = 25_000.0 * sum("light.npy");
    assert!((sum("counts.npy") - expected).abs() < 5.0 * expected.sqrt(), "{} {expected}", sum("counts.npy"));
    let text = std::fs::read_to_string(here.path().join("counts.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&description["detector"]["pulses"], &description["temporal_bins"]), (&50.into(), &3.into()));
    assert_eq!(
        (&description["unit"], &description["shape"]),
        (&"counts over all pulses".into(), &vec![12, 16, 3, 3].into())
    );

    // An image of several gates gives the counts and the description of the array.
    let of_image = ["--photons", "1000", "--pulses", "50", "--efficiency", "0.5"];
    run(&[&["detect", "light.exr", "-o", "image.npy"], &of_image[..]].concat());
    assert!(read(&here.path().join("image.npy")).unwrap() == read(&here.path().join("counts.npy")).unwrap());
    let text = std::fs::read_to_string(here.path().join("image.json")).unwrap();
    let of_image: serde_json::Value = serde_json::from_str(&text).unwrap();
    for key in ["start_opl", "bin_width_opl", "temporal_bins", "axes", "shape", "unit"] {
        assert!(of_image[key] == description[key] && !of_image[key].is_null(), "{key}: {text}");
    }
    for key in ["name", "gate_begin_m", "gate_end_m"] {
        assert_eq!(of_image["responses"][2][key], description["responses"][2][key], "{key}: {text}");
    }

    // With --first-photon, each channel of a pixel counts at most one photon per pulse.
    let first = ["detect", "light.npy", "--photons", "1e6", "--pulses", "9", "--first-photon"];
    run(&[&first[..], &["-o", "first.npy"]].concat());
    let counts = read(&here.path().join("first.npy")).unwrap();
    assert!(counts.values.chunks_exact(9).all(|pixel| (0..3).all(|c| pixel[c] + pixel[3 + c] + pixel[6 + c] <= 9.0)));
    let light = read(&here.path().join("light.npy")).unwrap();
    let of_channel = |pixel: &[f32], c: usize| f64::from(pixel[c] + pixel[3 + c] + pixel[6 + c]);
    let seen = |pixel: &[f32]| (0..3).map(|c| 9.0 * (1.0 - (-1e6 * of_channel(pixel, c)).exp())).sum::<f64>();
    let expected: f64 = light.values.chunks_exact(9).map(seen).sum();
    assert!((sum("first.npy") - expected).abs() < 5.0 * expected.sqrt(), "{} {expected}", sum("first.npy"));
    run(&[&first[..], &["-o", "again.npy"]].concat());
    assert!(read(&here.path().join("again.npy")).unwrap() == counts, "the same seed gives other counts");

    // The background is collected for the duration of the gate, 3 m or 10 ns. The image gives one gate, and --mono one channel.
    let day = ["--photons", "1e8", "--background", "day.exr", "--jitter", "100ps", "--dark-counts", "1e6", "--mono"];
    run(&[&["detect", "gate.exr", "-o", "day.npy"], &day[..]].concat());
    let bytes = std::fs::read(here.path().join("day.npy")).unwrap();
    assert!(String::from_utf8_lossy(&bytes[..128]).contains("(12, 16, 1)"));

    let text = std::fs::read_to_string(here.path().join("day.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&description["start_opl"], &description["bin_width_opl"]), (&5.0.into(), &3.0.into()), "{text}");

    let table: [(&[&str], &str); 16] = [
        (&["light.npy", "-o", "x.exr", "--photons", "1"], "must end in .npy"),
        (&["light.npy", "-o", "light.npy", "--photons", "1"], "would replace the light"),
        (&["light.npy", "-o", "x.npy", "--photons", "-1"], "0 or more"),
        (&["light.npy", "-o", "x.npy", "--photons", "1e300"], "lower --photons or --pulses"),
        (&["light.npy", "-o", "x.npy", "--photons", "1", "--efficiency", "2"], "from 0 to 1"),
        (&["light.npy", "-o", "x.npy", "--photons", "1", "--background", "night"], "is no background"),
        (&["light.npy", "-o", "x.npy", "--photons", "1", "--background", "light.exr"], "has several gates"),
        (
            &["light.npy", "-o", "x.npy", "--photons", "1e18", "--dead-time", "1e-30m"],
            "raise --dead-time or lower --photons",
        ),
        (
            &["light.npy", "-o", "x.npy", "--photons", "1e308", "--background", "1e12", "--dead-time", "1m"],
            "lower --photons",
        ),
        (
            &["light.npy", "-o", "x.npy", "--photons", "1e4", "--dead-time", "1m", "--pulses", "10000000000"],
            "lower --pulses, or use --first-photon",
        ),
        (
            &["light.npy", "-o", "x.npy", "--photons", "1", "--background", "gate.exr"],
            "has a gate, but daylight has none",
        ),
        (&["day.exr", "-o", "x.npy", "--photons", "1", "--jitter", "1ns"], "leave out --jitter"),
        (&["day.exr", "-o", "x.npy", "--photons", "1", "--dark-counts", "1"], "collects daylight and dark counts"),
        (&["light.npy", "-o", "x.npy", "--photons", "1", "--jitter", "5"], "like 100m or 400ns"),
        (&["light.npy", "-o", "x.npy"], "--photons"),
        (&["box.glb", "-o", "x.npy", "--photons", "1"], "must be an array"),
    ];
    for (arguments, part) in table {
        fails(here.path(), &[&["detect"], arguments].concat(), 2, part);
    }
    assert!(!names(here.path()).iter().any(|name| name.starts_with('x')));
}

/// Without jitter and dead time, each response is an exposure of its own.
#[test]
fn overlapping_gates_and_waves_give_counts() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    let small = ["render", "box.glb", "--resolution", "8x6", "--spp", "2", "-q"];
    let slices =
        ["--response", "near=box:5m..7m", "--response", "far=box:6m..8m", "-o", "slices.npy", "-o", "slices.exr"];
    run(&[&small[..], &slices].concat());
    run(&[&small[..], &["--cw", "20", "-o", "wave.npy", "-o", "wave.exr"]].concat());
    let images = |name: &str| {
        let array = read(&here.path().join(name)).unwrap();
        (0..array.images()).map(|k| array.image(k).iter().map(|&x| f64::from(x)).sum::<f64>()).collect::<Vec<_>>()
    };
    for (kind, count) in [("slices", 2), ("wave", 4)] {
        let light = images(&format!("{kind}.npy"));
        assert!(light.len() == count && light.iter().all(|&light| light > 0.0), "{light:?}");
        for extension in ["npy", "exr"] {
            let detect = ["detect", &format!("{kind}.{extension}"), "--photons", "1e4", "--pulses", "10", "-o"];
            run(&[&detect[..], &["counts.npy"]].concat());
            for (counts, light) in images("counts.npy").into_iter().zip(&light) {
                let expected = 1e5 * light;
                assert!((counts - expected).abs() < 6.0 * expected.sqrt(), "{kind}: {counts} {expected}");
            }
            for flags in [&["--first-photon"][..], &["--dead-time", "1ns"], &["--jitter", "1ns"]] {
                let part = format!("leave out {}, or render with --gates", flags[0]);
                fails(here.path(), &[&detect[..], &["x.npy"], flags].concat(), 2, &part);
            }
        }
    }
    assert!(!names(here.path()).iter().any(|name| name.starts_with('x')));
}

/// Daylight has the weight that the response gives to its travel time.
#[test]
fn a_measured_gate_collects_daylight_by_its_weights() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    // A triangle from 17 ns to 24 ns with the integral 3.5 ns.
    std::fs::write(here.path().join("slice.csv"), "time_ns,weight\n17,0\n20,1\n24,0\n").unwrap();
    let small = ["--resolution", "8x6", "--spp", "2", "-q", "-o", "light.npy", "-o", "light.exr", "-o", "light.acc"];
    let soft = ["--response", "soft=gauss:8m..8.299792458m,0.1m"];
    for (responses, nanoseconds) in [(&[][..], 3.5), (&soft[..], 4.5)] {
        run(&[&["render", "box.glb", "--response", "slice.csv"], &small[..], responses].concat());
        for light in ["light.npy", "light.exr", "light.acc"] {
            // The background outshines the light of the render.
            let day = ["--photons", "1e-3", "--background", "1e15", "--seed", "3"];
            run(&[&["detect", light, "-o", "day.npy"], &day[..]].concat());
            let counts = read(&here.path().join("day.npy")).unwrap();
            let total: f64 = counts.values.iter().map(|&x| f64::from(x)).sum();
            let expected = 1e3 * nanoseconds * 8.0 * 6.0 * 3.0;
            assert!((total - expected).abs() < 6.0 * expected.sqrt(), "{light}: {total} {expected}");
        }
    }
}

/// Counts are no light, and have no unit of light.
#[test]
fn counts_are_counts_in_a_histogram_and_no_light_for_detect() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let json = |arguments: &[&str]| -> serde_json::Value { serde_json::from_str(&run(arguments)).unwrap() };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    let small = ["--resolution", "8x6", "--spp", "2", "-q", "-o", "light.npy"];
    run(&[&["render", "box.glb", "--gates", "5m..8m/3"], &small[..]].concat());
    let detect = ["detect", "light.npy", "--photons", "1e4", "-o"];
    run(&[&detect[..], &["counts.npy"]].concat());
    run(&[&detect[..], &["mono.npy", "--mono"]].concat());

    let light = run(&["histogram", "light.npy", "--pixel", "3,2", "--plot", "light.svg"]);
    assert!(light.contains("R, G, B in W/m^2/sr") && !light.contains("counts over"), "{light}");
    let counts = run(&["histogram", "counts.npy", "--pixel", "3,2", "--plot", "counts.svg"]);
    assert!(counts.contains("R, G, B in counts over all pulses") && !counts.contains("W/m^2"), "{counts}");
    let plot = |name: &str| std::fs::read_to_string(here.path().join(name)).unwrap();
    assert!(
        plot("light.svg").contains("radiance in each gate") && plot("counts.svg").contains("counts over all pulses")
    );
    assert!(!plot("counts.svg").contains("radiance"));
    let rows = json(&["histogram", "counts.npy", "--pixel", "3,2", "--json"]);
    assert!(rows[1]["counts"].as_array().is_some_and(|counts| counts.len() == 3) && rows[1]["radiance"].is_null());

    // A detector without colours has one channel.
    let mono = run(&["histogram", "mono.npy", "--pixel", "3,2"]);
    assert!(mono.contains("to m  counts over all pulses"), "{mono}");
    let rows = json(&["histogram", "mono.npy", "--pixel", "3,2", "--json"]);
    let bytes = std::fs::read(here.path().join("mono.npy")).unwrap();
    let at = bytes.len() - 4 * (6 * 8 * 3) + 4 * ((2 * 8 + 3) * 3 + 1);
    let value = f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!(rows[1]["counts"], serde_json::json!([value]));

    for counts in ["counts.npy", "mono.npy"] {
        fails(here.path(), &["detect", counts, "-o", "x.npy", "--photons", "1"], 2, "holds counts of a detector");
    }
}

#[test]
fn detect_refuses_the_background_of_another_crop() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    let small = ["render", "box.glb", "--resolution", "16x12", "--spp", "2", "-q"];
    let light = ["-o", "light.npy", "-o", "light.exr", "-o", "light.acc"];
    for gates in ["5m..8m/1", "5m..8m/3"] {
        run(&[&small[..], &["--gates", gates, "--crop", "0,8,2,10"], &light].concat());
        run(&[&small[..], &["--crop", "8,16,2,10", "-o", "other.exr"]].concat());
        run(&[&small[..], &["--crop", "0,8,2,10", "-o", "day.exr"]].concat());
        for light in ["light.npy", "light.exr", "light.acc"] {
            let detect = ["detect", light, "-o", "x.npy", "--photons", "1", "--background"];
            let message =
                fails(here.path(), &[&detect[..], &["other.exr"]].concat(), 2, "other.exr: begins at column 8");
            assert!(message.contains("the light at column 0, row 2"), "{message}");
            run(&[&detect[..], &["day.exr"]].concat());
        }
    }
}

/// The file is sparse: it takes no space, and claims a terabyte.
#[test]
#[cfg(target_os = "linux")]
fn detect_refuses_light_that_does_not_fit_into_memory() {
    let here = folder();
    let path = here.path().join("huge.npy");
    std::fs::write(&path, npy("<f4", "(300000, 300000, 3)", &[])).unwrap();
    let file = std::fs::OpenOptions::new().append(true).open(&path).unwrap();
    if file.set_len(128 + 4 * 3 * 300_000 * 300_000).is_err() {
        println!("skipped: the disk has no sparse files");
        return;
    }
    fails(here.path(), &["detect", "huge.npy", "-o", "x.npy", "--photons", "1"], 2, "GiB of memory, but only");
}
