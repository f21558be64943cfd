//! Runs the program on a glTF file with an orthographic camera.

use std::path::Path;

use serde_json::Value;
use taugate::internals::generate::glb;
use taugate::internals::image::exr_file::read_picture;

#[path = "../common/orthographic.rs"]
mod closed_form;

use crate::taugate;

/// Runs a command that must exit with `code`. Returns stdout and stderr together.
fn run(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = taugate(folder, arguments);
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    text
}

/// A folder with the floor of the closed form. Its camera has no resolution of its own.
fn folder() -> tempfile::TempDir {
    let here = tempfile::tempdir().unwrap();
    let mut scene = closed_form::floor();
    scene.cameras[0].resolution = None;
    std::fs::write(here.path().join("floor.glb"), glb::write(&scene)).unwrap();
    here
}

fn pixels(folder: &Path, file: &str) -> Vec<f32> {
    read_picture(&folder.join(file)).unwrap().rgb
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[test]
fn a_file_with_an_orthographic_camera_renders() {
    let here = folder();
    let render = ["render", "floor.glb", "--resolution", "24x16", "--sampling", "uniform", "--spp", "64", "--quiet"];
    for gate in [closed_form::GATES[0], closed_form::GATES[2]] {
        let name = &format!("{}m..{}m", gate.0, gate.1);
        run(here.path(), &[&render[..], &["--gate", name, "-o", "whole.exr"]].concat(), 0);
        let whole = pixels(here.path(), "whole.exr");
        let truth = mean(closed_form::gated_pixels(gate).into_iter());
        let got = mean(whole.iter().map(|&x| f64::from(x)));
        assert!((got / truth - 1.0).abs() < 0.03, "{name}: {got} and not {truth}");
        // The pixels of a crop have the same values.
        run(here.path(), &[&render[..], &["--gate", name, "--crop", "5,21,3,14", "-o", "part.exr"]].concat(), 0);
        let part = pixels(here.path(), "part.exr");
        let row = |y: usize| &whole[3 * (24 * y + 5)..3 * (24 * y + 21)];
        assert_eq!(part, (3..14).flat_map(row).copied().collect::<Vec<f32>>(), "{name}");
    }
    // The resolution follows from the magnifications of the file.
    let text = run(here.path(), &["render", "floor.glb", "--print-config"], 0);
    assert!(text.contains("resolution = \"512x341\""), "{text}");
    // Before the first light, at 2.80 m, a gate is refused.
    let text = run(here.path(), &[&render[..], &["--gate", "1m..1.2m", "-o", "dark.exr"]].concat(), 2);
    assert!(text.contains("none arrives before"), "{text}");
}

#[test]
fn info_measures_from_the_sensor_plane() {
    let here = folder();
    let text = run(here.path(), &["info", "floor.glb"], 0);
    assert!(text.contains("parallel at (-0.299, -1.791, 2.388), orthographic, 4.0000 m high"), "{text}");
    let arguments = ["info", "floor.glb", "--resolution", "24x16", "--json", "--pixel", "3,12"];
    let report: Value = serde_json::from_str(&run(here.path(), &arguments, 0)).unwrap();
    let camera = &report["cameras"][0];
    assert_eq!((&camera["metres_high"], &camera["degrees_high"]), (&Value::from(4.0), &Value::Null));
    // The centre of the pixel is 0.925 m left of the axis and 0.725 m below it.
    let forward = glam::DVec3::new(0.1, 0.6, -0.8).normalize();
    let right = forward.cross(glam::DVec3::Y).normalize();
    let start = -3.0 * forward - 0.925 * right - 0.725 * right.cross(forward);
    let distance = -start.z / forward.z;
    let object = &report["render"]["pixel"]["object"];
    let close = |found: &Value, expected: f64| {
        let found = found.as_f64().unwrap();
        assert!((found - expected).abs() < 1e-4, "{found} and not {expected}: {object}");
    };
    close(&object["distance_metres"], distance);
    close(&object["axial_metres"], distance);
    let point = start + distance * forward;
    (0..3).for_each(|axis| close(&object["position"][axis], point[axis]));
    // The light of the pixel arrives around the time of its centre.
    let tau = point.distance(glam::DVec3::new(-0.4, -1.2, 0.7)) + distance;
    let light = &report["render"]["light"];
    let [first, last] = ["first", "last"].map(|key| light[key]["metres"].as_f64().unwrap());
    assert!(first < tau && tau < last && last - first < 0.5, "{tau}: {light}");
    let bounds = &report["render"]["possible"];
    assert!(bounds["least"].as_f64().unwrap() < 2.81 && bounds["greatest"].as_f64().unwrap() > 11.9, "{bounds}");
}

#[test]
fn flags_make_a_view_orthographic() {
    let here = folder();
    let lit = |flags: &[&str]| {
        let fixed = ["render", "floor.glb", "--resolution", "16x16", "--spp", "4", "--quiet", "-o", "out.exr"];
        run(here.path(), &[&fixed[..], flags].concat(), 0);
        let image = pixels(here.path(), "out.exr");
        image.iter().filter(|&&x| x > 0.0).count() as f64 / image.len() as f64
    };
    // 16 m of floor in a view of 64 m, seen from above, are a sixteenth of the image.
    let above = ["--look-from", "0,0,9", "--look-at", "0,0,0", "--principal-point", "0.5,0.5", "--ortho"];
    assert_eq!(lit(&[&above[..], &["64"]].concat()), 1.0 / 16.0);
    assert_eq!(lit(&[&above[..], &["16"]].concat()), 1.0);
    assert!(lit(&["--camera", "auto", "--ortho", "20", "--headlamp"]) > 0.2);
    let both = ["render", "floor.glb", "-o", "out.exr", "--fov", "30", "--ortho", "2"];
    let text = run(here.path(), &both, 2);
    assert!(text.contains("cannot be used with"), "{text}");
    let text = run(here.path(), &["render", "floor.glb", "-o", "out.exr", "--ortho", "0"], 2);
    assert!(text.contains("--ortho") && text.contains("metres above 0"), "{text}");
}
