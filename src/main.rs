//! The program `taugate`. `main` turns an error into one message and an exit code.

mod app;

use std::process::ExitCode;

use clap::Parser;
use taugate::{Error, ErrorKind};

use crate::app::render::NotFinite;

fn main() -> ExitCode {
    // clap prints its own messages and exits with 0 after --help, with 2 after a wrong flag.
    let cli = app::cli::Cli::try_parse().unwrap_or_else(|error| app::wrong_flags::exit_with(&error));
    match app::run(cli) {
        Ok(code) => code,
        Err(error) => {
            // A message of the library already contains the cause, so its sources are not printed again.
            match error.downcast_ref::<Error>() {
                Some(error) => app::say(&format!("error: {error}")),
                None => app::say(&format!("error: {error:#}")),
            }
            ExitCode::from(exit_code(&error))
        }
    }
}

/// 2: the user can solve the problem; 3: non-finite samples with --strict; 4: device error, or a defect of taugate's kernels.
fn exit_code(error: &anyhow::Error) -> u8 {
    if error.is::<NotFinite>() {
        return 3;
    }
    match error.downcast_ref().map(Error::kind) {
        Some(ErrorKind::Device | ErrorKind::Shader) => 4,
        _ => 2,
    }
}
