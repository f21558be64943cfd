//! Cameras with a calibration: flags, files of OpenCV, and what is refused.

use std::path::Path;

use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::image::exr_file::read_picture;

use crate::{fails, folder, taugate};

const CALIBRATION: &str = "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
                           dt: d\n   data: [ 60., 0., 31.5, 0., 61., 24., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   \
                           rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.2, 0.05, 1e-3, 0., 0. ]\n";
const LENS: [&str; 6] =
    ["--camera-matrix", "60,61,31.5,24", "--distortion", "-0.2,0.05,1e-3,0", "--resolution", "64x48"];

fn scene() -> tempfile::TempDir {
    let here = folder();
    std::fs::write(here.path().join("box.glb"), glb::write(&build(Kind::CornellBox))).unwrap();
    std::fs::write(here.path().join("camera.yml"), CALIBRATION).unwrap();
    here
}

/// Renders the box and returns the picture, and what was printed.
fn render(here: &Path, output: &str, arguments: &[&str]) -> (Vec<f32>, String) {
    let all = [&["render", "box.glb", "--spp", "2", "-o", output][..], arguments].concat();
    let run = taugate(here, &all);
    let text = String::from_utf8(run.stderr).unwrap();
    assert!(run.status.success(), "{arguments:?}: {text}");
    (read_picture(&here.join(output)).unwrap().rgb, text)
}

#[test]
fn a_calibration_file_is_the_same_as_its_flags() {
    let here = scene();
    let (flags, _) = render(here.path(), "flags.exr", &LENS);
    let (file, _) = render(here.path(), "file.exr", &["--calibration", "camera.yml"]);
    assert!(flags == file && flags.len() == 3 * 64 * 48);
    // An experiment that was printed has the numbers of the file, and needs it no more.
    let printed = taugate(here.path(), &["render", "box.glb", "--calibration", "camera.yml", "--print-config"]);
    let printed = String::from_utf8(printed.stdout).unwrap();
    assert!(
        printed.contains("camera-matrix = [60.0, 61.0, 31.5, 24.0]") && !printed.contains("camera.yml"),
        "{printed}"
    );
    std::fs::write(here.path().join("again.toml"), printed).unwrap();
    let again = taugate(here.path(), &["render", "again.toml", "--spp", "2", "-o", "again.exr"]);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    assert!(read_picture(&here.path().join("again.exr")).unwrap().rgb == flags);
    // The distortion changes the picture.
    let (straight, _) = render(here.path(), "straight.exr", &[LENS[0], LENS[1], LENS[4], LENS[5]]);
    assert!(straight != flags);
    // A smaller image of the same camera.
    let (half, text) = render(here.path(), "half.exr", &["--calibration", "camera.yml", "--resolution", "32x24"]);
    assert!(text.contains("scaled to --resolution 32x24"), "{text}");
    let mean = |rgb: &[f32]| rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / rgb.len() as f64;
    assert!((mean(&half) / mean(&flags) - 1.0).abs() < 0.2, "{} {}", mean(&half), mean(&flags));
}

#[test]
fn an_orthographic_view_replaces_the_lens_of_a_file() {
    let here = scene();
    let lens = "[camera]\naperture = '8mm'\nfocus = 3\nblades = 6\nvignetting = 'cos4'\ndistortion = [0.1, 0, 0, 0]\n";
    std::fs::write(here.path().join("lens.toml"), format!("scene = 'box.glb'\n{lens}")).unwrap();
    let printed = taugate(here.path(), &["render", "lens.toml", "--ortho", "2", "--print-config"]);
    let text = String::from_utf8(printed.stdout).unwrap();
    assert!(printed.status.success() && text.contains("ortho = 2"), "{text}");
    assert!(
        ["aperture", "focus", "blades", "vignetting", "distortion"].iter().all(|key| !text.contains(key)),
        "{text}"
    );
}

