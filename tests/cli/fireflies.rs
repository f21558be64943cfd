//! `--fireflies damp`: the damped image, and the unbiased one beside it.

use std::path::Path;

use taugate::internals::image::exr_file::{Picture, read_picture};
use taugate::internals::image::npy_read;

use crate::sums::{run, with_box};
use crate::{fails, taugate};

/// Rare bright light: few samples per pixel, and many gates of the box are narrow.
const SPARSE: [&str; 10] =
    ["render", "box.glb", "--resolution", "24x16", "--gate", "5m..5.1m", "--estimator", "pt", "--max-depth", "5"];

fn render(here: &Path, flags: &[&str]) -> String {
    run(here, &[&SPARSE[..], &["--spp", "40"], flags].concat())
}

fn picture(here: &Path, name: &str) -> Picture {
    read_picture(&here.join(name)).unwrap()
}

#[test]
fn the_unbiased_image_stays_in_the_file() {
    let here = with_box();
    let here = here.path();
    render(here, &["-o", "keep.exr"]);
    render(here, &["--fireflies", "keep", "-o", "also.exr"]);
    let summary = render(here, &["--fireflies", "damp", "-o", "damp.exr", "-o", "damp.npy", "-o", "damp.acc"]);
    assert!(summary.contains("--fireflies damp took away"), "{summary}");
    let [keep, also, damp] = ["keep.exr", "also.exr", "damp.exr"].map(|name| picture(here, name));
    assert!(keep.rgb == also.rgb && keep.undamped.is_none());
    assert_eq!((damp.undamped.as_ref(), &damp.variance), (Some(&keep.rgb), &keep.variance));
    assert!(damp.rgb.iter().zip(&keep.rgb).all(|(damped, x)| damped <= x), "damping takes light away");
    assert!(damp.rgb != keep.rgb, "nothing was damped, which proves nothing");
    assert_eq!(npy_read::read(&here.join("damp.npy")).unwrap().values, damp.rgb);

    // Sums have both images.
    run(here, &["develop", "damp.acc", "-o", "developed.exr"]);
    let developed = picture(here, "developed.exr");
    assert!(developed.rgb == damp.rgb && developed.undamped == damp.undamped);

    // The test of noise is about the unbiased images.
    render(here, &["--seed", "7", "-o", "other.exr"]);
    for image in ["damp.exr", "damp.acc"] {
        let output = taugate(here, &["compare", image, "other.exr", "--z", "z.png"]);
        let [found, note] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(note.contains("uses the images without damped fireflies"), "{note}");
        let without = taugate(here, &["compare", "keep.exr", "other.exr", "--z", "z.png"]).stdout;
        let z = |text: &str| text[text.find("\nz ").unwrap()..].to_string();
        assert_eq!(z(&found), z(&String::from_utf8(without).unwrap()), "{image}");
    }
}

#[test]
fn damped_renders_go_on_and_shards_merge() {
    let here = with_box();
    let here = here.path();
    let samples = |spp: &str, flags: &[&str]| {
        let damp = ["--fireflies", "damp", "--sampling", "uniform", "--spp", spp];
        run(here, &[&SPARSE[..], &damp, flags].concat())
    };
    let damp = |flags: &[&str]| samples("40", flags);
    damp(&["-o", "whole.exr"]);
    samples("20", &["--checkpoint", "sums.acc"]);
    damp(&["--checkpoint", "sums.acc", "-o", "went_on.exr"]);
    assert!(picture(here, "whole.exr").rgb == picture(here, "went_on.exr").rgb);

    damp(&["--shard", "0/2", "-o", "a.acc"]);
    damp(&["--shard", "1/2", "-o", "b.acc"]);
    run(here, &["merge", "a.acc", "b.acc", "-o", "merged.exr"]);
    let [whole, merged] = ["whole.exr", "merged.exr"].map(|name| picture(here, name));
    let unlike = whole.rgb.iter().zip(&merged.rgb).filter(|(a, b)| (*a - *b).abs() > 1e-4 * a.max(**b));
    assert_eq!(unlike.count(), 0);
    // A part of another render is refused, also if only this setting differs.
    render(here, &["--sampling", "uniform", "--shard", "1/2", "-o", "c.acc"]);
    fails(here, &["merge", "a.acc", "c.acc", "-o", "d.exr"], 2, "render.fireflies is");
}

#[test]
fn histograms_and_scans_are_refused() {
    let here = with_box();
    let here = here.path();
    let gates = ["render", "box.glb", "--gates", "4m..8m/6", "--fireflies", "damp", "-o", "a.npy"];
    fails(here, &gates, 2, "--fireflies damp is only for a single gate");
    std::fs::write(
        here.join("scan.toml"),
        "scene = 'box.glb'\n[scan]\nlaser = [0, 0, 0]\npoints = [[0, 0, -1]]\n[gate]\ngate = '1m..4m'\n[render]\nfireflies = 'damp'\n[output]\noutput = 'a.npy'\n",
    )
    .unwrap();
    fails(here, &["render", "scan.toml"], 2, "fireflies");
    fails(here, &["render", "box.glb", "--fireflies", "drop", "-o", "a.exr"], 2, "choose keep or damp");
}
