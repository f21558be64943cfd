//! The commands. Only here and in `main` is anything printed: results to stdout, everything else to stderr.

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

/// Prints a result. A reader that closed the pipe, such as `head`, has seen enough.
fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(e).context("the result cannot be written to where stdout leads")
        }
        _ => Ok(()),
    }
}

/// Says a line on stderr. Where nobody listens any more, because a pipe or a terminal was closed, work goes on.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
