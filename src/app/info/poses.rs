//! `--poses`: where an animated node is, as the trajectory of a scan.

use std::io::Write;
use std::path::Path;

use taugate::Error;
use taugate::internals::files::{check_writable, has_extension, write_atomically};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::job::read;

/// Poses per second, and the largest number of them, whose file a scan still reads.
const RATE: f64 = 240.0;
const MAX_POSES: f64 = 40_000.0;

/// Writes the poses of `NODE=FILE.csv`.
pub fn write(experiment: &Experiment, wanted: &str) -> Result<(), Error> {
    let split =
        wanted.rsplit_once('=').filter(|(node, file)| !node.is_empty() && has_extension(Path::new(file), "csv"));
    let Some((node, file)) = split else {
        return Err(Error::advice(
            format!("--poses {wanted} names no node and no file: "),
            "write it like car=poses.csv",
        ));
    };
    let file = Path::new(file);
    check_writable(file)?;
    let poses = read::poses(experiment, node, |end| (end * RATE).ceil().min(MAX_POSES) as u32)?;
    write_atomically(file, |writer| {
        writeln!(writer, "time,x,y,z,qx,qy,qz,qw")?;
        poses.iter().try_for_each(|(time, place, rotation)| {
            let [x, y, z] = place.to_array();
            let [qx, qy, qz, qw] = rotation.to_array();
            writeln!(writer, "{time},{x},{y},{z},{qx},{qy},{qz},{qw}")
        })
    })?;
    crate::app::say(&format!(
        "{}: {} poses of '{node}' from 0 s to {} s; with at, give begin the same time",
        file.display(),
        poses.len(),
        (poses[poses.len() - 1].0 * 1e6).round() / 1e6
    ));
    Ok(())
}
