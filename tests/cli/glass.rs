//! Warnings about glass: light that no strategy forms, and solids that face inwards. Needs a device.

use std::path::Path;

use glam::DVec3;
use serde_json::Value;
use taugate::internals::generate::glb;
use taugate::internals::generate::parts::{add, camera, diffuse, glass, material};
use taugate::internals::generate::shapes::{cuboid, inside_out, quad};
use taugate::internals::image::exr_file::read_picture;
use taugate::internals::scene::{LightKind, Mesh, Scene};

use crate::remembered::edit;
use crate::{fails, folder, taugate};

/// A wall 4 m before the camera and its lamp, behind a pane of glass. The left end of the pane is at `left`.
fn window(left: f64, turn: impl Fn(Mesh) -> Mesh) -> Scene {
    let mut scene = Scene::default();
    let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
    add(&mut scene, "wall", grey, quad(DVec3::new(-9.0, -9.0, -4.0), 18.0 * DVec3::X, 18.0 * DVec3::Y, [1.0; 2]));
    let clear = material(&mut scene, glass("clear"));
    let pane = cuboid(DVec3::new(left, -3.0, -1.01), DVec3::new(3.0, 3.0, -0.99));
    add(&mut scene, "window", clear, turn(pane));
    scene.add_light("headlamp", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, 0.1, [16, 16]);
    scene
}

/// Writes [`window`] as scene.glb, and an experiment without merging.
fn write_window(folder: &Path, left: f64, turn: impl Fn(Mesh) -> Mesh) {
    let scene = window(left, turn);
    std::fs::write(folder.join("scene.glb"), glb::write(&scene)).unwrap();
    std::fs::write(folder.join("off.toml"), "scene = \"scene.glb\"\n\n[render]\nmerge = \"off\"\n").unwrap();
}

fn info(folder: &Path, scene: &str, more: &[&str]) -> (String, String) {
    let output = taugate(folder, &[&["info", scene, "--json"], more].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    (json["warnings"].to_string(), json["notes"].to_string())
}

#[test]
fn light_behind_a_window_is_said_to_be_missing_without_merging() {
    let here = folder();
    write_window(here.path(), -3.0, |pane| pane);
    let render = ["render", "scene.glb", "-o", "out.exr", "--spp", "2", "--light-paths", "500", "--merge", "off"];
    let reason = "100 % of the pixels miss light of 'headlamp', because it passes smooth glass";
    let output = taugate(here.path(), &render);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && message.contains(reason) && message.contains("'window'"), "{message}");
    // A gate is refused with the reason.
    let gated = [&render[..], &["--gate", "7m..9m"]].concat();
    let message = taugate(here.path(), &gated);
    let (code, message) = (message.status.code(), String::from_utf8(message.stderr).unwrap());
    assert!(code == Some(2) && !message.contains("found no light"), "{message}");
    assert!(message.contains("meets no light") && message.matches(reason).count() == 2, "{message}");
    let (warnings, notes) = info(here.path(), "off.toml", &[]);
    assert!(warnings.contains(reason) && !notes.contains("no light"), "{warnings} {notes}");
    fails(here.path(), &["info", "off.toml", "--plot", "plot.svg"], 2, reason);
}

#[test]
fn merging_shows_what_is_behind_a_window_and_says_how_much_it_found() {
    let here = folder();
    write_window(here.path(), -3.0, |pane| pane);
    let (warnings, notes) = info(here.path(), "scene.glb", &[]);
    assert!(warnings == "[]" && !notes.contains("no light"), "{warnings} {notes}");
    let gate = ["--gate", "7m..9m", "--spp", "4", "--light-paths", "500", "--stats", "stats.json"];
    let output = taugate(here.path(), &[&["render", "scene.glb", "-o", "out.exr"][..], &gate].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && !message.contains("warning"), "{message}");
    let stats: Value = serde_json::from_slice(&std::fs::read(here.path().join("stats.json")).unwrap()).unwrap();
    // Light of the same wall without the pane, times the transmittance of both faces and both ways.
    let expected = 0.5 / std::f64::consts::PI / 16.0 * 0.96f64.powi(4);
    assert!((stats["image_mean"].as_f64().unwrap() / expected - 1.0).abs() < 0.05, "{stats}");
    let merged = read_picture(&here.path().join("out.exr")).unwrap().merged.unwrap();
    assert!(
        merged.share > 0.99 && merged.radius <= 1.5 && stats["merged"]["share"] == merged.share,
        "{merged:?} {stats}"
    );
}

