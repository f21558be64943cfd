//! `taugate view`, from the other end of its WebSocket. `python/tests/view` uses the page in a browser.

#![cfg(unix)]

mod client;

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};
use taugate::internals::image::exr_file::read_picture;
use tungstenite::Message;

use crate::{fails, folder, taugate};
use client::{PATIENCE, Page, Received, Viewer};

fn room() -> tempfile::TempDir {
    let here = folder();
    assert!(taugate(here.path(), &["generate", "cornell-box", "-o", "room.glb"]).status.success());
    here
}

const SMALL: [&str; 4] = ["--resolution", "40x32", "--spp", "4"];

/// Saves the image, renders it with the command of the page, and compares the bits.
fn is_what_its_command_renders(here: &Path, page: &mut Page, state: &Json, name: &str) -> Vec<f32> {
    let revision = &state["revision"];
    let progress = page.wait("progress", |p| p["phase"] == "done" && p["revision"] == *revision);
    page.say(&json!({"do": "save", "name": format!("{name}.exr")}));
    let saved = page.wait("saved", |_| true);
    assert_eq!(saved["files"], json!([here.canonicalize().unwrap().join(format!("{name}.exr"))]));

    let command = state["command"].as_str().unwrap();
    let line = format!("{command} --spp {} -o command.exr", progress["samples"]);
    let words = shlex::split(&line).unwrap();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    assert_eq!(words[0], "taugate");
    let output = taugate(here, &words[1..]);
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    let read = |name: &str| read_picture(&here.join(name)).unwrap().rgb;
    let (seen, rendered) = (read(&format!("{name}.exr")), read("command.exr"));
    assert!(seen.iter().any(|&x| x > 0.0), "{line}: a black image proves nothing");
    assert!(seen.iter().zip(&rendered).all(|(a, b)| a.to_bits() == b.to_bits()), "{line} renders another image");
    seen
}

#[test]
fn the_page_sees_what_its_command_renders() {
    let here = room();
    let viewer = Viewer::start(here.path(), &[&SMALL[..], &["--gate", "6.2m..6.5m"]].concat());
    let mut page = viewer.page();
    let welcome = page.wait("welcome", |_| true);
    assert_eq!((&welcome["scene"], &welcome["cameras"]), (&json!("room.glb"), &json!(["camera"])));
    let state = page.wait("state", |_| true);
    assert_eq!((&state["estimator"], &state["resolution"]), (&json!("lcs"), &json!([40, 32])));
    let camera_of_the_file = state["camera"].clone();

    let picture = page.wait_for_picture(|picture| picture.samples == 4);
    let image = is_what_its_command_renders(here.path(), &mut page, &state, "first");
    let largest = picture.rgb.iter().copied().fold(0.0f32, f32::max);
    let is_close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-3 * b + 1e-7 * largest;
    assert!(picture.rgb.iter().zip(&image).all(is_close), "the picture is not the image");

    // Another gate, then another camera, which is not in the file.
    let state = page.set(json!({"gate": "6.6m..7m"}));
    let gated = is_what_its_command_renders(here.path(), &mut page, &state, "gate");
    let camera = json!({"look-from": "0.3,1.25,3.1", "look-at": "0,0.9,0", "fov": "45"});
    let state = page.set(camera);
    let turned = is_what_its_command_renders(here.path(), &mut page, &state, "camera");
    assert!(gated != turned && gated != image);
    let state = page.set(json!({"gate": false, "estimator": "bdpt", "look-from": null, "look-at": null, "fov": null}));
    assert_eq!((&state["responses"][0]["hi"], &state["camera"]), (&Json::Null, &camera_of_the_file));
    is_what_its_command_renders(here.path(), &mut page, &state, "steady");
    let state = page.set(json!({"gate": null, "estimator": null}));
    assert_eq!(state["command"].as_str().unwrap().matches("6.2").count(), 1, "{}", state["command"]);
    is_what_its_command_renders(here.path(), &mut page, &state, "again");
}

