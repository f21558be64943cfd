//! Renders an experiment (.toml) or a scene (.glb, .gltf), as `taugate render` does: `render_file ROOM.glb OUT.exr [NAME=VALUE]...`.
//! If the program is stopped, the same command continues the render.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use taugate::{End, Job};

/// Renders `input` with further settings, and writes the image to `out`. Ends early if another thread sets `stop`.
pub fn render(input: &Path, settings: &[(&str, &str)], out: &Path, stop: &Arc<AtomicBool>) -> taugate::Result<End> {
    let job = Job::open_with(input, settings.iter().copied())?;
    job.notes().iter().for_each(|note| eprintln!("note: {note}"));
    let device = job.open_device()?;
    let mut job = job.prepare(&device)?;
    job.keep_sums(&out.with_extension("acc"), Duration::from_secs(60))?;
    job.warnings().for_each(|warning| eprintln!("warning: {warning}"));

    let end = job.run(stop, |progress| eprintln!("{:.0} %", 100.0 * progress.fraction))?;
    if job.film().samples() > 0 {
        job.write_exr(out)?;
    }
    Ok(end)
}

fn main() -> taugate::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [input, out, settings @ ..] = &words[..] else {
        eprintln!("usage: render_file ROOM.glb OUT.exr [NAME=VALUE]...");
        std::process::exit(2);
    };
    let settings: Vec<(&str, &str)> =
        settings.iter().map(|word| word.split_once('=').unwrap_or((word, "true"))).collect();
    let end = render(Path::new(input), &settings, Path::new(out), &Arc::default())?;
    println!("{out}: {end:?}");
    Ok(())
}
