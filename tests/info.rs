//! `taugate info` and the gates that no light can meet, from outside. Needs a device.

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

/// A folder with one of the project's own scenes in it.
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

/// A render that must fail with `code`, naming all of `parts`, and leave nothing.
fn refused(folder: &Path, more: &[&str], code: i32, parts: &[&str]) {
    let arguments = [&["render", "scene.glb", "-o", "out.exr", "--png", "--stats", "out.json"], more].concat();
    let output = taugate(folder, &arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{more:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{more:?}: expected {part:?} in: {message}");
    }
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1, "{more:?} leaves something");
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

    // The suggested gate is one that renders.
    let gate = text.split("--gate ").nth(1).and_then(|rest| rest.split_whitespace().next()).expect("a suggestion");
    let render = ["render", "scene.glb", "-o", "out.exr", "--resolution", "32x32", "--spp", "1", "--gate", gate];
    let output = taugate(here.path(), &render);
    assert!(output.status.success(), "{gate}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A lamp in the plane of the ceiling is speckled: both commands say so, and what to do.
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
    let said = String::from_utf8(output.stderr).unwrap();
    for text in [&found[0].to_string(), &said] {
        assert!(text.contains("'light' lies in the plane of 'ceiling'") && text.contains("in front"), "{text}");
    }
    let json = std::fs::read_to_string(here.path().join("out.json")).unwrap();
    assert_eq!(warnings(&serde_json::from_str(&json).unwrap()), found);
    // As it is shipped, the lamp hangs a centimetre below.
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
    // R = 1, albedo 0.5: the direct return, half of the light, comes at 2 R, up to the depth of the flat facets.
    let first = light["first"]["metres"].as_f64().unwrap();
    assert!((first - 2.0).abs() < 1e-3, "{first}");
    assert!(percentile(1.0) >= first && percentile(25.0) < 2.001);
    // By 3.5 m 64.6 % has arrived, by 4 m 77.0 % by the closed form of `oracle/sphere.rs`: 75 % at 3.92 m.
    assert!((percentile(75.0) - 3.92).abs() < 0.06, "{}", percentile(75.0));
    // The bounds hold what was seen.
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
    // Within the bounds, but after the last light there is: known only when it was rendered.
    refused("80m..80.1m", "no sample fell inside");
}

/// Before the first light that there can be, and after the last, nothing is traced unless culling is switched off.
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
    // Time is not spent on black.
    let minute = ["--resolution", "32x32", "--time", "60s", "--force", "--gate", "500m..501m"];
    let start = Instant::now();
    assert!(taugate(here.path(), &[&files[..], &minute[..]].concat()).status.success());
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
}

#[test]
fn a_render_that_does_not_fit_is_refused_before_it_starts() {
    let here = scene("cornell-box");
    // How many vertices the paths leave is not known before they are traced; 7 GiB are likely, more than a buffer may have.
    let json = info(here.path(), &["--resolution", "32x32", "--light-paths", "16777216"]);
    let largest = &json["render"]["memory"]["largest"][0];
    assert_eq!(
        (largest["name"].as_str(), largest["fits"].as_bool()),
        (Some("light vertices"), Some(false)),
        "{largest}"
    );
    // The film and its tallies, of 1 GiB each: more than lavapipe allows a buffer, and than SwiftShader has in all.
    let film = ["--resolution", "8192x8192"];
    let device = Device::open(None).unwrap();
    let part = match device.info() {
        device if device.largest_buffer() < 1 << 30 => "the film pixels need 1024 MiB",
        device if device.heap_bytes <= 2 << 30 => "the largest part are the film tallies with 1024 MiB",
        _ => return, // There is room.
    };
    refused(here.path(), &film, 4, &[part, "--resolution"]);
    let json = info(here.path(), &film);
    let problem = json["render"]["memory"]["problem"].as_str().unwrap();
    assert!(problem.contains(part), "{problem}");
}

/// Where buffers are as small as Vulkan lets them be, nobody has to ask for fewer light paths than the default.
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

/// What the light vertices will need is estimated before they are traced, and said if it is too much.
#[test]
fn a_pool_that_is_likely_too_large_is_warned_about() {
    let scene = build(Kind::CornellBox);
    let mut experiment = Experiment::default();
    experiment.render.light_paths = Some(1 << 20);
    let settings = resolve(&experiment, &scene).unwrap().settings;
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let warning = |max_texels: u64| {
        // Kernels see as much as texels as in a storage buffer.
        let device = DeviceInfo { max_texels, max_storage_buffer_range: max_texels * 16, ..DeviceInfo::unlimited() };
        let plan = MemoryPlan::new(&scene, &settings, &prepared, Some(&device)).unwrap();
        (plan.warning(&device), plan.check(&device).is_ok())
    };
    // A vertex is seven texels; every path leaves one for certain, four are the estimate, and there is room for an eighth more.
    assert_eq!(warning(40 << 20), (None, true));
    let (said, fits) = warning(20 << 20);
    let said = said.expect("a warning");
    assert!(fits && said.contains("light vertices need 504 MiB") && said.contains("--light-paths"), "{said}");
    assert_eq!(warning(7 << 20), (None, false), "what is certain is refused instead");
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
