//! Renders that write their sums to a file, and renders that go on from sums.

use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::job::sum_files::SumFiles;
use taugate::internals::job::sums::Identity;
use taugate::internals::settings::Settings;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::table::OutputTable;

use crate::errors::{Result, settings as mistake};

/// The files of sums that `wanted` names. `experiment` is that of the render, with all defaults; `None` if no file has the whole scene.
/// Fails if the sums that exist belong to another render, or lack the variances of several gates that this render must have.
pub fn sum_files(
    wanted: &OutputTable,
    experiment: Option<Experiment>,
    settings: &Settings,
    has_variance: bool,
) -> Result<SumFiles> {
    let checkpoint = resolve::checkpoint(wanted)?;
    if checkpoint.is_none() && wanted.resume.is_none() {
        return Ok(SumFiles::default());
    }
    let Some(experiment) = experiment else {
        return Err(mistake(
            "a scene from arrays, or with moved nodes, is in no file, so its render cannot be continued; leave out checkpoint and \
             resume",
        ));
    };
    let mut sums = SumFiles::open(wanted.resume.as_deref(), checkpoint.as_ref())?;
    if !sums.shard(None)?.is_all() {
        return Err(mistake("these sums are a shard; continue them with the program: taugate render --resume"));
    }
    sums.identify(Identity::new(experiment, settings, Shard::ALL)?);
    sums.check(has_variance)?;
    Ok(sums)
}