#[test]
fn a_pixel_has_its_values() {
    let here = room();
    let viewer = Viewer::start(here.path(), &[&SMALL[..], &["--gates", "5m..8m/6"]].concat());
    let mut page = viewer.page();
    page.wait("progress", |progress| progress["phase"] == "done");
    let mut pixel = |x: u32, y: u32| {
        page.say(&json!({"do": "pixel", "x": x, "y": y}));
        page.say(&json!({"do": "pause", "on": false}));
        page.wait("pixel", |pixel| pixel["x"] == x && pixel["y"] == y)
    };
    // The camera stands 3.9 m from the middle of the box, whose back wall is 1 m behind the middle.
    let middle = pixel(20, 8);
    assert_eq!((&middle["object"], &middle["revision"], &middle["response"]), (&json!("back"), &json!(1), &json!(0)));
    assert!((middle["depth"].as_f64().unwrap() - 4.9).abs() < 0.3, "{middle}");
    let histogram: Vec<f64> = serde_json::from_value(middle["histogram"].clone()).unwrap();
    assert!(histogram.len() == 6 && histogram.iter().any(|&light| light > 0.0), "{middle}");
}

#[test]
fn mistakes_of_a_page_change_nothing() {
    let here = room();
    let viewer = Viewer::start(here.path(), &SMALL);
    std::fs::write(here.path().join("there.exr"), "mine").unwrap();
    let mut page = viewer.page();
    page.wait("progress", |progress| progress["phase"] == "done");
    let changes = [
        (json!({"gate": "1..2"}), "no unit"),
        (json!({"gate": "6m..7m", "fov": "200"}), "between 0 and 180"),
        (json!({"resolution": "999999x1"}), "16384"),
        (json!({"density-grid": "/etc/passwd"}), "cannot change"),
        (json!({"output": "x.exr"}), "cannot change"),
        (json!({"estimator": "magic"}), "lcs"),
        (json!({"camera": "nobody"}), "no camera is called"),
        (json!({"gates": "1m..2m/4096", "resolution": "4096x4096"}), "memory"),
    ];
    for (changes, part) in changes {
        page.say(&json!({"do": "set", "changes": changes}));
        let problem = page.wait("problem", |_| true);
        let message = problem["message"].as_str().unwrap();
        assert!(message.contains(part) && !message.contains('\n'), "{changes}: {message}");
    }
    for (name, part) in
        [("there.exr", "exists"), ("../a.exr", "file name"), ("a.gif", "ends in none"), ("", "file name")]
    {
        page.say(&json!({"do": "save", "name": name}));
        let problem = page.wait("problem", |_| true);
        assert!(problem["message"].as_str().unwrap().contains(part), "{name}: {problem}");
    }
    for text in [
        "",
        "{",
        "[]",
        "{\"do\":\"fly\"}",
        "{\"do\":\"ack\",\"frame\":-1}",
        "{\"do\":\"set\",\"changes\":{\"gate\":[1]}}",
    ] {
        page.socket.send(Message::text(text)).unwrap();
        page.wait("problem", |_| true);
    }
    assert_eq!(page.last["state"]["revision"], 1);
    // Together with the six above, these are one more than a page may send. Further messages would fail: the connection is closed.
    for _ in 0..15 {
        page.socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    }
    assert_eq!(page.wait_for_close(), 4400);
    assert_eq!(std::fs::read_to_string(here.path().join("there.exr")).unwrap(), "mine");
    assert_eq!(crate::names(here.path()), ["room.glb", "there.exr"]);
}

/// An iteration of several gates is in their images as soon as it begins, so it must not be abandoned for nothing.
#[test]
fn a_refused_change_keeps_the_image_of_several_gates() {
    let here = room();
    let viewer = Viewer::start(here.path(), &["--resolution", "160x120", "--gates", "5m..8m/6"]);
    let mut page = viewer.page();
    let mut samples = 4;
    for _ in 0..6 {
        let progress = page.wait("progress", |p| p["phase"] == "rendering" && p["samples"].as_u64().unwrap() > samples);
        samples = progress["samples"].as_u64().unwrap();
        page.say(&json!({"do": "set", "changes": {"camera": "nobody"}}));
        let start = page.last["progress"]["samples"].as_u64().unwrap();
        page.wait("problem", |_| true);
        page.last.remove("progress");
        let now = page.wait("progress", |p| p["phase"] == "rendering")["samples"].as_u64().unwrap();
        assert!(now >= start, "{now} samples after {start}");
    }
}

