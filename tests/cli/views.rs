//! Runs the program for its other results beside the image: images of strategies, statistics and comparisons.

use std::path::Path;

use taugate::internals::image::exr_file::read_picture;

use crate::taugate;

/// Runs a command that must exit with `code`. Returns stdout and stderr.
fn run(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = taugate(folder, arguments);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out}{err}");
    (out, err)
}

/// A folder with a Cornell box.
fn folder() -> tempfile::TempDir {
    let here = tempfile::tempdir().unwrap();
    run(here.path(), &["generate", "cornell-box", "-o", "box.glb"], 0);
    here
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const SMALL: [&str; 8] = ["--resolution", "20x16", "--light-paths", "500", "--spp", "16", "--max-depth", "3"];

fn render(folder: &Path, more: &[&str], code: i32) -> String {
    run(folder, &[&["render", "box.glb"], &SMALL[..], more].concat(), code).1
}

#[test]
fn strategy_images_add_up_to_the_image() {
    let here = folder();
    for (gate, estimator) in [("6m..8m", "bdpt"), ("0m..inf", "lcs-paper")] {
        let message = render(
            here.path(),
            &["-o", "a.exr", "--estimator", estimator, "--gate", gate, "--strategy-images", "pyramid"],
            0,
        );
        assert!(message.contains("pyramid: 8 strategies"), "{message}");
        let image = read_picture(&here.path().join("a.exr")).unwrap().rgb;
        let mut sum = vec![0.0f64; image.len()];
        let files = names(&here.path().join("pyramid"));
        assert_eq!(files.len(), 16, "{files:?}");
        for file in files.iter().filter(|file| file.ends_with("_weighted.exr")) {
            let part = read_picture(&here.path().join("pyramid").join(file)).unwrap().rgb;
            sum.iter_mut().zip(part).for_each(|(to, from)| *to += f64::from(from));
        }
        let mean = sum.iter().sum::<f64>() / sum.len() as f64;
        assert!(mean > 0.0);
        for (x, s) in image.iter().zip(&sum) {
            assert!((f64::from(*x) - s).abs() < 2e-5 * (s + mean), "{x} {s}");
        }
    }
    // The image is the same with and without the flag.
    let with = std::fs::read(here.path().join("a.exr")).unwrap();
    render(here.path(), &["-o", "b.exr", "--estimator", "lcs-paper", "--gate", "0m..inf"], 0);
    let pixels = |file: &str| read_picture(&here.path().join(file)).unwrap().rgb;
    assert!(!with.is_empty() && pixels("a.exr") == pixels("b.exr"));
    assert_eq!(names(here.path()), ["a.exr", "b.exr", "box.glb", "pyramid"], "nothing else is left behind");
}

/// The folder of strategy images replaces any file or folder of the same name. The image was lost when it was in that folder.
#[test]
fn strategy_images_do_not_replace_the_image() {
    let here = folder();
    std::fs::create_dir(here.path().join("p")).unwrap();
    for (image, folder) in
        [("a.exr", "a.exr"), ("p/a.exr", "p"), ("p/s01_t02_weighted.exr", "./p"), ("p/a.exr", "p/../p")]
    {
        let message = render(here.path(), &["-o", image, "--strategy-images", folder], 2);
        assert!(message.contains("replaced as a whole") && message.contains(image), "{message}");
    }
    assert_eq!((names(here.path()), names(&here.path().join("p")).len()), (vec!["box.glb".into(), "p".into()], 0));
}

#[test]
fn a_folder_of_other_files_is_not_touched() {
    let here = folder();
    std::fs::create_dir(here.path().join("mine")).unwrap();
    std::fs::write(here.path().join("mine/thesis.tex"), "years of work").unwrap();
    let message = render(here.path(), &["-o", "a.exr", "--strategy-images", "mine"], 2);
    assert!(message.contains("holds 'thesis.tex'"), "{message}");
    let message = render(here.path(), &["-o", "a.exr", "--strategy-images", "no/where"], 2);
    assert!(message.contains("cannot be written"), "{message}");
    let deep = [
        "--estimator",
        "bdpt",
        "--resolution",
        "512x512",
        "--max-depth",
        "24",
        "-o",
        "a.exr",
        "--strategy-images",
        "p",
    ];
    let message = run(here.path(), &[&["render", "box.glb"], &deep[..]].concat(), 2).1;
    assert!(message.contains("323 strategies") && message.contains("--max-depth"), "{message}");
    assert_eq!(names(here.path()), ["box.glb", "mine"]);
}

#[test]
fn the_summary_says_how_well_the_image_is_known() {
    let here = folder();
    let message = render(here.path(), &["-o", "a.exr", "--gate", "7m..8m", "--stats", "a.json"], 0);
    for part in ["mean ", " +- ", "connections inside the gate: ", "non-finite samples dropped: 0"] {
        assert!(message.contains(part), "{part:?} is missing in: {message}");
    }
    let numbers = |file: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(here.path().join(file)).unwrap()).unwrap()
    };
    let of = |value: &serde_json::Value, key: &str| value[key].as_f64().unwrap_or_else(|| panic!("{key}: {value}"));
    let n = numbers("a.json");
    // Queries choose connections that meet the gate. bdpt does not choose, and few of its connections meet the gate.
    render(here.path(), &["-o", "b.exr", "--gate", "7m..8m", "--estimator", "bdpt", "--stats", "b.json"], 0);
    let [lcs, bdpt] = [&n, &numbers("b.json")].map(|n| of(n, "connections_inside_gate"));
    assert!(bdpt > 0.0 && bdpt < 0.5, "a thin gate must let few connections of bdpt through: {bdpt}");
    assert!(lcs > bdpt && lcs <= 1.0, "queries do not choose by the gate: {lcs} of lcs, {bdpt} of bdpt");
    assert!(of(&n, "inside_gate_per_sample") > 0.0 && n["samples_dropped"] == 0);

    // The standard error equals the spread of the means of independent seeds.
    let means: Vec<[f64; 2]> = (1..=8)
        .map(|seed| {
            let seed = seed.to_string();
            render(here.path(), &["-o", "b.exr", "--gate", "7m..8m", "--stats", "b.json", "--seed", &seed], 0);
            let n = numbers("b.json");
            [of(&n, "image_mean"), of(&n, "image_mean_standard_error").powi(2)]
        })
        .collect();
    let count = means.len() as f64;
    let mean = means.iter().map(|m| m[0]).sum::<f64>() / count;
    let spread = means.iter().map(|m| (m[0] - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let claimed = means.iter().map(|m| m[1]).sum::<f64>() / count;
    eprintln!("mean {mean:.5}, spread {:.2e}, claimed {:.2e}", spread.sqrt(), claimed.sqrt());
    // F distribution with 7 and 120 degrees of freedom: a probability of 1e-3 beyond each end.
    assert!((0.08..3.8).contains(&(spread / claimed)), "{spread} against {claimed}");

    // A gate near the resolution of travel times gives a warning at the start, again at the end, and in the statistics.
    let message = render(here.path(), &["-o", "c.exr", "--gate", "7m+0.1mm", "--stats", "c.json", "--force"], 0);
    assert_eq!(message.matches("steps of 32-bit travel times").count(), 2, "{message}");
    assert!(numbers("c.json")["warnings"][0].as_str().unwrap().contains("32-bit travel times"));

    // One iteration gives no estimate of the error.
    let one = ["--resolution", "8x8", "--spp", "1", "-o", "d.exr", "--stats", "d.json"];
    let message = run(here.path(), &[&["render", "box.glb"], &one[..]].concat(), 0).1;
    assert!(message.contains("unknown error") && numbers("d.json")["image_mean_standard_error"].is_null(), "{message}");
}

#[test]
fn a_comparison_gives_a_verdict_and_a_map() {
    let here = folder();
    let image = |file: &str, seed: &str, more: &[&str]| {
        render(here.path(), &[&["-o", file, "--seed", seed], more].concat(), 0);
    };
    image("a.exr", "1", &["--gate", "6m..8m"]);
    image("b.exr", "2", &["--gate", "6m..8m"]);
    image("late.exr", "3", &["--gate", "6.8m..8m"]);
    let compare = |arguments: &[&str], code: i32| run(here.path(), &[&["compare"], arguments].concat(), code);
    let (message, _) = compare(&["b.exr", "a.exr", "--z", "same.png"], 0);
    assert!(
        message.contains("the two agree: max |z| = ") && message.contains("threshold") && message.contains("y 0.."),
        "{message}"
    );
    let (message, _) = compare(&["late.exr", "a.exr", "--z", "map.exr"], 1);
    assert!(message.contains("the two differ: max |z| = "), "{message}");
    let map = read_picture(&here.path().join("map.exr")).unwrap();
    assert_eq!((map.width, map.height), (20, 16));
    // late.exr misses the early light: it is darker, so z is negative.
    assert!(map.rgb.iter().all(|&z| z <= 4.0) && map.rgb.iter().any(|&z| z < -4.0));
    let (json, _) = compare(&["late.exr", "a.exr", "--z", "map.png", "--json"], 1);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json["z"]["verdict"] == "differ" && json["z"]["max_z"].as_f64() > json["z"]["threshold"].as_f64());
    let worst = &json["z"]["worst"][0];
    assert!(worst["x"][1].as_u64() <= Some(20) && worst["z"].as_f64() < Some(-4.0), "{worst}");
    for picture in ["same.png", "map.png"] {
        assert!(std::fs::read(here.path().join(picture)).unwrap().starts_with(b"\x89PNG"));
    }
}

