//! Runs the program as a user does. The tests of this file are about help, exit codes and messages; they need no device.

mod bench;
mod bench_rows;
mod beside;
mod corpus;
mod detect;
mod devices;
mod doppler;
mod fireflies;
mod frames;
mod gates;
mod glass;
mod grids;
#[cfg(unix)]
mod guide;
mod info;
mod lens;
mod lidar;
mod memory;
mod moving_lidar;
mod orthographic;
mod rays;
mod regressions;
mod remembered;
mod scan;
mod scenes;
mod shutter;
mod sums;
mod tev;
mod texels;
mod thin_glass;
mod view;
mod views;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::image::film::Film;
use taugate::internals::settings::Crop;
use taugate::internals::settings::units::Gate;

fn taugate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_taugate")).args(arguments).current_dir(folder).output().expect("taugate starts")
}

/// Runs a command that must fail with `code` and one message on stderr that contains `part`. Returns the message.
fn fails(folder: &Path, arguments: &[&str], code: i32, part: &str) -> String {
    let output = taugate(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?} prints a result");
    assert!(message.starts_with("error: ") && message.contains(part), "{arguments:?}: expected {part:?} in: {message}");
    assert!(!message.contains("panicked") && !message.contains("backtrace"), "{message}");
    message
}

/// Whether tests run all commands, files and variants, because the environment variable `TAUGATE_LONG_TESTS` is set.
fn is_long() -> bool {
    std::env::var_os("TAUGATE_LONG_TESTS").is_some()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Writes an image of one grey value, accumulated in two iterations.
fn write_exr(path: &Path, width: u32, height: u32, value: f32) {
    let mut film = Film::new(width, height);
    let image = vec![value; 3 * (width * height) as usize];
    film.add(&image, 1);
    film.add(&image, 1);
    let crop = Crop { x0: 0, x1: width, y0: 0, y1: height };
    let settings = String::new();
    let provenance = Provenance {
        resolution: [width, height],
        crop,
        responses: Gate::OPEN.into(),
        seed: 0,
        seconds: 1.0,
        settings,
        merged: None,
    };
    exr_file::write(path, &film, &provenance).unwrap();
}

#[test]
fn help_is_what_was_reviewed() {
    let here = folder();
    let mut help = String::new();
    for command in [
        "",
        "render",
        "view",
        "merge",
        "develop",
        "compare",
        "histogram",
        "detect",
        "lidar",
        "bench",
        "info",
        "devices",
        "generate",
    ] {
        let arguments: Vec<&str> = [command, "--help"].into_iter().filter(|a| !a.is_empty()).collect();
        let output = taugate(here.path(), &arguments);
        assert!(output.status.success());
        help += &format!("$ taugate {}\n{}\n", arguments.join(" "), String::from_utf8(output.stdout).unwrap());
    }
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs/help.txt");
    if std::env::var_os("TAUGATE_ACCEPT").is_some() {
        std::fs::write(&path, &help).unwrap();
    }
    let reviewed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        help == reviewed,
        "the help text differs from docs/help.txt; read it, and accept it with\n    TAUGATE_ACCEPT=1 cargo test --test cli\n\n{help}"
    );
}

#[test]
fn flags_of_other_renderers_say_what_to_do_instead() {
    let here = folder();
    for (flag, part) in [
        ("--shutter-speed", "with --shutter, like 0..20ms"),
        ("--f-number", "with --aperture"),
        ("--focus-distance", "with --focus"),
        ("--k1", "with --distortion"),
    ] {
        let message = fails(here.path(), &["render", "a.glb", flag, "2"], 2, part);
        assert!(message.contains(flag), "{message}");
    }
}

