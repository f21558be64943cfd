//! `--print-config`.

use std::process::ExitCode;

use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::sequence::at_first_frame;
use taugate::internals::input::{resolve, scenery};
use taugate::internals::scene::gltf;

use super::{load_scene, source};
use crate::app::print_toml;

/// Prints the settings of an experiment. A sequence has the camera, the headlamp and the estimator of its first frame.
pub fn print(experiment: &Experiment) -> anyhow::Result<ExitCode> {
    let (path, allowed, playback) = source(experiment);
    let end = match &experiment.output.frames {
        Some(_) => gltf::end_of_animations(path, &allowed, playback.animation)?,
        None => None,
    };
    let mut first = at_first_frame(experiment, end)?;
    let mut scene = load_scene(&first)?;
    scenery::apply(&mut first, &mut scene)?;
    let resolved = resolve::resolve(&first, &scene)?;
    // The frames choose the time.
    first.input.at = experiment.input.at;
    let config = resolve::as_experiment(&first, &resolved.settings, &scene);
    // With absolute paths the experiment is valid in every folder.
    print_toml(&config.with_absolute_paths()?.to_toml())?;
    Ok(ExitCode::SUCCESS)
}
