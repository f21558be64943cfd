//! Renders with --checkpoint that are killed, interrupted, or cannot write.

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use taugate::internals::image::accumulation::file::read;
use taugate::internals::image::exr_file::read_picture;

use crate::{SIGNALS, names, send, taugate, with_box, with_default_signals};

const RENDER: [&str; 11] = [
    "render",
    "box.glb",
    "--resolution",
    "96x96",
    "--gate",
    "5m..6m",
    "--light-paths",
    "2000",
    "--checkpoint",
    "sums.acc",
    "--every",
];

/// Starts a render that writes its sums as often as possible.
fn start(here: &Path, flags: &[&str]) -> Child {
    let arguments = [&RENDER[..], &["1ms"], flags].concat();
    with_default_signals(&mut taugate(here, &arguments)).stderr(Stdio::piped()).spawn().expect("taugate starts")
}

/// Number of samples in the checkpoint; 0 if there is none. Fails if the checkpoint is not complete.
fn samples(here: &Path) -> u64 {
    let path = here.join("sums.acc");
    if !path.exists() {
        return 0;
    }
    read(&path).unwrap_or_else(|e| panic!("{e}")).about.samples_per_pixel
}

/// Maximum time until a render writes its sums, on a busy machine.
const LIMIT: Duration = Duration::from_secs(60);

/// Waits until a render writes its sums: until there is a temporary file with contents. The check before a render writes one byte.
fn wait_for_a_write(here: &Path) {
    let started = Instant::now();
    let is_temporary = |name: &String| name.starts_with(".taugate-sums.acc-") && name.ends_with(".tmp");
    let is_written = |name: &String| std::fs::metadata(here.join(name)).is_ok_and(|file| file.len() > 1);
    while !names(here).iter().any(|name| is_temporary(name) && is_written(name)) {
        assert!(started.elapsed() < LIMIT, "no sums were written");
    }
}

