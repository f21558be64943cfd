//! `taugate view` as a process, and `taugate render` to compare with.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Condvar, Mutex};

use exr::prelude::read_first_flat_layer_from_file;

/// Width and height of all images of these tests.
pub const SIZE: u32 = 32;

/// The root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

pub fn scenes() -> PathBuf {
    root().join("scenes")
}

fn taugate() -> Command {
    let program =
        std::env::var_os("TAUGATE_PROGRAM").map_or_else(|| root().join("target/release/taugate"), PathBuf::from);
    assert!(program.exists(), "{} is not there; run cargo build --release first", program.display());
    Command::new(program)
}

/// A running viewer. It ends when it is dropped.
pub struct Program {
    process: Child,
    /// The address that it printed.
    pub url: String,
    /// The folder for saved files.
    pub folder: tempfile::TempDir,
    _turn: Turn,
}

/// The right to run a viewer. Viewers run one after the other: several would slow each other down.
struct Turn;

static IS_TAKEN: Mutex<bool> = Mutex::new(false);
static IS_FREE: Condvar = Condvar::new();

impl Turn {
    fn wait() -> Turn {
        let is_taken = IS_TAKEN.lock().unwrap();
        *IS_FREE.wait_while(is_taken, |is_taken| *is_taken).unwrap() = true;
        Turn
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *IS_TAKEN.lock().unwrap() = false;
        IS_FREE.notify_one();
    }
}

impl Program {
    /// A viewer of the Cornell box, with images of [`SIZE`] x [`SIZE`] pixels.
    pub fn start(flags: &[&str]) -> Program {
        Program::of("cornell-box.glb", [SIZE; 2], flags)
    }

    /// A viewer of a scene of the folder `scenes`.
    pub fn of(scene: &str, [width, height]: [u32; 2], flags: &[&str]) -> Program {
        let turn = Turn::wait();
        let folder = tempfile::tempdir().unwrap();
        let mut process = taugate()
            .arg("view")
            .arg(scenes().join(scene))
            .args(["--resolution", &format!("{width}x{height}"), "--listen", "127.0.0.1:0", "--save-to"])
            .arg(folder.path())
            .args(flags)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("taugate starts");
        let mut url = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut url).unwrap();
        let url = url.trim_end().to_string();
        assert!(url.starts_with("http://127.0.0.1:"), "taugate view prints its address first, not {url:?}");
        Program { process, url, folder, _turn: turn }
    }

    pub fn port(&self) -> u16 {
        let (address, _) = self.url.split_once("/#").unwrap();
        address.rsplit_once(':').unwrap().1.parse().unwrap()
    }

    pub fn token(&self) -> &str {
        self.url.split_once('#').unwrap().1
    }

    /// Ends the program as Ctrl-C does.
    #[cfg(unix)]
    pub fn interrupt(&mut self) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        self.process.wait().unwrap();
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Renders with the words of a command line after `taugate`, with another seed than the page, into a new folder.
pub fn render(words: &[String]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("image.exr");
    let output = taugate()
        .args(words)
        .args(["--seed", "7", "--spp", "32", "--quiet", "-o"])
        .arg(&image)
        .output()
        .expect("taugate starts");
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    (folder, image)
}

/// The words of a render of the Cornell box with the size of these tests.
pub fn words(flags: &[&str]) -> Vec<String> {
    let size = format!("{SIZE}x{SIZE}");
    let scene = scenes().join("cornell-box.glb").display().to_string();
    ["render", &scene, "--resolution", &size].iter().chain(flags).map(|word| word.to_string()).collect()
}

/// Whether two images agree within their noise, as `taugate compare --z` decides.
pub fn agree(a: &Path, b: &Path) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let output = taugate()
        .arg("compare")
        .args([a, b])
        .arg("--z")
        .arg(folder.path().join("z.png"))
        .output()
        .expect("taugate starts");
    match output.status.code() {
        Some(0) => true,
        Some(1) => false,
        _ => panic!("{}", String::from_utf8_lossy(&output.stderr)),
    }
}

/// R, G, B of an image file, pixel by pixel.
pub fn pixels(path: &Path) -> Vec<f32> {
    let image = read_first_flat_layer_from_file(path).unwrap();
    let channels = &image.layer_data.channel_data.list;
    let [r, g, b] = ["R", "G", "B"].map(|name| {
        let channel = channels.iter().find(|channel| channel.name.to_string() == name).expect("a channel");
        channel.sample_data.values_as_f32().collect::<Vec<f32>>()
    });
    r.into_iter().zip(g).zip(b).flat_map(|((r, g), b)| [r, g, b]).collect()
}
