//! `--shutter` and `--rolling` as a user gives them.

use std::path::Path;

use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::image::exr_file::read_picture;

use crate::{fails, taugate};

const SMALL: [&str; 6] = ["--resolution", "24x12", "--estimator", "bdpt", "--max-depth", "3"];
const SPP: [&str; 2] = ["--spp", "32"];
const OPEN: [&str; 4] = ["--at", "1s", "--shutter", "0..300ms"];

/// A folder with the street, in which a car drives.
fn folder() -> tempfile::TempDir {
    let here = tempfile::tempdir().unwrap();
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/street.glb");
    std::fs::copy(street, here.path().join("street.glb")).unwrap();
    here
}

fn render(here: &Path, flags: &[&str]) -> String {
    let spp = if flags.contains(&"--spp") { &[] } else { &SPP[..] };
    let output = taugate(here, &[&["render", "street.glb"], &SMALL[..], spp, flags].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{flags:?}: {message}");
    message
}

fn pixels(here: &Path, name: &str) -> Vec<f32> {
    read_picture(&here.join(name)).unwrap().rgb
}

/// Nobody knows before a render how many moments fit in a time.
#[test]
fn too_short_a_time_is_named_after_the_render() {
    let folder = folder();
    let flags =
        [&["render", "street.glb"], &SMALL[..], &OPEN, &["--time", "0.001ms", "-o", "s.exr", "--stats", "s.json"]]
            .concat();
    let message = String::from_utf8(taugate(folder.path(), &flags).stderr).unwrap();
    let warning = "with 2 samples per pixel, the exposure shows 1 moment, which may look like separate images";
    assert!(message.contains(&format!("warning: {warning}; use at least --spp 32")), "{message}");
    assert!(std::fs::read_to_string(folder.path().join("s.json")).unwrap().contains(warning));
}

/// An exposure that is continued, divided among shards or rendered with two iterations in flight keeps its bits.
#[test]
fn an_exposure_goes_on_and_is_divided_like_other_renders() {
    let folder = folder();
    let here = folder.path();
    render(here, &[&OPEN[..], &["-o", "whole.exr"]].concat());
    let (whole, still) = (pixels(here, "whole.exr"), {
        render(here, &["--at", "1.15s", "-o", "still.exr"]);
        pixels(here, "still.exr")
    });
    assert!(whole != still);
    for rolling in [&[][..], &["--rolling", "30ms"]] {
        let open = [&OPEN[..], rolling].concat();
        render(here, &[&open[..], &["-o", "all.exr"]].concat());
        let all = pixels(here, "all.exr");
        assert_eq!(all == whole, rolling.is_empty());
        render(here, &[&open[..], &["--spp", "8", "--checkpoint", "part.acc"]].concat());
        render(here, &[&open[..], &["--resume", "part.acc", "-o", "resumed.exr"]].concat());
        assert!(pixels(here, "resumed.exr") == all, "{rolling:?}");
        std::fs::remove_file(here.join("part.acc")).unwrap();
        // Shards adapt by themselves.
        let uniform = [&open[..], &["--sampling", "uniform"]].concat();
        render(here, &[&uniform[..], &["-o", "uniform.exr"]].concat());
        for shard in ["0/2", "1/2"] {
            let name = format!("{}.acc", &shard[..1]);
            render(here, &[&uniform[..], &["--shard", shard, "-o", &name]].concat());
        }
        let merged = taugate(here, &["merge", "0.acc", "1.acc", "-o", "merged.exr"]);
        assert!(merged.status.success(), "{}", String::from_utf8_lossy(&merged.stderr));
        let (merged, uniform) = (pixels(here, "merged.exr"), pixels(here, "uniform.exr"));
        assert!(merged.iter().zip(&uniform).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs()), "{rolling:?}");
    }
}

#[test]
fn frames_of_a_sequence_are_exposed_one_by_one() {
    let folder = folder();
    let here = folder.path();
    let flags = ["--fps", "2", "--frames", "1..3", "-o", "f#.exr", "--gif", "f.gif", "--shutter"];
    let open = [&flags[..], &["0..100ms"]].concat();
    render(here, &open);
    for (frame, at) in [("f1.exr", "0.5s"), ("f2.exr", "1s")] {
        render(here, &["--at", at, "--shutter", "0..100ms", "-o", "alone.exr"]);
        assert!(pixels(here, frame) == pixels(here, "alone.exr"), "{frame}");
    }
    assert!(render(here, &open).contains("2 of 2 frames exist"));
    let other = [&["render", "street.glb"], &SMALL[..], &SPP, &flags, &["0..90ms"]].concat();
    fails(here, &other, 2, "has other settings (input.shutter is");
}

#[test]
fn mistakes_name_the_remedy() {
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("box.glb"), glb::write(&build(Kind::CornellBox))).unwrap();
    for (flags, message) in [
        (&["street.glb", "--shutter", "20ms..0"][..], "like 0..20ms"),
        (
            &["street.glb", "--shutter", "0..20ms", "--at", "2"],
            "from 2 s to 2.02 s, but the animations last from 0 s to 2 s",
        ),
        (&["street.glb", "--shutter", "-10ms..20ms"], "from -0.01 s to 0.02 s"),
        (&["street.glb", "--shutter", "0..20ms", "--rolling", "200ms"], "from 0 s to 2.22 s"),
        (&["street.glb", "--rolling", "20us"], "add --shutter 0..20ms"),
        (&["street.glb", "--shutter", "0..20ms", "--rolling", "0"], "like 20us"),
        (&["street.glb", "--shutter", "0..20ms", "--animation", "none"], "leave out --shutter"),
        (&["box.glb", "--shutter", "0..20ms"], "no node of the scene is animated"),
        (&["street.glb", "--shutter", "0..20ms", "--frames", "0..49", "--gif", "a.gif"], "from 2 s to 2.02 s"),
        (&["street.glb", "--shutter", "0..20ms", "--strategy-images", "folder"], "leave out --shutter"),
        (&["street.glb", "--cw", "20", "--heterodyne", "30"], "turn during an exposure: add --shutter"),
        (&["street.glb", "--shutter", "0..20ms", "--heterodyne", "30"], "add --cw MHZ"),
        (&["street.glb", "--shutter", "0..20ms", "--cw", "20", "--heterodyne", "0"], "like 30Hz"),
        (&["street.glb", "--shutter-speed", "20ms"], "with --shutter, like 0..20ms"),
    ] {
        let command = [&["render"], flags, &["--resolution", "24x12", "-o", "f#.exr"]].concat();
        let command: Vec<&str> = match flags.contains(&"--frames") {
            true => command,
            false => command.into_iter().map(|word| if word == "f#.exr" { "f.exr" } else { word }).collect(),
        };
        fails(here, &command, 2, message);
    }
    assert_eq!(std::fs::read_dir(here).unwrap().count(), 2);
    let few = render(here, &["--shutter", "0..20ms", "--spp", "4", "-o", "few.exr"]);
    assert!(few.contains("shows 2 moments") && few.contains("at least --spp 32"), "{few}");
}