#[test]
fn a_change_opens_a_lost_device_again() {
    let here = room();
    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.env("TAUGATE_LOST_AFTER", "400");
    let small = ["--resolution", "8x8", "--light-paths", "100", "--max-depth", "4"];
    let viewer = Viewer::start_by(&mut command, here.path(), &small);
    let mut page = viewer.page();
    let failed = page.wait("failed", |_| true);
    let message = failed["message"].as_str().unwrap();
    assert!(message.contains("was lost") && message.contains("change a setting"), "{message}");
    page.last.remove("failed");
    page.set(json!({"seed": "1"}));
    page.wait_for_picture(|picture| picture.revision == 2 && picture.samples > 0);
}

/// Nothing is replaced, not even the variances of an array that is gone.
#[test]
fn saved_arrays_have_variances() {
    let here = room();
    let viewer = Viewer::start(here.path(), &[&SMALL[..], &["--gates", "5m..8m/6"]].concat());
    let mut page = viewer.page();
    page.wait("progress", |progress| progress["phase"] == "done");
    std::fs::write(here.path().join("a.variance.npy"), "mine").unwrap();
    page.say(&json!({"do": "save", "name": "a.npy"}));
    assert!(page.wait("problem", |_| true)["message"].as_str().unwrap().contains("a.variance.npy exists already"));
    page.say(&json!({"do": "save", "name": "b.npy"}));
    page.wait("saved", |_| true);
    assert!(here.path().join("b.variance.npy").exists());
}

#[test]
fn strangers_are_refused() {
    let here = room();
    let viewer = Viewer::start(here.path(), &SMALL);
    let host = format!("localhost:{}", viewer.port);
    for (host, origin) in
        [("evil.example", "http://evil.example"), (host.as_str(), "http://evil.example"), (host.as_str(), "null")]
    {
        let refused = viewer.connect(host, origin).err().expect("it is refused");
        assert!(refused.contains("403"), "{refused}");
    }
    // Another port is allowed, since ssh -L changes it.
    viewer.connect("localhost:9", "http://localhost:9").unwrap();
    let mut wrong = viewer.connect(&host, "http://localhost:1").unwrap();
    wrong.say(&json!({"do": "hello", "token": "0".repeat(32)}));
    assert_eq!(wrong.wait_for_close(), 4401);
    let mut early = viewer.connect(&host, "http://localhost:1").unwrap();
    early.say(&json!({"do": "pause", "on": true}));
    assert_eq!(early.wait_for_close(), 4401);

    let (head, body) = viewer.get("/", &host);
    assert!(head.starts_with("HTTP/1.1 200") && body.contains("<title>"), "{head}");
    assert!(head.to_lowercase().contains("content-security-policy: default-src 'none'"), "{head}");
    assert!(!body.contains(&viewer.token), "the page must not contain the token");
    for path in ["/../Cargo.toml", "/%2e%2e/Cargo.toml", "/page/main.js", "/nothing.js", "/ws/x"] {
        let head = viewer.get(path, &host).0;
        assert!(head.starts_with("HTTP/1.1 404") || head.starts_with("HTTP/1.1 400"), "{path}: {head}");
    }
    assert!(viewer.get("/", "evil.example").0.starts_with("HTTP/1.1 403"));
    assert!(viewer.get("/ws", &host).0.starts_with("HTTP/1.1 4"));
}

