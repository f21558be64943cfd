//! Sums of renders on the command line: renders that are resumed, and shards that are merged into one render.

use std::path::Path;

use taugate::internals::image::exr_file::read_picture;
use taugate::internals::image::npy_read;

use crate::grids::npy;
use crate::{fails, folder, names, taugate};

const SMALL: [&str; 8] = ["--resolution", "24x16", "--gate", "5m..6m", "--light-paths", "1000", "--max-depth", "5"];

pub fn with_box() -> tempfile::TempDir {
    let here = folder();
    run(here.path(), &["generate", "cornell-box", "-o", "box.glb"]);
    here
}

/// Runs a command that must succeed. Returns what it prints on stderr.
pub fn run(here: &Path, arguments: &[&str]) -> String {
    let output = taugate(here, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {message}");
    message
}

/// Runs a command that prints JSON.
fn run_for_result(here: &Path, arguments: &[&str]) -> serde_json::Value {
    let output = taugate(here, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn render(here: &Path, flags: &[&str]) -> String {
    run(here, &[&["render", "box.glb"], &SMALL[..], flags].concat())
}

/// The bits of the image and of its variances.
fn bits(here: &Path, name: &str) -> [Vec<u32>; 2] {
    let picture = read_picture(&here.join(name)).unwrap();
    assert!(picture.rgb.iter().any(|&x| x > 0.0), "{name} is black, which proves nothing");
    [picture.rgb, picture.variance.unwrap()].map(|values| values.into_iter().map(f32::to_bits).collect())
}

#[test]
fn a_render_that_goes_on_ends_with_the_same_bits() {
    let here = with_box();
    let here = here.path();
    // lcs samples adaptively, lcs-paper uniformly. The counts of 20 and 40 samples end with whole iterations.
    for estimator in ["lcs", "lcs-paper"] {
        let estimator = ["--estimator", estimator];
        render(here, &[&estimator[..], &["--spp", "40", "-o", "whole.exr"]].concat());
        render(here, &[&estimator[..], &["--spp", "20", "--checkpoint", "sums.acc"]].concat());
        let went_on =
            render(here, &[&estimator[..], &["--spp", "40", "--checkpoint", "sums.acc", "-o", "b.exr"]].concat());
        assert!(went_on.contains("going on after 20 samples per pixel in 9 iterations"), "{went_on}");
        assert!(bits(here, "whole.exr") == bits(here, "b.exr"), "{estimator:?}");

        // The sums contain the scene's path and the settings. A render that has all its samples is written at once.
        run(here, &["render", "--resume", "sums.acc", "--spp", "40", "-o", "c.exr"]);
        run(here, &["develop", "sums.acc", "-o", "d.exr", "-o", "d.npy", "-o", "d.png"]);
        assert!(bits(here, "whole.exr") == bits(here, "c.exr") && bits(here, "whole.exr") == bits(here, "d.exr"));
        assert!(npy_read::read(&here.join("d.npy")).unwrap().values == read_picture(&here.join("d.exr")).unwrap().rgb);
        std::fs::remove_file(here.join("sums.acc")).unwrap();
    }
}

#[test]
fn histograms_go_on_too() {
    let here = with_box();
    let here = here.path();
    let gates = ["--resolution", "12x8", "--gates", "4m..8m/6", "--light-paths", "500"];
    let render = |flags: &[&str]| run(here, &[&["render", "box.glb"], &gates[..], flags].concat());
    render(&["--spp", "24", "-o", "whole.npy", "--variance"]);
    render(&["--spp", "12", "--checkpoint", "sums.acc"]);
    render(&["--spp", "24", "--checkpoint", "sums.acc", "-o", "c.npy", "--variance"]);
    run(here, &["develop", "sums.acc", "-o", "d.npy", "--variance"]);
    let same = run_for_result(here, &["compare", "sums.acc", "whole.npy", "--json"]);
    assert_eq!(same["relmse"], 0.0, "{same}");
    run(here, &["detect", "sums.acc", "-o", "a.npy", "--photons", "1e4"]);
    run(here, &["detect", "whole.npy", "-o", "b.npy", "--photons", "1e4"]);
    assert!(npy_read::read(&here.join("a.npy")).unwrap() == npy_read::read(&here.join("b.npy")).unwrap());
    // An earlier array with this name had variances, which a new array without variances does not keep.
    assert!(here.join("d.variance.npy").exists());
    run(here, &["develop", "sums.acc", "-o", "d2.npy", "--variance"]);
    run(here, &["develop", "sums.acc", "-o", "d2.npy"]);
    assert!(!here.join("d2.variance.npy").exists());
    for suffix in ["npy", "variance.npy"] {
        let read = |name: &str| npy_read::read(&here.join(format!("{name}.{suffix}"))).unwrap();
        assert!(read("whole") == read("c") && read("whole") == read("d"), "{suffix}");
    }
}

#[test]
fn variances_that_the_sums_lack_are_not_written() {
    let here = with_box();
    let here = here.path();
    let flags = ["--resolution", "8x6", "--gates", "4m..8m/100", "--light-paths", "500", "--spp", "4", "-o", "a.acc"];
    run(here, &[&["render", "box.glb"], &flags[..]].concat());
    for outputs in [&["-o", "o.npy", "-o", "c.acc"][..], &["-o", "o.npy"], &["-o", "c.acc"]] {
        let develop = [&["develop", "a.acc", "--variance"], outputs].concat();
        fails(here, &develop, 2, "a.acc has no variances of its gates");
    }
    assert_eq!(names(here), ["a.acc", "box.glb"]);
    run(here, &["develop", "a.acc", "-o", "o.npy", "-o", "c.acc"]);
}

#[test]
fn shards_become_one_render_in_any_order() {
    let here = with_box();
    let here = here.path();
    let uniform = ["--sampling", "uniform", "--spp", "30"];
    render(here, &[&uniform[..], &["-o", "whole.exr"]].concat());
    for part in ["0", "1", "2"] {
        let (shard, file) = (format!("{part}/3"), format!("{part}.acc"));
        render(here, &[&uniform[..], &["--shard", &shard, "-o", &file]].concat());
    }
    let merged = run(here, &["merge", "2.acc", "0.acc", "1.acc", "-o", "a.exr", "-o", "a.acc"]);
    assert!(merged.contains("30 samples per pixel in 12 iterations") && !merged.contains("warning"), "{merged}");
    run(here, &["merge", "0.acc", "1.acc", "2.acc", "-o", "b.exr", "-o", "b.acc"]);
    assert!(bits(here, "a.exr") == bits(here, "b.exr"));
    assert!(std::fs::read(here.join("a.acc")).unwrap() == std::fs::read(here.join("b.acc")).unwrap());
    for (a, b) in bits(here, "a.exr").iter().zip(&bits(here, "whole.exr")) {
        assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1));
    }
    // A shard can be resumed, and renders only its own iterations.
    let more = run(here, &["render", "--resume", "1.acc", "--spp", "60", "-o", "1b.acc"]);
    assert!(more.contains("going on after"), "{more}");
    let uneven = run(here, &["merge", "0.acc", "1b.acc", "2.acc", "-o", "c.exr"]);
    assert!(uneven.contains("is missing, because a shard ended early"), "{uneven}");

    let missing = run(here, &["merge", "2.acc", "0.acc", "-o", "c.exr"]);
    assert!(missing.contains("warning: shards are missing (1/3)"), "{missing}");
    fails(here, &["merge", "2.acc", "0.acc", "2.acc", "-o", "c.exr"], 2, "merge every part once");
    fails(here, &["merge", "a.acc", "1.acc", "-o", "c.exr"], 2, "1.acc has iteration 1, which another");
    fails(here, &["merge", "0.acc", "1.acc", "-o", "1.acc"], 2, "1.acc: is one of the files to read");
    let other = [&["render", "box.glb"], &SMALL[..], &uniform, &["--shard", "0/2", "--checkpoint", "1.acc"]].concat();
    fails(here, &other, 2, "1.acc holds shard 1/3, and not shard 0/2");
}

/// With 48 samples per pixel there is no iteration 20.
#[test]
fn a_shard_without_light_is_merged() {
    let here = with_box();
    let here = here.path();
    for shard in ["0", "20"] {
        render(here, &["--spp", "48", "--shard", &format!("{shard}/32"), "-o", &format!("{shard}.acc")]);
    }
    let message = run(here, &["merge", "20.acc", "0.acc", "-o", "both.exr", "-o", "both.acc"]);
    assert!(message.contains("2 samples per pixel in 1 iterations") && !message.contains("is black"), "{message}");
    let message = run(here, &["merge", "20.acc", "-o", "none.npy"]);
    assert!(message.contains("warning: the image is black"), "{message}");
}

#[test]
fn adaptive_shards_become_the_same_image_with_other_noise() {
    let here = with_box();
    let here = here.path();
    for part in ["0/2", "1/2"] {
        let file = format!("{}.acc", &part[..1]);
        render(here, &["--spp", "128", "--shard", part, "-o", &file]);
    }
    run(here, &["merge", "0.acc", "1.acc", "-o", "merged.exr"]);
    render(here, &["--spp", "128", "--seed", "7", "-o", "other.exr"]);
    run(here, &["compare", "merged.exr", "other.exr", "--z", "z.png"]);
    run(here, &["develop", "0.acc", "-o", "half.exr"]);
    let same = run_for_result(here, &["compare", "0.acc", "half.exr", "--json"]);
    assert_eq!(same["relmse"], 0.0, "{same}");
    // The comparison detects a gate that is 2 % shorter.
    let dim = [&["render", "box.glb"], &SMALL[..2], &["--gate", "5m..5.98m", "--spp", "128", "-o", "dim.exr"]].concat();
    run(here, &[&dim[..], &["--seed", "7"], &SMALL[4..]].concat());
    assert_eq!(taugate(here, &["compare", "merged.exr", "dim.exr", "--z", "z.png"]).status.code(), Some(1));
}

#[test]
fn every_nth_frame_is_a_shard_of_a_sequence() {
    let here = with_box();
    let here = here.path();
    let flags =
        ["--frames", "3..8", "--gate-keys", "3=5m..6m", "--gate-keys", "7=6m..7m", "-o", "f#.exr", "--spp", "2"];
    let small = ["--resolution", "12x8", "--light-paths", "500"];
    let of = |shard: &str| run(here, &[&["render", "box.glb", "--shard", shard], &small[..], &flags].concat());
    of("1/2");
    assert_eq!(names(here), ["box.glb", "f4.exr", "f6.exr"]);
    of("0/2");
    let message = run(here, &[&["render", "box.glb", "--gif", "f.gif"], &small[..], &flags].concat());
    assert!(message.contains("5 of 5 frames exist"), "{message}");
}

#[test]
fn auxiliary_layers_stay_with_the_sums() {
    let here = with_box();
    let here = here.path();
    let layers = |name: &str| {
        use exr::prelude::*;
        let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let layer = image.all_attributes().from_file(here.join(name)).unwrap().layer_data;
        let channels = layer.channel_data.list.into_iter().filter(|channel| {
            let name = channel.name.to_string();
            name.contains('.') && !name.starts_with("Variance")
        });
        let objects = layer.attributes.other.get(&Text::from("tof:objects")).cloned();
        (channels.map(|channel| (channel.name.to_string(), channel.sample_data)).collect::<Vec<_>>(), objects)
    };
    let names = |name: &str| layers(name).0.into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    let aov = ["--aov", "depth,object"];
    render(here, &[&aov[..], &["--spp", "8", "--shard", "0/2", "-o", "a.exr", "--checkpoint", "a.acc"]].concat());
    render(here, &["--spp", "8", "--shard", "1/2", "-o", "b.acc"]);
    assert_eq!(names("a.exr"), ["depth.Z", "object.ID"]);
    assert!(layers("a.exr").1.is_some());

    // Merged sums and resumed renders keep the layers.
    run(here, &["merge", "b.acc", "a.acc", "-o", "merged.acc"]);
    run(here, &["develop", "merged.acc", "-o", "merged.exr"]);
    run(here, &["render", "--resume", "a.acc", "--spp", "16", "-o", "more.exr", "-o", "more.acc"]);
    run(here, &["develop", "more.acc", "-o", "developed.exr"]);
    for other in ["merged.exr", "more.exr", "developed.exr"] {
        assert!(layers(other) == layers("a.exr"), "{other}");
    }

    run(here, &["develop", "a.acc", "--aov", "depth", "-o", "depth.exr"]);
    assert_eq!((names("depth.exr"), layers("depth.exr").1), (vec!["depth.Z".into()], None));
    run(here, &["develop", "a.acc", "--aov", "all", "-o", "all.exr"]);
    assert!(layers("all.exr") == layers("a.exr"));
    fails(here, &["develop", "a.acc", "--aov", "normal", "-o", "none.exr"], 2, "no layer normal");
    fails(here, &["develop", "a.acc", "--aov", "depth", "-o", "none.png"], 2, "-o OUT.acc");
}

#[test]
fn another_render_is_refused_with_what_differs() {
    let here = with_box();
    let here = here.path();
    render(here, &["--spp", "4", "--checkpoint", "sums.acc"]);
    let before = std::fs::read(here.join("sums.acc")).unwrap();
    let refused = |flags: &[&str], part: &str| {
        let command = [&["render", "box.glb"], &SMALL[..], &["--checkpoint", "sums.acc"], flags].concat();
        fails(here, &command, 2, part);
    };
    refused(&["--seed", "1"], "render.seed is 0 in sums.acc and is 1 in this command");
    refused(&["--headlamp"], "emitter.headlamp");
    refused(&["--estimator", "bdpt"], "render.estimator");
    refused(&["--resume", "other.acc"], "keep one, or choose another name");
    for command in ["develop", "merge"] {
        fails(
            here,
            &[command, "sums.acc", "--aov", "depth", "-o", "a.exr"],
            2,
            "render --resume SUMS.acc --aov depth -o",
        );
    }
    let gate = ["render", "--resume", "sums.acc", "--gate", "5m..7m", "-o", "a.exr"];
    fails(here, &gate, 2, "gate.gate is \"5m..6m\" in sums.acc and is \"5m..7m\" in this command");
    fails(here, &["render", "--resume", "missing.acc", "-o", "a.exr"], 2, "missing.acc: no such file");
    fails(here, &["render", "-o", "a.exr"], 2, "<SCENE|EXPERIMENT>");

    // The file has the same name but other contents, so all settings are the same.
    run(here, &["generate", "cornell-box", "--roughness", "0.2", "-o", "box.glb"]);
    refused(&["--spp", "8"], "the files of the scene, or those that the settings name, have other contents");
    assert!(std::fs::read(here.join("sums.acc")).unwrap() == before);

    std::fs::write(here.join("sums.acc"), "nothing").unwrap();
    refused(&[], "sums.acc: this is not an accumulation of taugate");
    fails(here, &["develop", "sums.acc", "-o", "a.exr"], 2, "not an accumulation");
    fails(here, &["develop", "sums.acc", "-o", "a.jpg"], 2, "not an accumulation");
    assert_eq!(names(here), ["box.glb", "sums.acc"]);
}

#[test]
fn sums_of_a_named_response_go_on() {
    let here = with_box();
    let here = here.path();
    let rest = ["--resolution", "8x8", "--light-paths", "500", "--max-depth", "5"];
    for gate in [&["--response", "near=box:5m..6m"][..], &["--gate", "5m..6m", "--response", "box"]] {
        run(here, &[&["render", "box.glb", "--spp", "4", "-o", "a.acc"], &rest[..], gate].concat());
        let said = run(here, &["render", "--resume", "a.acc", "--spp", "8", "-o", "a.exr"]);
        assert!(said.contains("going on after 4 samples per pixel"), "{said}");
    }
}

#[test]
fn files_may_move_while_their_contents_stay() {
    let here = with_box();
    let here = here.path();
    let grid =
        |name: &str, density: f32| std::fs::write(here.join(name), npy("<f4", "(1, 1, 2)", &[0.5, density])).unwrap();
    let fog = ["--sigma-s", "0.1", "--medium-bounds=-0.5,0.5,-0.5,0.5,1.5,0.5", "--density-grid"];
    grid("a.npy", 0.25);
    render(here, &[&fog[..], &["a.npy", "--spp", "4", "--checkpoint", "sums.acc"]].concat());
    std::fs::rename(here.join("a.npy"), here.join("b.npy")).unwrap();
    let more = [&fog[..], &["b.npy", "--spp", "8", "--resume", "sums.acc", "-o", "more.exr"]].concat();
    let said = render(here, &more);
    assert!(said.contains("going on after 4 samples per pixel"), "{said}");
    grid("b.npy", 0.125);
    let more = [&["render", "box.glb"], &SMALL[..], &more].concat();
    fails(here, &more, 2, "or those that the settings name, have other contents");
}

/// The sums name the files that the render read. The files of an image do not replace them.
#[test]
fn images_of_sums_do_not_replace_the_inputs_of_the_render() {
    let here = with_box();
    let here = here.path();
    std::fs::write(here.join("fog.npy"), npy("<f4", "(2, 2, 2)", &[0.5; 8])).unwrap();
    let grid = ["--sigma-s", "1", "--medium-bounds=-0.5,0.5,-0.5,0.5,1.5,0.5", "--density-grid", "fog.npy"];
    render(here, &[&grid[..], &["--spp", "2", "-o", "a.acc"]].concat());
    let before = std::fs::read(here.join("fog.npy")).unwrap();
    fails(here, &["develop", "a.acc", "-o", "fog.npy"], 2, "fog.npy: is a file that the settings name as an input");
    fails(here, &["merge", "a.acc", "-o", "fog.npy"], 2, "choose another name");
    assert!(std::fs::read(here.join("fog.npy")).unwrap() == before);
}
