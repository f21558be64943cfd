//! Sequences of frames, on the command line.

use std::path::Path;

use taugate::internals::generate::{Kind, build, glb};
use taugate::internals::image::exr_file::read_picture;
use taugate::internals::image::exr_header::read_settings;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::scene::LightKind;

use crate::{fails, folder, names, taugate};

const SMALL: [&str; 8] = ["--resolution", "12x8", "--spp", "2", "--sampling", "uniform", "--light-paths", "500"];

/// Width, height and pixels of a picture.
fn rgb8(path: &Path) -> (u32, u32, Vec<[u8; 3]>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!(reader.output_color_type(), (png::ColorType::Rgb, png::BitDepth::Eight));
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    (info.width, info.height, rgb.as_chunks().0.to_vec())
}

fn with(scene: &str) -> tempfile::TempDir {
    let here = folder();
    assert!(taugate(here.path(), &["generate", scene, "-o", "scene.glb"]).status.success());
    here
}

/// Renders and returns what the program prints.
fn render(here: &Path, flags: &[&str]) -> String {
    let output = taugate(here, &[&["render", "scene.glb"], &SMALL[..], flags].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{flags:?}: {message}");
    message
}

fn pixels(here: &Path, name: &str) -> Vec<f32> {
    let picture = read_picture(&here.join(name)).unwrap();
    assert!(picture.rgb.iter().any(|&x| x > 0.0), "{name} is black, which proves nothing");
    picture.rgb
}

#[test]
fn frames_of_a_moving_scene_are_those_rendered_alone() {
    let here = with("street");
    let frames = ["--depth", "20m..40m", "--frames", "3..6", "--fps", "4", "-o", "f.##.exr", "--gif", "f.gif"];
    let message = render(here.path(), &[&frames[..], &["--contact-sheet", "sheet.png"]].concat());
    assert!(message.contains("frame 5: 3 of 3") && !message.contains("warning"), "{message}");
    assert_eq!(names(here.path()), ["f.03.exr", "f.04.exr", "f.05.exr", "f.gif", "scene.glb", "sheet.png"]);
    render(here.path(), &["--depth", "20m..40m", "--at", "1s", "-o", "alone.exr"]);
    assert!(pixels(here.path(), "alone.exr") == pixels(here.path(), "f.04.exr"));
    assert!(pixels(here.path(), "f.05.exr") != pixels(here.path(), "f.04.exr"), "the car stands still");

    // The animation has all frames at the right speed; the contact sheet is three frames wide.
    let file = std::fs::File::open(here.path().join("f.gif")).unwrap();
    let gif = gif::Decoder::new(file).unwrap();
    assert_eq!((gif.width(), gif.height(), gif.repeat()), (12, 8, gif::Repeat::Infinite));
    let delays: Vec<u16> = gif.into_iter().map(|frame| frame.unwrap().delay).collect();
    assert_eq!(delays, [25; 3]);
    let (width, height, _) = rgb8(&here.path().join("sheet.png"));
    assert_eq!((width, height), (36, 8));

    // Existing frames are kept. A missing frame is rendered again, with the same bits.
    let before = pixels(here.path(), "f.03.exr");
    std::fs::remove_file(here.path().join("f.03.exr")).unwrap();
    assert!(render(here.path(), &frames).contains("2 of 3 frames exist"));
    assert!(pixels(here.path(), "f.03.exr") == before);
    let other = [&["render", "scene.glb", "--seed", "5"], &SMALL[..], &frames].concat();
    fails(here.path(), &other, 2, "f.03.exr exists, but has other settings");
}

/// A camera and a lamp that move need no new BVH, and give the bits of frames that are rendered alone.
#[test]
fn a_moving_camera_and_lamp_keep_the_scene() {
    let here = folder();
    let mut scene = build(Kind::CornellBox);
    scene.cameras[0].name = "rig".into();
    let place = scene.cameras[0].transform.translation;
    let intensity = [3.0, 2.0, 1.0];
    scene.add_light("rig", place, glam::DVec3::NEG_Z, LightKind::Point { intensity });
    let positions = [0.0, 0.3].map(|x| (place + glam::DVec3::new(x, 0.0, 0.0)).as_vec3().to_array());
    let motion = glb::Motion { node: "rig", times: vec![0.0, 1.0], positions: positions.to_vec() };
    std::fs::write(here.path().join("scene.glb"), glb::write_moving(&scene, Some(&motion))).unwrap();
    let here = here.path();
    let gate = ["--gates", "4m..8m/2", "--estimator", "lcs"];
    let frames = ["--frames", "0..3", "--fps", "2", "-o", "f#.exr", "--stats", "f#.json"];
    render(here, &[&gate[..], &frames].concat());
    for (frame, at) in ["0s", "0.5s", "1s"].into_iter().enumerate() {
        render(here, &[&gate[..], &["--at", at, "-o", "alone.exr"]].concat());
        assert!(pixels(here, "alone.exr") == pixels(here, &format!("f{frame}.exr")), "frame {frame}");
    }
    assert!(pixels(here, "f0.exr") != pixels(here, "f1.exr") && pixels(here, "f1.exr") != pixels(here, "f2.exr"));
    for (frame, rebuilds) in [(0, true), (1, false), (2, false)] {
        let stats = std::fs::read_to_string(here.join(format!("f{frame}.json"))).unwrap();
        assert_eq!(stats.contains("build BVH"), rebuilds, "frame {frame}");
        let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
        assert_eq!(stats["renderer"]["samples"], 2 * 12 * 8, "frame {frame}");
    }
}

/// Writes the scene as `name`, with an animation that scales `node` to nothing at 0.5 s and back to 1 at 1 s.
fn write_shrinking(path: &Path, scene: &taugate::Scene, node: &'static str) {
    let motion = glb::Motion { node, times: vec![0.0, 0.5, 1.0], positions: vec![[1.0; 3], [0.0; 3], [1.0; 3]] };
    let mut bytes = glb::write_moving(scene, Some(&motion));
    let (moves, scales) = (br#""path":"translation""#, br#""path":"scale"      "#);
    let at = bytes.windows(moves.len()).position(|window| window == moves).unwrap();
    bytes[at..at + moves.len()].copy_from_slice(scales);
    std::fs::write(path, bytes).unwrap();
}

/// A spot without a direction once ended the whole sequence.
#[test]
fn a_spot_is_off_while_it_is_scaled_to_nothing() {
    let here = folder();
    let mut scene = build(Kind::CornellBox);
    let place = scene.cameras[0].transform.translation;
    scene.add_light("spot", place, glam::DVec3::NEG_Z, LightKind::spot([30.0; 3], 0.2, 0.4));
    write_shrinking(&here.path().join("scene.glb"), &scene, "spot");
    let here = here.path();
    let message = render(here, &["--estimator", "pt", "--frames", "0..3", "--fps", "2", "-o", "f#.exr"]);
    assert!(message.contains("are off (first: node `spot`)") && !message.contains("headlamp"), "{message}");
    render(here, &["--estimator", "pt", "--at", "0.5s", "--emitters", "light", "-o", "without.exr"]);
    assert!(pixels(here, "f1.exr") == pixels(here, "without.exr"));
    assert!(pixels(here, "f0.exr") == pixels(here, "f2.exr") && pixels(here, "f0.exr") != pixels(here, "f1.exr"));

    // The only lamp is no reason for a headlamp, neither in the first frame nor in another one. A frame without light is left out.
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    write_shrinking(&here.join("scene.glb"), &scene, "spot");
    for first in ["0", "1"] {
        let name = format!("{first}-#.exr");
        let frames = format!("{first}..3");
        let flags = ["--frames", &frames, "--fps", "2", "-o", &name];
        let output = taugate(here, &[&["render", "scene.glb"], &SMALL[..], &flags].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(
            message.contains("1 of ") && message.contains("the first is frame 1") && !message.contains("a headlamp"),
            "{message}"
        );
        assert!(!here.join(format!("{first}-1.exr")).exists() && here.join(format!("{first}-2.exr")).exists());
    }
}

/// A camera that cannot be used in one frame must not be replaced by another one, and must not end the other frames.
#[test]
fn a_frame_whose_camera_is_scaled_to_nothing_is_left_out() {
    let here = folder();
    let mut scene = build(Kind::CornellBox);
    let other = taugate::Camera { name: "other".into(), ..scene.cameras[0].clone() };
    scene.cameras[0].name = "eye".into();
    scene.cameras.push(other);
    write_shrinking(&here.path().join("scene.glb"), &scene, "eye");
    let here = here.path();
    let flags = ["--frames", "0..3", "--fps", "2", "-o", "f#.exr", "--gif", "f.gif"];
    let command = [&["render", "scene.glb"], &SMALL[..], &flags].concat();
    for _ in 0..2 {
        let output = taugate(here, &command);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains("1 of 3 frames could not be rendered"), "{message}");
        assert!(
            message.contains("the first is frame 1:") && message.contains("camera `eye` is scaled to nothing"),
            "{message}"
        );
        assert_eq!(names(here), ["f0.exr", "f2.exr", "scene.glb"]);
    }
    // Another camera does not mind.
    render(here, &["--camera", "other", "--frames", "0..3", "--fps", "2", "-o", "o#.exr"]);
    // Alone, the camera is an error, and the default is a camera that can be used.
    let alone = [&["render", "scene.glb", "--at", "0.5s", "-o", "a.exr"], &SMALL[..]].concat();
    fails(
        here,
        &[&alone[..], &["--camera", "eye"]].concat(),
        2,
        "camera `eye` is scaled to nothing; set its scale to 1",
    );
    render(here, &["--at", "0.5s", "-o", "a.exr"]);
    assert!(pixels(here, "a.exr") == pixels(here, "o1.exr"));
    scene.cameras.pop();
    write_shrinking(&here.join("scene.glb"), &scene, "eye");
    fails(here, &alone, 2, "or place another camera with --camera auto or --look-from");
}

/// One box of a scene without a camera and without a lamp moves away. The diagonal of the scene grows from 2 m to 10 m.
#[test]
fn automatic_choices_are_those_of_the_first_frame() {
    let here = folder();
    let mut scene = build(Kind::CornellBox);
    scene.cameras.clear();
    scene.instances.retain(|instance| instance.node.ends_with("box"));
    scene.instances[0].transform = glam::DAffine3::IDENTITY;
    let motion = glb::Motion { node: "short box", times: vec![0.0, 1.0], positions: vec![[0.0; 3], [10.0, 0.0, 0.0]] };
    std::fs::write(here.path().join("scene.glb"), glb::write_moving(&scene, Some(&motion))).unwrap();
    let here = here.path();
    let frames = ["--gate", "16m..19m", "--frames", "1..3", "--fps", "2", "-o", "f#.exr"];
    let message = render(here, &frames);
    assert!(message.contains("--camera auto") && message.contains("a headlamp of"), "{message}");
    let settings = |name: &str| Experiment::parse(&read_settings(&here.join(name)).unwrap()).unwrap();
    let [first, second] = ["f1.exr", "f2.exr"].map(settings);
    assert_eq!([&first, &second].map(|settings| settings.input.at.map(|at| at.0)), [Some(0.5), Some(1.0)]);
    assert!(first.camera.look_from.is_some() && first.emitter.headlamp.is_some());
    assert_eq!((first.camera, first.emitter, first.render), (second.camera, second.emitter, second.render));
    // The first frame is the one rendered alone.
    render(here, &["--gate", "16m..19m", "--at", "0.5s", "-o", "alone.exr"]);
    assert!(pixels(here, "alone.exr") == pixels(here, "f1.exr"));

    // A printed sequence has the same choices, so the frames are finished.
    let printed = taugate(here, &[&["render", "scene.glb", "--print-config"], &SMALL[..], &frames].concat());
    std::fs::write(here.join("e.toml"), printed.stdout).unwrap();
    let message = String::from_utf8(taugate(here, &["render", "e.toml"]).stderr).unwrap();
    assert!(message.contains("2 of 2 frames exist with the same settings"), "{message}");
}

#[test]
fn a_gate_that_sweeps_is_a_sequence() {
    let here = with("cornell-box");
    let keys = ["--gate-keys", "10=5m..6m", "--gate-keys", "14=7m..9m"];
    render(here.path(), &[&keys[..], &["--frames", "11..13", "-o", "g#.exr", "-o", "g#.npy"]].concat());
    assert_eq!(names(here.path()), ["g11.exr", "g11.json", "g11.npy", "g12.exr", "g12.json", "g12.npy", "scene.glb"]);
    // The gate of frame 12 is so wide that another estimator is its default. All frames have the estimator of the first.
    render(here.path(), &["--gate", "6m..7.5m", "--estimator", "lcs", "-o", "alone.exr"]);
    assert!(pixels(here.path(), "alone.exr") == pixels(here.path(), "g12.exr"));
}

/// The car stops after 2 s, but the gate sweeps on.
#[test]
fn a_gate_sweeps_over_a_scene_that_stops() {
    let here = with("street");
    let keys = ["--gate-keys", "0=40m..60m", "--gate-keys", "4=60m..80m"];
    render(here.path(), &[&keys[..], &["--frames", "1..5", "--fps", "1", "-o", "g#.exr"]].concat());
    for (frame, at, gate) in [(1, "1s", "45m..65m"), (4, "2s", "60m..80m")] {
        render(here.path(), &["--at", at, "--gate", gate, "-o", "alone.exr"]);
        assert!(pixels(here.path(), "alone.exr") == pixels(here.path(), &format!("g{frame}.exr")), "frame {frame}");
    }
    // The car may also stay at its place in the file.
    render(here.path(), &[&keys[..], &["--animation", "none", "--frames", "1..2", "-o", "n#.exr"]].concat());
    render(here.path(), &["--gate", "42.5m..62.5m", "-o", "alone.exr"]);
    assert!(pixels(here.path(), "alone.exr") != pixels(here.path(), "n1.exr"));
    render(here.path(), &["--gate", "45m..65m", "-o", "alone.exr"]);
    assert!(pixels(here.path(), "alone.exr") == pixels(here.path(), "n1.exr"));
}

/// The picture of a frame shows the light of all gates, in every file format.
#[test]
fn a_contact_sheet_shows_all_gates() {
    let here = with("street");
    let flags = ["--gates", "10m..80m/2", "--frames", "0..2", "--fps", "2"];
    for kind in ["exr", "npy", "acc"] {
        let (frames, sheet) = (format!("f#.{kind}"), format!("{kind}.png"));
        render(here.path(), &[&flags[..], &["-o", &frames, "--contact-sheet", &sheet]].concat());
    }
    let picture = |name: &str| rgb8(&here.path().join(name));
    assert!(picture("exr.png") == picture("npy.png") && picture("exr.png") == picture("acc.png"));
    // `--exposure` is allowed if only the contact sheet has a picture.
    let bright = ["-o", "f#.exr", "--contact-sheet", "bright.png", "--exposure", "20"];
    assert!(render(here.path(), &[&flags[..], &bright].concat()).contains("2 of 2 frames exist"));
    assert!(picture("bright.png").2.as_flattened().iter().filter(|&&byte| byte == 255).count() > 100);
}

/// A picture does not say which exposure it has, so pictures of finished frames are made again.
#[test]
fn pictures_of_frames_have_one_exposure() {
    let here = with("cornell-box");
    let here = here.path();
    let keys = ["--gate-keys", "0=5m..6m", "--gate-keys", "2=6m..7m", "--frames", "0..2"];
    let name = "f1.png";
    for frames in ["f#.exr", "f#.npy", "f#.acc"] {
        let flags = [&keys[..], &["-o", frames, "--png"]].concat();
        let picture = || std::fs::read(here.join(name)).unwrap();
        let run = |exposure: &str| {
            let message = render(here, &[&flags[..], &["--exposure", exposure]].concat());
            (message.contains("2 of 2 frames exist with the same settings and are kept"), picture())
        };
        // The pictures of new frames have the exposure of the contact sheet. Each frame alone would have another one.
        let message = render(here, &[&flags[..], &["--contact-sheet", "sheet.png"]].concat());
        let exposures: Vec<&str> =
            message.lines().filter_map(|line| line.split_once(": exposure ")?.1.split(' ').next()).collect();
        assert_eq!(exposures.len(), 1, "{message}");
        let image = |name: &str| rgb8(&here.join(name));
        for (name, left) in [("f0.png", 0), ("f1.png", 12)] {
            let (width, _, sheet) = image("sheet.png");
            let part = sheet.chunks(width as usize).flat_map(|row| &row[left..left + 12]).copied().collect();
            assert!(image(name) == (12, 8, part), "{name} of {frames}");
            std::fs::remove_file(here.join(name)).unwrap();
        }
        // The next picture is made from a frame that has none.
        let (was_there, dark) = run("1");
        let (is_there, bright) = run("3");
        assert!(was_there && is_there && dark != bright, "{frames}");
        assert!(run("1") == (true, dark), "{frames}");
        std::fs::remove_file(here.join(name)).unwrap();
    }
}

/// Finished frames are kept if only settings have changed that do not affect them.
#[test]
fn frames_are_kept_if_their_settings_give_the_same_image() {
    let here = with("cornell-box");
    let here = here.path();
    let keys = ["--gate-keys", "0=5m..6m", "--gate-keys", "2=6m..7m", "--frames", "0..2"];
    let files = ["-o", "f#.exr", "-o", "g#.npy", "-o", "s#.acc"];
    render(here, &[&keys[..], &files].concat());
    let again = [&["render", "./scene.glb", "--strict", "--force", "--device", "0"], &SMALL[..], &keys, &files];
    let output = taugate(here, &again.concat());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("2 of 2 frames exist"), "{message}");
    let longer = [&["render", "scene.glb", "--spp", "3"], &SMALL[..2], &SMALL[4..], &keys, &["-o", "f#.exr"]].concat();
    fails(here, &longer, 2, "has other settings (render.spp is 3 in this command and is 2 in the file); remove it");
}

#[test]
fn frames_of_another_scene_or_without_the_layers_are_not_kept() {
    let here = with("cornell-box");
    let here = here.path();
    let frames = ["--gate-keys", "0=5m..6m", "--gate-keys", "2=6m..7m", "--frames", "0..2"];
    let again = |flags: &[&str], part: &str| {
        let command = [&["render", "scene.glb"], &SMALL[..], &frames, flags].concat();
        let message = fails(here, &command, 2, part);
        assert!(message.contains("remove it, or choose another name"), "{message}");
    };
    let files = ["-o", "f#.exr", "-o", "f#.npy"];
    render(here, &[&frames[..], &files].concat());
    assert!(render(here, &[&frames[..], &files].concat()).contains("2 of 2 frames exist"));
    again(&[&files[..], &["--aov", "depth"]].concat(), "f0.exr exists, but lacks the layer depth");
    render(here, &[&frames[..], &["-o", "s#.acc"]].concat());
    again(&["-o", "s#.acc", "--aov", "depth"], "s0.acc exists, but lacks the layer depth");
    let longer =
        [&["render", "scene.glb", "--spp", "3"], &SMALL[..2], &SMALL[4..], &frames, &["-o", "s#.acc"]].concat();
    fails(here, &longer, 2, "s0.acc exists, but was rendered with another --spp or --time");
    render(here, &[&frames[..], &["-o", "g#.exr", "--aov", "depth,normal"]].concat());
    assert!(
        render(here, &[&frames[..], &["-o", "g#.exr", "--aov", "normal"]].concat()).contains("2 of 2 frames exist")
    );

    // The path of the scene is the same, but not its contents.
    let mut scene = build(Kind::CornellBox);
    scene.add_light(
        "lamp",
        scene.cameras[0].transform.translation,
        glam::DVec3::NEG_Z,
        LightKind::Point { intensity: [1.0; 3] },
    );
    std::fs::write(here.join("scene.glb"), glb::write(&scene)).unwrap();
    again(&files, "f0.exr exists, but its scene or another input has changed");
    again(&["-o", "f#.npy"], "f0.npy exists, but its scene or another input has changed");
}

#[test]
fn a_printed_sequence_keeps_its_gates() {
    let here = with("cornell-box");
    let keys = ["--gate-keys", "0=5m..5.2m", "--gate-keys", "2=6m..6.2m", "--frames", "0..2", "-o", "g#.exr"];
    let print = |arguments: &[&str]| {
        let output = taugate(here.path(), &[&["render"], arguments, &["--print-config"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let config = print(&[&["scene.glb"], &keys[..]].concat());
    assert!(config.contains("gate-keys = [[0, \"5m..5.2m\"], [2, \"6m..6.2m\"]]"), "{config}");
    assert!(config.contains("estimator = \"lcs\"") && !config.contains("gate = \""), "{config}");
    std::fs::write(here.path().join("e.toml"), &config).unwrap();
    assert_eq!(print(&["e.toml"]), config, "a printed experiment prints itself");
}

#[test]
fn a_moment_overrides_the_frames_of_a_file() {
    let here = with("street");
    let file = "scene = 'scene.glb'\ngate.depth = '20m..40m'\n[output]\noutput = 'f.##.exr'\nframes = '0..16'\nfps = 8\ngif = 'f.gif'\n";
    std::fs::write(here.path().join("e.toml"), file).unwrap();
    let run = |arguments: &[&str]| {
        let output = taugate(here.path(), &[&["render"], arguments, &SMALL[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    // The name of the frames is no name for one moment.
    let message = "f.##.exr is a name for the frames of a sequence: give -o OUT.exr instead,";
    fails(here.path(), &["render", "e.toml", "--at", "1s"], 2, message);
    assert_eq!(names(here.path()), ["e.toml", "scene.glb"]);
    run(&["e.toml", "--at", "1s", "-o", "m.exr"]);
    assert_eq!(names(here.path()), ["e.toml", "m.exr", "scene.glb"]);
    run(&["scene.glb", "--depth", "20m..40m", "--at", "1s", "-o", "alone.exr"]);
    assert!(pixels(here.path(), "alone.exr") == pixels(here.path(), "m.exr"));
}

#[test]
fn mistakes_name_the_remedy() {
    let here = with("street");
    assert!(taugate(here.path(), &["generate", "cornell-box", "-o", "box.glb"]).status.success());
    let table: [(&[&str], &str); 10] = [
        (&["scene.glb", "--frames", "0..2", "-o", "f.exr"], "write the number of the frame as #"),
        (&["scene.glb", "--frames", "2..2", "-o", "f#.exr"], "like 0..24"),
        (&["scene.glb", "--frames", "50..52", "-o", "f#.exr"], "from 0 s to 2 s, so it has no pose at"),
        (&["scene.glb", "--frames", "47..50", "-o", "f#.exr"], "no pose at 2.04"),
        (&["scene.glb", "--at", "9s", "-o", "f.exr"], "no pose at 9 s"),
        (&["scene.glb", "--at", "1s", "--animation", "walk", "-o", "f.exr"], "choose one of 'drive'"),
        (&["scene.glb", "--at", "1s", "--frames", "0..2", "-o", "f#.exr"], "cannot be used with"),
        (&["scene.glb", "--gif", "f.gif", "-o", "f.exr"], "add --frames"),
        (&["box.glb", "--at", "1s", "-o", "f.exr"], "has no animations"),
        (&["box.glb", "--frames", "0..2", "-o", "f#.exr"], "all frames would be the same"),
    ];
    for (arguments, part) in table {
        fails(here.path(), &[&["render"], arguments].concat(), 2, part);
    }
    assert_eq!(names(here.path()), ["box.glb", "scene.glb"]);
}