#[test]
fn images_that_do_not_tell_their_noise_are_not_judged() {
    let here = folder();
    let judge = |a: &str, b: &str, z: &str, part: &str| {
        let message = run(here.path(), &["compare", a, b, "--z", z], 2).1;
        assert!(message.starts_with("error: ") && message.contains(part), "{part:?}: {message}");
    };
    render(here.path(), &["-o", "a.exr", "--seed", "1"], 0);
    render(here.path(), &["-o", "late.exr", "--seed", "1", "--gate", "0m..6.5m"], 0);
    run(here.path(), &["render", "box.glb", "-o", "few.exr", "--resolution", "20x16", "--spp", "4"], 0);
    run(here.path(), &["render", "box.glb", "-o", "small.exr", "--resolution", "8x8", "--spp", "4"], 0);
    let (width, height, rgb) = (20, 16, vec![1.0; 960]);
    let write = |file: &str, rgb: &[f32]| {
        taugate::internals::image::exr_file::write_plain(&here.path().join(file), width, height, rgb).unwrap();
    };
    write("plain.exr", &rgb);
    write("nan.exr", &[&rgb[1..], &[f32::NAN]].concat());
    judge("late.exr", "a.exr", "z.png", "seed 1");
    judge("few.exr", "a.exr", "z.png", "2 iterations");
    judge("small.exr", "a.exr", "z.png", "differ in size");
    judge("plain.exr", "a.exr", "z.png", "plain.exr: has no estimate of its noise");
    judge("nan.exr", "a.exr", "z.png", "nan.exr: pixel 19,15 is NaN");
    judge("few.exr", "a.exr", "z.jpg", ".png or .exr");
    judge("few.exr", "a.exr", "a.exr", "would overwrite a.exr");
    // Pixels that were changed after rendering no longer belong to the error estimate in the attributes.
    render(here.path(), &["-o", "b.exr", "--seed", "2"], 0);
    double(&here.path().join("b.exr"), &here.path().join("doubled.exr"));
    judge("doubled.exr", "a.exr", "z.png", "doubled.exr: its pixels were changed after rendering");
    judge("a.exr", "doubled.exr", "z.png", "doubled.exr: its pixels were changed after rendering");
    assert_eq!(names(here.path()).iter().filter(|name| name.starts_with('z')).count(), 0);
}

