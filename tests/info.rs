//! Runs `taugate info`, and renders with gates that no light reaches. Needs a device.

use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;
use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::{Device, DeviceInfo};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::render::{MemoryPlan, PreparedScene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::values::Resolution;

fn taugate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_taugate")).args(arguments).current_dir(folder).output().expect("taugate starts")
}

/// A folder with one of the generated scenes as `scene.glb`.
fn scene(name: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    assert!(taugate(folder.path(), &["generate", name, "-o", "scene.glb"]).status.success());
    folder
}

fn info(folder: &Path, more: &[&str]) -> Value {
    let output = taugate(folder, &[&["info", "scene.glb", "--json"], more].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs a render that must fail with `code` and a message that contains all `parts`, and must write no file.
fn refused(folder: &Path, more: &[&str], code: i32, parts: &[&str]) {
    let arguments = [&["render", "scene.glb", "-o", "out.exr", "--png", "--stats", "out.json"], more].concat();
    let output = taugate(folder, &arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{more:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{more:?}: expected {part:?} in: {message}");
    }
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1, "{more:?} leaves a file behind");
}

#[test]
fn info_shows_emitters_memory_and_travel_times() {
    let here = scene("cornell-box");
    let output = taugate(here.path(), &["info", "scene.glb", "--resolution", "96x96"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all = [
        "emissive mesh, ",
        " W",
        "materials",
        "memory",
        "MiB allowed",
        "96x96 through",
        "possible",
        "  50 %",
        "m depth",
    ];
    for part in all {
        assert!(text.contains(part), "expected {part:?} in:\n{text}");
    }

    // The gate that info suggests gives an image.
    let gate = text.split("--gate ").nth(1).and_then(|rest| rest.split_whitespace().next()).expect("a suggestion");
    let render = ["render", "scene.glb", "-o", "out.exr", "--resolution", "32x32", "--spp", "1", "--gate", gate];
    let output = taugate(here.path(), &render);
    assert!(output.status.success(), "{gate}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A lamp in the plane of the ceiling renders with speckles. Both commands warn and give the remedy.
#[test]
fn a_lamp_in_the_plane_of_another_surface_is_named() {
    let mut scene = build(Kind::CornellBox);
    let lamp = scene.instances.iter_mut().find(|i| i.node == "light").expect("the lamp of the box");
    lamp.transform.translation.y += 0.01;
    let here = tempfile::tempdir().unwrap();
    std::fs::write(here.path().join("scene.glb"), taugate::internals::generate::glb::write(&scene)).unwrap();
    let warnings = |json: &Value| json["warnings"].as_array().unwrap().clone();
    let found = warnings(&info(here.path(), &[]));
    assert_eq!(found.len(), 1, "{found:?}");
    let render = ["render", "scene.glb", "-o", "out.exr", "--resolution", "8x8", "--spp", "1", "--stats", "out.json"];
    let output = taugate(here.path(), &render);
    let message = String::from_utf8(output.stderr).unwrap();
    for text in [&found[0].to_string(), &message] {
        assert!(text.contains("'light' lies in the plane of 'ceiling'") && text.contains("in front"), "{text}");
    }
    let json = std::fs::read_to_string(here.path().join("out.json")).unwrap();
    assert_eq!(warnings(&serde_json::from_str(&json).unwrap()), found);
    // In the generated scene the lamp is a centimetre below the ceiling, so there is no warning.
    let shipped = self::scene("cornell-box");
    assert!(warnings(&info(shipped.path(), &[])).is_empty());
}

#[test]
fn travel_times_of_the_gated_sphere_are_the_known_ones() {
    let here = scene("gated-sphere");
    let json = info(here.path(), &[]);
    let light = &json["render"]["light"];
    let percentile = |p: f64| {
        let all = light["percentiles"].as_array().unwrap();
        all.iter().find(|a| a["percent"] == p).unwrap()["metres"].as_f64().unwrap()
    };
    // R = 1, albedo 0.5: the direct return, half of the light, arrives at 2 R, or slightly earlier because facets are flat.
    let first = light["first"]["metres"].as_f64().unwrap();
    assert!((first - 2.0).abs() < 1e-3, "{first}");
    assert!(percentile(1.0) >= first && percentile(25.0) < 2.001);
    // By the closed form of `oracle/sphere.rs`, 64.6 % of the light has arrived by 3.5 m and 77.0 % by 4 m: 75 % by 3.92 m.
    assert!((percentile(75.0) - 3.92).abs() < 0.06, "{}", percentile(75.0));
    // The bounds on travel times contain all measured travel times.
    let bound = |name: &str| json["render"]["possible"][name].as_f64().unwrap();
    assert!(bound("least") > 1.9 && bound("least") <= first);
    assert!(bound("greatest") > light["last"]["metres"].as_f64().unwrap());
    let nanoseconds = light["first"]["nanoseconds"].as_f64().unwrap();
    assert!((nanoseconds * 0.299792458 - first).abs() < 1e-9);
}

#[test]
fn gates_no_light_can_meet_are_refused_with_the_feasible_range() {
    let here = scene("gated-sphere");
    let small = ["--resolution", "32x32", "--spp", "1"];
    let refused = |gate: &str, part: &str| {
        let parts = ["feasible range", "half by", "try --gate", "--force", part];
        refused(here.path(), &[&small[..], &["--gate", gate]].concat(), 2, &parts);
    };
    refused("0.1m..0.5m", "none arrives before 1.9");
    refused("500m..501m", "no path of 24 segments (--max-depth)");
    // This gate is within the bounds, but all light arrives earlier: the program learns this only by rendering.
    refused("80m..80.1m", "no sample fell inside");
}

/// With `--force`, a gate outside the bounds on travel times gives a black image. The renderer traces nothing for it, unless
/// `--no-cull` switches the bounds off.
#[test]
fn force_writes_the_black_image() {
    let here = scene("gated-sphere");
    let files = ["render", "scene.glb", "-o", "out.exr", "--stats", "s.json"];
    let small = ["--resolution", "32x32", "--spp", "1", "--force", "--gate"];
    for (gate, more, traced) in
        [("500m..501m", None, false), ("1m..1.5m", None, false), ("1m..1.5m", Some("--no-cull"), true)]
    {
        let arguments: Vec<&str> = files.into_iter().chain(small).chain([gate]).chain(more).collect();
        let output = taugate(here.path(), &arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && message.contains("warning: the image is black"), "{message}");
        assert!(here.path().join("out.exr").exists());
        let stats: Value = serde_json::from_slice(&std::fs::read(here.path().join("s.json")).unwrap()).unwrap();
        let rays = stats["renderer"]["closest_rays"].as_u64().unwrap();
        assert_eq!(rays > 0, traced, "{gate} {more:?}: {rays} rays");
        assert_eq!(stats["renderer"]["samples"], 1024);
    }
    // A budget of time is not spent on a black image.
    let minute = ["--resolution", "32x32", "--time", "60s", "--force", "--gate", "500m..501m"];
    let start = Instant::now();
    assert!(taugate(here.path(), &[&files[..], &minute[..]].concat()).status.success());
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
}

#[test]
fn a_render_that_does_not_fit_is_refused_before_it_starts() {
    let here = scene("cornell-box");
    // The number of light vertices is known only after tracing. The estimate is 7 GiB, more than one buffer may have.
    let json = info(here.path(), &["--resolution", "32x32", "--light-paths", "16777216"]);
    let largest = &json["render"]["memory"]["largest"][0];
    assert_eq!(
        (largest["name"].as_str(), largest["fits"].as_bool()),
        (Some("light vertices"), Some(false)),
        "{largest}"
    );
    // The film and its tallies need 1 GiB each. lavapipe allows no buffer of this size, and SwiftShader has less memory in all.
    let film = ["--resolution", "8192x8192"];
    let device = Device::open(None).unwrap();
    let part = match device.info() {
        device if device.largest_buffer() < 1 << 30 => "the film pixels need 1024 MiB",
        device if device.heap_bytes <= 2 << 30 => "the largest part are the film tallies with 1024 MiB",
        _ => return, // The device has enough memory.
    };
    refused(here.path(), &film, 4, &[part, "--resolution"]);
    let json = info(here.path(), &film);
    let problem = json["render"]["memory"]["problem"].as_str().unwrap();
    assert!(problem.contains(part), "{problem}");
}

/// The default number of light paths fits a device with the smallest buffers that Vulkan allows.
#[test]
fn default_light_paths_fit_the_smallest_device() {
    let scene = build(Kind::CornellBox);
    let device = DeviceInfo { max_texels: 1 << 16, max_storage_buffer_range: 128 << 20, ..DeviceInfo::unlimited() };
    for estimator in Estimator::ALL {
        let mut experiment = Experiment::default();
        experiment.render.estimator = Some(estimator);
        experiment.camera.resolution = Some(Resolution([1920, 1080]));
        let settings = resolve(&experiment, &scene).unwrap().settings;
        let prepared = PreparedScene::new(&scene, &settings).unwrap();
        let plan = MemoryPlan::new(&scene, &settings, &prepared, Some(&device)).unwrap();
        plan.check(&device).unwrap_or_else(|e| panic!("{estimator:?}: {e}"));
        assert_eq!(plan.warning(&device), None, "{estimator:?}");
    }
}

/// The program estimates the memory of the light vertices before it traces them, and warns if it is likely too much.
#[test]
fn a_pool_that_is_likely_too_large_is_warned_about() {
    let scene = build(Kind::CornellBox);
    let mut experiment = Experiment::default();
    experiment.render.light_paths = Some(1 << 20);
    let settings = resolve(&experiment, &scene).unwrap().settings;
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let warning = |max_texels: u64| {
        // The same limit in bytes for texel buffers (16 bytes per texel) and storage buffers.
        let device = DeviceInfo { max_texels, max_storage_buffer_range: max_texels * 16, ..DeviceInfo::unlimited() };
        let plan = MemoryPlan::new(&scene, &settings, &prepared, Some(&device)).unwrap();
        (plan.warning(&device), plan.check(&device).is_ok())
    };
    // A vertex takes seven texels. Every path leaves at least one vertex, the estimate is four, plus a reserve of an eighth.
    assert_eq!(warning(40 << 20), (None, true));
    let (message, fits) = warning(20 << 20);
    let message = message.expect("a warning");
    assert!(fits && message.contains("light vertices need 504 MiB") && message.contains("--light-paths"), "{message}");
    assert_eq!(warning(7 << 20), (None, false), "the plan must refuse what does not fit for certain");
}

#[test]
fn without_a_device_info_prints_the_rest_and_says_why() {
    let here = scene("cornell-box");
    let output = Command::new(env!("CARGO_BIN_EXE_taugate"))
        .args(["info", "scene.glb"])
        .env("VK_DRIVER_FILES", "/nonexistent.json")
        .env("VK_ICD_FILENAMES", "/nonexistent.json")
        .current_dir(here.path())
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success());
    for part in ["triangles", "memory", "possible", "note", "travel times were not measured: device: no Vulkan"] {
        assert!(text.contains(part), "expected {part:?} in:\n{text}");
    }
}

#[test]
fn a_device_that_is_not_there_is_an_error() {
    let here = scene("cornell-box");
    let output = taugate(here.path(), &["info", "scene.glb", "--device", "nobody's card"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.code() == Some(4) && message.contains("no device matches --device nobody's card"),
        "{message}"
    );
    assert!(output.stdout.is_empty());
}

#[test]
fn wrong_flags_of_info_are_refused() {
    let here = scene("cornell-box");
    for (flag, value, part) in [
        ("--camera", "nobody", "no camera is called 'nobody'"),
        ("--emitters", "nothing", "no node 'nothing' emits light"),
        ("--max-depth", "0", "--max-depth is 0"),
        ("--resolution", "512", "640x480"),
    ] {
        let output = taugate(here.path(), &["info", "scene.glb", flag, value]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(part), "{flag}: {message}");
    }
}
