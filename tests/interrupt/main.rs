//! Interrupts renders by signals at various moments, and takes their folders away: the program writes complete files or none, and
//! no finished image is lost.

#![cfg(unix)]

mod checkpoints;

use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use taugate::internals::image::exr_file::read_picture;

/// SIGINT comes from Ctrl-C, SIGTERM from batch systems and at shutdown, SIGHUP from a terminal that is gone.
const SIGNALS: [(&str, libc::c_int); 3] = [("-INT", libc::SIGINT), ("-TERM", libc::SIGTERM), ("-HUP", libc::SIGHUP)];

/// Gives the signals their default action, so that they end the command until it installs its own handlers. Scripts ignore signals
/// for jobs in the background, and child processes inherit this. So the process that runs the tests may ignore them.
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

fn send(child: &Child, signal: &str) {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill starts");
    assert!(kill.success());
}

fn interrupt(child: &mut Child, signal: &str) -> ExitStatus {
    send(child, signal);
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
        signalled.elapsed() < Duration::from_secs(120),
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

/// `taugate` in `folder`. A file that cannot be written to its own folder goes to the folder `spare` inside `folder`.
fn taugate(folder: &Path, arguments: &[&str]) -> Command {
    let spare = folder.join("spare");
    std::fs::create_dir_all(&spare).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_taugate"));
    command.args(arguments).current_dir(folder).env("TMPDIR", spare);
    command
}

/// A folder with a small scene `box.glb`.
fn with_box() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    assert!(taugate(folder.path(), &["generate", "cornell-box", "-o", "box.glb"]).status().unwrap().success());
    folder
}

/// The path in a message that says where the render is saved.
fn saved_in(message: &str) -> &str {
    let path = message.split("saved in ").nth(1).unwrap_or_else(|| panic!("nothing is saved: {message}"));
    path.trim_end().split(", ").next().unwrap()
}

#[test]
fn a_hangup_does_not_end_a_render_that_nohup_keeps_alive() {
    let folder = with_box();
    let ignore = || {
        // SAFETY: `signal` may be called between fork and exec.
        unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
        Ok(())
    };
    let mut command =
        taugate(folder.path(), &["render", "box.glb", "-o", "out.exr", "--resolution", "32x32", "--time", "15s", "-q"]);
    // SAFETY: `ignore` allocates nothing and takes no lock.
    let mut child = unsafe { command.pre_exec(ignore) }.spawn().unwrap();
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(5) {
        send(&child, "-HUP");
        std::thread::sleep(Duration::from_millis(200));
    }
    assert!(child.try_wait().unwrap().is_none(), "it ended too soon");
    assert!(child.wait().unwrap().success());
    assert!(folder.path().join("out.exr").exists());
}

/// The first line on stderr is a warning that comes after the check of the outputs. After this line, the test removes their folder.
#[test]
fn a_render_whose_folder_vanishes_is_saved_elsewhere() {
    let folder = with_box();
    std::fs::create_dir(folder.path().join("gone")).unwrap();
    let arguments = ["render", "box.glb", "-o", "gone/out.exr", "--png", "--resolution", "32x32", "--time", "2s"];
    let thin = ["--gate", "8m+100um", "--force"];
    let mut child = taugate(folder.path(), &[&arguments[..], &thin].concat())
        .stderr(Stdio::piped())
        .spawn()
        .expect("taugate starts");
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    assert!(line.contains("steps of 32-bit"), "{line}");
    std::fs::remove_dir_all(folder.path().join("gone")).unwrap();
    let mut message = String::new();
    stderr.read_to_string(&mut message).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(2), "{message}");
    assert!(message.contains("the folder gone does not exist"), "{message}");
    let saved = Path::new(saved_in(&message));
    assert!(saved.starts_with(folder.path().join("spare")), "{message}");
    assert_eq!(read_picture(saved).unwrap().width, 32);
    assert!(saved.with_extension("png").exists());
}

