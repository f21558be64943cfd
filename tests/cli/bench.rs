//! Runs `taugate bench` as a user does: a tiny suite from reference to report, resuming it, and the mistakes that bench refuses.

use std::path::Path;

use taugate::internals::bench::case::Case;
use taugate::internals::bench::suite::Suite;
use taugate::internals::bench::table::{self, COLUMNS};
use taugate::internals::generate::{Kind, glb_bytes};
use taugate::internals::image::exr_file::{self, Picture, Provenance, read_picture};
use taugate::internals::image::film::Film;
use taugate::internals::settings::Crop;
use taugate::internals::settings::units::Gate;

use crate::taugate;

fn fails(folder: &Path, arguments: &[&str], code: i32, part: &str) {
    let output = taugate(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(message.contains(part) && !message.contains("panicked"), "{arguments:?}: expected {part:?} in: {message}");
}

fn succeeds(folder: &Path, arguments: &[&str]) -> (String, String) {
    let output = taugate(folder, arguments);
    let [out, messages] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(output.status.success(), "{arguments:?}: {messages}");
    (out, messages)
}

/// A folder with the Cornell box and a suite of two scenes: the box, and a scene whose file is missing.
fn folder(time: &str, gate: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let box_file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.glb");
    std::fs::copy(box_file, folder.path().join("box.glb")).unwrap();
    let suite = format!(
        r#"about = "A test."
time = "{time}"
repetitions = 2
[render]
light-paths = 300
max-depth = 5
[[scene]]
name = "the box"
scene = "box.glb"
gate = "{gate}"
resolution = "12x12"
[[scene]]
name = "gone"
scene = "no/such/scene.glb"
[[variant]]
name = "bdpt"
render = {{ estimator = "bdpt" }}
[[variant]]
name = "lcs"
render = {{ estimator = "lcs-paper", queries = 2 }}
"#
    );
    std::fs::write(folder.path().join("s.toml"), suite).unwrap();
    folder
}

fn bench<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["bench", "s.toml", "--out", "out"], more].concat()
}

fn edit(folder: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(folder.join("s.toml")).unwrap();
    assert!(text.contains(from), "{from}");
    std::fs::write(folder.join("s.toml"), text.replacen(from, to, 1)).unwrap();
}

#[test]
fn a_suite_runs_from_reference_to_report_and_resumes() {
    let here = folder("250ms", "7.5m..8.5m");
    fails(here.path(), &bench(&[]), 2, "make it with: taugate bench s.toml --out out --reference");
    assert!(!here.path().join("out").exists(), "nothing is written without a reference");

    // The reference is made for ten times the suite's time. It is then precise enough even if the machine runs faster during
    // the comparison.
    edit(here.path(), "250ms", "2500ms");
    let (_, messages) = succeeds(here.path(), &bench(&["--reference", "--reference-time", "40s"]));
    edit(here.path(), "2500ms", "250ms");
    assert!(messages.contains("agrees with") && messages.contains("skipped 1 scene: gone"), "{messages}");
    let references: Vec<_> = std::fs::read_dir(here.path().join("references")).unwrap().collect();
    assert_eq!(references.len(), 1, "both variants share a reference");

    edit(here.path(), "scene = \"box.glb\"", "scene = \"box.glb\"\npaper = \"2.5 times lower\"");
    let (text, messages) = succeeds(here.path(), &bench(&["--repetitions", "1"]));
    assert!(
        text.contains("the box") && text.contains("times lower (") && messages.contains("skipped 1"),
        "{text}{messages}"
    );
    let results = here.path().join("out/results.csv");
    let csv = std::fs::read_to_string(&results).unwrap();
    assert_eq!(csv.lines().next().unwrap(), COLUMNS.join(","));
    let first = table::read(&results).unwrap();
    for variant in ["bdpt", "lcs"] {
        let rows: Vec<_> = first.iter().filter(|row| row.variant == variant).collect();
        assert!(rows.windows(2).all(|w| w[0].seconds < w[1].seconds && w[0].point < w[1].point), "{rows:?}");
        let last = rows.last().unwrap();
        assert!(last.seconds >= 0.03 && last.relmse.all > 0.0 && last.flip > 0.0 && last.flip < 1.0, "{last:?}");
        let own_is_valid = last.own.all > 0.0 && last.own.trimmed <= last.own.all;
        assert!(own_is_valid && last.relmse.trimmed > 0.0 && last.relmse.trimmed <= last.relmse.all, "{last:?}");
        assert!(last.light_vertices > 0.0 && last.queries_per_s > 0.0 && last.rays_per_s > 0.0, "{last:?}");
        assert!((0.0..1.0).contains(&last.dead_query_share) && last.samples > 0 && last.dropped == 0, "{last:?}");
    }
    for name in [
        "report.md",
        "the-box.svg",
        "the-box.png",
        "the-box-crops.svg",
        "images/the-box@bdpt.exr",
        "images/the-box@lcs.exr",
    ] {
        assert!(here.path().join("out").join(name).exists(), "{name}");
    }
    let page = std::fs::read_to_string(here.path().join("out/report.md")).unwrap();
    assert!(page.lines().any(|l| l.starts_with("| the box | lcs | ") && l.ends_with("| 2.5 times lower |")), "{page}");
    for part in [
        "A test.",
        "(the-box.svg)",
        "(the-box-crops.svg)",
        "| lcs |",
        "gone is not on this machine",
        "The paper reports: 2.5 times lower.",
    ] {
        assert!(page.contains(part), "{part} is missing in: {page}");
    }

    // Bench adds the second repetition and keeps the rows of the first.
    fails(here.path(), &bench(&[]), 2, "add --resume");
    succeeds(here.path(), &bench(&["--resume"]));
    let both = table::read(&results).unwrap();
    assert_eq!(both[..first.len()], first[..]);
    assert!(both[first.len()..].iter().all(|row| row.repetition == 1) && both.len() > first.len());
    // Every repetition is already there: bench renders nothing and keeps all rows.
    succeeds(here.path(), &bench(&["--resume"]));
    assert_eq!(table::read(&results).unwrap(), both);

    // Changed settings give rows with a new fingerprint.
    edit(here.path(), "queries = 2", "queries = 3");
    succeeds(here.path(), &bench(&["--resume", "--repetitions", "1"]));
    let changed = table::read(&results).unwrap();
    let fingerprint = |variant: &str| changed.iter().find(|row| row.variant == variant).unwrap().fingerprint.clone();
    assert_ne!(fingerprint("lcs"), first.iter().find(|row| row.variant == "lcs").unwrap().fingerprint);

    // A reference is valid for one gate only.
    edit(here.path(), "7.5m..8.5m", "7.5m..8.4m");
    fails(here.path(), &bench(&["--resume"]), 2, "there is no reference for the box");
}

