//! Bugs that hostile use of the program has shown: one test per bug, named after the right behaviour.

#[path = "../common/glb.rs"]
mod glb;

use std::path::Path;
use std::process::Command;

use glb::complete;
use serde_json::json;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::scene::{Light, LightKind, gltf};

use crate::{fails, names, taugate};

fn cornell_box(folder: &Path) {
    assert!(taugate(folder, &["generate", "cornell-box", "-o", "box.glb"]).status.success());
}

#[test]
fn stats_do_not_overwrite_the_scene_or_the_image() {
    let folder = tempfile::tempdir().unwrap();
    cornell_box(folder.path());
    let scene = std::fs::read(folder.path().join("box.glb")).unwrap();
    for stats in ["box.glb", "./out.exr"] {
        let arguments =
            ["render", "box.glb", "-o", "out.exr", "--resolution", "4x4", "--spp", "1", "--light-paths", "9"];
        let output = taugate(folder.path(), &[&arguments[..], &["--stats", stats]].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains("--stats") && message.contains(".json"), "{message}");
        assert_eq!(std::fs::read(folder.path().join("box.glb")).unwrap(), scene);
    }
}

#[test]
fn a_gated_render_does_not_leave_out_a_directional_light_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    cornell_box(folder.path());
    let mut scene = gltf::load(&folder.path().join("box.glb")).unwrap();
    assert!(resolve(&Experiment::default(), &scene).unwrap().warnings.is_empty());
    scene.lights.push(Light {
        node: "sun".into(),
        position: glam::DVec3::ZERO,
        direction: glam::DVec3::NEG_Z,
        kind: LightKind::Directional { irradiance: [1.0; 3] },
    });
    assert!(resolve(&Experiment::default(), &scene).unwrap().warnings.is_empty());
    let warnings = resolve(&Experiment::parse("gate.gate = '6m..7m'").unwrap(), &scene).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].ends_with("leaves out sun"), "{warnings:?}");
}

#[test]
fn a_scene_whose_lights_have_no_power_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut glb = complete();
    glb.json["materials"][0]["emissiveFactor"] = json!([0.0, 0.0, 0.0]);
    glb.json["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(0.0);
    glb.json["nodes"][4]["extras"]["emitter"]["power"] = json!(0.0);
    std::fs::write(folder.path().join("dark.glb"), glb.build()).unwrap();
    let output = taugate(folder.path(), &["render", "dark.glb", "-o", "out.exr", "--emitters", "lamp"]);
    let message = String::from_utf8(output.stderr).unwrap();
    let expected = "error: dark.glb: nothing emits light (a light of power 0";
    assert!(output.status.code() == Some(2) && message.contains(expected), "{message}");
}

/// A mesh that bounds a medium must be closed. Rays that enter an open bottle through its neck would not find the milk inside, and
/// the image would be wrong.
#[test]
fn an_open_mesh_around_a_medium_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut glb = complete();
    glb.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] = json!(1.0);
    glb.json["materials"][0]["extras"] = json!({ "medium": { "sigma_s": 20.0 } });
    std::fs::write(folder.path().join("bottle.glb"), glb.build()).unwrap();
    let part = "mesh 'Tri[0]' bounds a medium but is not closed (3 of its edges belong to one triangle only); close it";
    fails(folder.path(), &["render", "bottle.glb", "-o", "out.exr"], 2, part);
    assert_eq!(names(folder.path()), ["bottle.glb"]);
    let text = String::from_utf8(taugate(folder.path(), &["info", "bottle.glb"]).stdout).unwrap();
    for part in ["Paint contains a medium: mean free path 0.0500000 m, 100.000 % scattered", "cannot be rendered: mesh"]
    {
        assert!(text.contains(part), "{text}");
    }
}

/// A program that opens a pipe waits until another program writes to it. Inputs that are pipes must be refused instead.
#[cfg(unix)]
#[test]
fn pipes_are_refused_rather_than_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    for kind in ["glb", "toml", "exr"] {
        let pipe = folder.path().join(format!("pipe.{kind}"));
        assert!(Command::new("mkfifo").arg(pipe).status().unwrap().success());
    }
    for arguments in [
        &["render", "pipe.glb", "-o", "out.exr"][..],
        &["info", "pipe.glb"],
        &["render", "pipe.toml"],
        &["bench", "pipe.toml"],
        &["compare", "pipe.exr", "pipe.exr"],
    ] {
        let output = taugate(folder.path(), arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains("file; "), "{arguments:?}: {message}");
    }
}

/// The encoder passes on the error of a full disk. The test gives it `/dev/full` directly, because the program accepts only plain
/// files as outputs.
#[cfg(target_os = "linux")]
#[test]
fn a_picture_on_a_full_disk_keeps_the_kind_of_the_error() {
    let noise: Vec<f32> = (0..3 * 256 * 256).map(|i| (i * 7919 % 1009) as f32).collect();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let error = taugate::internals::image::png_file::encode(full, 256, 256, &noise, 1e-3).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull, "{error}");
}