/// The test sets the limit while the render runs. The software driver keeps the memory of the device in files, and a limit from the
/// start would affect these files too.
#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_file_sizes_gives_a_message_and_leaves_nothing_behind() {
    let folder = with_box();
    let render = ["render", "box.glb", "-o", "out.exr", "--stats", "out.json", "--resolution", "96x96", "--time", "8s"];
    let mut child = taugate(folder.path(), &render).stderr(Stdio::piped()).spawn().expect("taugate starts");
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    assert!(line.contains("samples"), "a line of progress: {line}");
    // The image is larger than the limit, the statistics are smaller.
    let limit = Command::new("prlimit").args(["--pid", &child.id().to_string(), "--fsize=40000"]).status();
    if !limit.is_ok_and(|status| status.success()) {
        println!("skipped: prlimit is missing");
        child.kill().unwrap();
        child.wait().unwrap();
        return;
    }
    let mut message = String::new();
    stderr.read_to_string(&mut message).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(2), "{message}");
    assert!(message.contains("ulimit -f") && message.contains("out.exr is lost"), "{message}");
    assert_eq!(names(folder.path()), ["box.glb", "out.json", "spare"]);
    assert!(names(&folder.path().join("spare")).is_empty());
}

/// Needs the right to mount a file system in a namespace of its own.
#[cfg(target_os = "linux")]
#[test]
fn a_render_that_meets_a_full_disk_is_saved_elsewhere() {
    let folder = with_box();
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    let inside = |command: &str| {
        let mount = format!("mount -t tmpfs -o size=40k none disk && {command}");
        Command::new("unshare")
            .args(["-rm", "sh", "-c", &mount, env!("CARGO_BIN_EXE_taugate")])
            .current_dir(folder.path())
            .env("TMPDIR", folder.path().join("spare"))
            .output()
    };
    if !inside("true").is_ok_and(|output| output.status.success()) {
        println!("skipped: this process may not mount a file system");
        return;
    }
    let saved = |command: &str| {
        let output = inside(command).unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{command}: {message}");
        assert!(message.contains("has no space left"), "{command}: {message}");
        let path = Path::new(saved_in(&message)).to_path_buf();
        assert!(path.starts_with(folder.path().join("spare")), "{command}: {message}");
        path
    };
    let render = "\"$0\" render box.glb --estimator bdpt --resolution 96x96 --spp 1";
    let image = saved(&format!("{render} --gate 6m..8m -o light.npy -o disk/out.exr"));
    assert_eq!(read_picture(&image).unwrap().width, 96);
    // The old set of an array stays whole if the new one has no space.
    let sets = "\"$0\" render box.glb -q --gates 5m..8m/3 --resolution 8x8 --spp 1 -o disk/a.npy || exit 9; \
                head -c 99999 /dev/zero > disk/full 2> messages; truncate -s -8192 disk/full; \
                \"$0\" render box.glb -q --gates 4m..9m/3 --resolution 32x32 --spp 1 -o disk/a.npy; code=$?; \
                \"$0\" histogram disk/a.npy --json > old.json || exit 9; exit $code";
    assert!(saved(sets).with_extension("json").exists());
    let rows: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("old.json")).unwrap()).unwrap();
    assert_eq!((rows[0]["begin_m"].as_f64(), rows[2]["end_m"].as_f64()), (Some(5.0), Some(8.0)));
    // Other results that take time are saved too.
    assert!(saved("\"$0\" detect light.npy -o disk/counts.npy --photons 1").ends_with("counts.npy"));
    let strategies = saved(&format!("{render} --max-depth 2 -o out.exr --strategy-images disk/pyramid"));
    assert!(names(&strategies).iter().any(|name| name.ends_with("_weighted.exr")));
    let suite = "time = \"30ms\"\nrepetitions = 1\n[render]\nlight-paths = 100\nmax-depth = 3\n\
                 [[scene]]\nname = \"box\"\nscene = \"box.glb\"\ngate = \"7m..8.5m\"\nresolution = \"24x24\"\n\
                 [[variant]]\nname = \"bdpt\"\nrender = { estimator = \"bdpt\" }\n";
    std::fs::write(folder.path().join("s.toml"), suite).unwrap();
    let bench =
        "head -c 36000 /dev/zero > disk/full; \"$0\" bench s.toml --out disk/out --reference --reference-time 10ms";
    assert_eq!(read_picture(&saved(bench)).unwrap().width, 24);
}