/// Waits until there are sums with more than `before` samples.
fn wait_for_sums(here: &Path, before: u64) {
    let started = Instant::now();
    while samples(here) <= before {
        assert!(started.elapsed() < LIMIT, "no sums were written");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Kills a render `times` times, a third of them while it writes, and lets it end.
fn survives_being_killed(times: u32) {
    let folder = with_box();
    let here = folder.path();
    // This render compiles the kernels, so that the later ones live long enough to write.
    assert!(start(here, &["--spp", "2", "-o", "out.exr"]).wait().unwrap().success());
    let (mut before, mut written) = (samples(here), 0);
    for round in 0..times {
        let mut child = start(here, &["--time", "1h", "-o", "out.exr"]);
        // The moments differ from round to round: multiples of the golden ratio are spread evenly.
        let spread = (0.618_033_988 * f64::from(round)).fract();
        match round % 3 {
            // At any moment, also before the first iteration.
            0 => std::thread::sleep(Duration::from_secs_f64(spread)),
            // While sums are written, or soon after.
            1 => {
                wait_for_a_write(here);
                std::thread::sleep(Duration::from_secs_f64(0.02 * spread));
            }
            // Between two writes.
            _ => {
                wait_for_sums(here, before);
                std::thread::sleep(Duration::from_secs_f64(0.2 * spread));
            }
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let now = samples(here);
        assert!(now >= before, "round {round}: {now} samples after {before}");
        written += u32::from(now > before);
        before = now;
    }
    assert!(written >= times / 3, "only {written} of {times} renders wrote sums before they were killed");

    // The image equals that of a render that was never killed. At 64 samples, and any multiple of 8 above, an iteration ends.
    let spp = (before + 16).next_multiple_of(8).max(64).to_string();
    assert!(start(here, &["--spp", &spp, "-o", "out.exr"]).wait().unwrap().success());
    assert_eq!(names(here), ["box.glb", "out.exr", "spare", "sums.acc"], "killed renders leave nothing behind");
    let whole = [&RENDER[..8], &["--spp", &spp, "-o", "whole.exr", "-q"]].concat();
    assert!(taugate(here, &whole).status().unwrap().success());
    let pixels = |name: &str| read_picture(&here.join(name)).unwrap();
    let (a, b) = (pixels("out.exr"), pixels("whole.exr"));
    assert!(a.rgb == b.rgb && a.variance == b.variance, "{spp} samples differ");
}

#[test]
fn a_killed_render_goes_on_from_whole_sums() {
    survives_being_killed(9);
}

#[test]
#[ignore = "starts 200 renders"]
fn a_render_survives_being_killed_200_times() {
    survives_being_killed(200);
}

#[test]
fn signals_write_the_sums() {
    let folder = with_box();
    let here = folder.path();
    for (name, _) in SIGNALS {
        let before = samples(here);
        // --every is so long that the render writes its sums only when it ends.
        let arguments = [&RENDER[..], &["1h", "--time", "1h"]].concat();
        let mut command = taugate(here, &arguments);
        let mut child = with_default_signals(&mut command).stderr(Stdio::piped()).spawn().unwrap();
        let mut stderr = std::io::BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        // The first line of progress comes after some iterations. A resumed render prints another line before.
        while !line.contains(" samples, ") {
            line.clear();
            assert!(std::io::BufRead::read_line(&mut stderr, &mut line).unwrap() > 0, "{name}: it ended");
        }
        send(&child, name);
        let mut rest = String::new();
        std::io::Read::read_to_string(&mut stderr, &mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{name}: {rest}");
        assert!(rest.contains("interrupted; the same command goes on from sums.acc"), "{name}: {rest}");
        assert!(samples(here) > before, "{name} wrote nothing");
    }
}

#[test]
fn a_checkpoint_has_one_writer() {
    let folder = with_box();
    let here = folder.path();
    let mut first = start(here, &["--time", "1h"]);
    wait_for_a_write(here);
    let second = start(here, &["--spp", "2"]).wait_with_output().unwrap();
    let message = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(2), "{message}");
    assert!(message.contains("sums.acc: another render is writing this file"), "{message}");
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(start(here, &["--spp", "2"]).wait().unwrap().success(), "the lock of a killed render is free");
}

#[test]
fn a_render_goes_on_if_its_sums_cannot_be_written() {
    let folder = with_box();
    let here = folder.path();
    std::fs::create_dir(here.join("gone")).unwrap();
    let flags = ["--resolution", "32x32", "--checkpoint", "gone/sums.acc", "--every", "1ms", "--spp", "8"];
    let mut command = taugate(here, &[&["render", "box.glb", "-o", "out.exr"], &flags[..]].concat());
    let child = command.stderr(Stdio::piped()).spawn().unwrap();
    // The render locks the file before it prepares the device.
    let started = Instant::now();
    while !here.join("gone/.taugate-sums.acc.lock").exists() {
        assert!(started.elapsed() < LIMIT, "the file was not locked");
    }
    std::fs::remove_dir_all(here.join("gone")).unwrap();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("warning: gone/sums.acc: cannot be written: the folder gone does not exist"), "{message}");
    assert!(message.contains("the render goes on"), "{message}");
    assert_eq!(read_picture(&here.join("out.exr")).unwrap().width, 32);
    assert!(read(Path::new(crate::saved_in(&message))).is_ok(), "{message}");
}

/// A limit of the file size acts like a full disk: the sums are larger than the limit, and the picture is smaller.
#[cfg(target_os = "linux")]
#[test]
fn sums_that_do_not_fit_on_the_disk_leave_one_message() {
    let folder = with_box();
    let here = folder.path();
    let mut child = start(here, &["--time", "3s", "-o", "out.png"]);
    wait_for_a_write(here);
    let limit =
        std::process::Command::new("prlimit").args(["--pid", &child.id().to_string(), "--fsize=200000"]).status();
    if !limit.is_ok_and(|status| status.success()) {
        println!("skipped: prlimit is missing");
        child.kill().unwrap();
        child.wait().unwrap();
        return;
    }
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("sums.acc: cannot be written: the file is larger than the limit"), "{message}");
    assert!(message.contains("is lost, because") && !message.contains("archive"), "{message}");
    assert!(here.join("out.png").exists(), "the picture is small enough");
    samples(here);
}
