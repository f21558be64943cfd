//! `taugate render` of an experiment with `[scan]`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use taugate::internals::files::has_extension;
use taugate::internals::gpu::Device;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::job::ready_scan::ReadyScan;
use taugate::internals::job::sum_files::Before;
use taugate::internals::job::{Job, read};
use taugate::internals::settings::table::OutputTable;
use taugate::{Error, Result};

use super::super::interrupts::Interrupt;
use super::super::progress::{Position, duration, rays};
use super::super::report::dropped;
use super::super::rescue::Rescue;
use super::{Session, check_inputs, check_outputs, code, failure, with_saved_results};

/// Measures all pairs of points and writes the array.
pub fn run(experiment: Experiment, session: &mut Session) -> anyhow::Result<ExitCode> {
    let path = output(&experiment)?;
    let scene_path = experiment.scene.clone().expect("the experiment names a scene");
    let outputs = resolve::outputs(&experiment)?;
    check_outputs(&outputs)?;
    check_inputs(&outputs.replaced(), &scene_path, &experiment)?;
    if experiment.output.tev.is_some() {
        session.say("note: a scan is not shown in tev, because it is no image".into());
    }

    // Load the scene and prepare the device.
    let scene = read::scene(&experiment)?;
    let job = Job::new(experiment, scene)?;
    let device = job.experiment.render.device.clone();
    let mut say = |warning: &str| session.say(format!("warning: {warning}"));
    let mut scan = ReadyScan::new(job, || Device::open(device.as_deref()), &mut say)?;

    // Measure.
    session.interrupts.end_the_process_at(Interrupt::Second);
    let count = scan.points();
    let end = scan.measure(&session.interrupts.stop, |measurement, progress| {
        let elapsed = Duration::from_secs_f64(progress.seconds);
        let position = Position::of(measurement.renderer(), elapsed, Before::default());
        session.progress.show(progress.fraction, || {
            format!("point {} of {count}, {}", measurement.measured(), rays(position.rays_per_second()))
        });
    });
    session.progress.finish();
    let failure = failure(end?)?;
    let measured = scan.measured();
    if measured == 0 {
        session.progress.line("interrupted before the first point of the laser was measured; nothing was written");
        return Ok(code(true));
    }
    let layers = scan.layers()?;

    // Write.
    session.interrupts.end_the_process_at(Interrupt::None);
    let mut rescue = Rescue::default();
    rescue.write(&path, |path| scan.write(path, layers.as_ref()));
    rescue.finish()?;
    if let Some(warning) = dropped(scan.dropped()) {
        session.progress.line(&format!("warning: {warning}"));
    }
    let (samples, settings) = (scan.measurement().samples(), scan.measurement().scene().1);
    session.progress.line(&format!(
        "{}: {count} laser points x {} sensor points x {} gates, {samples} samples each, in {}",
        path.display(),
        scan.measurement().scan.sensor_count(),
        settings.responses().len(),
        duration(scan.seconds())
    ));
    if !scan.is_complete() {
        session.progress.line(&format!("interrupted after {measured} points of the laser; the others are NaN"));
    }
    match failure {
        Some(failure) => {
            let results = format!("the {measured} points of the laser before the error");
            Err(with_saved_results(failure, &results).into())
        }
        None => Ok(code(!scan.is_complete())),
    }
}

/// The file of the array that the scan writes. Fails if the user wants other files.
fn output(experiment: &Experiment) -> Result<PathBuf> {
    let OutputTable { output, checkpoint, resume, shard, .. } = &experiment.output;
    if checkpoint.is_some() || resume.is_some() || shard.is_some() {
        return Err(Error::advice(
            "a scan has no sums to keep: ",
            "leave out --checkpoint, --resume and --shard, and scan fewer points per command",
        ));
    }
    let files = output.clone().map_or(vec![], |files| files.0);
    match &files[..] {
        [file] if has_extension(file, "npy") => Ok(file.clone()),
        _ => Err(Error::advice("a scan is one array: ", "write -o OUT.npy")),
    }
}
