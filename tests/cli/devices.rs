//! Tests `taugate devices --check`, the command for a user whose graphics card nobody has tested. Also tests commands whose device is
//! lost. Needs a device.

use std::path::Path;
use std::process::{Command, Output};

use taugate::internals::image::exr_file::read_picture;
use taugate::internals::settings::{Estimator, Sampling};

fn taugate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_taugate")).args(arguments).output().expect("taugate starts")
}

/// `cargo test --release --test cli -- --ignored every_check_is_ok`. A unit test of `self_check` runs some checks of `lcs`.
#[test]
#[ignore = "takes a minute"]
fn every_check_is_ok_on_this_device() {
    let output = taugate(&["devices", "--check"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8_lossy(&output.stderr));
    for what in ["lcs, adaptive, the sphere in a thin gate", "bdpt, uniform, the sphere in three gates at once"] {
        assert!(text.contains(&format!("ok     {what}")), "no check '{what}' in:\n{text}");
    }
    assert!(!text.contains("FAILED") && text.trim_end().lines().last().unwrap().starts_with("all "), "{text}");
    for estimator in Estimator::ALL {
        for sampling in Sampling::ALL {
            // The sphere has too many triangles for `epc`.
            let sphere = if estimator == Estimator::Epc { "the zoo" } else { "the sphere" };
            for what in ["a lamp seen directly", sphere, "the zoo lit by a lamp", "a lamp in fog", "bits"] {
                let name = format!("ok     {estimator}, {sampling}, {what}");
                assert!(text.lines().any(|line| line.starts_with(&name)), "no line '{name}' in:\n{text}");
            }
        }
    }
}

#[test]
fn a_check_needs_a_device_that_exists() {
    let output = taugate(&["devices", "--check", "--device", "no such card"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(4), "{message}");
    assert!(message.contains("no such card"), "{message}");
    assert_eq!(taugate(&["devices", "--device", "0"]).status.code(), Some(2), "--device is for --check");
}

/// Runs a command in `folder` whose device counts as lost after `submits` submits. Returns the message.
fn lost_after(submits: &str, folder: &Path, arguments: &[&str]) -> String {
    lost_with("", submits, folder, arguments)
}

/// As [`lost_after`], with this number of iterations in flight; empty for that of the device.
fn lost_with(in_flight: &str, submits: &str, folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.env("TAUGATE_LOST_AFTER", submits).env("TAUGATE_IN_FLIGHT", in_flight);
    let output = command.args(arguments).current_dir(folder).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(4), "{message}");
    assert!(message.contains("error: device: the device was lost while waiting for the device"), "{message}");
    message
}

#[test]
fn a_lost_device_does_not_take_the_image_with_it() {
    let folder = crate::folder();
    let here = folder.path();
    assert!(crate::taugate(here, &["generate", "cornell-box", "-o", "box.glb"]).status.success());
    let render = ["render", "box.glb", "--resolution", "8x8", "--light-paths", "100", "--max-depth", "4", "-q", "-o"];
    let (one, many) = (["--gate", "5m..6m"], ["--gates", "4m..8m/4"]);
    for (gates, in_flight) in [(one, "1"), (one, "2"), (many, "1"), (many, "2")] {
        let lost = [&render[..], &["lost.exr", "--spp", "10000"], &gates].concat();
        let message = lost_with(in_flight, "150", here, &lost);
        let samples = message.split("the files hold the ").nth(1).unwrap_or_else(|| panic!("{message}"));
        let samples = samples.split(' ').next().unwrap();
        assert!(
            crate::taugate(here, &[&render[..], &["whole.exr", "--spp", samples], &gates].concat()).status.success()
        );
        let [lost, whole] = ["lost.exr", "whole.exr"].map(|name| read_picture(&here.join(name)).unwrap());
        assert!(
            lost.rgb == whole.rgb && lost.variance == whole.variance,
            "{gates:?}, {in_flight} in flight: {samples} samples"
        );
    }
    // Without an iteration there is no image.
    let message = lost_after("1", here, &[&render[..], &["none.exr"]].concat());
    assert!(!message.contains("the files hold") && !here.join("none.exr").exists(), "{message}");
}

#[test]
fn a_lost_device_keeps_the_measured_points_of_a_scan() {
    let folder = crate::folder();
    let here = folder.path();
    assert!(crate::taugate(here, &["generate", "hidden-letter", "-o", "letter.glb"]).status.success());
    let scan = "scene = 'letter.glb'\n[scan]\nlaser = [2, 0, 1.5]\npoints = { corner = [-0.4, 0.4, 0], across = [0.8, 0, 0], \
                down = [0, -0.8, 0], count = [20, 20] }\n[gate]\ngates = '1.9m..2.9m/5'\n[render]\nspp = 4\n";
    std::fs::write(here.join("scan.toml"), scan).unwrap();
    let message = lost_after("300", here, &["render", "scan.toml", "-o", "out.npy"]);
    let about = std::fs::read_to_string(here.join("out.json")).unwrap();
    let measured =
        serde_json::from_str::<serde_json::Value>(&about).unwrap()["measured_laser_points"].as_u64().unwrap();
    assert!((1..400).contains(&measured), "{measured}");
    assert!(
        message.contains(&format!("the files hold the {measured} points of the laser before the error")),
        "{message}"
    );
}

/// The plot needs travel times, which need the device. So `info` fails with the device's error and writes no plot.
#[test]
fn a_lost_device_is_the_reason_why_info_has_no_plot() {
    let folder = crate::folder();
    let here = folder.path();
    assert!(crate::taugate(here, &["generate", "cornell-box", "-o", "box.glb"]).status.success());
    lost_after("1", here, &["info", "box.glb", "--resolution", "8x6", "--plot", "p.svg"]);
    assert!(!here.join("p.svg").exists());
}
