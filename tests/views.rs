//! What a render shows beside its image: strategies, numbers and comparisons, from outside.

use std::path::Path;
use std::process::{Command, Output};

use taugate::exr_file::read_picture;

fn taugate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_taugate")).args(arguments).current_dir(folder).output().expect("taugate starts")
}

/// Runs what must end with `code`; returns stdout and stderr.
fn run(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = taugate(folder, arguments);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out}{err}");
    (out, err)
}

/// A folder with a Cornell box.
fn folder() -> tempfile::TempDir {
    let here = tempfile::tempdir().unwrap();
    run(here.path(), &["generate", "cornell-box", "-o", "box.glb"], 0);
    here
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const SMALL: [&str; 8] = ["--resolution", "20x16", "--light-paths", "500", "--spp", "16", "--max-depth", "3"];

fn render(folder: &Path, more: &[&str], code: i32) -> String {
    run(folder, &[&["render", "box.glb"], &SMALL[..], more].concat(), code).1
}

#[test]
fn strategy_images_add_up_to_the_image() {
    let here = folder();
    for (gate, estimator) in [("6m..8m", "bdpt"), ("0m..inf", "lcs-paper")] {
        let said = render(
            here.path(),
            &["-o", "a.exr", "--estimator", estimator, "--gate", gate, "--strategy-images", "pyramid"],
            0,
        );
        assert!(said.contains("pyramid: 8 strategies"), "{said}");
        let image = read_picture(&here.path().join("a.exr")).unwrap().rgb;
        let mut sum = vec![0.0f64; image.len()];
        let files = names(&here.path().join("pyramid"));
        assert_eq!(files.len(), 16, "{files:?}");
        for file in files.iter().filter(|file| file.ends_with("_weighted.exr")) {
            let part = read_picture(&here.path().join("pyramid").join(file)).unwrap().rgb;
            sum.iter_mut().zip(part).for_each(|(to, from)| *to += f64::from(from));
        }
        let mean = sum.iter().sum::<f64>() / sum.len() as f64;
        assert!(mean > 0.0);
        for (x, s) in image.iter().zip(&sum) {
            assert!((f64::from(*x) - s).abs() < 2e-5 * (s + mean), "{x} {s}");
        }
    }
    // With and without the flag: the same image.
    let with = std::fs::read(here.path().join("a.exr")).unwrap();
    render(here.path(), &["-o", "b.exr", "--estimator", "lcs-paper", "--gate", "0m..inf"], 0);
    let pixels = |file: &str| read_picture(&here.path().join(file)).unwrap().rgb;
    assert!(!with.is_empty() && pixels("a.exr") == pixels("b.exr"));
    assert_eq!(names(here.path()), ["a.exr", "b.exr", "box.glb", "pyramid"], "nothing else is left behind");
}

#[test]
fn a_folder_of_other_files_is_not_touched() {
    let here = folder();
    std::fs::create_dir(here.path().join("mine")).unwrap();
    std::fs::write(here.path().join("mine/thesis.tex"), "years of work").unwrap();
    let said = render(here.path(), &["-o", "a.exr", "--strategy-images", "mine"], 2);
    assert!(said.contains("holds 'thesis.tex'"), "{said}");
    let said = render(here.path(), &["-o", "a.exr", "--strategy-images", "no/where"], 2);
    assert!(said.contains("cannot be written"), "{said}");
    let deep = ["--resolution", "512x512", "--max-depth", "24", "-o", "a.exr", "--strategy-images", "p"];
    let said = run(here.path(), &[&["render", "box.glb"], &deep[..]].concat(), 2).1;
    assert!(said.contains("323 strategies") && said.contains("--max-depth"), "{said}");
    assert_eq!(names(here.path()), ["box.glb", "mine"]);
}

#[test]
fn the_summary_says_how_well_the_image_is_known() {
    let here = folder();
    let said = render(here.path(), &["-o", "a.exr", "--gate", "7m..8m", "--stats", "a.json"], 0);
    for part in ["mean ", " +- ", "connections inside the gate: ", "samples dropped as not finite: 0"] {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
    let numbers = |file: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(here.path().join(file)).unwrap()).unwrap()
    };
    let of = |value: &serde_json::Value, key: &str| value[key].as_f64().unwrap_or_else(|| panic!("{key}: {value}"));
    let n = numbers("a.json");
    let share = of(&n, "connections_inside_gate");
    assert!(share > 0.0 && share < 0.5, "a thin gate lets few connections through: {share}");
    assert!(of(&n, "inside_gate_per_sample") > 0.0 && n["samples_dropped"] == 0);

    // The standard error is the spread of the means of other seeds, which share nothing.
    let means: Vec<[f64; 2]> = (1..=12)
        .map(|seed| {
            let seed = seed.to_string();
            render(here.path(), &["-o", "b.exr", "--gate", "7m..8m", "--stats", "b.json", "--seed", &seed], 0);
            let n = numbers("b.json");
            [of(&n, "image_mean"), of(&n, "image_mean_standard_error").powi(2)]
        })
        .collect();
    let count = means.len() as f64;
    let mean = means.iter().map(|m| m[0]).sum::<f64>() / count;
    let spread = means.iter().map(|m| (m[0] - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let claimed = means.iter().map(|m| m[1]).sum::<f64>() / count;
    eprintln!("mean {mean:.5}, spread {:.2e}, claimed {:.2e}", spread.sqrt(), claimed.sqrt());
    // F distribution with 11 and 180 degrees of freedom: 1e-3 to both sides.
    assert!((0.16..3.0).contains(&(spread / claimed)), "{spread} against {claimed}");

    // A gate near the resolution of travel times is named again at the end, and in the numbers.
    let said = render(here.path(), &["-o", "c.exr", "--gate", "7m+0.1mm", "--stats", "c.json", "--force"], 0);
    assert_eq!(said.matches("steps of 32-bit travel times").count(), 2, "{said}");
    assert!(numbers("c.json")["warnings"][0].as_str().unwrap().contains("32-bit travel times"));

    // One iteration: no error can be known.
    let one = ["--resolution", "8x8", "--spp", "1", "-o", "d.exr", "--stats", "d.json"];
    let said = run(here.path(), &[&["render", "box.glb"], &one[..]].concat(), 0).1;
    assert!(said.contains("unknown error") && numbers("d.json")["image_mean_standard_error"].is_null(), "{said}");
}
