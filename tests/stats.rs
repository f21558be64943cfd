//! `--stats`: the times of a render's stages add up to its wall time.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Allowed wall time outside all stages: another program may suspend a thread between two stages. In tiny renders this can be
/// most of the wall time.
const SLACK_SECONDS: f64 = 0.02;

/// Number of renders of which one must be explained.
const ATTEMPTS: usize = 20;

/// Whether the stages without "unexplained" add up to `wall`: at most 5 % and the slack below, at most the clock error above.
fn explain(stages: &[(String, f64)], wall: f64) -> bool {
    let sum: f64 = stages.iter().filter(|(name, _)| name != "unexplained").map(|(_, seconds)| seconds).sum();
    sum >= 0.95 * wall - SLACK_SECONDS && sum <= 1.001 * wall
}

fn stages(of: &Value) -> Vec<(String, f64)> {
    let stage = |s: &Value| (s["name"].as_str().unwrap().to_string(), s["seconds"].as_f64().unwrap());
    of.as_array().unwrap().iter().map(stage).collect()
}

fn render(folder: &Path, estimator: &str) -> Value {
    let arguments =
        ["-o", "o.exr", "--resolution", "96x64", "--spp", "8", "--light-paths", "4000", "--stats", "s.json"];
    let output = Command::new(env!("CARGO_BIN_EXE_taugate"))
        .arg("render")
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.glb"))
        .args(arguments)
        .args(["--gate", "6m..9m", "--estimator", estimator])
        .current_dir(folder)
        .output()
        .expect("taugate starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&std::fs::read(folder.join("s.json")).unwrap()).unwrap()
}

/// The two lists of stages in the statistics of a render: the key of their wall time, and their own key.
const LISTS: [(&str, &str); 2] = [("render_seconds", "stages"), ("prepare_seconds", "prepare_stages")];

/// Renders until the stages explain the wall time. On a busy machine, other programs may suspend a thread between two stages, so a
/// render may fail. A stage that nobody measures is missing in all of them.
fn render_that_is_explained(folder: &Path, estimator: &str) -> Value {
    let is_explained =
        |stats: &Value| LISTS.iter().all(|(wall, list)| explain(&stages(&stats[list]), stats[wall].as_f64().unwrap()));
    let mut renders = (0..ATTEMPTS).map(|_| render(folder, estimator));
    renders.find(is_explained).unwrap_or_else(|| panic!("{estimator}: {ATTEMPTS} renders have unexplained time"))
}

#[test]
fn stages_explain_the_wall_time() {
    let folder = tempfile::tempdir().unwrap();
    for estimator in ["lcs-paper", "lcs", "bdpt", "pt"] {
        let stats = render_that_is_explained(folder.path(), estimator);
        for (wall, list) in LISTS {
            let (wall, stages) = (stats[wall].as_f64().unwrap(), stages(&stats[list]));
            assert_eq!(stages.last().unwrap().0, "unexplained");
            let all: f64 = stages.iter().map(|(_, seconds)| seconds).sum();
            assert!((all - wall).abs() < 1e-9, "all stages together take {all} s, not {wall} s");
            let longest = &stages[0].0;
            // Negative controls: the longest stage missing, and the longest stage counted twice.
            let without: Vec<_> = stages.iter().filter(|(name, _)| name != longest).cloned().collect();
            let twice: Vec<_> = stages.iter().chain(&stages[..1]).cloned().collect();
            assert!(!explain(&without, wall) && !explain(&twice, wall), "{longest}: {stages:?}");
        }
        assert!(
            stats["waits"].as_u64().unwrap() >= stats["iterations"].as_u64().unwrap(),
            "{estimator}: fewer waits than iterations"
        );
        let names: Vec<String> = stages(&stats["stages"]).into_iter().map(|(name, _)| name).collect();
        let expected = ["kernel sensor_trace", "kernel connect", "submits and waits", "compile kernels", "build trees"];
        for name in expected.into_iter().chain(["upload", "read light vertices", "read film", "add to film"]) {
            assert!(names.iter().any(|n| n == name), "{estimator}: {name} is missing in {names:?}");
        }
    }
}
