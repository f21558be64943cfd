//! `taugate generate`: writes the project's own scenes to files.

use std::io::Write;
use std::process::ExitCode;

use taugate::Error;
use taugate::internals::files::{has_extension, write_atomically};
use taugate::internals::generate::{Kind, glb_bytes};

use crate::app::cli::GenerateArgs;

pub fn run(args: &GenerateArgs) -> anyhow::Result<ExitCode> {
    let GenerateArgs { name, output, roughness, triangles } = args;
    let kind = Kind::parse(name).ok_or_else(|| {
        Error::settings(format!("no scene is called '{name}'; choose one of {}", Kind::NAMES.join(", ")))
    })?;
    let kind = kind.with(*roughness, *triangles).map_err(Error::settings)?;
    if !has_extension(output, "glb") {
        return Err(Error::settings(format!("the output {} must end in .glb", output.display())).into());
    }
    write_atomically(output, |writer| writer.write_all(&glb_bytes(kind)))?;
    Ok(ExitCode::SUCCESS)
}
