//! `taugate render` of an experiment with `[scan]`: one render per point of the laser, on one renderer.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use taugate::internals::error::Result;
use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::image::scan_file::ScanFilm;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::input::scan_table::{Scan, ScanTable};
use taugate::internals::input::scenery;
use taugate::internals::render::schedule::scan_samples;
use taugate::internals::render::{MemoryPlan, PreparedScene, Renderer, check_aimed_points};
use taugate::internals::scene::Scene;
use taugate::internals::settings::table::OutputTable;
use taugate::internals::settings::{Budget, Sampling, Settings};
use taugate::{Error, ErrorKind};

use super::super::interrupts::Interrupt;
use super::super::preparation::Preparation;
use super::super::progress::{Before, Position, duration, rays};
use super::super::report::dropped;
use super::super::rescue::Rescue;
use super::super::{feasible, memory};
use super::{
    NotFinite, Outcome, Session, check_inputs, check_outputs, load_scene, with_saved_results, with_scene_path,
};

/// Measures all pairs of points and writes the array.
pub fn run(table: &ScanTable, mut experiment: Experiment, session: &mut Session) -> anyhow::Result<ExitCode> {
    let path = output(&experiment)?;
    let scan = table.scan().map_err(Error::Settings)?;
    let scene_path = experiment.scene.clone().expect("the experiment names a scene");
    let has_variance = experiment.output.variance.unwrap_or(false);
    let outputs = resolve::outputs(&experiment)?;
    check_outputs(&outputs)?;
    check_inputs(&outputs.replaced(), &scene_path, &experiment)?;

    // Load the scene and resolve the settings.
    let mut preparation = Preparation::new();
    let mut scene = preparation.timed("load scene", || load_scene(&experiment))?;
    scenery::apply(&mut experiment, &mut scene)?;
    let resolved = resolve::resolve(&experiment, &scene)?;
    let settings = resolved.settings.change().sampling(Sampling::Uniform).build()?;
    let config = resolve::as_experiment(&experiment, &settings, &scene);
    let printed = Experiment { output: Default::default(), ..config }.to_toml();
    for warning in scene.warnings.iter().chain(&resolved.warnings) {
        session.say(format!("warning: {warning}"));
    }
    if experiment.output.tev.is_some() {
        session.say("note: a scan is not shown in tev, because it is no image".into());
    }
    memory::check(&settings, memory::ImageParts { variance: has_variance, exr: false }, memory::free())?;
    memory::check_bytes(
        ScanFilm::bytes(&scan, settings.responses().len(), has_variance),
        memory::free(),
        "the array of the scan",
        "use fewer gates or points",
    )?;

    // Prepare the device.
    let prepared = preparation.timed("build BVH and tables", || PreparedScene::new(&scene, &settings));
    let mut prepared = prepared.map_err(|error| with_scene_path(error, &scene_path))?;
    let device = preparation.timed("open device", || Device::open(experiment.render.device.as_deref()))?;
    MemoryPlan::new(&scene, &settings, &prepared, Some(device.info()))?.check(device.info())?;
    if !scan.accounts_first_and_last {
        preparation.timed("check points", || check_points(&device, &scene, &settings, &scan))?;
    }
    let mut renderer = Renderer::from_prepared(&device, &scene, &settings, &prepared)?;
    if has_variance {
        renderer.estimate_response_variance();
    }
    let laser = scene.lights.len() - 1;
    preparation.finish();

    // Measure.
    session.interrupts.end_the_process_at(Interrupt::Second);
    let strict = experiment.render.strict.unwrap_or(false);
    let mut film = ScanFilm::new(&scan, settings.responses().len(), has_variance);
    let count = scan.laser_points.len();
    let (mut measured, mut samples) = (0, 0);
    let mut failure = None;
    let started = Instant::now();
    while measured < count {
        scene.lights[laser] = scan.light(measured);
        let turned = turn(&mut renderer, &mut prepared, &scene, &settings, &scan, measured);
        let result = turned.map_err(anyhow::Error::from);
        match result.and_then(|()| measure(&mut renderer, &settings, count, strict, session)) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => match error.downcast::<Error>()? {
                error if error.kind() == ErrorKind::Device && measured > 0 => {
                    failure = Some(error);
                    break;
                }
                error => return Err(error.into()),
            },
        }
        film.set(measured, renderer.film(), renderer.responses());
        (measured, samples) = (measured + 1, renderer.film().samples());
        let rays_so_far = renderer.stats().rays();
        let position = Position { samples, elapsed: started.elapsed(), rays: rays_so_far, before: Before::default() };
        session.progress.show(measured as f64 / count as f64, || {
            format!("point {measured} of {count}, {}", rays(position.rays_per_second()))
        });
    }
    session.progress.finish();
    if measured == 0 {
        session.progress.line("interrupted before the first point of the laser was measured; nothing was written");
        return Ok(Outcome::Interrupted.code());
    }
    if measured == count && film.is_black() && !experiment.gate.force.unwrap_or(false) {
        return Err(feasible::nothing_inside(&device, &scene, &settings).into());
    }

    // Write.
    session.interrupts.end_the_process_at(Interrupt::None);
    let provenance = Provenance::new(&settings, started.elapsed().as_secs_f64(), printed);
    let mut rescue = Rescue::default();
    let description = film.description(table, &scan, measured, samples, &provenance);
    rescue.write(&path, |path| film.write(path, &scan, &description));
    rescue.finish()?;
    let is_whole = measured == count;
    if let Some(warning) = dropped(renderer.stats().dropped) {
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
        None => Ok(if is_whole { Outcome::Done } else { Outcome::Interrupted }.code()),
    }
}

