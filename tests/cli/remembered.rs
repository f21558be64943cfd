//! Sums on the command line: the files remember all that a later command must know about the render.

use std::io::{Cursor, Write};
use std::path::Path;

use serde_json::Value;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::fails;
use crate::sums::{run, with_box};

const SMALL: [&str; 6] = ["--resolution", "8x6", "--light-paths", "500", "--sampling", "uniform"];

fn render(here: &Path, flags: &[&str]) -> String {
    run(here, &[&["render", "box.glb"], &SMALL[..], flags].concat())
}

/// Changes the description in a file of sums.
pub fn edit(path: &Path, change: impl Fn(&mut Value)) {
    let mut old = ZipArchive::new(Cursor::new(std::fs::read(path).unwrap())).unwrap();
    let mut about: Value = serde_json::from_reader(old.by_name("about.json").unwrap()).unwrap();
    change(&mut about);
    let mut new = ZipWriter::new(Cursor::new(vec![]));
    for index in 0..old.len() {
        let entry = old.by_index_raw(index).unwrap();
        if entry.name().unwrap() != "about.json" {
            new.raw_copy_file(entry).unwrap();
        }
    }
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    new.start_file("about.json", stored).unwrap();
    new.write_all(about.to_string().as_bytes()).unwrap();
    std::fs::write(path, new.finish().unwrap().into_inner()).unwrap();
}

fn is_same_file(here: &Path, a: &str, b: &str) -> bool {
    let [a, b] = [a, b].map(|name| std::fs::read(here.join(name)).unwrap());
    a == b
}

/// The sums are those of the weights that the table had during the render.
#[test]
fn develop_merge_detect_and_compare_refuse_a_changed_response() {
    let here = with_box();
    let here = here.path();
    let write = |table: &str| std::fs::write(here.join("slice.csv"), table).unwrap();
    write("time_ns,weight\n17,0\n20,1\n24,0\n");
    render(here, &["--spp", "2", "--response", "slice.csv", "-o", "one.acc"]);
    let two = ["--response", "slice.csv", "--response", "soft=gauss:8m..8.3m,0.1m"];
    render(here, &[&["--spp", "2", "-o", "two.acc"], &two[..]].concat());
    let commands: [&[&str]; 7] = [
        &["develop", "one.acc", "-o", "one.npy"],
        &["develop", "two.acc", "-o", "two.npy"],
        &["merge", "two.acc", "-o", "merged.npy"],
        &["detect", "one.acc", "-o", "counts.npy", "--photons", "1"],
        &["detect", "two.acc", "-o", "counts.npy", "--photons", "1"],
        &["compare", "one.acc", "one.acc"],
        &["compare", "two.acc", "two.acc"],
    ];
    // The rows count, and not the text of the file.
    write("# the same\ntime_ns,weight\n17.0,0\n20.0,1\n24.0,0\n");
    for command in commands {
        assert!(!run(here, command).contains("warning"), "{command:?}");
    }
    // The integral is the same.
    write("time_ns,weight\n17,0\n21,1\n24,0\n");
    for command in commands {
        fails(here, command, 2, "the response slice has other weights than during the render");
    }

    // Earlier versions did not keep the weights.
    for file in ["one.acc", "two.acc"] {
        edit(&here.join(file), |about| drop(about.as_object_mut().unwrap().remove("tables")));
    }
    for command in commands {
        let message = run(here, command);
        assert!(message.contains("warning") && message.contains("slice.csv"), "{command:?}: {message}");
    }
    assert_eq!(run(here, &["develop", "one.acc", "-o", "one.npy", "-q"]), "");
}