#[test]
fn version_and_usage() {
    let here = folder();
    assert!(taugate(here.path(), &["--version"]).status.success());
    for arguments in [&[] as &[&str], &["paint"], &["render"], &["render", "a.glb", "--colour"]] {
        assert_eq!(taugate(here.path(), arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn bad_flags_are_refused_with_an_example() {
    let here = folder();
    let table = [
        ("--gate", "12.5..12.8", "no unit"),
        ("--gate", "12.8m..12.5m", "reversed"),
        ("--gate", "12.5m..12.5m", "empty"),
        ("--gate", "12.5m", "not an interval"),
        ("--gate", "nanm..3m", "not a number"),
        ("--gate", "-3m..-1m", "at or before 0"),
        ("--gate", "inf..12m", "finite"),
        ("--gate", "1parsec..2parsec", "not a unit"),
        ("--depth", "1ns..2ns", "not a unit"),
        ("--depth", "2..3", "no unit"),
        ("--time", "30", "30s"),
        ("--estimator", "magic", "lcs-paper"),
        ("--strategies", "some", "all or paper"),
        ("--resolution", "512", "640x480"),
        ("--crop", "1,2,3", "x0,x1,y0,y1"),
        ("--emitters", "beam,,lamp", "node names"),
        ("--spp", "-1", "--spp"),
        ("--look-from", "1,2", "3 numbers"),
        ("--look-at", "-1,2,x", "like 1,2.5,-3"),
        ("--up", "up", "3 numbers"),
        ("--fov", "180", "between 0 and 180"),
        ("--principal-point", "1", "2 numbers"),
        ("--headlamp", "0", "a number above 0"),
        ("--headlamp-offset", "1", "3 numbers"),
        ("--lamp", "1,2,3", "4 numbers"),
        ("--lamp", "1,2,3,-1", "an intensity above 0"),
    ];
    for (flag, value, part) in table {
        let argument = format!("{flag}={value}");
        let message = fails(here.path(), &["render", "a.glb", "-o", "a.exr", &argument], 2, part);
        assert!(message.contains(flag), "{message}");
    }
    fails(here.path(), &["render", "a.glb", "--gate", "1m..2m", "--depth", "1m..2m"], 2, "cannot be used with");
    fails(here.path(), &["render", "a.glb", "--spp", "1", "--time", "2s"], 2, "cannot be used with");
}

#[test]
fn bad_inputs_are_named() {
    let here = folder();
    fails(here.path(), &["render", "no.glb", "-o", "a.exr"], 2, "no.glb: ");
    fails(here.path(), &["info", "no.glb"], 2, "no.glb: ");
    fails(here.path(), &["render", "no.toml", "-o", "a.exr"], 2, "no.toml: no such file; check the name");
    fails(here.path(), &["bench", "no.toml"], 2, "no.toml: no such file; check the name");
    fails(here.path(), &["render", "picture.jpg", "-o", "a.exr"], 2, "neither a scene");
    assert!(names(here.path()).is_empty(), "a failed render leaves nothing");
}

#[test]
fn experiment_mistakes_have_line_and_column() {
    let here = folder();
    let experiment = |text: &str| std::fs::write(here.path().join("e.toml"), text).unwrap();
    let fails = |part: &str| fails(here.path(), &["render", "e.toml"], 2, part);
    experiment("scene = \"a.glb\"\n[render]\nssp = 4\n");
    fails("e.toml:3:1: [render] has no key ssp");
    experiment("scene = \"a.glb\"\n[gate]\ngate = \"1..2\"\n");
    fails("e.toml:3:8: the gate '1..2' has no unit");
    experiment("scene = \"a.glb\"\n[medium]\nsigma-s = -1\n");
    fails("e.toml:3:11: '-1' is not a coefficient per metre");
    experiment("[output]\noutput = \"a.exr\"\n");
    fails("names no scene");
    experiment("scene = \"\"\n[output]\noutput = \"a.exr\"\n");
    fails("e.toml: names no scene");
    experiment("scene = \"a.glb\"\n");
    fails("-o OUT.exr");
    experiment("scene = \"a.glb\"\n[output]\noutput = \"\"\n");
    fails("-o OUT.exr");
    std::fs::write(here.path().join("e.toml"), [0xff, 0xfe, 0]).unwrap();
    fails("not text in UTF-8");
}

#[test]
fn outputs_are_checked_before_anything_is_loaded() {
    let here = folder();
    std::fs::create_dir(here.path().join("dir.exr")).unwrap();
    for (output, part) in [
        ("no/such/folder/a.exr", "does not exist"),
        ("dir.exr", "not a plain file"),
        ("a.jpg", "must end in .exr"),
        #[cfg(target_os = "linux")]
        ("/proc/a.exr", "cannot be written"),
        #[cfg(target_os = "linux")]
        ("/dev/full", "must end in .exr"),
    ] {
        fails(here.path(), &["render", "a.glb", "-o", output], 2, part);
    }
    fails(here.path(), &["render", "a.glb", "-o", "a.exr", "--png", "p.jpg"], 2, "must end in .png");
    fails(here.path(), &["render", "a.glb", "-o", "a.exr", "--stats", "no/s.json"], 2, "does not exist");
    assert_eq!(names(here.path()), ["dir.exr"]);
}

#[test]
fn compare_measures_and_judges() {
    let here = folder();
    write_exr(&here.path().join("a.exr"), 5, 4, 1.1);
    write_exr(&here.path().join("r.exr"), 5, 4, 1.0);

    // Each pixel contributes (1.1 - 1)^2 / (1^2 + 1e-4).
    let output = taugate(here.path(), &["compare", "a.exr", "r.exr", "--json"]);
    assert!(output.status.success());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((json["relmse"].as_f64().unwrap() - 0.01 / 1.0001).abs() < 1e-7, "{json}");
    assert!((json["eps"].as_f64().unwrap() - 1e-4).abs() < 1e-12, "{json}");
    assert!((0.0..0.1).contains(&json["flip"].as_f64().unwrap()), "{json}");
    assert!((json["ratio_of_means"].as_f64().unwrap() - 1.1).abs() < 1e-6, "{json}");
    assert!(json["formula"].as_str().unwrap().contains("eps"), "{json}");

    let text = String::from_utf8(taugate(here.path(), &["compare", "a.exr", "r.exr"]).stdout).unwrap();
    assert!(
        text.contains("relMSE")
            && text.contains("FLIP")
            && text.contains("eps = 1.0")
            && text.contains("ratio of means"),
        "{text}"
    );
    let code = |max: &str| taugate(here.path(), &["compare", "a.exr", "r.exr", "--max-relmse", max]).status.code();
    assert_eq!((code("0.02"), code("0.005"), code("-1"), code("nan")), (Some(0), Some(1), Some(2), Some(2)));
}

#[test]
fn compare_refuses_what_it_cannot_judge() {
    let here = folder();
    write_exr(&here.path().join("a.exr"), 5, 4, 1.0);
    write_exr(&here.path().join("small.exr"), 4, 4, 1.0);
    write_exr(&here.path().join("black.exr"), 5, 4, 0.0);
    write_exr(&here.path().join("nan.exr"), 5, 4, f32::NAN);
    std::fs::write(here.path().join("text.exr"), "no image").unwrap();
    let whole = std::fs::read(here.path().join("a.exr")).unwrap();
    std::fs::write(here.path().join("half.exr"), &whole[..whole.len() / 2]).unwrap();
    let compare = |a: &str, b: &str, part: &str| fails(here.path(), &["compare", a, b], 2, part);
    compare("a.exr", "no.exr", "no.exr: no such file");
    compare("a.exr", "small.exr", "differ in size: a.exr is 5x4, small.exr is 4x4");
    compare("a.exr", "black.exr", "black");
    compare("nan.exr", "a.exr", "nan.exr: pixel 0,0 is NaN in R");
    compare("text.exr", "a.exr", "text.exr: ");
    compare("half.exr", "a.exr", "half.exr: ");
}

/// `compare` notes on stderr when the files state different gates or crops. It is no error: a user may compare two gates on
/// purpose.
#[test]
fn images_of_different_gates_are_noted() {
    let here = folder();
    let write = |name: &str, gate: Gate, x0: u32| {
        let mut film = Film::new(4, 4);
        film.add(&[1.0; 48], 1);
        let (crop, settings) = (Crop { x0, x1: x0 + 4, y0: 0, y1: 4 }, String::new());
        let provenance = Provenance {
            resolution: [8, 4],
            crop,
            responses: gate.into(),
            seed: 0,
            seconds: 1.0,
            settings,
            merged: None,
        };
        exr_file::write(&here.path().join(name), &film, &provenance).unwrap();
    };
    write("a.exr", Gate { lo: 1.0, hi: 2.0 }, 0);
    write("b.exr", Gate { lo: 1.5, hi: 2.0 }, 0);
    write("c.exr", Gate { lo: 1.0, hi: 2.0 }, 4);
    let notes = |other: &str| {
        let output = taugate(here.path(), &["compare", "a.exr", other]);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(notes("a.exr"), "");
    assert!(notes("b.exr").contains("different gates: 1 m to 2 m, and 1.5 m to 2 m"));
    assert!(notes("c.exr").contains("different crops: one begins at column"));
}

/// The program fails if it cannot write to stdout, because a result is lost. An error of stderr does not change the exit code.
#[test]
#[cfg(target_os = "linux")]
fn a_full_stdout_is_an_error_and_a_full_stderr_is_not() {
    let here = folder();
    write_exr(&here.path().join("a.exr"), 4, 4, 1.0);
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let command = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
        command.args(arguments).current_dir(here.path());
        command
    };
    let lost = command(&["compare", "a.exr", "a.exr"]).stdout(full()).output().unwrap();
    assert_eq!(lost.status.code(), Some(2), "{lost:?}");
    assert!(String::from_utf8_lossy(&lost.stderr).contains("stdout"), "{lost:?}");
    let unheard = command(&["render", "nothing.glb", "-o", "x.exr"]).stderr(full()).status().unwrap();
    assert_eq!(unheard.code(), Some(2));
}

/// Text that comes from files must not command the terminal, wherever the program prints it.
#[test]
fn files_cannot_command_the_terminal() {
    let here = folder();
    let hostile = "x\u{1b}[2J\u{9b}31m\u{202e}y";
    let harmless = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        let text = String::from_utf8(output.stdout).unwrap() + &String::from_utf8(output.stderr).unwrap();
        let bad: Vec<char> = text.chars().filter(|&c| (c.is_control() && c != '\n') || c == '\u{202e}').collect();
        assert!(bad.is_empty(), "{arguments:?} prints {bad:?}: {}", text.escape_debug());
        assert!(text.contains("31m"), "{arguments:?} does not print the text: {text}");
    };
    // Names of all kinds in a scene, and names that messages quote.
    let mut scene = build(Kind::CornellBox);
    for instance in &mut scene.instances {
        instance.node = format!("{}{hostile}", instance.node);
    }
    scene.meshes.iter_mut().for_each(|mesh| mesh.name += hostile);
    scene.materials.iter_mut().for_each(|material| material.name += hostile);
    scene.cameras[0].name += hostile;
    std::fs::write(here.path().join("scene.glb"), glb::write(&scene)).unwrap();
    harmless(&["info", "scene.glb", "--resolution", "8x8"]);
    harmless(&["info", "scene.glb", "--resolution", "8x8", "--json"]);
    harmless(&["render", "scene.glb", "-o", "a.exr", "--camera", "nobody"]);
    harmless(&["render", "scene.glb", "-o", "a.exr", "--emitters", "nobody"]);
    harmless(&["render", "scene.glb", "--print-config"]);
    let wrong =
        format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extensionsRequired\": [\"{}\"]}}", "x\\u009b31m\\u202e");
    std::fs::write(here.path().join("wrong.gltf"), wrong).unwrap();
    harmless(&["info", "wrong.gltf"]);

    // Experiments and suites. TOML may hold these characters as codes.
    let escaped = "x\\u001b[2J\\u009b31m\\u202ey";
    for line in
        ["[render]\nestimator = \"NAME\"", "[camera]\ncamera = \"NAME\"", "\"NAME\" = 1", "[gate]\ngate = \"NAME\""]
    {
        let text = format!("scene = \"scene.glb\"\n{}\n", line.replace("NAME", escaped));
        std::fs::write(here.path().join("e.toml"), text).unwrap();
        harmless(&["render", "e.toml", "-o", "a.exr"]);
    }
    let suite = format!("time = \"1s\"\n[[variant]]\nname = \"pt\"\nrender = {{ estimator = \"{escaped}\" }}\n");
    std::fs::write(here.path().join("suite.toml"), suite).unwrap();
    harmless(&["bench", "suite.toml"]);

    // Channels of an image.
    use exr::prelude::*;
    let name = Text::from_bytes_unchecked(hostile.bytes().collect());
    let channel = AnyChannel::new(name, FlatSamples::F32(vec![0.0; 16]));
    let image = Image::from_channels((4, 4), AnyChannels::sort(std::iter::once(channel).collect()));
    image.write().to_file(here.path().join("odd.exr")).unwrap();
    harmless(&["compare", "odd.exr", "odd.exr"]);
}

/// Images store their settings, and with them the scene's name, as UTF-8 text.
#[test]
#[cfg(target_os = "linux")]
fn a_name_that_is_no_text_is_refused_before_the_work() {
    use std::os::unix::ffi::OsStrExt;
    let here = folder();
    let name = std::ffi::OsStr::from_bytes(b"sc\xe9ne.glb");
    std::fs::write(here.path().join(name), "not read").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_taugate"))
        .args([std::ffi::OsStr::new("render"), name])
        .args(["-o", "x.exr"])
        .current_dir(here.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("not UTF-8; rename it"), "{output:?}");
}