/// Prepares the renderer for point `number` of the laser. The last light of `scene` is the laser at that point.
fn turn(
    renderer: &mut Renderer,
    prepared: &mut PreparedScene,
    scene: &Scene,
    settings: &Settings,
    scan: &Scan,
    number: usize,
) -> Result<()> {
    if !prepared.follow(scene, settings)? || !renderer.set_camera(&scan.camera(number))? {
        unreachable!("laser and sensor keep their places, and turn");
    }
    renderer.set_lights(prepared, settings)?;
    renderer.restart(Scan::seed(settings.seed(), number), settings.responses().clone())
}

/// The file of the array that the scan writes. Fails if the user wants other files.
fn output(experiment: &Experiment) -> Result<PathBuf> {
    let OutputTable { output, checkpoint, resume, shard, .. } = &experiment.output;
    if checkpoint.is_some() || resume.is_some() || shard.is_some() {
        return Err(Error::Settings(
            "a scan has no sums to keep: leave out --checkpoint, --resume and --shard, and scan fewer points per command"
                .into(),
        ));
    }
    let files = output.clone().map_or(vec![], |files| files.0);
    match &files[..] {
        [file] if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) => Ok(file.clone()),
        _ => Err(Error::Settings("a scan is one array: write -o OUT.npy".into())),
    }
}

/// Renders one point of the laser. Returns false if an interrupt ended the render of the point early.
fn measure(
    renderer: &mut Renderer,
    settings: &Settings,
    points: usize,
    strict: bool,
    session: &mut Session,
) -> anyhow::Result<bool> {
    let budget = match settings.budget() {
        Budget::Seconds(seconds) => Budget::Seconds(seconds / points as f64),
        budget => budget,
    };
    let started = Instant::now();
    loop {
        let (film, elapsed): (_, Duration) = (renderer.film(), started.elapsed());
        let samples = scan_samples(&budget, film.width(), film.samples(), elapsed);
        if samples == 0 {
            return Ok(true);
        }
        if session.interrupts.stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        renderer.iterate(samples)?;
        let dropped = renderer.stats().dropped;
        if strict && dropped > 0 {
            return Err(NotFinite { dropped }.into());
        }
    }
}

/// Fails if a point does not lie on the surface that the laser or the sensor sees in its direction. The travel times would then be
/// those of another point.
fn check_points(device: &Device, scene: &Scene, settings: &Settings, scan: &Scan) -> Result<()> {
    let sensor_points = scan.sensor_points.as_ref().unwrap_or(&scan.laser_points);
    check_aimed_points(device, scene, settings, "sensor", &Scan::camera_at(scan.sensor, sensor_points))?;
    check_aimed_points(device, scene, settings, "laser", &Scan::camera_at(scan.laser, &scan.laser_points))
}
