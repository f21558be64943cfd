//! The flag `--tev`, which shows the image in the viewer tev. Needs a device.

mod stream;
mod viewer;

use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use exr::prelude::{ReadChannels, ReadLayers, read};
use taugate::internals::image::exr_file::read_picture;

use crate::{fails, folder, names, taugate};
use viewer::{Image, listen, show};

const SMALL: [&str; 4] = ["--sampling", "uniform", "--light-paths", "500"];

fn with(scene: &str) -> tempfile::TempDir {
    let here = folder();
    assert!(taugate(here.path(), &["generate", scene, "-o", "scene.glb"]).status.success());
    here
}

/// Renders with `--tev=ADDRESS`. Returns what the program prints.
fn render(here: &Path, address: &str, flags: &[&str]) -> String {
    let tev = format!("--tev={address}");
    let output = taugate(here, &[&["render", "scene.glb", &tev], &SMALL[..], flags].concat());
    message_of(output)
}

/// What the program prints. It must succeed.
fn message_of(output: Output) -> String {
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{message}");
    message
}

/// The warnings in the output of a render. Checks that the output also reports the image.
fn warnings(message: &str) -> Vec<&str> {
    assert!(message.contains(": 64x48, ") || message.contains("640x480"), "{message}");
    message.lines().filter(|line| line.starts_with("warning: ")).collect()
}

/// Checks that tev shows the channels of a file and no others, bit by bit.
fn check_same(shown: &Image, file: &Path) {
    let layers = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let layer = layers.from_file(file).unwrap().layer_data;
    assert_eq!((shown.width, shown.height), (layer.size.width(), layer.size.height()));
    let channels = layer.channel_data.list;
    let mut names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
    for (name, channel) in names.iter().zip(&channels) {
        let bits: Vec<u32> = channel.sample_data.values_as_f32().map(f32::to_bits).collect();
        assert!(shown.channels[name].iter().map(|x| x.to_bits()).eq(bits.iter().copied()), "{name}");
        assert!(bits.iter().any(|&x| x != 0), "{name} is black, which proves nothing");
    }
    names.sort();
    assert!(shown.channels.keys().eq(&names), "{names:?}");
}

#[test]
fn tev_shows_what_the_file_holds() {
    let here = with("cornell-box");
    // The first image has two columns and two rows of tiles.
    for (name, count, flags) in [
        ("one.exr", 6, &["--resolution", "150x140", "--gate", "5m..7m", "--spp", "8"][..]),
        ("three.exr", 18, &["--resolution", "20x16", "--gates", "5m..8m/3", "--spp", "8"]),
        ("cw.exr", 55, &["--resolution", "20x16", "--cw", "20,60", "--spp", "8"]),
    ] {
        let (listener, address) = listen();
        let viewer = show(listener);
        let message = render(here.path(), &address, &[flags, &["-o", name]].concat());
        assert!(!message.contains("warning"), "{message}");
        let viewer = viewer.join().unwrap();
        assert_eq!(viewer.created, [name]);
        assert_eq!(viewer.images[name].channels.len(), count);
        check_same(&viewer.images[name], &here.path().join(name));
    }
}

/// The address is an IPv6 address, and comes from an experiment.
#[test]
fn each_frame_is_an_image() {
    let here = with("cornell-box");
    let Ok(listener) = std::net::TcpListener::bind("[::1]:0") else { return };
    let address = listener.local_addr().unwrap();
    let viewer = show(listener);
    let experiment = format!(
        "scene = 'scene.glb'\ncamera.resolution = '20x16'\nrender.spp = 8\n[gate]\ngate-keys = [[0, '5m..6m'], [2, '6m..7m']]\n\
         [output]\ntev = '{address}'\nframes = '0..3'\noutput = 'f#.exr'\n"
    );
    std::fs::write(here.path().join("e.toml"), experiment).unwrap();
    let message = message_of(taugate(here.path(), &["render", "e.toml"]));
    assert!(!message.contains("warning"), "{message}");
    let viewer = viewer.join().unwrap();
    assert_eq!(viewer.created, ["f0.exr", "f1.exr", "f2.exr"]);
    for (name, image) in &viewer.images {
        check_same(image, &here.path().join(name));
    }
}