#[test]
fn a_pixel_beside_the_window_is_told_from_one_behind_it() {
    let here = folder();
    write_window(here.path(), 0.0, |pane| pane);
    let (warnings, _) = info(here.path(), "off.toml", &[]);
    assert!(warnings.contains("50 % of the pixels miss light"), "{warnings}");
    let (warnings, _) = info(here.path(), "off.toml", &["--pixel", "1,8"]);
    assert_eq!(warnings, "[]");
    let (warnings, notes) = info(here.path(), "off.toml", &["--pixel", "14,8"]);
    assert!(warnings.contains("100 % of the pixels") && !notes.contains("no light"), "{warnings} {notes}");
}

#[test]
fn glass_that_faces_inwards_is_named() {
    let here = folder();
    write_window(here.path(), -3.0, inside_out);
    let (warnings, _) = info(here.path(), "scene.glb", &[]);
    assert!(warnings.contains("the triangles of the glass 'window' face inwards"), "{warnings}");
}

/// Sums know how much of the light was merged: shards that are merged say so as the whole render does, and so do renders that go on.
#[test]
fn sums_say_how_much_of_the_light_was_merged() {
    let here = folder();
    let here = here.path();
    write_window(here, -3.0, |pane| pane);
    let render = |flags: &[&str]| {
        let common = ["render", "scene.glb", "--gate", "7m..9m", "--light-paths", "500", "--sampling", "uniform"];
        let output = taugate(here, &[&common[..], flags].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    render(&["--spp", "12", "-o", "whole.exr"]);
    render(&["--spp", "12", "--shard", "0/2", "-o", "0.acc"]);
    render(&["--spp", "12", "--shard", "1/2", "-o", "1.acc"]);
    assert!(taugate(here, &["merge", "0.acc", "1.acc", "-o", "both.exr", "-o", "both.acc"]).status.success());
    render(&["--spp", "6", "--checkpoint", "sums.acc"]);
    render(&["--spp", "12", "--checkpoint", "sums.acc", "-o", "on.exr"]);
    let picture = |name: &str| read_picture(&here.join(name)).unwrap();
    let whole = picture("whole.exr");
    let bits = |rgb: Vec<f32>| rgb.into_iter().map(f32::to_bits).collect::<Vec<_>>();
    let merged = whole.merged.unwrap();
    assert!(merged.share > 0.99 && merged.radius < 1.2, "{merged:?}");
    let of_whole = bits(whole.rgb);
    for name in ["both.exr", "on.exr"] {
        let found = picture(name);
        let other = found.merged.unwrap();
        assert!(
            (other.share - merged.share).abs() < 1e-6 && other.radius == merged.radius,
            "{name}: {other:?} {merged:?}"
        );
        // The order of the sums may change the last bit.
        assert!(bits(found.rgb).iter().zip(&of_whole).all(|(a, b)| a.abs_diff(*b) <= 1), "{name}");
    }
    // Sums of an earlier version do not know.
    std::fs::copy(here.join("both.acc"), here.join("old.acc")).unwrap();
    edit(&here.join("old.acc"), |about| drop(about.as_object_mut().unwrap().remove("merged").unwrap()));
    assert!(taugate(here, &["develop", "old.acc", "-o", "old.exr"]).status.success());
    assert_eq!(picture("old.exr").merged, None);
}

/// Frames of a lamp and a camera that move before glass have the bits of frames that are rendered alone.
#[test]
fn frames_behind_glass_are_those_rendered_alone() {
    let here = folder();
    let here = here.path();
    let mut scene = window(-3.0, |pane| pane);
    (scene.cameras[0].name, scene.lights[0].node) = ("rig".into(), "rig".into());
    let positions = vec![[0.0; 3], [0.3, 0.0, 0.0]];
    let motion = glb::Motion { node: "rig", times: vec![0.0, 1.0], positions };
    std::fs::write(here.join("scene.glb"), glb::write_moving(&scene, Some(&motion))).unwrap();
    let render = |flags: &[&str]| {
        let common = ["render", "scene.glb", "--gate", "7m..9m", "--spp", "2", "--light-paths", "500"];
        let output = taugate(here, &[&common[..], flags].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    render(&["--frames", "0..2", "--fps", "2", "-o", "f#.exr"]);
    let picture = |name: &str| read_picture(&here.join(name)).unwrap();
    for (frame, at) in [("f0.exr", "0s"), ("f1.exr", "0.5s")] {
        render(&["--at", at, "-o", "alone.exr"]);
        let (frame, alone) = (picture(frame), picture("alone.exr"));
        assert!(frame.rgb == alone.rgb && frame.merged == alone.merged && alone.merged.unwrap().share > 0.9);
    }
    assert!(picture("f0.exr").rgb != picture("f1.exr").rgb);
}
