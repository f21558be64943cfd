//! `--doppler` as a user gives it.

use std::path::Path;

use taugate::internals::generate::{Kind, build, glb};

use crate::{fails, taugate};

fn folder() -> tempfile::TempDir {
    let here = tempfile::tempdir().unwrap();
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/street.glb");
    std::fs::copy(street, here.path().join("street.glb")).unwrap();
    std::fs::write(here.path().join("box.glb"), glb::write(&build(Kind::CornellBox))).unwrap();
    here
}

/// The values of a channel of an EXR file.
fn channel(path: &Path, name: &str) -> Vec<f32> {
    let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let found = image.layer_data.channel_data.list.iter().find(|channel| channel.name == *name);
    found.unwrap_or_else(|| panic!("{name} is missing")).sample_data.values_as_f32().collect()
}

/// The car of the street drives towards the camera, and all else is at rest. Shards, frames and exposures record it too.
#[test]
fn the_car_of_the_street_approaches() {
    let folder = folder();
    let here = folder.path();
    let small =
        ["--resolution", "64x36", "--spp", "16", "--max-depth", "2", "--doppler", "20m/s", "--estimator", "bdpt"];
    let render = |flags: &[&str]| {
        let output = taugate(here, &[&["render", "street.glb"], &small[..], flags].concat());
        assert!(output.status.success(), "{flags:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    // Pixels of the car, and those at rest. At edges, both mix.
    let count = |name: &str| {
        let [mean, deviation] =
            ["mean", "deviation"].map(|what| channel(&here.join(name), &format!("velocity.{what}")));
        let sharp = || mean.iter().zip(&deviation).filter(|(_, deviation)| **deviation < 0.3);
        let approaching = sharp().filter(|(mean, _)| **mean < -4.0).count();
        (approaching, sharp().filter(|(mean, _)| mean.abs() < 0.01).count())
    };
    render(&["--at", "1s", "-o", "car.exr"]);
    let (car, rest) = count("car.exr");
    assert!((5..200).contains(&car) && rest > 1000, "{car} and {rest} pixels");
    for shard in ["0/2", "1/2"] {
        render(&["--at", "1s", "--sampling", "uniform", "--shard", shard, "-o", &format!("{}.acc", &shard[..1])]);
    }
    let merged = taugate(here, &["merge", "0.acc", "1.acc", "-o", "merged.exr"]);
    assert!(merged.status.success(), "{}", String::from_utf8_lossy(&merged.stderr));
    assert!(count("merged.exr").0.abs_diff(car) < 4);
    render(&["--fps", "2", "--frames", "1..3", "-o", "f#.exr"]);
    assert!(count("f2.exr").0.abs_diff(car) < 4 && count("f1.exr").0 > 0);
    render(&["--at", "1s", "--shutter", "0..10ms", "-o", "open.exr"]);
    assert!(count("open.exr").0.abs_diff(car) < 6);
}

/// What a sensor of velocities records is no light of travel times.
#[test]
fn a_detector_counts_no_velocities() {
    let folder = folder();
    let here = folder.path();
    let small =
        ["--resolution", "24x12", "--spp", "2", "--max-depth", "2", "--estimator", "bdpt", "--gates", "10m..80m/7"];
    for (flags, name) in [(&["--doppler", "20m/s"][..], "speeds"), (&["--fmcw", "1550nm,1GHz,10us"], "beats")] {
        for extension in ["npy", "exr", "acc"] {
            let file = format!("{name}.{extension}");
            let output =
                taugate(here, &[&["render", "street.glb", "--at", "1s", "-o", &file], &small[..], flags].concat());
            assert!(output.status.success(), "{file}: {}", String::from_utf8_lossy(&output.stderr));
            fails(
                here,
                &["detect", &file, "--photons", "5", "-o", "counts.npy"],
                2,
                "render it without --doppler and --fmcw",
            );
        }
    }
    let about = std::fs::read_to_string(here.join("beats.json")).unwrap();
    // 1 GHz / 10 us / c.
    assert!(about.contains("\"beat_hz_per_m\": 333564") || about.contains("\"beat_hz_per_m\":333564"), "{about}");
}

#[test]
fn mistakes_name_the_remedy() {
    let folder = folder();
    let here = folder.path();
    for (flags, message) in [
        (&["street.glb", "--doppler", "0"][..], "like 20m/s"),
        (&["box.glb", "--doppler", "20m/s"], "open a file with animations"),
        (&["street.glb", "--at", "1s", "--doppler", "20m/s", "--estimator", "epc"], "use lcs, bdpt or pt"),
        (&["street.glb", "--at", "1s", "--doppler", "20m/s", "--fireflies", "damp"], "leave out one of them"),
        (&["street.glb", "--at", "1s", "--doppler", "20m/s", "--cw", "20"], "leave out one of them"),
        (
            &["street.glb", "--at", "1s", "--doppler", "20m/s", "--ellipsoids", "on", "--estimator", "lcs"],
            "leave out one of them",
        ),
        (&["street.glb", "--at", "1s", "--doppler", "20m/s", "--strategy-images", "folder"], "leave out one of them"),
        (&["street.glb", "--fmcw", "1550nm,1GHz,0"], "like 1550nm,1GHz,10us"),
        (&["street.glb", "--fmcw", "1550nm,1GHz,10us"], "like --gates 0..80m/200"),
        (
            &["street.glb", "--fmcw", "1550nm,1GHz,10us", "--gates", "0..80m/9", "--repeat", "100m"],
            "cannot be used with",
        ),
    ] {
        let command = [&["render"], flags, &["--resolution", "24x12", "-o", "f.exr"]].concat();
        fails(here, &command, 2, message);
    }
    assert_eq!(std::fs::read_dir(here).unwrap().count(), 2);
}
