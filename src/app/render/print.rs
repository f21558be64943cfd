//! `--print-config`.

use std::process::ExitCode;

use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::input::sequence::at_first_frame;
use taugate::internals::job::{Job, read};

use crate::app::print_toml;

/// Prints the settings of an experiment. A sequence has the camera, the headlamp and the estimator of its first frame.
pub fn print(experiment: &Experiment) -> anyhow::Result<ExitCode> {
    let end = match &experiment.output.frames {
        Some(_) => read::end_of_animations(experiment)?,
        None => None,
    };
    let first = at_first_frame(experiment, end)?;
    let scene = read::scene(&first)?;
    let Job { experiment: mut first, scene, resolved, .. } = Job::new(first, scene)?;
    // The frames choose the time.
    first.input.at = experiment.input.at;
    let config = resolve::as_experiment(&first, &resolved.settings, &scene);
    // With absolute paths the experiment is valid in every folder.
    print_toml(&config.with_absolute_paths()?.to_toml())?;
    Ok(ExitCode::SUCCESS)
}
