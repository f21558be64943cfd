//! Ctrl-C, or SIGTERM, at any moment of a render: a whole image or none, and nothing half-written.

#![cfg(unix)]

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use taugate::exr_file::read_picture;

/// Ctrl-C, and what batch systems and shutdowns send.
const SIGNALS: [(&str, i32); 2] = [("-INT", 2), ("-TERM", 15)];

fn start(folder: &Path, budget: &str) -> Child {
    let arguments =
        ["room.glb", "-o", "out.exr", "--png", "--stats", "out.json", "--resolution", "64x64", "--gate", "8m..9m"];
    Command::new(env!("CARGO_BIN_EXE_taugate"))
        .arg("render")
        .args(arguments)
        .args(["--time", budget])
        .current_dir(folder)
        .stderr(Stdio::null())
        .spawn()
        .expect("taugate starts")
}

fn interrupt(child: &mut Child, signal: &str) -> ExitStatus {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill starts");
    assert!(kill.success());
    child.wait().expect("it ends")
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn an_interrupt_leaves_a_whole_image_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // Large enough that loading it takes a while.
    let generate = ["generate", "cluttered-room", "-o", "room.glb"];
    assert!(Command::new(env!("CARGO_BIN_EXE_taugate")).args(generate).current_dir(here).status().unwrap().success());
    let (mut without_image, mut images) = (0, [0, 0]);
    let delays = [0, 10, 30, 60, 120, 250, 500, 1000, 4000].map(|delay| (delay, SIGNALS[0]));
    for (delay, (name, number)) in delays.into_iter().chain([0, 200, 4000].map(|delay| (delay, SIGNALS[1]))) {
        let mut child = start(here, "1h");
        std::thread::sleep(Duration::from_millis(delay));
        let asked = Instant::now();
        let status = interrupt(&mut child, name);
        // Before the program has said what to do with it, the signal itself ends the process.
        let ended = status.code() == Some(130) || status.signal() == Some(number);
        assert!(ended, "after {delay} ms: {status:?}");
        assert!(asked.elapsed() < Duration::from_secs(30), "after {delay} ms it took {:?}", asked.elapsed());
        match names(here).iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["room.glb"] => without_image += 1,
            ["out.exr", "out.json", "out.png", "room.glb"] => {
                images[usize::from(number != SIGNALS[0].1)] += 1;
                let picture = read_picture(&here.join("out.exr")).unwrap();
                assert_eq!((picture.width, picture.height), (64, 64));
                let numbers = std::fs::read(here.join("out.json")).unwrap();
                assert!(
                    serde_json::from_slice::<serde_json::Value>(&numbers).unwrap()["iterations"].as_u64() > Some(0)
                );
                for file in ["out.exr", "out.json", "out.png"] {
                    std::fs::remove_file(here.join(file)).unwrap();
                }
            }
            _ => panic!("after {delay} ms: {:?}", names(here)),
        }
    }
    assert!(images.iter().all(|&n| n > 0), "images after -INT and -TERM: {images:?}");
    assert!(without_image >= 3, "the scene is loaded too fast for this test: {without_image}");
}
