//! Scenes on the command line: generated, completed by the program, or empty.

use taugate::internals::generate::{Kind, build, glb};

use crate::grids::npy;
use crate::{fails, folder, names, taugate};

#[test]
fn a_generated_scene_is_described_and_resolved() {
    let here = folder();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    run(&["generate", "cornell-box", "-o", "box.glb"]);
    let info = run(&["info", "box.glb"]);
    for part in ["triangles", "bounds", "camera", "emitter", "materials"] {
        assert!(info.contains(part), "{part} is missing in: {info}");
    }
    let config = run(&["render", "box.glb", "--depth", "1m..2m", "--resolution", "8x6", "--print-config"]);
    assert!(config.contains("gate = \"2m..4m\"") && config.contains("resolution = \"8x6\""), "{config}");
    std::fs::write(here.path().join("e.toml"), &config).unwrap();
    assert_eq!(run(&["render", "e.toml", "--print-config"]), config, "a printed experiment prints itself");
    // A switch is on if the experiment file sets it, or if the command line does.
    for (switch, flag, text) in [
        ("force = true", "--force", "scene = \"box.glb\"\n[gate]\nforce = true\n"),
        ("no-cull = true", "--no-cull", "scene = \"box.glb\"\n[render]\nno-cull = true\n"),
        ("strict = true", "--strict", "scene = \"box.glb\"\n[render]\nstrict = true\n"),
    ] {
        std::fs::write(here.path().join("switch.toml"), text).unwrap();
        assert!(run(&["render", "switch.toml", "--print-config"]).contains(switch), "{switch} from the file");
        assert!(run(&["render", "box.glb", flag, "--print-config"]).contains(switch), "{flag}");
        assert!(!run(&["render", "box.glb", "--print-config"]).contains(switch), "{switch}, which nobody set");
    }
    std::fs::remove_file(here.path().join("switch.toml")).unwrap();
    std::fs::create_dir(here.path().join("sub")).unwrap();
    std::fs::write(here.path().join("sub/e.toml"), &config).unwrap();
    assert_eq!(run(&["render", "sub/e.toml", "--print-config"]), config, "the file may be in another folder");
    std::fs::remove_dir_all(here.path().join("sub")).unwrap();

    fails(here.path(), &["generate", "palace", "-o", "p.glb"], 2, "choose one of cornell-box");
    fails(here.path(), &["generate", "cornell-box", "-o", "p.obj"], 2, "must end in .glb");
    run(&["generate", "cornell-box", "--roughness", "0.05", "--triangles", "100", "-o", "fine.glb"]);
    std::fs::remove_file(here.path().join("fine.glb")).unwrap();
    fails(here.path(), &["generate", "cornell-box", "--roughness", "2", "-o", "p.glb"], 2, "from 0 to 1");
    fails(here.path(), &["generate", "door-ajar", "--triangles", "9", "-o", "p.glb"], 2, "no number of triangles");
    let wrong = |flag: &str, value: &str, part: &str| {
        fails(here.path(), &["render", "box.glb", "-o", "a.exr", flag, value], 2, part);
    };
    wrong("--camera", "nobody", "no camera is called 'nobody'; choose one of ");
    wrong("--emitters", "nothing", "no node 'nothing' emits light; --emitters may name ");
    wrong("--crop", "0,9999,0,5", "inside the image");
    wrong("--spp", "0", "--spp is 0");
    wrong("--gate", "100m+0.0001mm", "--force");
    wrong("--gate", "0m..1e300m", "for a gate without an end write inf");
    let config = run(&["render", "box.glb", "--gate", "1m..1e30m", "--print-config"]);
    assert!(config.contains("gate = \"1m..1e30m\""), "{config}");
    let twice = |a: &str, b: &str| run(&["render", "box.glb", "--print-config", "--emitters", a, "--emitters", b]);
    assert!(twice("light", "light").contains("emitters = [\"light\", \"light\"]"));
    assert!(twice("light", "scene").contains("emitters = \"scene\""));
    assert_eq!(names(here.path()), ["box.glb", "e.toml"]);
}

/// However the user spells the path, an output never replaces a file that the settings name.
#[test]
fn what_the_settings_read_is_not_overwritten() {
    let here = folder();
    let here = here.path();
    assert!(taugate(here, &["generate", "cornell-box", "-o", "box.glb"]).status.success());
    let smoke = npy("<f4", "(1, 1, 2)", &[0.5, 0.25]);
    std::fs::write(here.join("smoke.npy"), &smoke).unwrap();
    let small = ["render", "box.glb", "--resolution", "4x4", "--spp", "1", "--sigma-s", "0.1"];
    let small = [&small[..], &["--medium-bounds=-0.5,0.5,-0.5,0.5,1.5,0.5", "--density-grid"]].concat();
    let refused = |grid: &str, output: &str| {
        let message = fails(here, &[&small[..], &[grid, "-o", output]].concat(), 2, "is a file that the settings name");
        assert!(message.contains("choose another name"), "{message}");
        assert_eq!(std::fs::read(here.join(grid)).unwrap(), smoke);
    };
    refused("smoke.npy", "./smoke.npy");
    assert_eq!(names(here), ["box.glb", "smoke.npy"]);
    // The array fog.npy would remove the variances of an earlier array.
    std::fs::rename(here.join("smoke.npy"), here.join("fog.variance.npy")).unwrap();
    refused("fog.variance.npy", "fog.npy");
}

