//! `taugate render` of an experiment with `[scan]`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use taugate::internals::files::has_extension;
use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::{self, Resolved};
use taugate::internals::input::scan_table::ScanTable;
use taugate::internals::job::sum_files::Before;
use taugate::internals::job::{Job, feasible, read};
use taugate::internals::scan::{Measurement, PreparedScan, check_memory, scene_at};
use taugate::internals::settings::Sampling;
use taugate::internals::settings::aov::Aov;
use taugate::internals::settings::table::OutputTable;
use taugate::{Error, Result};

use super::super::interrupts::Interrupt;
use super::super::progress::{Position, duration, rays};
use super::super::report::dropped;
use super::super::rescue::Rescue;
use super::{Session, check_inputs, check_outputs, code, failure, with_saved_results, with_scene_path};

/// Measures all pairs of points and writes the array.
pub fn run(table: &ScanTable, experiment: Experiment, session: &mut Session) -> anyhow::Result<ExitCode> {
    let path = output(&experiment)?;
    let scan = table.scan().map_err(Error::settings)?;
    let scene_path = experiment.scene.clone().expect("the experiment names a scene");
    let has_variance = experiment.output.variance.unwrap_or(false);
    let outputs = resolve::outputs(&experiment)?;
    check_outputs(&outputs)?;
    check_inputs(&outputs.replaced(), &scene_path, &experiment)?;

    // Load the scene and resolve the settings.
    let scene = read::scene(&experiment)?;
    let mut job = Job::new(experiment, scene)?;
    job.resolved.settings = job.resolved.settings.change().sampling(Sampling::Uniform).build()?;
    let printed = job.config().to_toml();
    job.warnings().iter().for_each(|warning| session.say(format!("warning: {warning}")));
    let Job { experiment, scene, resolved: Resolved { settings, .. }, .. } = job;
    if experiment.output.tev.is_some() {
        session.say("note: a scan is not shown in tev, because it is no image".into());
    }
    check_memory(&scan, &settings, has_variance)?;

    // Prepare the device.
    let ready = PreparedScan::new(&scan, scene, &settings).map_err(|error| with_scene_path(error, &scene_path))?;
    let (warnings, darkest) = ready.warnings(&scan, &settings);
    warnings.iter().for_each(|warning| session.say(format!("warning: {warning}")));
    let device = Device::open(experiment.render.device.as_deref())?;
    let mut measurement = Measurement::new(&device, &scan, ready, has_variance)?;

    // Measure.
    session.interrupts.end_the_process_at(Interrupt::Second);
    let strict = experiment.render.strict.unwrap_or(false);
    let count = scan.laser_points.len();
    let started = Instant::now();
    let end = measurement.run(strict, &session.interrupts.stop, |measurement| {
        let measured = measurement.measured();
        let position = Position::of(measurement.renderer(), started.elapsed(), Before::default());
        session.progress.show(measured as f64 / count as f64, || {
            format!("point {measured} of {count}, {}", rays(position.rays_per_second()))
        });
    });
    let failure = failure(end?)?;
    session.progress.finish();
    let (measured, samples, film) = (measurement.measured(), measurement.samples(), measurement.film());
    if measured == 0 {
        session.progress.line("interrupted before the first point of the laser was measured; nothing was written");
        return Ok(code(true));
    }
    if measured == count && film.is_black() && !experiment.gate.force.unwrap_or(false) {
        let scene = scene_at(measurement.scene().0.clone(), &scan, &settings, darkest);
        return Err(feasible::nothing_inside(&device, &scene, &settings).into());
    }

    let layers = (outputs.aov != Aov::default()).then(|| measurement.layers(&device, outputs.aov)).transpose()?;

    // Write.
    session.interrupts.end_the_process_at(Interrupt::None);
    let provenance = Provenance::new(&settings, started.elapsed().as_secs_f64(), printed);
    let mut rescue = Rescue::default();
    let description = film.description(table, &scan, measured, samples, layers.as_ref(), &provenance);
    rescue.write(&path, |path| film.write(path, &scan, layers.as_ref(), &description));
    rescue.finish()?;
    let is_whole = measured == count;
    if let Some(warning) = dropped(measurement.renderer().stats().dropped) {
        session.progress.line(&format!("warning: {warning}"));
    }
    session.progress.line(&format!(
        "{}: {count} laser points x {} sensor points x {} gates, {samples} samples each, in {}",
        path.display(),
        scan.sensor_count(),
        settings.responses().len(),
        duration(provenance.seconds)
    ));
    if !is_whole {
        session.progress.line(&format!("interrupted after {measured} points of the laser; the others are NaN"));
    }
    match failure {
        Some(failure) => {
            let results = format!("the {measured} points of the laser before the error");
            Err(with_saved_results(failure, &results).into())
        }
        None => Ok(code(!is_whole)),
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