#[test]
fn a_reference_that_is_too_noisy_is_refused() {
    let here = folder("200ms", "7.5m..8.5m");
    succeeds(here.path(), &["bench", "s.toml", "--reference", "--reference-time", "10ms", "-q"]);
    // Much noisier than any image of the variants, however slow the machine is.
    rewrite(&reference(here.path()), [1.0, 30.0], 16, |_, _| {});
    let output = taugate(here.path(), &["bench", "s.toml", "-q"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("refused: the box") && message.contains("--reference"), "{message}");
    assert!(!here.path().join("bench-s/results.csv").exists());

    // The next run adds to the samples of the refused reference.
    let file = || reference(here.path());
    let own = |picture: &Picture| picture.variance.as_ref().unwrap().iter().map(|&v| f64::from(v)).sum::<f64>();
    let first = read_picture(&file()).unwrap();
    let (_, messages) = succeeds(here.path(), &["bench", "s.toml", "--reference", "--reference-time", "2s"]);
    let second = read_picture(&file()).unwrap();
    assert!(messages.contains(" before, own relMSE"), "{messages}");
    assert!(own(&second) < own(&first) && second.seed != first.seed, "{} {}", own(&first), own(&second));
    assert!(second.seconds.unwrap() > first.seconds.unwrap() + 0.1, "{:?} {:?}", first.seconds, second.seconds);
}

/// The only file in the folder of references.
fn reference(folder: &Path) -> std::path::PathBuf {
    std::fs::read_dir(folder.join("references")).unwrap().next().unwrap().unwrap().path()
}

/// Replaces a reference with a new one of `batches` batches. Their mean is the old image times `scale`, and the standard error of
/// the mean is `noise` times the old standard error. `change` then edits each batch; its first argument is the index of the batch.
fn rewrite(path: &Path, [scale, noise]: [f32; 2], batches: u32, change: impl Fn(u32, &mut [f32])) {
    let Picture { width, height, rgb, variance, seed, .. } = read_picture(path).unwrap();
    let mut film = Film::new(width, height);
    for batch in 0..batches {
        let sign = if batch % 2 == 0 { 1.0 } else { -1.0 };
        let noise = |v: f32| noise * sign * (v * (batches as f32 - 1.0)).sqrt();
        let mut image: Vec<f32> =
            rgb.iter().zip(variance.as_ref().unwrap()).map(|(x, &v)| scale * x + noise(v)).collect();
        change(batch, &mut image);
        film.add(&image, 10);
    }
    let (crop, gate) = (Crop { x0: 0, x1: width, y0: 0, y1: height }, Gate { lo: 7.5, hi: 8.5 });
    let (seed, settings) = (seed.unwrap().parse().unwrap(), String::new());
    let provenance = Provenance {
        resolution: [width, height],
        crop,
        responses: gate.into(),
        seed,
        seconds: 2.0,
        settings,
        merged: None,
    };
    exr_file::write(path, &film, &provenance).unwrap();
}

/// Overwrites the renderer's fingerprint in the file, as if other shaders had rendered it.
fn forget_renderer(path: &Path) {
    let (mut bytes, fingerprint) = (std::fs::read(path).unwrap(), taugate::internals::image::fingerprint::RENDERER);
    let at = bytes.windows(fingerprint.len()).position(|w| w == fingerprint.as_bytes()).expect("a fingerprint");
    bytes[at..at + fingerprint.len()].fill(b'0');
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_reference_by_another_version_is_checked_before_it_counts() {
    let here = folder("60ms", "7.5m..8.5m");
    let make = &bench(&["--reference", "--reference-time", "500ms"]);
    succeeds(here.path(), make);
    let file = reference(here.path());
    let first = read_picture(&file).unwrap();
    forget_renderer(&file);
    fails(here.path(), &bench(&[]), 2, "is by another version of the renderer (its code or its version differs)");
    let (_, messages) = succeeds(here.path(), make);
    assert!(messages.contains("agrees with this version") && messages.contains(" before, own relMSE"), "{messages}");
    let second = read_picture(&file).unwrap();
    // The new total is the time of the first reference plus the time of the check, which is a tenth of the first time.
    assert!(second.seconds.unwrap() > 1.09 * first.seconds.unwrap(), "{:?} {:?}", first.seconds, second.seconds);

    // Negative control: a reference that is twice as bright.
    rewrite(&file, [2.0, 1.0], 16, |_, _| {});
    forget_renderer(&file);
    let (_, messages) = succeeds(here.path(), make);
    assert!(messages.contains("differs from this version") && messages.contains("a new one was started"), "{messages}");
    assert!(!messages.contains(" before, own relMSE"), "{messages}");
    // Two batches are too few for an error estimate: bench cannot check this reference and starts a new one.
    rewrite(&file, [1.0, 1.0], 2, |_, _| {});
    forget_renderer(&file);
    let (_, messages) = succeeds(here.path(), make);
    assert!(messages.contains("cannot be checked; a new one was started"), "{messages}");
}

/// One pixel of the reference is bright in one batch and dark in the other. The reference is then too noisy for the relMSE over
/// all pixels, but good enough for the trimmed relMSE, which leaves out the worst pixels.
#[test]
fn relmse_and_trimmed_relmse_are_refused_separately() {
    let here = folder("400ms", "7.5m..8.5m");
    succeeds(here.path(), &bench(&["--reference", "--reference-time", "500ms"]));
    let pixel = |by: f32| move |batch: u32, image: &mut [f32]| image[100] += by * if batch == 0 { 1.0 } else { -1.0 };
    rewrite(&reference(here.path()), [1.0, 0.1], 2, pixel(5.0));
    let (text, messages) = succeeds(here.path(), &bench(&["--repetitions", "1"]));
    assert!(
        messages.contains("note: the box")
            && messages.contains("relMSE over all pixels, ")
            && messages.contains("the report leaves it out"),
        "{messages}"
    );
    assert!(text.contains("relMSE -  trimmed ") && text.contains("times lower ("), "{text}");
    let page = std::fs::read_to_string(here.path().join("out/report.md")).unwrap();
    assert!(page.contains("| reference too noisy | - |") && page.contains("![trimmed relMSE against time]"), "{page}");

    // Negative control: the same noise in many pixels spoils the trimmed relMSE too.
    rewrite(&reference(here.path()), [1.0, 0.1], 2, |batch, image| {
        (0..48).for_each(|i| pixel(5.0)(batch, &mut image[3 * i..]))
    });
    // The rows of another scene that was refused stay.
    let (results, refused) = (here.path().join("out/results.csv"), here.path().join("out/refused.csv"));
    let mut others = table::read(&results).unwrap();
    others.iter_mut().for_each(|row| row.scene = "another".into());
    table::write(&refused, &others).unwrap();
    let output = taugate(here.path(), &bench(&["--resume"]));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("refused: the box"));
    let rows = table::read(&refused).unwrap();
    assert!(rows.starts_with(&others) && rows[others.len()..].iter().all(|row| row.scene == "the box"), "{rows:?}");
    assert!(rows.len() > others.len());
}

#[test]
fn a_suite_of_costs_needs_no_reference_and_fits_its_sweeps() {
    let here = tempfile::tempdir().unwrap();
    let mut suite =
        String::from("time = \"60ms\"\nrepetitions = 1\nerrors = false\n[render]\nlight-paths = 300\nmax-depth = 5\n");
    for (name, triangles) in [("few", 36), ("more", 100), ("many", 2000)] {
        suite += &format!(
            "[[scene]]\nname = \"{name}\"\ngenerate = {{ name = \"cornell-box\", triangles = {triangles} }}\n\
             sweep = \"triangles\"\ngate = \"8m..8.5m\"\nresolution = \"8x8\"\n"
        );
    }
    suite += "[[variant]]\nname = \"lcs\"\nrender = { estimator = \"lcs\" }\n";
    std::fs::write(here.path().join("s.toml"), suite).unwrap();
    fails(here.path(), &bench(&["--reference"]), 2, "measures costs only");
    let (text, _) = succeeds(here.path(), &bench(&[]));
    assert!(text.contains("us per pixel sample") && text.contains("| triangles | lcs | 3 | 36 | 2178 |"), "{text}");
    let rows = table::read(&here.path().join("out/results.csv")).unwrap();
    for row in &rows {
        assert!(row.relmse.all.is_nan() && row.us_per_sample > 0.0 && row.pixels == 64, "{row:?}");
        assert!((row.gate_m - 0.5).abs() < 1e-9 && [36, 138, 2178].contains(&row.triangles), "{row:?}");
        let cost = 1e6 * row.seconds / (row.samples * row.pixels) as f64;
        // The file states seconds to a tenth of a millisecond.
        assert!((row.us_per_sample / cost - 1.0).abs() < 0.01 + 5e-5 / row.seconds, "{row:?}");
    }
    let growth = std::fs::read_to_string(here.path().join("out/growth.csv")).unwrap();
    assert!(growth.lines().nth(1).unwrap().starts_with("triangles,lcs,3,36,2178,"), "{growth}");
    let page = std::fs::read_to_string(here.path().join("out/report.md")).unwrap();
    assert!(page.contains("## Growth") && !page.contains("relMSE"), "{page}");
    succeeds(here.path(), &bench(&["--resume"]));
    let read = || table::read(&here.path().join("out/results.csv")).unwrap();
    assert_eq!(read().len(), rows.len());

    // Scenes that a run leaves out keep their rows, and no backup replaces another.
    let of = |is_few: bool| {
        let rows = read().into_iter().filter(|row| (row.scene == "few") == is_few);
        rows.map(|row| format!("{row:?}")).collect::<Vec<_>>()
    };
    let (few, others) = (of(true), of(false));
    for (time, backup) in [("50ms", "results.old.csv"), ("40ms", "results.old2.csv")] {
        let (text, _) = succeeds(here.path(), &bench(&["--resume", "--scenes", "few", "--time", time]));
        assert!(text.contains("few") && !text.contains("many"), "{text}");
        assert!(of(false) == others && !of(true).is_empty() && !of(true).contains(&few[0]));
        assert!(here.path().join("out").join(backup).exists(), "{backup}");
    }
}

/// A reference is bound to the content of its scene, including the buffers and images in other files.
#[test]
fn references_follow_the_files_that_a_scene_names() {
    let here = tempfile::tempdir().unwrap();
    let glb = glb_bytes(Kind::CornellBox);
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
    let (json, mut binary) = (&glb[20..20 + word(12)], glb[28 + word(12)..].to_vec());
    let mut document: serde_json::Value = serde_json::from_slice(json).unwrap();
    document["buffers"][0]["uri"] = "box.bin".into();
    document["images"] = serde_json::json!([{ "uri": "paint.png" }]);
    std::fs::write(here.path().join("box.gltf"), document.to_string()).unwrap();
    std::fs::write(here.path().join("box.bin"), &binary).unwrap();
    std::fs::write(here.path().join("paint.png"), "one").unwrap();
    let text = "[[scene]]\nname = \"a\"\nscene = \"box.gltf\"\n[[variant]]\nname = \"b\"\n";
    let suite = Suite::parse(&here.path().join("s.toml"), text.into()).unwrap();
    let reference = || Case::load(&suite, &suite.scenes[0]).unwrap().entries[0].reference.clone();

    let first = reference();
    assert_eq!(reference(), first);
    binary[0] ^= 1;
    std::fs::write(here.path().join("box.bin"), &binary).unwrap();
    let second = reference();
    assert_ne!(second, first);
    std::fs::write(here.path().join("paint.png"), "two").unwrap();
    assert_ne!(reference(), second);
}

#[test]
fn path_tracing_is_left_out_in_scenes_with_a_beam() {
    let here = tempfile::tempdir().unwrap();
    let door = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/door-ajar.glb");
    let suite = |variants: &[&str]| {
        let mut text = format!(
            "time = \"30ms\"\nrepetitions = 1\nerrors = false\nrender.light-paths = 100\n[[scene]]\nname = \"door\"\n\
             scene = {door:?}\nresolution = \"8x8\"\n"
        );
        for name in variants {
            text += &format!("[[variant]]\nname = \"{name}\"\nrender = {{ estimator = \"{name}\" }}\n");
        }
        std::fs::write(here.path().join("s.toml"), text).unwrap();
    };
    suite(&["pt", "bdpt"]);
    let (out, messages) = succeeds(here.path(), &bench(&[]));
    assert!(messages.contains("door: pt is left out") && out.contains("bdpt"), "{out}{messages}");
    let rows = table::read(&here.path().join("out/results.csv")).unwrap();
    assert!(!rows.is_empty() && rows.iter().all(|row| row.variant == "bdpt"), "{rows:?}");
    suite(&["pt"]);
    fails(here.path(), &["bench", "s.toml"], 2, "no variant finds the light of its beam");
}

#[test]
fn a_suite_whose_scenes_are_all_skipped_fails() {
    let here = folder("60ms", "7.5m..8.5m");
    for more in [&["--scenes", "gone"][..], &["--scenes", "gone", "--reference"]] {
        fails(here.path(), &bench(more), 2, "no scene is left to measure: gone is not on this machine");
    }
}

#[test]
fn mistakes_name_their_place() {
    let here = folder("1s", "8m..8.5m");
    let cases = [
        ("box.glb", "bax.glb", "s.toml:9:9: there is no scene bax.glb"),
        ("\"bdpt\" }", "\"magic\" }", "s.toml:17:24: no estimator is called 'magic'"),
        ("8m..8.5m", "8.5m..8m", "s.toml:10:8: the gate is reversed"),
        (
            "resolution = \"12x12\"",
            "resolution = \"12x12\"\nemitters = [\"sun\"]",
            "s.toml:8:8: no node 'sun' emits light",
        ),
        ("resolution = \"12x12\"", "resolutoin = \"12x12\"", "s.toml:11:1: [[scene]] has no key resolutoin"),
    ];
    let good = std::fs::read_to_string(here.path().join("s.toml")).unwrap();
    for (from, to, part) in cases {
        edit(here.path(), from, to);
        fails(here.path(), &["bench", "s.toml"], 2, part);
        std::fs::write(here.path().join("s.toml"), &good).unwrap();
    }
    edit(here.path(), "8m..8.5m", "0.1m..0.2m");
    fails(here.path(), &["bench", "s.toml", "--reference"], 2, "s.toml:10:8: the gate 0.1-0.2 m");
    fails(here.path(), &["bench", "s.toml", "--scenes", "attic"], 2, "the suite has no scene 'attic': choose from");
    fails(here.path(), &["bench", "none.toml"], 2, "none.toml: no such file; check the name");
    fails(here.path(), &["bench", "s.toml", "--reference", "--resume"], 2, "cannot be used with");
}

#[test]
fn shipped_suites_are_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/suites");
    let mut count = 0;
    for file in std::fs::read_dir(folder).unwrap() {
        let suite = Suite::read(&file.unwrap().path()).unwrap_or_else(|e| panic!("{e}"));
        for scene in &suite.scenes {
            assert!(scene.exists() || !scene.folder_exists(), "{}: {}", suite.name, scene.path().display());
        }
        count += 1;
    }
    assert!(count >= 5);
}

/// Without --reference-estimator, a variant or an estimator with default settings renders the reference, whichever is the fastest.
#[test]
fn the_chosen_estimator_renders_the_reference() {
    let here = folder("60ms", "7.5m..8.5m");
    for estimator in ["pt", "bdpt"] {
        let (_, messages) = succeeds(
            here.path(),
            &bench(&["--reference", "--reference-time", "300ms", "--reference-estimator", estimator]),
        );
        let by = format!(" by {estimator}");
        assert!(messages.contains(&by), "{messages}");
    }
    fails(here.path(), &bench(&["--reference-estimator", "pt"]), 2, "--reference");
}