/// However the user spells the path, an output never overwrites a file that the scene reads.
#[test]
fn what_the_scene_reads_is_not_overwritten() {
    let here = folder();
    let scene = r#"{"asset": {"version": "2.0"}, "images": [{"uri": "wood%20floor.png"}]}"#;
    std::fs::write(here.path().join("room.gltf"), scene).unwrap();
    std::fs::write(here.path().join("wood floor.png"), "a texture").unwrap();
    for picture in [&["--png", "wood floor.png"][..], &["--png", "./wood floor.png"]] {
        let arguments = [&["render", "room.gltf", "-o", "out.exr"], picture].concat();
        fails(here.path(), &arguments, 2, "is a file that the scene room.gltf reads; choose another name");
    }
    fails(here.path(), &["render", "room.gltf", "-o", "wood floor.exr", "--png"], 2, "that the scene room.gltf reads");
    let frames = ["render", "room.gltf", "--gate-keys", "0=1m..2m", "--frames", "0..2", "-o", "f#.exr"];
    let sheet = [&frames[..], &["--contact-sheet", "wood floor.png"]].concat();
    fails(here.path(), &sheet, 2, "that the scene room.gltf reads");
    assert_eq!(std::fs::read(here.path().join("wood floor.png")).unwrap(), b"a texture");
    // With another name, the command passes this check and fails later, when it loads the scene.
    fails(here.path(), &["render", "room.gltf", "-o", "out.exr", "--png"], 2, "room.gltf: ");
    assert_eq!(names(here.path()), ["room.gltf", "wood floor.png"]);
}

/// The experiment that the program prints describes the camera and the lights that it added, with all their numbers.
#[test]
fn a_scene_without_camera_and_light_is_completed() {
    let here = folder();
    let mut scene = build(Kind::CornellBox);
    scene.cameras.clear();
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    std::fs::write(here.path().join("dark.glb"), glb::write(&scene)).unwrap();
    let printed = |arguments: &[&str]| {
        let output = taugate(here.path(), &[&["render", "-o", "x.exr", "--print-config"], arguments].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let lamps = ["--headlamp", "5", "--lamp", "-1,1,0.5,2", "--lamp", "0,1,0,3", "--emitters", "lamp-2,headlamp"];
    let place = ["--look-from", "-0.5,1,3", "--up", "-1,0,0", "--fov", "50", "--principal-point", "-0.1,0.5"];
    let table = [
        (&[][..], &["camera = \"auto\"", "look-from = [", "fov = 40.0", "headlamp = "][..]),
        (&place, &["camera = \"look\"", "look-from = [-0.5, 1.0, 3.0]", "up = [-1.0, 0.0, 0.0]"]),
        (&lamps, &["headlamp = 5.0", "lamp = [[-1.0, 1.0, 0.5, 2.0], [0.0, 1.0, 0.0, 3.0]]"]),
    ];
    for (flags, parts) in table {
        let first = printed(&[&["dark.glb"], flags].concat());
        for part in parts {
            assert!(first.contains(part), "expected {part:?} in:\n{first}");
        }
        std::fs::write(here.path().join("e.toml"), &first).unwrap();
        assert_eq!(printed(&["e.toml"]), first);
    }
    fails(
        here.path(),
        &["render", "dark.glb", "-o", "x.exr", "--emitters", "sun"],
        2,
        "(--headlamp, --lamp and --sky add lights)",
    );
}

#[test]
fn a_scene_without_surfaces_is_described_but_not_rendered() {
    let here = folder();
    let empty = r#"{ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{}] }"#;
    std::fs::write(here.path().join("empty.gltf"), empty).unwrap();
    fails(
        here.path(),
        &["render", "empty.gltf", "-o", "a.exr"],
        2,
        "has no surfaces; export a scene with visible meshes",
    );
    let text = String::from_utf8(taugate(here.path(), &["info", "empty.gltf"]).stdout).unwrap();
    for part in ["the scene has no triangles", "cannot be rendered: has no surfaces"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn a_scene_of_fog_and_a_lamp_needs_no_surfaces() {
    let here = folder();
    let fog = r#"{ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "extras": { "medium": { "sigma_s": 0.2, "sigma_a": 0.05 } } }] }"#;
    std::fs::write(here.path().join("fog.gltf"), fog).unwrap();
    let view = ["--look-from", "0,0,5", "--look-at", "0,0,0", "--lamp", "1,1,0,5", "--resolution", "8x8"];
    let with = |words: &[&'static str]| [words, &view].concat();
    let output = taugate(here.path(), &with(&["render", "fog.gltf", "--gate", "8m..9m", "--spp", "1", "-o", "a.exr"]));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text_of = |words: &[&'static str]| String::from_utf8(taugate(here.path(), &with(words)).stdout).unwrap();
    let text = text_of(&["info", "fog.gltf"]);
    for part in [
        "mean free path 4.0000 m, 80.000 % scattered",
        "in all space",
        "optical thickness unlimited along",
        "m (at the median; at least 2 % of the time in which 90 % of the light arrives wide)",
    ] {
        assert!(text.contains(part), "{text}");
    }
    assert!(!text.contains("triangles; export"), "{text}");
    // Clear for blue light, which goes straight on forever.
    let blue = text_of(&["info", "fog.gltf", "--sigma-a", "0.3,0.1,0"]);
    let part = "optical thickness unlimited along the central ray";
    assert!(blue.contains(part) && blue.contains("; 33.333 % of the light goes straight through"), "{blue}");
}
