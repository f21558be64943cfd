//! The command `taugate`: turns an error chain into one message and an exit code.

mod app;

use std::process::ExitCode;

use clap::Parser;
use taugate::{Error, ErrorKind};

use crate::app::render::NotFinite;

fn main() -> ExitCode {
    // clap prints its own messages: 0 after --help, 2 after a mistake.
    let cli = app::cli::Cli::parse();
    match app::run(cli) {
        Ok(code) => code,
        Err(error) => {
            // A message of the library is whole: it says in its own words what the system said.
            match error.downcast_ref::<Error>() {
                Some(error) => app::say(&format!("error: {error}")),
                None => app::say(&format!("error: {error:#}")),
            }
            ExitCode::from(exit_code(&error))
        }
    }
}

/// 2: the user can mend it; 3: non-finite samples under --strict; 4: the device, or a defect of taugate's kernels.
fn exit_code(error: &anyhow::Error) -> u8 {
    if error.is::<NotFinite>() {
        return 3;
    }
    match error.downcast_ref().map(Error::kind) {
        Some(ErrorKind::Device | ErrorKind::Shader) => 4,
        _ => 2,
    }
}
