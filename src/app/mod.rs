//! The commands. Only this module and `main` print: results to stdout, everything else to stderr.

mod accumulated;
mod bench;
mod check;
pub mod cli;
mod compare;
mod compiling;
mod detect;
mod devices;
mod flags;
mod generate;
mod histogram;
mod images;
mod info;
mod interrupts;
mod lidar;
mod live;
mod merge;
mod progress;
pub mod render;
mod report;
mod rescue;
mod sample_time;
mod sheet;
mod strategies;
mod view;
pub mod wrong_flags;

use std::io::{ErrorKind, IsTerminal, Write};
use std::process::ExitCode;

use anyhow::Context;
use taugate::internals::printable::escaped;
use taugate::internals::threads::start_pool;

use crate::app::cli::{Cli, Command};

pub fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    #[cfg(unix)]
    interrupts::outlive_size_limits()?;
    start_pool()?;
    match cli.command {
        Command::Render(args) => render::run(*args),
        Command::View(args) => view::run(*args),
        Command::Merge(args) => merge::run(&args.parts, &args.files, args.quiet),
        Command::Develop(args) => merge::run(std::slice::from_ref(&args.sums), &args.files, args.quiet),
        Command::Compare(args) => compare::run(&args),
        Command::Histogram(args) => histogram::run(&args),
        Command::Detect(args) => detect::run(&args),
        Command::Lidar(args) => lidar::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Generate(args) => generate::run(&args),
    }
}

/// Prints a result to stdout: plain text or JSON, with control characters escaped. A closed pipe is no error: its reader, such as
/// `head`, wants no more.
fn print(text: &str) -> anyhow::Result<()> {
    print_exactly(&escaped(text))
}

/// As [`print`], for TOML, where an escape code does not always stand for its character. So only a terminal gets codes.
fn print_toml(text: &str) -> anyhow::Result<()> {
    if std::io::stdout().is_terminal() { print(text) } else { print_exactly(text) }
}

fn print_exactly(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(e).context("the result cannot be written to stdout; check where stdout is redirected")
        }
        _ => Ok(()),
    }
}

/// Prints a line to stderr, with control characters escaped. Errors are ignored: the work must go on after the user closes the pipe
/// or the terminal.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", escaped(line));
}
