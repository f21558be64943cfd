//! The commands. Only here and in `main` is anything printed: results to stdout, everything else to stderr.

mod compare;
mod devices;
mod info;
mod progress;
pub mod render;

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::scene::Scene;

use crate::cli::{Cli, Command};

pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    match cli.command {
        Command::Render(args) => render::run(*args),
        Command::Compare(args) => compare::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Devices(args) => devices::run(&args),
    }
}

/// Loads a glTF scene.
fn load_scene(path: &Path) -> taugate::error::Result<Scene> {
    let fail = |message: String| Err(Error::Scene { path: path.into(), message });
    match std::fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => fail("no such file; check the name".into()),
        Err(e) => fail(format!("cannot be read: {e}")),
        Ok(_) => fail("this build cannot load scenes yet".into()),
    }
}

/// Prints a result. A reader that closed the pipe, such as `head`, has seen enough.
fn print(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}