/// Writes a copy of an EXR file with all samples doubled.
fn double(from: &Path, to: &Path) {
    use exr::prelude::*;
    let mut image =
        read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes().from_file(from);
    for channel in image.as_mut().unwrap().layer_data.iter_mut().flat_map(|layer| &mut layer.channel_data.list) {
        let FlatSamples::F32(samples) = &mut channel.sample_data else { panic!("taugate writes 32 bits") };
        samples.iter_mut().for_each(|x| *x *= 2.0);
    }
    image.unwrap().write().to_file(to).unwrap();
}

/// `--aov` adds layers to the image file and changes nothing else. `compare` reads the file.
#[test]
fn auxiliary_layers_do_not_change_the_image() {
    let here = folder();
    let gate = ["--gate", "6m..8m", "--crop", "2,18,1,15"];
    render(here.path(), &[&gate[..], &["-o", "a.exr"]].concat(), 0);
    render(here.path(), &[&gate[..], &["-o", "b.exr", "--aov", "all"]].concat(), 0);
    let pixels = |file: &str| read_picture(&here.path().join(file)).unwrap();
    assert_eq!((pixels("a.exr").rgb, pixels("a.exr").variance), (pixels("b.exr").rgb, pixels("b.exr").variance));
    run(here.path(), &["compare", "a.exr", "b.exr", "--max-relmse", "0"], 0);
    let channel = |name: &str| -> Vec<f32> {
        use exr::prelude::*;
        let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = image.all_attributes().from_file(here.path().join("b.exr")).unwrap();
        let layer = image.layer_data.channel_data;
        let found = layer.list.iter().find(|channel| channel.name.to_string() == name).expect(name);
        found.sample_data.values_as_f32().collect()
    };
    // The box is 2 m wide, and the camera stands 3.9 m before its centre. No light arrives from the lamp's own black surface. The
    // depth is that of the pixel's centre; another part of the pixel may show a surface up to 1.5 m nearer.
    let (depth, arrival) = (channel("depth.Z"), channel("arrival.Z"));
    assert_eq!((depth.len(), arrival.len()), (16 * 14, 16 * 14));
    assert!(depth.iter().all(|&z| (2.9..6.0).contains(&z)), "{depth:?}");
    assert!(arrival.iter().zip(&depth).all(|(&tau, &z)| tau == 0.0 || (tau > z - 1.5 && tau < 30.0)), "{arrival:?}");
    assert!(arrival.iter().filter(|&&tau| tau == 0.0).count() <= 6, "{arrival:?}");
    assert!(channel("object.ID").iter().all(|&id| (1.0..9.0).contains(&id)));

    render(here.path(), &["-o", "c.exr", "--aov", "depth,colour"], 2);
    assert!(!here.path().join("c.exr").exists());
}

