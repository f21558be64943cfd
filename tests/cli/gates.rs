//! Many gates from one render, on the command line: the files, and the messages about mistakes.

use std::path::Path;

use taugate::internals::image::exr_file::read_picture;

use crate::grids::npy;
use crate::{fails, folder, names, taugate};

const SMALL: [&str; 6] = ["--resolution", "8x6", "--spp", "4", "--sampling", "uniform"];

fn with_box() -> tempfile::TempDir {
    let here = folder();
    assert!(taugate(here.path(), &["generate", "cornell-box", "-o", "box.glb"]).status.success());
    here
}

/// Renders the box and returns what the program prints.
fn render(here: &Path, flags: &[&str]) -> String {
    let output = taugate(here, &[&["render", "box.glb"], &SMALL[..], flags].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{flags:?}: {message}");
    message
}

/// The shape and the values of an array.
fn array(path: &Path) -> (String, Vec<f32>) {
    let bytes = std::fs::read(path).unwrap();
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
    let shape = header.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0;
    let values = bytes[10 + length..].as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    (shape.into(), values)
}

#[test]
fn the_files_hold_the_same_light() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    let message = render(here.path(), &["--gates", "5m..8m/3", "-o", "a.npy", "-o", "a.exr", "--variance", "--png"]);
    assert!(message.contains("3 gates in 5-8 m"), "{message}");
    assert_eq!(names(here.path()), ["a.exr", "a.json", "a.npy", "a.png", "a.variance.npy", "box.glb"]);

    // The first gate is R, G, B of the image.
    let (shape, means) = array(&at("a.npy"));
    assert_eq!((shape.as_str(), means.len()), ("6, 8, 3, 3", 6 * 8 * 3 * 3));
    let (_, variances) = array(&at("a.variance.npy"));
    let picture = read_picture(&at("a.exr")).unwrap();
    let first = |values: &[f32]| -> Vec<f32> { values.chunks_exact(9).flat_map(|pixel| pixel[..3].to_vec()).collect() };
    assert_eq!((picture.rgb, picture.variance), (first(&means), Some(first(&variances))));
    assert_eq!(picture.gate, Some([5.0, 6.0]));
    let meta = exr::meta::MetaData::read_from_file(at("a.exr"), false).unwrap();
    let channels: Vec<String> = meta.headers[0].channels.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(channels.len(), 18);
    assert!(["R", "Variance.B", "bin1.G", "bin2.Variance.R"].iter().all(|name| channels.iter().any(|c| c == name)));

    let text = std::fs::read_to_string(at("a.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&description["start_opl"], &description["bin_width_opl"]), (&5.0.into(), &1.0.into()));
    assert_eq!((&description["temporal_bins"], &description["shape"]), (&3.into(), &vec![6, 8, 3, 3].into()));
    assert_eq!(description["responses"][2]["gate_begin_m"], 7.0);

    // The settings in the file render the same array.
    std::fs::write(at("again.toml"), description["settings"].as_str().unwrap()).unwrap();
    assert!(taugate(here.path(), &["render", "again.toml", "-o", "b.npy"]).status.success());
    assert_eq!(array(&at("b.npy")).1, means);
}

#[test]
fn one_gate_is_an_array_too() {
    let here = with_box();
    render(here.path(), &["--gate", "5m..8m", "-o", "a.npy", "-o", "a.exr"]);
    let (shape, means) = array(&here.path().join("a.npy"));
    assert_eq!((shape.as_str(), means), ("6, 8, 3", read_picture(&here.path().join("a.exr")).unwrap().rgb));
}

#[test]
fn a_list_of_responses_is_rendered_again_from_its_settings() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    std::fs::write(at("laser.csv"), "# measured\ntime_ns,weight\n17,0\n20,1\n24,0\n").unwrap();
    let list =
        ["--gate", "5m..8m", "--response", "box", "--response", "soft=gauss:6m..7m,1ns", "--response", "laser.csv"];
    render(here.path(), &[&list[..], &["-o", "a.npy", "-o", "a.exr"]].concat());
    let text = std::fs::read_to_string(at("a.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(description["start_opl"].is_null() && description["responses"][1]["name"] == "soft", "{text}");
    let folder = at("elsewhere");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("again.toml"), description["settings"].as_str().unwrap()).unwrap();
    // The paths in an experiment are relative to its folder.
    for name in ["box.glb", "laser.csv"] {
        std::fs::copy(at(name), folder.join(name)).unwrap();
    }
    assert!(taugate(&folder, &["render", "again.toml", "-o", "b.npy"]).status.success());
    assert_eq!(array(&at("a.npy")), array(&folder.join("b.npy")));

    // One response is an image like any other.
    let message =
        render(here.path(), &["--gate", "5m..8m", "--response", "trapezoid:0.5m", "-o", "c.exr", "-o", "c.npy"]);
    assert!(message.contains("with ramps of 0.5 m"), "{message}");
    assert_eq!(array(&at("c.npy")).1, read_picture(&at("c.exr")).unwrap().rgb);
}

#[test]
fn a_continuous_wave_sensor_writes_depths() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    let message = render(here.path(), &["--cw", "80,60", "-o", "a.npy", "-o", "a.exr"]);
    assert!(message.contains("continuous wave of 80,60 MHz"), "{message}");
    assert_eq!(names(here.path()), ["a.depth.npy", "a.exr", "a.json", "a.npy", "box.glb"]);
    assert_eq!(array(&at("a.npy")).0, "6, 8, 8, 3");
    let (shape, depths) = array(&at("a.depth.npy"));
    // The phases of both frequencies repeat together after 7.5 m.
    assert!(shape == "6, 8" && depths.iter().all(|&depth| depth.is_nan() || (0.0..7.5).contains(&depth)), "{depths:?}");
    let meta = exr::meta::MetaData::read_from_file(at("a.exr"), false).unwrap();
    let names: Vec<String> = meta.headers[0].channels.list.iter().map(|channel| channel.name.to_string()).collect();
    for name in ["R", "cw80MHz-3.G", "cw60MHz.amplitude", "cw80MHz.phase", "cw80MHz.depth", "cw.depth"] {
        assert!(names.iter().any(|found| found == name), "{name}: {names:?}");
    }
}

#[test]
fn arrays_are_compared_and_plotted() {
    let here = with_box();
    let out = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    render(here.path(), &["--gates", "5m..8m/3", "-o", "a.npy", "--variance"]);
    render(here.path(), &["--gates", "5m..8m/3", "--seed", "2", "-o", "b.npy"]);
    render(here.path(), &["--gate", "5m..8m", "-o", "b.exr"]);

    let same: serde_json::Value = serde_json::from_str(&out(&["compare", "a.npy", "a.npy", "--json"])).unwrap();
    assert_eq!((&same["relmse"], &same["ratio_of_means"], &same["compared"]), (&0.0.into(), &1.0.into(), &3.into()));
    let text = out(&["compare", "a.npy", "b.npy"]);
    assert!(text.contains("3 of 3 gates") && text.contains("in bin2"), "{text}");
    let code = |max| taugate(here.path(), &["compare", "a.npy", "b.npy", "--max-relmse", max]).status.code();
    assert_eq!((code("1e9"), code("1e-9")), (Some(0), Some(1)));

    // The histogram of a pixel has the values of the array, and error bars from the variances.
    let (_, means) = array(&here.path().join("a.npy"));
    let rows: serde_json::Value =
        serde_json::from_str(&out(&["histogram", "a.npy", "--pixel", "3,2", "--plot", "p.svg", "--json"])).unwrap();
    let at = (2 * 8 + 3) * 9;
    assert_eq!(rows[1]["radiance"][2].as_f64().map(|x| x as f32), Some(means[at + 5]));
    assert_eq!((&rows[1]["name"], &rows[1]["begin_m"], &rows[1]["end_m"]), (&"bin1".into(), &6.0.into(), &7.0.into()));
    assert!(rows[1]["deviation"][0].as_f64().unwrap() > 0.0);
    assert!(std::fs::read_to_string(here.path().join("p.svg")).unwrap().contains("pixel 3,2 of a.npy"));
    let text = out(&["histogram", "b.npy"]);
    assert!(text.contains("mean over all pixels") && text.contains("bin2") && !text.contains("+-"), "{text}");
    out(&["info", "box.glb", "--resolution", "8x6", "--plot", "arrivals.svg"]);
    assert!(std::fs::read_to_string(here.path().join("arrivals.svg")).unwrap().contains("optical path"));

    std::fs::write(here.path().join("text.npy"), "no array").unwrap();
    std::fs::copy(here.path().join("b.npy"), here.path().join("alone.npy")).unwrap();
    render(here.path(), &["--gates", "5m..8m/4", "-o", "four.npy"]);
    let table: [(&[&str], &str); 9] = [
        (&["compare", "a.npy", "b.exr"], "only compared with another of them"),
        (&["compare", "a.npy", "four.npy"], "differ in size: a.npy is 8x6 with 3 gates, four.npy is 8x6 with 4 gates"),
        (&["compare", "a.npy", "b.npy", "--z", "z.png"], "--z needs two images of a single gate"),
        (&["compare", "a.npy", "text.npy"], "text.npy: this is not a NumPy array"),
        (&["histogram", "a.npy", "--pixel", "8,0"], "outside of the array"),
        (&["histogram", "a.npy", "--plot", "p.png"], "must end in .svg"),
        (&["histogram", "alone.npy", "--plot", "q.svg"], "keep the JSON file beside the array"),
        (&["histogram", "none.npy"], "none.npy: no such file"),
        (&["info", "box.glb", "--plot", "p.png"], "must end in .svg"),
    ];
    for (arguments, part) in table {
        fails(here.path(), arguments, 2, part);
    }
}

/// A gate that is dark in the reference has no relative error, but light in it is an error all the same.
#[test]
fn compare_finds_light_in_dark_gates() {
    let here = folder();
    let write = |name: &str, values: &[f32]| {
        std::fs::write(here.path().join(name), npy("<f4", "(1, 1, 4, 3)", values)).unwrap();
    };
    let light = |dark: f32, faint: f32| [[1.0; 3], [1.0; 3], [dark; 3], [faint; 3]].concat();
    write("reference.npy", &light(0.0, 0.0009));
    write("false.npy", &light(0.5, 0.0011));
    write("right.npy", &light(0.0, 0.0011));
    let run = |image: &str, more: &[&str]| {
        let output = taugate(here.path(), &[&["compare", image, "reference.npy"], more].concat());
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    let (code, text) = run("false.npy", &["--max-relmse", "10"]);
    assert!(code == Some(1) && text.contains("light in 1 of the gates that are dark in the reference"), "{text}");
    assert_eq!(run("false.npy", &[]).0, Some(0));
    let (code, json) = run("false.npy", &["--max-relmse", "10", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &json["lit_dark_gates"], &json["within"]), (Some(1), &1.into(), &false.into()));
    let (code, text) = run("right.npy", &["--max-relmse", "10"]);
    assert!(code == Some(0) && !text.contains("dark in the reference"), "{text}");
}

/// Error bars never belong to an older array of the same name.
#[test]
fn variances_of_an_older_array_are_removed() {
    let here = with_box();
    let gates = ["--gates", "5m..8m/3", "-o", "a.npy"];
    render(here.path(), &[&gates[..], &["--variance"]].concat());
    render(here.path(), &[&gates[..], &["--seed", "2", "-q"]].concat());
    assert_eq!(names(here.path()), ["a.json", "a.npy", "box.glb"]);
    let run = |arguments: &[&str]| assert!(taugate(here.path(), arguments).status.success(), "{arguments:?}");
    // An array of counts has no variances, whatever had its name before.
    std::fs::copy(here.path().join("a.npy"), here.path().join("counts.npy")).unwrap();
    std::fs::copy(here.path().join("a.json"), here.path().join("counts.json")).unwrap();
    std::fs::copy(here.path().join("a.npy"), here.path().join("counts.variance.npy")).unwrap();
    run(&["detect", "a.npy", "-o", "counts.npy", "--photons", "10"]);
    assert_eq!(names(here.path()), ["a.json", "a.npy", "box.glb", "counts.json", "counts.npy"]);
}

/// Readers notice that an array and its JSON file are of two renders.
#[test]
fn an_array_beside_the_description_of_another_is_refused() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    render(here.path(), &["--gates", "5m..8m/3", "-o", "a.npy", "--variance"]);
    render(here.path(), &["--gates", "5m..8m/3", "-o", "b.npy", "--variance", "--seed", "2"]);
    let histogram = ["histogram", "a.npy", "--pixel", "3,2"];
    assert!(taugate(here.path(), &histogram).status.success());
    std::fs::copy(at("b.variance.npy"), at("a.variance.npy")).unwrap();
    fails(here.path(), &histogram, 2, "a.variance.npy: does not belong to a.json");
    std::fs::copy(at("b.npy"), at("a.npy")).unwrap();
    for command in
        [&histogram[..], &["compare", "b.npy", "a.npy"], &["detect", "a.npy", "-o", "c.npy", "--photons", "1"]]
    {
        fails(here.path(), command, 2, "a.npy: does not belong to a.json");
    }
    std::fs::remove_file(at("a.json")).unwrap();
    let text = String::from_utf8(taugate(here.path(), &["histogram", "a.npy"]).stdout).unwrap();
    assert!(text.contains("gate 2"), "{text}");
}

#[test]
fn a_picture_shows_the_sum_or_each_gate() {
    let here = with_box();
    let gates = ["--gates", "5m..8m/3", "-o", "a.npy", "--png"];
    render(here.path(), &[&gates[..], &["--png-gates", "each"]].concat());
    let pictures: Vec<String> = names(here.path()).into_iter().filter(|name| name.ends_with(".png")).collect();
    assert_eq!(pictures.len(), 3, "{pictures:?}");
    let size = |name: &str| {
        let bytes = std::fs::read(here.path().join(name)).unwrap();
        let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        [word(16), word(20)]
    };
    let [width, height] = size(&pictures[0]);
    render(here.path(), &[&gates[..], &["--png-gates", "strip"]].concat());
    // Three pictures fit one row.
    assert_eq!(size("a.png"), [3 * width, height]);
    render(here.path(), &gates);
    assert_eq!(size("a.png"), [width, height]);
    let detect = ["detect", "a.npy", "-o", "counts.npy", "--photons", "1e3", "--png"];
    assert!(taugate(here.path(), &detect).status.success());
    assert_eq!(size("counts.png"), [width, height]);
    fails(here.path(), &[&detect[..], &["counts.exr"]].concat(), 2, "must end in .png");
    let no_picture = ["render", "box.glb", "-o", "b.npy", "--gates", "5m..8m/3", "--png-gates", "each"];
    fails(here.path(), &no_picture, 2, "--png-gates is for the picture: add --png");
}

/// Depths never belong to an older array of the same name.
#[test]
fn depths_of_an_older_array_are_removed() {
    let here = with_box();
    render(here.path(), &["--cw", "20", "-o", "a.npy"]);
    render(here.path(), &["--gate", "5m..8m", "-o", "a.npy"]);
    assert_eq!(names(here.path()), ["a.json", "a.npy", "box.glb"]);
    render(here.path(), &["--cw", "20", "-o", "b.npy"]);
    fails(here.path(), &["detect", "b.depth.npy", "-o", "b.npy", "--photons", "10"], 2, "would replace the light");
}

/// Light between two gates does not make an image that is black without a message.
#[test]
fn light_that_counts_for_no_gate_is_an_error() {
    let here = with_box();
    std::fs::write(here.path().join("gap.csv"), "tau_m,weight\n0,1\n0.1,0\n900,0\n900.1,1\n").unwrap();
    let before = names(here.path());
    let two = ["--max-depth", "3", "--response", "a=box:0m..0.1m", "--response", "b=box:40m..300m"];
    for flags in [&two[..], &["--response", "gap.csv"]] {
        let render = [&["render", "box.glb", "-q", "--resolution", "8x6", "--spp", "2", "-o", "a.npy"], flags].concat();
        fails(here.path(), &render, 2, "no light: ");
        assert_eq!(names(here.path()), before);
    }
}

/// Sums and images of one render have one gate, without its edges.
#[test]
fn sums_and_images_of_a_shaped_gate_have_one_gate() {
    let here = with_box();
    render(here.path(), &["--gate", "5m..8m", "--response", "gauss:0.1m", "-o", "a.exr", "-o", "a.acc"]);
    let output = taugate(here.path(), &["compare", "a.exr", "a.acc"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// An image of several gates is not taken for its first gate.
#[test]
fn all_gates_of_an_image_are_compared() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    let out = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        (output.status.code(), String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    // The first gates are equal, the others differ.
    let [first, second, third] = ["bin0=box:5m..6m", "bin1=box:6m..7m", "bin2=box:7m..8m"];
    let list = ["--response", first, "--response", second, "--response", third];
    render(here.path(), &[&list[..], &["-o", "a.exr", "-o", "a.npy", "--aov", "depth"]].concat());
    let list = ["--response", first, "--response", third, "--response", second];
    render(here.path(), &[&list[..], &["-o", "b.exr", "-o", "b.npy"]].concat());
    assert!(read_picture(&at("a.exr")).unwrap().rgb == read_picture(&at("b.exr")).unwrap().rgb);
    let (code, text, note) = out(&["compare", "b.exr", "a.exr", "--max-relmse", "1e-9"]);
    assert!(code == Some(1) && text.contains("  in bin2") && note.contains("different gates"), "{text} {note}");
    // An image and an array of the same render hold the same light.
    for (a, b) in [("a.exr", "a.npy"), ("b.npy", "b.exr"), ("a.exr", "a.exr")] {
        let (code, text, note) = out(&["compare", a, b, "--json"]);
        let same: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!((code, &same["relmse"], &same["compared"], note.as_str()), (Some(0), &0.0.into(), &3.into(), ""));
    }
    render(here.path(), &["--gate", "5m..6m", "-o", "one.exr"]);
    fails(here.path(), &["compare", "a.exr", "one.exr"], 2, "render both with the same gates");
    let message = fails(here.path(), &["compare", "a.exr", "b.exr", "--z", "z.png"], 2, "of a single gate");
    assert!(message.contains("render each gate alone"), "{message}");
}

#[test]
fn mistakes_name_the_remedy() {
    let here = with_box();
    std::fs::write(here.path().join("bad.csv"), "1,2\n2,3\n").unwrap();
    std::fs::write(here.path().join("down.csv"), "m,weight\n2,1\n1,1\n").unwrap();
    std::fs::write(here.path().join("negative.csv"), "m,weight\n1,1\n2,-1\n3,1\n").unwrap();
    let table: [(&[&str], &str); 21] = [
        (&["--gates", "5m..8m", "-o", "a.npy"], "does not say how many gates"),
        (&["--gates", "5m..8m/5000", "-o", "a.npy"], "give 1 to 4096"),
        (&["--gates", "8m..5m/5", "-o", "a.npy"], "reversed"),
        (&["--gates", "5m..8m/65", "-o", "a.exr"], "write -o OUT.npy"),
        (&["--gates", "5m..5.001m/4096", "-o", "a.npy"], "make the gate wider"),
        (&["--gates", "5m..8m/5", "--gate", "5m..6m", "-o", "a.npy"], "cannot be used with"),
        (&["--gates", "5m..8m/4096", "--resolution", "8192x8192", "-o", "a.npy"], "use fewer gates"),
        (&["--gates", "5m..8m/5", "-o", "a.npy", "-o", "b.npy"], "would hold the same image"),
        (&["--gates", "5m..8m/5", "-o", "a.npy", "--stats", "a.json"], "two outputs have the name a.json"),
        (&["--response", "gauss:1m", "-o", "a.npy"], "has no gate"),
        (&["--response", "sinc:1m", "-o", "a.npy"], "is not a response"),
        (&["--response", "bad.csv", "-o", "a.npy"], "names no unit"),
        (&["--response", "down.csv", "-o", "a.npy"], "ascending order"),
        (&["--response", "negative.csv", "-o", "a.npy"], "a number that is negative or not finite"),
        (&["--response", "gone.csv", "-o", "a.npy"], "gone.csv"),
        (&["--cw", "20,20", "-o", "a.npy"], "like 20 or 80,60"),
        (&["--cw", "20", "--gate", "1m..2m", "-o", "a.npy"], "cannot be used with"),
        (&["--repeat", "20m", "-o", "a.npy"], "add --gate A..B"),
        (&["--gate", "1m..2m", "--repeat", "-3m", "-o", "a.npy"], "like 100m or 400ns"),
        (&["--cw", "20", "--repeat", "20m", "-o", "a.npy"], "cannot be used with"),
        (&["--gates", "1km..2km/5", "-o", "a.npy"], "meet no light"),
    ];
    for (flags, part) in table {
        fails(here.path(), &[&["render", "box.glb"], flags].concat(), 2, part);
    }
    assert_eq!(names(here.path()), ["bad.csv", "box.glb", "down.csv", "negative.csv"]);
}
