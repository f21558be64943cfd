//! The files of a render on the command line, and files of the same names that were there before.

use std::path::Path;

use crate::grids::npy;
use crate::{fails, folder, names, taugate};

const SMALL: [&str; 8] = ["--resolution", "12x8", "--spp", "2", "--sampling", "uniform", "--light-paths", "500"];
const SWEEP: [&str; 6] = ["--gate-keys", "0=5m..6m", "--gate-keys", "2=6m..7m", "--frames", "0..2"];

fn with_box() -> tempfile::TempDir {
    let here = folder();
    assert!(taugate(here.path(), &["generate", "cornell-box", "-o", "scene.glb"]).status.success());
    here
}

/// Renders in the folder `here` and returns what the program prints.
fn render(here: &Path, scene: &str, flags: &[&str]) -> String {
    let output = taugate(here, &[&["render", scene], &SMALL[..], flags].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{flags:?}: {message}");
    message
}

#[test]
fn a_description_or_an_array_alone_is_no_finished_frame() {
    let here = with_box();
    let flags = [&SWEEP[..], &["-o", "f#.npy"]].concat();
    render(here.path(), "scene.glb", &flags);
    let written = |name: &str| std::fs::metadata(here.path().join(name)).unwrap().modified().unwrap();
    for frame in ["f0", "f1"] {
        assert!(written(&format!("{frame}.npy")) <= written(&format!("{frame}.json")), "{frame}");
    }
    std::fs::remove_file(here.path().join("f1.npy")).unwrap();
    assert!(render(here.path(), "scene.glb", &flags).contains("1 of 2 frames exist with the same settings"));
    // An array without its JSON file may belong to somebody else.
    std::fs::remove_file(here.path().join("f0.json")).unwrap();
    let again = [&["render", "scene.glb"], &SMALL[..], &flags].concat();
    fails(here.path(), &again, 2, "f0.npy exists, but has no JSON file beside it; remove it");
    // A process that was killed before it gave the JSON file its name does not block the sequence.
    std::fs::write(here.path().join(".taugate-f0.json-1-a.tmp"), "").unwrap();
    assert!(render(here.path(), "scene.glb", &flags).contains("1 of 2 frames exist with the same settings"));
    assert!(here.path().join("f0.json").exists() && !here.path().join(".taugate-f0.json-1-a.tmp").exists());
}

/// Images record the paths of their inputs as the user typed them. The contents of the inputs decide.
#[test]
fn frames_are_continued_from_another_folder() {
    let here = with_box();
    let sub = here.path().join("sub");
    std::fs::create_dir(&sub).unwrap();
    let grid = |density: f32| {
        std::fs::write(here.path().join("fog.npy"), npy("<f4", "(1, 1, 2)", &[0.5, density])).unwrap();
    };
    grid(0.25);
    let fog = ["--sigma-s", "0.1", "--medium-bounds=-0.5,0.5,-0.5,0.5,1.5,0.5", "--density-grid"];
    render(here.path(), "scene.glb", &[&SWEEP[..], &fog, &["fog.npy", "-o", "f#.exr", "-o", "f#.npy"]].concat());
    let elsewhere = [&SWEEP[..], &fog, &["../fog.npy", "-o", "../f#.exr", "-o", "../f#.npy"]].concat();
    let message = render(&sub, "../scene.glb", &elsewhere);
    assert!(message.contains("2 of 2 frames exist with the same settings"), "{message}");
    grid(0.75);
    let again = [&["render", "../scene.glb"], &SMALL[..], &elsewhere].concat();
    fails(&sub, &again, 2, "its scene or another input has changed");
    let settings = [&["render", "../scene.glb", "--seed", "2"], &SMALL[..], &elsewhere].concat();
    fails(&sub, &settings, 2, "has other settings (render.seed is 2 in this command and is 0 in the file)");
}

/// Only the files beside an array that taugate described are those of an earlier array.
#[test]
fn arrays_of_the_user_survive() {
    let here = with_box();
    let at = |name: &str| here.path().join(name);
    for name in ["room.depth.npy", "room.variance.npy", "counts.depth.npy"] {
        std::fs::write(at(name), "mine").unwrap();
    }
    let flags = ["--gate", "5m..6m", "-o", "room.npy"];
    render(here.path(), "scene.glb", &flags);
    let detect = ["detect", "room.npy", "-o", "counts.npy", "--photons", "1e3"];
    assert!(taugate(here.path(), &detect).status.success());
    for name in ["room.depth.npy", "room.variance.npy", "counts.depth.npy"] {
        assert!(std::fs::read(at(name)).is_ok_and(|bytes| bytes == b"mine"), "{name}");
    }
    // The earlier array had a gate and thus no depths.
    render(here.path(), "scene.glb", &flags);
    assert!(std::fs::read(at("room.depth.npy")).is_ok_and(|bytes| bytes == b"mine"));
}

#[test]
fn a_contact_sheet_does_not_replace_a_frame() {
    let here = with_box();
    let flags = [&SWEEP[..], &["-o", "f#.exr", "--png", "--contact-sheet"]].concat();
    for sheet in ["f1.png", "./f1.png"] {
        let command = [&["render", "scene.glb"], &SMALL[..], &flags, &[sheet]].concat();
        fails(here.path(), &command, 2, "is a file of frame 1; choose another name");
    }
    assert_eq!(names(here.path()), ["scene.glb"]);
    render(here.path(), "scene.glb", &[&flags[..], &["f2.png"]].concat());
}
