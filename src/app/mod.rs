//! The commands. Only this module and `main` print: results to stdout, everything else to stderr.

mod bench;
mod check;
pub mod cli;
mod compare;
mod devices;
mod feasible;
mod flags;
mod generate;
mod info;
mod interrupts;
mod preparation;
mod progress;
pub mod render;
mod report;
mod strategies;

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::Context;

use crate::app::cli::{Cli, Command};

pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    match cli.command {
        Command::Render(args) => render::run(*args),
        Command::Compare(args) => compare::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Generate(args) => generate::run(&args),
    }
}

/// Prints a result to stdout. A closed pipe is no error: its reader, such as `head`, wants no more.
fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(e).context("the result cannot be written to stdout; check where stdout is redirected")
        }
        _ => Ok(()),
    }
}

/// Prints a line to stderr. Errors are ignored: the work must go on after the user closes the pipe or the terminal.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
