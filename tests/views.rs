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