/// A browser is a script here, which keeps its arguments, and the mode and the contents of the file.
#[test]
#[cfg(target_os = "linux")]
fn a_browser_gets_the_token_in_a_private_file() {
    use std::os::unix::fs::PermissionsExt;

    use crate::names;

    let here = room();
    let [tools, files] = ["tools", "files"].map(|name| here.path().join(name));
    for folder in [&tools, &files] {
        std::fs::create_dir(folder).unwrap();
    }
    let script = "#!/bin/sh\nstat -c %a \"$1\" > mode\ncat \"$1\" > page\necho \"$@\" > part && mv part arguments\n";
    std::fs::write(tools.join("xdg-open"), script).unwrap();
    std::fs::set_permissions(tools.join("xdg-open"), PermissionsExt::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", tools.display(), std::env::var("PATH").unwrap());

    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.envs([("PATH", path.as_str()), ("TMPDIR", files.to_str().unwrap())]);
    let mut viewer = Viewer::start_by(&mut command, here.path(), &[&SMALL[..], &["--open"]].concat());
    let read = |name| std::fs::read_to_string(here.path().join(name)).unwrap();
    let start = Instant::now();
    while !here.path().join("arguments").exists() {
        assert!(start.elapsed() < PATIENCE, "no browser");
        std::thread::sleep(Duration::from_millis(20));
    }
    let file = names(&files).concat();
    assert_eq!(read("arguments").trim(), files.join(&file).to_str().unwrap());
    assert!(file.ends_with(".html") && !file.contains(&viewer.token), "{file}");
    assert_eq!(read("mode").trim(), "600");
    let address = format!("http://127.0.0.1:{}/#{}", viewer.port, viewer.token);
    assert!(read("page").contains(&format!("content=\"0; url={address}\"")), "{}", read("page"));

    viewer.signal();
    assert_eq!(viewer.child.wait().unwrap().code(), Some(0));
    assert_eq!(names(&files), [""; 0], "the file is removed");
}

#[test]
fn pages_share_a_render_and_a_slow_page_gets_few_pictures() {
    let here = room();
    let mut viewer = Viewer::start(here.path(), &["--resolution", "24x24"]);
    let mut slow = viewer.page();
    slow.acknowledges = false;
    slow.wait_for_picture(|_| true);
    let mut pages: Vec<Page> = (0..9).map(|_| viewer.page()).collect();
    for page in &mut pages {
        page.wait_for_picture(|picture| picture.samples > 0 && picture.size == [24, 24]);
    }
    pages[0].set(json!({"gate": "6.2m..6.5m"}));
    for page in &mut pages {
        page.wait_for_picture(|picture| picture.revision == 2);
    }
    // A flood of messages, as after a stall of the link, is read slowly and holds up no other page.
    for _ in 0..250 {
        pages[8].say(&json!({"do": "pixel", "x": 1, "y": 1}));
    }
    pages[8].say(&json!({"do": "pixel", "x": 2, "y": 2}));
    pages[0].set(json!({"gate": "6.2m..6.6m"}));
    pages[8].wait("pixel", |pixel| pixel["x"] == 2);
    // The slow page has got all texts, but no further picture.
    let mut pictures = 0;
    slow.say(&json!({"do": "pixel", "x": 1, "y": 1}));
    loop {
        match slow.receive() {
            Received::Picture(_) => pictures += 1,
            Received::Text(kind, _) if kind == "pixel" => break,
            Received::Closed(code) => panic!("closed with {code}"),
            Received::Text(..) => {}
        }
    }
    assert_eq!(pictures, 0);

    viewer.signal();
    assert_eq!(pages[1].wait_for_close(), 1001);
    assert_eq!(viewer.child.wait().unwrap().code(), Some(0));
}

#[test]
fn a_viewer_needs_a_picture() {
    let here = room();
    fails(here.path(), &["view", "no.glb"], 2, "no.glb");
    fails(here.path(), &["view", "room.glb", "--save-to", "nowhere"], 2, "nowhere");
    fails(here.path(), &["view", "room.glb", "--listen", "localhost"], 2, "--listen");
    fails(here.path(), &["view", "room.glb", "--spp", "0"], 2, "--spp");
    std::fs::write(here.path().join("scan.toml"), "scene = 'room.glb'\n[scan]\n").unwrap();
    fails(here.path(), &["view", "scan.toml"], 2, "scan");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    fails(here.path(), &["view", "room.glb", "--listen", &address], 2, "give another --listen");
}
