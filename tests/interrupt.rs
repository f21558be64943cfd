//! Interrupts renders by Ctrl-C or SIGTERM at various moments: the program writes complete files or none.

#![cfg(unix)]

use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use taugate::internals::image::exr_file::read_picture;

/// SIGINT comes from Ctrl-C, SIGTERM from batch systems and at shutdown.
const SIGNALS: [(&str, libc::c_int); 2] = [("-INT", libc::SIGINT), ("-TERM", libc::SIGTERM)];

/// Resets the handling of the signals, so that they end the command until it installs its own handlers. A process inherits
/// ignored signals, and scripts ignore them for jobs in the background, so the process that runs the tests may ignore them.
fn with_default_signals(command: &mut Command) -> &mut Command {
    let reset = || {
        for (_, number) in SIGNALS {
            // SAFETY: `signal` may be called between fork and exec, and the default action needs no handler.
            unsafe { libc::signal(number, libc::SIG_DFL) };
        }
        Ok(())
    };
    // SAFETY: `reset` allocates nothing and takes no lock.
    unsafe { command.pre_exec(reset) }
}

fn start(folder: &Path, budget: &str) -> Child {
    let arguments =
        ["room.glb", "-o", "out.exr", "--png", "--stats", "out.json", "--resolution", "64x64", "--gate", "8m..9m"];
    with_default_signals(&mut Command::new(env!("CARGO_BIN_EXE_taugate")))
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

/// Interrupts a render of `room.glb` after `delay` ms and checks the files that it leaves. Returns whether it left an image.
fn leaves_an_image(here: &Path, delay: u64, (name, number): (&str, i32)) -> bool {
    let mut child = start(here, "1h");
    std::thread::sleep(Duration::from_millis(delay));
    let signalled = Instant::now();
    let status = interrupt(&mut child, name);
    // Until the program has installed its handler, the signal itself ends the process.
    let ended = status.code() == Some(130) || status.signal() == Some(number);
    assert!(ended, "{name} after {delay} ms: {status:?}");
    assert!(
        signalled.elapsed() < Duration::from_secs(30),
        "{name} after {delay} ms: it took {:?}",
        signalled.elapsed()
    );
    match names(here).iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["room.glb"] => false,
        ["out.exr", "out.json", "out.png", "room.glb"] => {
            let picture = read_picture(&here.join("out.exr")).unwrap();
            assert_eq!((picture.width, picture.height), (64, 64));
            let numbers = std::fs::read(here.join("out.json")).unwrap();
            assert!(serde_json::from_slice::<serde_json::Value>(&numbers).unwrap()["iterations"].as_u64() > Some(0));
            for file in ["out.exr", "out.json", "out.png"] {
                std::fs::remove_file(here.join(file)).unwrap();
            }
            true
        }
        _ => panic!("{name} after {delay} ms: {:?}", names(here)),
    }
}

#[test]
fn an_interrupt_leaves_a_whole_image_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // The scene is so large that loading takes a while: some signals arrive before the first image.
    let generate = ["generate", "cluttered-room", "-o", "room.glb"];
    assert!(Command::new(env!("CARGO_BIN_EXE_taugate")).args(generate).current_dir(here).status().unwrap().success());
    let images = [0, 10, 30, 60, 120, 250, 500, 1000, 4000].map(|delay| leaves_an_image(here, delay, SIGNALS[0]));
    let without = images.iter().filter(|image| !**image).count();
    assert!(without >= 3, "the scene is loaded too fast for this test: {without}");
    // On a busy machine the first image may take long, so the delays grow. Each signal must leave an image in the end.
    for signal in SIGNALS {
        leaves_an_image(here, 0, signal);
        let image = [1000, 4000, 16_000, 60_000].iter().any(|&delay| leaves_an_image(here, delay, signal));
        assert!(image, "{signal:?} left no image");
    }
}
