//! Runs `taugate devices --check`, the command for a user whose graphics card nobody has tested. Needs a device.

use std::process::{Command, Output};

use taugate::internals::settings::{Estimator, Sampling};

fn taugate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_taugate")).args(arguments).output().expect("taugate starts")
}

/// `cargo test --release --test cli -- --ignored every_check_is_ok`. A unit test of `self_check` runs the checks of one estimator.
#[test]
#[ignore = "takes a minute"]
fn every_check_is_ok_on_this_device() {
    let output = taugate(&["devices", "--check"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(!text.contains("FAILED") && text.trim_end().lines().last().unwrap().starts_with("all "), "{text}");
    for estimator in Estimator::ALL {
        for sampling in Sampling::ALL {
            // The sphere has too many triangles for `epc`.
            let sphere = if estimator == Estimator::Epc { "the zoo" } else { "the sphere" };
            for what in ["a lamp seen directly", sphere, "the zoo lit by a lamp", "bits"] {
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