/// Where no thread can be started, there is one message and no panic. The limit does not hold for root, so root becomes another user.
#[cfg(target_os = "linux")]
#[test]
fn without_threads_there_is_a_message() {
    let folder = with_box();
    let limited = |arguments: &[&str]| {
        let mut command = taugate(folder.path(), arguments);
        // SAFETY: the calls may be made between fork and exec.
        unsafe {
            command.pre_exec(|| {
                if libc::geteuid() == 0 && (libc::setgid(54_321) != 0 || libc::setuid(54_321) != 0) {
                    return Err(std::io::Error::last_os_error());
                }
                let limit = libc::rlimit { rlim_cur: 1, rlim_max: 1 };
                match libc::setrlimit(libc::RLIMIT_NPROC, &raw const limit) {
                    0 => Ok(()),
                    _ => Err(std::io::Error::last_os_error()),
                }
            })
        };
        command.output()
    };
    // Other users may not be allowed to read the program.
    if !limited(&["--version"]).is_ok_and(|output| output.status.success()) {
        println!("skipped: another user cannot run the program");
        return;
    }
    for arguments in [&["info", "box.glb"][..], &["render", "box.glb", "-o", "x.exr"], &["devices"]] {
        let output = limited(arguments).unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{arguments:?}: {message}");
        assert!(message.contains("allows no more threads") && !message.contains("panicked"), "{message}");
    }
}

/// SIGKILL leaves a temporary file. The next render to the same name removes it.
#[test]
fn what_a_killed_render_leaves_is_removed_by_the_next() {
    let folder = with_box();
    let left_over = folder.path().join(".taugate-out.exr-1-abcdef.tmp");
    std::fs::write(&left_over, "half").unwrap();
    let render = ["render", "box.glb", "-o", "out.exr", "--resolution", "16x16", "--spp", "1", "-q"];
    assert!(taugate(folder.path(), &render).status().unwrap().success());
    assert_eq!(names(folder.path()), ["box.glb", "out.exr", "spare"]);
}

/// Without this check, the picture would replace the image.
#[test]
fn two_outputs_that_are_links_to_one_file_are_refused() {
    let folder = with_box();
    std::os::unix::fs::symlink("out.exr", folder.path().join("out.png")).unwrap();
    let output = taugate(folder.path(), &["render", "box.glb", "-o", "out.exr", "--png"]).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("out.exr and out.png are links to one file"), "{message}");
}

/// An iteration of a large image may take minutes. The bug: an interrupt waited for its end.
#[test]
fn an_interrupt_abandons_the_iteration() {
    let folder = with_box();
    // An iteration takes most of a second or more, on a graphics card too.
    let devices = taugate(folder.path(), &["devices", "--json"]).output().unwrap().stdout;
    let devices: serde_json::Value = serde_json::from_slice(&devices).unwrap();
    let is_card = devices.as_array().unwrap().iter().any(|device| device["is_cpu"] == false);
    let resolution = if is_card { "2048x2048" } else { "512x512" };
    let render =
        ["render", "box.glb", "--gate", "6.2m..6.5m", "--resolution", resolution, "--spp", "10000", "-o", "out.exr"];
    let mut child = taugate(folder.path(), &render).stderr(Stdio::piped()).spawn().expect("taugate starts");
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let is_progress = |line: &String| line.contains(" of 10000 samples");
    let first = lines.find(is_progress).expect("progress after the first iteration");
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(interrupt(&mut child, "-INT").code(), Some(130));
    let rest: Vec<String> = lines.collect();
    assert!(!rest.iter().any(is_progress), "after '{first}': {rest:?}");
    let samples = first.split(' ').next().unwrap();
    assert!(rest.iter().any(|line| line.contains(&format!(" {samples} samples per pixel"))), "{first}, {rest:?}");
}