#[test]
fn info_says_what_the_lens_does() {
    let here = scene();
    let text = |more: &[&str]| {
        let output = taugate(here.path(), &[&["info", "box.glb"], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let calibrated =
        text(&["--calibration", "camera.yml", "--aperture", "8mm", "--focus", "3", "--vignetting", "cos4"]);
    let lens =
        "pixels 1.016667 times as wide as high, distortion, aperture of 8 mm in focus at 3 m, vignetting by cos4";
    assert!(calibrated.contains(lens), "{calibrated}");
    let pinhole = text(&[]);
    assert!(!pinhole.contains("distortion") && !pinhole.contains("vignetting"), "{pinhole}");
}

#[test]
fn a_lens_that_cannot_be_is_refused_with_the_remedy() {
    let here = scene();
    let render = |arguments: &[&str], part: &str| {
        let all = [&["render", "box.glb", "-o", "x.exr"][..], arguments].concat();
        fails(here.path(), &all, 2, part);
        assert!(!here.path().join("x.exr").exists());
    };
    render(&["--distortion", "-0.9,0,0,0", "--fov", "100"], "folds inside the image");
    render(&["--distortion", "1,2,3"], "write k1,k2,p1,p2");
    render(&["--camera-matrix", "60,-61,31.5,24", "--resolution", "64x48"], "positive focal lengths");
    render(&["--camera-matrix", "60,61,31.5,24", "--fov", "40"], "--fov");
    render(&["--distortion", "0,0,0,0", "--ortho", "2"], "--ortho");
    render(&["--calibration", "camera.yml", "--camera-matrix", "1,1,0,0"], "--camera-matrix");
    render(&["--calibration", "missing.yml"], "missing.yml");
    render(&["--aperture", "f/2.8", "--focus", "3"], "add the focal length");
    render(&["--aperture", "8mm"], "give --focus too");
    render(&["--focus", "3"], "give --aperture too");
    render(&["--aperture", "8m", "--focus", "3"], "focus farther away");
    render(&["--aperture", "8mm", "--focus", "3", "--blades", "2"], "use 3 to 64");
    let fisheye = ["--distortion", "fisheye:0,0,0,0", "--aperture", "8mm", "--focus", "3"];
    render(&fisheye, "leave the aperture out");
    render(&["--distortion", "fisheye:0,0,0,0", "--vignetting", "cos4"], "give its vignetting as a table");
    render(&["--vignetting", "cos2"], "write cos4");
    render(&["--vignetting", "missing.csv"], "missing.csv");
    render(&["--vignetting", "cos4", "--ortho", "2"], "--ortho");
    for (table, part) in [
        ("0,1\n3,0.9\n", "ends at 3.00 degrees, but its image reaches"),
        ("0,1\n30,0.9\n20,0.8\n", "sort the rows"),
        ("5,1\n60,0.9\n", "give the angle 0 first"),
        ("0,100\n60,40\n", "from 0 to 1"),
        ("0,1\n20\n", "v.csv:2: '20' is not a row"),
    ] {
        std::fs::write(here.path().join("v.csv"), table).unwrap();
        render(&["--vignetting", "v.csv"], part);
    }
    std::fs::write(here.path().join("wrong.yml"), "a: 1\n").unwrap();
    render(&["--calibration", "wrong.yml"], "does not have one camera matrix");
    std::fs::write(here.path().join("unsized.json"), r#"{"K": [60, 61, 31.5, 24], "D": [0, 0, 0, 0]}"#).unwrap();
    let mut sizeless = build(Kind::CornellBox);
    sizeless.cameras[0].resolution = None;
    std::fs::write(here.path().join("sizeless.glb"), glb::write(&sizeless)).unwrap();
    fails(
        here.path(),
        &["render", "sizeless.glb", "--calibration", "unsized.json", "-o", "x.exr"],
        2,
        "give the --resolution of the calibrated images",
    );
}