#[test]
fn without_a_tev_there_is_one_warning_and_the_image() {
    let here = with("cornell-box");
    let address = listen().1;
    let flags = ["--resolution", "64x48", "--spp", "4", "-o", "a.exr"];
    let message = render(here.path(), &address, &flags);
    let [warning] = warnings(&message)[..] else { panic!("{message}") };
    let port = address.rsplit(':').next().unwrap();
    let remedy = format!(
        "start tev there, or connect the port to a tev on your own computer with ssh -R {port}:localhost:14158"
    );
    assert!(
        warning.starts_with(&format!("warning: no tev answers at {address} (")) && warning.contains(&remedy),
        "{warning}"
    );
    // The image has the bits of a render without --tev.
    let pixels = || read_picture(&here.path().join("a.exr")).unwrap().rgb;
    let with_tev = pixels();
    message_of(taugate(here.path(), &[&["render", "scene.glb"], &SMALL[..], &flags].concat()));
    assert!(pixels() == with_tev);
    // A sequence warns once.
    let frames = [
        "--resolution",
        "64x48",
        "--spp",
        "4",
        "-o",
        "f#.exr",
        "--frames",
        "0..3",
        "--gate-keys",
        "0=5m..6m",
        "--gate-keys",
        "2=6m..7m",
    ];
    let message = render(here.path(), &address, &frames);
    assert_eq!(warnings(&message).len(), 1, "{message}");
    assert_eq!(names(here.path()), ["a.exr", "f0.exr", "f1.exr", "f2.exr", "scene.glb"]);
}

#[test]
fn a_tev_that_goes_away_is_one_warning() {
    let here = with("cornell-box");
    let (listener, address) = listen();
    // This tev takes the first packet and ends.
    let tev = std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        viewer::read_packet(&mut stream).unwrap();
    });
    let message = render(here.path(), &address, &["--resolution", "64x48", "-o", "a.exr", "--spp", "64"]);
    tev.join().unwrap();
    let [warning] = warnings(&message)[..] else { panic!("{message}") };
    assert!(warning.starts_with(&format!("warning: tev at {address} is gone (")), "{warning}");
    assert_eq!(names(here.path()), ["a.exr", "scene.glb"]);
}

#[cfg(unix)]
#[test]
fn a_tev_that_reads_nothing_delays_the_render_by_seconds_only() {
    let here = with("cornell-box");
    let (listener, address) = listen();
    stream::shrink(&listener);
    let flags = ["--resolution", "640x480", "--max-depth", "2", "--spp", "1", "-o", "a.exr"];
    let tev = std::thread::spawn(move || {
        let stream = listener.accept().unwrap();
        // Keeps the connection open while the program runs.
        (stream, listener)
    });
    let start = Instant::now();
    let message = render(here.path(), &address, &flags);
    let elapsed = start.elapsed();
    drop(tev.join().unwrap());
    let [warning] = warnings(&message)[..] else { panic!("{message}") };
    assert!(warning.contains("did not take the whole image within 5 s"), "{warning}");
    // The render waits for tev once, and not once per packet. With a busy machine, all may take 20 times as long.
    let free = Instant::now();
    taugate(here.path(), &[&["render", "scene.glb"], &SMALL[..], &flags].concat());
    let bound = 20 * (free.elapsed() + Duration::from_secs(5));
    assert!(elapsed < bound, "{elapsed:?}, although it takes {:?} without tev", free.elapsed());
}

#[test]
fn addresses_are_checked_before_anything_is_loaded() {
    let here = folder();
    for address in ["localhost", "localhost:0", "::1:14158", "[::1:14158", "http://localhost:14158", ":14158", ""] {
        let tev = format!("--tev={address}");
        fails(here.path(), &["render", "a.glb", "-o", "a.exr", &tev], 2, "--tev");
    }
    let message = fails(here.path(), &["render", "a.glb", "-o", "a.exr", "--tev=localhost"], 2, "like 127.0.0.1:14158");
    assert!(message.contains("'localhost' is not the address of a tev: write HOST:PORT"), "{message}");
    // Without =, the word after --tev is the scene.
    fails(here.path(), &["render", "-o", "a.exr", "--tev", "a.glb"], 2, "a.glb: ");
    fails(here.path(), &["render", "--tev", "a.glb"], 2, "add -o OUT.exr");
    for (value, part) in
        [("'nowhere'", "write HOST:PORT"), ("false", "remove the key"), ("3", "must be true or an address like")]
    {
        std::fs::write(here.path().join("e.toml"), format!("scene = 'a.glb'\n[output]\ntev = {value}\n")).unwrap();
        fails(here.path(), &["render", "e.toml", "-o", "a.exr"], 2, part);
    }
}

#[test]
fn a_scan_is_not_shown_and_says_so() {
    let here = with("hidden-letter");
    let (listener, address) = listen();
    let experiment = "scene = 'scene.glb'\n[scan]\nlaser = [2, 0, 1.5]\npoints = [[0, 0, 0]]\n[gate]\ngates = '1.9m..2.9m/2'\n\
                      [render]\nspp = 64\n[output]\noutput = 'a.npy'\n";
    std::fs::write(here.path().join("e.toml"), experiment).unwrap();
    let message = message_of(taugate(here.path(), &["render", "e.toml", &format!("--tev={address}")]));
    assert!(message.contains("note: a scan is not shown in tev"), "{message}");
    listener.set_nonblocking(true).unwrap();
    assert!(listener.accept().is_err(), "it connects");
}