#[test]
fn pictures_with_one_exposure_can_be_compared() {
    let here = folder();
    let png = |file: &str| {
        let file = std::io::BufReader::new(std::fs::File::open(here.path().join(file)).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    let mean = |file: &str| png(file).iter().map(|&x| f64::from(x)).sum::<f64>();
    let message = render(here.path(), &["-o", "a.exr", "--png"], 0);
    let stops = message.split("auto; --exposure ").nth(1).and_then(|rest| rest.split(' ').next()).expect(&message);
    assert!(message.contains(&format!("a.png: exposure +{stops} EV")), "{message}");
    // The same exposure gives the same picture, up to the digits of the message; a stop less is darker.
    render(here.path(), &["-o", "b.exr", "--png", "--exposure", stops], 0);
    assert!(png("a.png").iter().zip(png("b.png")).all(|(a, b)| a.abs_diff(b) <= 2));
    let less = format!("{}", stops.parse::<f64>().unwrap() - 1.0);
    let message = render(here.path(), &["-o", "c.exr", "--png", "--exposure", &less], 0);
    assert!(mean("c.png") < 0.9 * mean("a.png") && message.contains("c.png: exposure "), "{message}");
    let message = render(here.path(), &["-o", "d.exr", "--exposure", "-1"], 2);
    assert!(message.contains("--exposure is for the picture: add --png"), "{message}");
}
