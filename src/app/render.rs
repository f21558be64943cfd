//! `taugate render`: from the command line to the files.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use taugate::Error;
use taugate::error::Result;
use taugate::experiment::Experiment;
use taugate::exr_file::Provenance;
use taugate::files::check_writable;
use taugate::gpu::Device;
use taugate::render::{Prepared, Renderer, StrategyImages};
use taugate::resolve::{self, Outputs};
use taugate::schedule::next_samples;
use taugate::settings::Settings;

use super::progress::{Position, Progress};
use super::report::{Report, files, is_black};
use super::{feasible, strategies};
use crate::cli::RenderArgs;

/// Non-finite samples under --strict.
#[derive(Debug, thiserror::Error)]
#[error("{dropped} samples were not finite, and --strict was given; no image was written. Without it they count as 0")]
pub struct NotFinite {
    dropped: u64,
}

pub fn run(args: RenderArgs) -> anyhow::Result<ExitCode> {
    let (quiet, print_config) = (args.quiet, args.print_config);
    let experiment = read_experiment(args)?;
    if !print_config {
        check_outputs(&resolve::outputs(&experiment)?)?;
    }

    // Load the scene and settle what is to be done.
    let scene_path = experiment.scene.clone().expect("read_experiment names a scene");
    let scene = taugate::scene::gltf::load(&scene_path)?;
    let resolved = resolve::resolve(&experiment, &scene)?;
    let settings = &resolved.settings;
    let config = resolve::as_experiment(&experiment, settings, &scene);
    if print_config {
        super::print(&config.to_toml());
        return Ok(ExitCode::SUCCESS);
    }
    let outputs = resolve::outputs(&experiment)?;

    if outputs.strategy_images.is_some() {
        StrategyImages::check(settings)?;
    }

    // Prepare the device.
    let mut progress = Progress::new(quiet);
    for warning in scene.warnings.iter().chain(&resolved.warnings) {
        progress.line(&format!("warning: {warning}"));
    }
    let started = Instant::now();
    let prepared = Prepared::new(&scene, settings)?;
    let (device, force) = (experiment.render.device.as_deref(), experiment.gate.force.unwrap_or(false));
    if !settings.gate.is_open() && !force {
        feasible::check_gate(&scene, settings, &prepared, device)?;
    }
    let device = Device::open(device)?;
    let mut renderer = Renderer::from_prepared(&device, &scene, settings, &prepared)?;
    drop(prepared);
    let prepared = started.elapsed();

    // Render.
    let stop = stop_on_interrupt()?;
    let strict = experiment.render.strict.unwrap_or(false);
    let rendering = Instant::now();
    let rendered = iterate(&mut renderer, settings, strict, &stop, &mut progress);
    progress.finish();
    let schedule = rendered?;
    let elapsed = rendering.elapsed();
    let interrupted = stop.load(Ordering::Relaxed);
    if interrupted && renderer.film().samples() == 0 {
        progress.line("interrupted before the first image; nothing was written");
        return Ok(ExitCode::from(130));
    }

    if !settings.gate.is_open() && !force && !interrupted && is_black(&renderer) {
        return Err(feasible::nothing_inside(&device, &scene, settings).into());
    }

    // Write.
    let provenance = Provenance {
        resolution: settings.resolution,
        crop: settings.crop,
        gate: settings.gate,
        seed: settings.seed,
        seconds: elapsed.as_secs_f64(),
        settings: Experiment { output: Default::default(), ..config }.to_toml(),
    };
    let report =
        Report { renderer: &renderer, settings, provenance: &provenance, prepared, warnings: &resolved.warnings };
    report.write(&outputs)?;
    report.summarise(&outputs, &progress);
    if let Some(folder) = outputs.strategy_images.as_ref().filter(|_| !interrupted) {
        drop(renderer);
        let images = strategies::Job { device: &device, scene: &scene, settings, schedule: &schedule, stop: &stop };
        images.write(folder, &provenance, &progress)?;
    }
    Ok(ExitCode::from(if stop.load(Ordering::Relaxed) { 130 } else { 0 }))
}

/// What was typed, over the experiment file if one was named. Names a scene.
fn read_experiment(args: RenderArgs) -> Result<Experiment> {
    let input = args.input.clone();
    let mut typed = args.into_experiment();
    let extension = input.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "toml" {
        let experiment = typed.over(Experiment::read(&input)?);
        if experiment.scene.is_none() {
            let message = "names no scene; add a first line like scene = \"room.glb\"".into();
            return Err(Error::File { path: input, message });
        }
        return Ok(experiment);
    }
    if extension != "glb" && extension != "gltf" {
        let message = "is neither a scene (.glb, .gltf) nor an experiment (.toml)".into();
        return Err(Error::File { path: input, message });
    }
    typed.scene = Some(input);
    Ok(typed)
}

/// An hour of rendering should not end in a folder that cannot be written to.
fn check_outputs(outputs: &Outputs) -> Result<()> {
    files(outputs).try_for_each(|path| check_writable(path))?;
    outputs.strategy_images.as_ref().map_or(Ok(()), |folder| strategies::check_folder(folder))
}

/// The first interrupt ends the render after the running iteration, the second at once.
pub(super) fn stop_on_interrupt() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })?;
    Ok(stop)
}

/// Adds iterations until the budget is used or somebody interrupts; returns the samples of each.
fn iterate(
    renderer: &mut Renderer,
    settings: &Settings,
    strict: bool,
    stop: &AtomicBool,
    progress: &mut Progress,
) -> anyhow::Result<Vec<u32>> {
    let started = Instant::now();
    let mut schedule = vec![];
    loop {
        let samples = next_samples(&settings.budget, renderer.film().samples(), started.elapsed());
        if samples == 0 || stop.load(Ordering::Relaxed) {
            return Ok(schedule);
        }
        renderer.iterate(samples)?;
        schedule.push(samples);
        let dropped = renderer.stats().dropped;
        if strict && dropped > 0 {
            return Err(NotFinite { dropped }.into());
        }
        progress.update(&Position::of(renderer, started.elapsed()), &settings.budget);
    }
}