#[test]
fn dropped_samples_survive_resume_and_merge() {
    let here = with_box();
    let here = here.path();
    let gate = ["--gate", "5m..6m", "--spp", "4"];
    render(here, &[&gate[..], &["-o", "a.acc"]].concat());
    edit(&here.join("a.acc"), |about| about["dropped"] = 5.into());
    let warning = "warning: 5 samples were not finite and count as 0";
    let developed = run(here, &["develop", "a.acc", "-o", "a.exr", "-o", "copy.acc"]);
    assert!(developed.contains(warning), "{developed}");
    let resumed = ["render", "--resume", "copy.acc", "--spp", "8", "-o", "b.exr", "-o", "b.acc", "--stats", "b.json"];
    let message = run(here, &resumed);
    assert!(message.contains(warning) && message.contains("samples dropped: 5"), "{message}");
    let strict = ["render", "--resume", "b.acc", "--spp", "8", "--strict", "-q", "-o", "c.exr"];
    fails(here, &strict, 3, "5 samples were not finite");
    assert!(!here.join("c.exr").exists());

    // The statistics say which part of the work an earlier process did.
    let stats: Value = serde_json::from_slice(&std::fs::read(here.join("b.json")).unwrap()).unwrap();
    assert_eq!((&stats["samples_dropped"], &stats["samples_per_pixel"]), (&5.into(), &8.into()));
    assert_eq!(stats["earlier_samples_per_pixel"], 4);
    assert!(stats["earlier_seconds"].as_f64().unwrap() > 0.0, "{stats}");

    for (part, dropped) in [("0", 2), ("1", 3)] {
        let (shard, file) = (format!("{part}/2"), format!("{part}.acc"));
        render(here, &[&gate[..], &["--shard", &shard, "-o", &file]].concat());
        edit(&here.join(&file), |about| about["dropped"] = dropped.into());
    }
    let merged = run(here, &["merge", "0.acc", "1.acc", "-o", "m.exr"]);
    assert!(merged.contains(warning), "{merged}");
}

#[test]
fn sums_of_an_impossible_time_are_refused() {
    let here = with_box();
    let here = here.path();
    render(here, &["--gate", "5m..6m", "--spp", "2", "-o", "a.acc"]);
    edit(&here.join("a.acc"), |about| about["seconds"] = 1e300.into());
    fails(here, &["render", "--resume", "a.acc", "--spp", "4", "-o", "a.exr"], 2, "seconds of render time");
    fails(here, &["develop", "a.acc", "-o", "a.exr"], 2, "seconds of render time");
}

#[test]
fn a_resumed_shard_is_no_whole_render() {
    let here = with_box();
    let here = here.path();
    render(here, &["--gate", "5m..6m", "--spp", "30", "--shard", "0/3", "-o", "0.acc"]);
    let resume = ["render", "--resume", "0.acc", "--spp", "60", "-o"];
    fails(here, &[&resume[..], &["x.exr"]].concat(), 2, "a shard is a part of a render: add -o OUT.acc");
    assert!(!here.join("x.exr").exists());
    let message = run(here, &[&resume[..], &["x.exr", "-o", "more.acc"]].concat());
    assert!(message.contains("0.acc: shard 0/3, going on after"), "{message}");
    run(here, &["develop", "0.acc", "-o", "part.exr"]);
    assert!(!is_same_file(here, "x.exr", "part.exr"));
}

#[test]
fn a_shard_without_iterations_is_noted() {
    let here = with_box();
    let here = here.path();
    for (shard, spp, part) in [
        ("20/64", "16", "shard 20/64 has no iteration of a render of 16 samples per pixel; use at most 8 shards"),
        ("20/32", "48", "shard 20/32 has no iteration of a render of 48 samples per pixel; use at most 16 shards"),
    ] {
        let message = render(here, &["--gate", "5m..6m", "--spp", spp, "--shard", shard, "-o", "20.acc"]);
        assert!(message.contains(part) && !message.contains("is black"), "{message}");
    }
    let message = render(here, &["--gate", "5m..6m", "--spp", "16", "--shard", "7/8", "-o", "7.acc"]);
    assert!(!message.contains("has no iteration"), "{message}");
}
