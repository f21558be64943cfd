//! Runs `taugate info`, and renders with gates that no light reaches. Needs a device.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;
use taugate::internals::generate::{Kind, build};

use crate::{names, taugate};

/// A folder with one of the generated scenes as `scene.glb`.
pub fn scene(name: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    assert!(taugate(folder.path(), &["generate", name, "-o", "scene.glb"]).status.success());
    folder
}

pub fn info(folder: &Path, more: &[&str]) -> Value {
    let output = taugate(folder, &[&["info", "scene.glb", "--json"], more].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs a render that must fail with `code` and a message that contains all `parts`, and must write no file.
pub fn refused(folder: &Path, more: &[&str], code: i32, parts: &[&str]) {
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
    // In the closed form of `self_check/sphere.rs`, 75 % of the light has arrived by 3.92 m (64.6 % by 3.5 m, 77.0 % by 4 m).
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
    let refused_with = |flags: &[&str], try_this: &str, part: &str| {
        let parts = ["feasible range", "half by", try_this, "--force", part];
        refused(here.path(), &[&small[..], flags].concat(), 2, &parts);
    };
    let refused = |gate: &str, part: &str| refused_with(&["--gate", gate], "try --gate 1", part);
    refused("0.1m..0.5m", "none arrives before 1.9");
    refused("500m..501m", "no path of 24 segments (--max-depth)");
    // This gate is within the bounds, but all light arrives earlier: the program learns this only by rendering.
    refused("80m..80.1m", "no sample fell inside");
    refused_with(&["--gates", "500m..600m/20"], "try --gates 1", "m depth meet no light: no path of 24 segments");
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
    let hour = ["--resolution", "32x32", "--time", "1h", "--force", "--gate", "500m..501m"];
    let start = Instant::now();
    assert!(taugate(here.path(), &[&files[..], &hour[..]].concat()).status.success());
    assert!(start.elapsed() < Duration::from_secs(1800), "{:?}", start.elapsed());
}

#[test]
fn an_experiment_has_its_camera_its_medium_and_its_gate() {
    let here = scene("cornell-box");
    let text = "scene = 'scene.glb'\n[camera]\nresolution = '40x30'\n[medium]\nsigma-s = 0.01\nphase-g = 0.5\n[gate]\ngate = '4m..8m'\n\
                [output]\noutput = 'scene.glb'\n";
    std::fs::write(here.path().join("e.toml"), text).unwrap();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), &[&["info", "e.toml"], arguments].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let json: Value = serde_json::from_str(&run(&["--json"])).unwrap();
    assert_eq!(json["render"]["resolution"], serde_json::json!([40, 30]));
    assert_eq!(json["media"].as_array().unwrap().len(), 1);
    // Fog without bounds may scatter light at any distance.
    assert!(json["render"]["possible"]["greatest"].is_null(), "{}", json["render"]["possible"]);
    let share = json["render"]["gate"]["share"].as_f64().unwrap();
    assert!((0.5..0.99).contains(&share), "{share}");
    let text = run(&["--resolution", "16x16"]);
    assert!(text.contains("16x16 through") && text.contains("without an upper limit"), "{text}");
    assert!(text.contains("% of the light arrives in it"), "{text}");
    assert!(names(here.path()) == ["e.toml", "scene.glb"]);
}

#[test]
fn a_broken_driver_manifest_is_no_lack_of_memory() {
    let here = scene("cornell-box");
    std::fs::write(here.path().join("broken.json"), "{ \"ICD\": { \"library_path\": 3").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_taugate"))
        .args(["render", "scene.glb", "-o", "out.exr", "--resolution", "8x8", "--spp", "1"])
        .env("VK_DRIVER_FILES", here.path().join("broken.json"))
        .env("VK_ICD_FILENAMES", here.path().join("broken.json"))
        .current_dir(here.path())
        .output()
        .unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(4), "{message}");
    assert!(!message.contains("out of memory") && !message.contains("--resolution"), "{message}");
    assert!(message.contains("driver manifests") || message.contains("no Vulkan driver"), "{message}");
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

/// `info` suggests nothing that `render` refuses, and a scene without camera and light renders in one command.
#[test]
fn a_scene_without_camera_and_light_is_described_and_rendered() {
    let mut scene = build(Kind::CornellBox);
    scene.cameras.clear();
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    let here = tempfile::tempdir().unwrap();
    std::fs::write(here.path().join("scene.glb"), taugate::internals::generate::glb::write(&scene)).unwrap();
    let json = info(here.path(), &["--look-from", "0,1,3", "--resolution", "32x32"]);
    assert_eq!((&json["cameras"][0]["name"], &json["emitters"][0]["node"]), (&"look".into(), &"headlamp".into()));
    assert!(json["notes"][0].as_str().unwrap().contains("--headlamp"), "{}", json["notes"]);
    let gate = json["render"]["light"]["suggested_gate"].as_str().unwrap();
    let small = ["render", "scene.glb", "-o", "out.exr", "--resolution", "32x32", "--spp", "2"];
    for more in [&[][..], &["--look-from", "0,1,3", "--gate", gate]] {
        let output = taugate(here.path(), &[&small[..], more].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && !message.contains("black"), "{message}");
        assert!(message.contains("note: the scene has no light that can be rendered"), "{message}");
        assert_eq!(message.contains("note: the scene has no camera"), more.is_empty(), "{message}");
    }

    // At 9 km, 2 % of the scene's diagonal are about 40 steps of 32-bit travel times: too thin without a warning.
    let far = ["--look-from", "0,1,9000", "--look-at", "0,1,0", "--fov", "0.02"];
    let json = info(here.path(), &[&far[..], &["--resolution", "32x32"]].concat());
    let gate = json["render"]["light"]["suggested_gate"].as_str().unwrap();
    let output = taugate(here.path(), &[&small[..], &far, &["--gate", gate]].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && !message.contains("32-bit travel times"), "{gate}: {message}");
}
/// A pixel of the lamp and a pixel of the back wall. The first light at the wall comes from the lamp, by the shortest way.
#[test]
fn a_pixel_has_an_object_and_its_own_times() {
    let here = scene("cornell-box");
    let small = ["--resolution", "64x64", "--pixel"];
    let at = |pixel: &str| info(here.path(), &[&small[..], &[pixel]].concat());
    let wall = at("32,20");
    let shown = &wall["render"]["pixel"];
    assert_eq!((&shown["column"], &shown["row"], &shown["object"]["node"]), (&32.into(), &20.into(), &"back".into()));
    let of = |name: &str| shown["object"][name].as_f64().unwrap();
    // The camera is 4.9 m before the back wall.
    assert!((of("axial_metres") - 4.9).abs() < 1e-3 && of("distance_metres") >= of("axial_metres"), "{shown}");
    let position: Vec<f64> =
        shown["object"]["position"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    assert!((position[2] + 1.0).abs() < 1e-3, "{position:?}");
    let first = wall["render"]["light"]["first"]["metres"].as_f64().unwrap();
    let first_of_all = info(here.path(), &small[..2])["render"]["light"]["first"]["metres"].as_f64().unwrap();
    assert!(first > first_of_all && first > 4.9 + 0.9 && first < 4.9 + 1.6, "{first} {first_of_all}");
    assert_eq!(wall["render"]["crop"], "32,33,20,21");

    let output = taugate(here.path(), &["info", "scene.glb", "--resolution", "64x64", "--pixel", "32,20"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("32,20 shows node 'back' (mesh back[0], material ") && text.contains("; in this pixel)"),
        "{text}"
    );
    assert!(text.contains("m from the camera, "), "{text}");
    for (arguments, part) in [
        (&["--pixel", "64,0"][..], "--pixel 64,0 is outside the image of 64x64"),
        (&["--pixel", "6"], "like 120,80"),
        (&["--pixel", "6,6", "--crop", "0,1,0,1"], "cannot be used with"),
        (&["--crop", "0,65,0,1"], "does not lie inside the image"),
    ] {
        let output = taugate(here.path(), &[&["info", "scene.glb", "--resolution", "64x64"], arguments].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(part), "{arguments:?}: {message}");
    }
}

/// A crop of the back wall, which the lamp lights from 0.82 m away and which is 4.97 m from the camera.
#[test]
fn a_crop_has_its_own_times() {
    let here = scene("cornell-box");
    let arguments = ["--resolution", "64x64", "--crop", "24,40,16,24"];
    let json = info(here.path(), &arguments);
    let first = json["render"]["light"]["first"]["metres"].as_f64().unwrap();
    assert!((5.75..6.0).contains(&first) && json["render"]["crop"] == "24,40,16,24", "{first}");
    let output = taugate(here.path(), &[&["info", "scene.glb"], &arguments[..]].concat());
    assert!(String::from_utf8(output.stdout).unwrap().contains("; in the crop)"));
}

#[test]
fn a_map_shows_when_light_arrives() {
    let here = scene("gated-sphere");
    let maps = ["--resolution", "32x24", "--crop", "4,20,2,14", "--map", "a.png", "--map", "a.exr"];
    let json = info(here.path(), &maps);
    let map = &json["render"]["map"];
    assert_eq!((&map["files"], &map["pixels"]), (&serde_json::json!(["a.png", "a.exr"]), &192.into()));
    assert_eq!(map["lit_pixels"], 192);
    // Every pixel sees the wall of the sphere, 1 m from lamp and camera.
    let [first, last] = ["first", "last"].map(|name| map["scale"][name]["metres"].as_f64().unwrap());
    assert!((first - 2.0).abs() < 1e-3 && (last - 2.0).abs() < 1e-3, "{first} {last}");
    let file = std::io::BufReader::new(std::fs::File::open(here.path().join("a.png")).unwrap());
    let reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (16, 12));
    let meta = exr::prelude::MetaData::read_from_file(here.path().join("a.exr"), true).unwrap();
    let window = meta.headers[0].data_window();
    assert_eq!(meta.headers[0].channels.list[0].name.to_string(), "arrival.Z");
    assert_eq!((window.position.0, window.position.1, window.size.0, window.size.1), (4, 2, 16, 12));

    let output = taugate(here.path(), &[&["info", "scene.glb"], &maps[..]].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("a.png, a.exr: first light per pixel, from ") && text.contains(" in dark blue to "),
        "{text}"
    );
    for (file, part) in [("a.jpg", "must end in .png or .exr"), ("no/a.png", "does not exist")] {
        let output = taugate(here.path(), &["info", "scene.glb", "--map", file]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(part), "{file}: {message}");
    }
}

/// The text report lists some emitters, the JSON report all of them.
#[test]
fn long_lists_are_cut() {
    let here = scene("hundred-lamps");
    let output = taugate(here.path(), &["info", "scene.glb", "--resolution", "16x16"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("emitter ")).count(), 21, "{text}");
    assert!(text.contains("emitter     ... and 80 more, listed by --json"), "{text}");
    let json = info(here.path(), &["--resolution", "16x16"]);
    assert_eq!(json["emitters"].as_array().unwrap().len(), 100);
}

/// A floor that is seen from below is black. `info` says which share of the view is black, and a gated render says why it sees nothing.
#[test]
fn surfaces_that_are_black_from_behind_are_named() {
    let mut box_scene = build(Kind::CornellBox);
    for material in box_scene.materials.iter_mut().filter(|material| material.emission == [0.0; 3]) {
        material.double_sided = false;
    }
    let here = tempfile::tempdir().unwrap();
    std::fs::write(here.path().join("scene.glb"), taugate::internals::generate::glb::write(&box_scene)).unwrap();
    // From behind the back wall, the whole view is the back of this wall.
    let view = ["--look-from", "0,1,-3", "--look-at", "0,1,0", "--fov", "20", "--resolution", "64x64"];
    let report = info(here.path(), &view);
    assert_eq!(report["render"]["black_backs"], 1.0, "{report}");
    assert!(report["notes"].to_string().contains("--double-sided makes both sides reflect"), "{report}");
    refused(
        here.path(),
        &[&view[..], &["--gate", "4m..8m", "--spp", "1"]].concat(),
        2,
        &["100 % of the surface in view"],
    );

    let both = info(here.path(), &[&view[..], &["--double-sided"]].concat());
    assert_eq!(both["render"]["black_backs"], 0.0, "{both}");
    // Seen from inside, the walls of the box show their fronts.
    assert_eq!(info(here.path(), &["--resolution", "64x64"])["render"]["black_backs"], 0.0);
}

/// The light of suns and skies has no travel time, so the report suggests no gate for it.
#[test]
fn info_lists_suns_and_skies_and_suggests_no_gate_for_them() {
    let mut scene = build(Kind::CornellBox);
    let kind = taugate::internals::scene::LightKind::Directional { irradiance: [3.0, 2.0, 1.0] };
    scene.add_light("sun", glam::DVec3::ZERO, glam::DVec3::NEG_Z, kind);
    let here = tempfile::tempdir().unwrap();
    let written =
        |scene| std::fs::write(here.path().join("scene.glb"), taugate::internals::generate::glb::write(scene));
    let small = ["--resolution", "32x32"];
    written(&scene).unwrap();
    // With a lamp, the report is about the light of the lamp.
    let both = info(here.path(), &small);
    let lamp = info(here.path(), &[&small[..], &["--emitters", "light"]].concat());
    let kind = both["emitters"][0]["kind"].as_str().unwrap();
    assert!(kind.contains("(3, 2, 1) W/m^2") && both["emitters"][0]["watts"].is_null(), "{kind}");
    assert_eq!(both["render"]["possible"], lamp["render"]["possible"]);
    assert!(lamp["render"]["light"]["suggested_gate"].is_string());
    assert_eq!(both["render"]["light"], lamp["render"]["light"]);
    let alone = info(here.path(), &[&small[..], &["--emitters", "sun"]].concat());
    assert!(alone["render"]["possible"].is_null() && alone["render"]["light"].is_null(), "{alone}");
    assert!(alone["notes"][0].as_str().unwrap().contains("no travel time"), "{alone}");
    let of_pixel = ["info", "scene.glb", "--resolution", "32x32", "--emitters", "sun", "--pixel", "16,10"];
    let text = String::from_utf8(taugate(here.path(), &of_pixel).stdout).unwrap();
    assert!(text.contains("16,10 shows node 'back'"), "{text}");
    for node in ["sun", "sky"] {
        let flags = ["--sky", "1", "--emitters", node, "--gate", "1m..2m"];
        refused(here.path(), &flags, 2, &[&format!("'{node}' is infinitely far away"), "from light"]);
    }
    let sky = info(here.path(), &[&small[..], &["--sky", "2", "--sky-scale", "0.5", "--emitters", "sky"]].concat());
    let kind = sky["emitters"][1]["kind"].as_str().unwrap();
    assert!(kind.contains("(3.1416, 3.1416, 3.1416) W/m^2") && sky["render"]["light"].is_null(), "{sky}");
}
