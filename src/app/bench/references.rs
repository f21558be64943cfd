//! `taugate bench --reference`: renders, extends and checks the references of a suite.

use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use taugate::internals::bench::case::{Case, Entry};
use taugate::internals::bench::quality::{ReferenceTarget, Trust, trust};
use taugate::internals::bench::reference::{self, OtherVersion, ReferenceReport};
use taugate::internals::bench::table::{self, Row};
use taugate::internals::compare::agreement::Agreement;
use taugate::internals::compare::metrics::Means;
use taugate::internals::gpu::Device;
use taugate::{Error, Result};

use super::{Bench, make_folder};
use crate::app::cli::BenchArgs;
use crate::app::interrupts::INTERRUPTED;
use crate::app::progress::{Progress, duration};
use crate::app::rescue::Rescue;

/// Time limit of a reference without --reference-time, as a multiple of the suite's time.
const TIME_LIMIT_FACTOR: f64 = 40.0;

/// Renders every missing reference of the suite. Extends or replaces each reference that is not accurate enough for the results, or that
/// another version of the renderer rendered. With --reference-time, extends all references.
pub fn make(
    bench: &Bench,
    args: &BenchArgs,
    device: &Device,
    stop: &AtomicBool,
    progress: &mut Progress,
) -> anyhow::Result<ExitCode> {
    if !bench.suite.errors {
        let message = "this suite measures costs only and needs no references; leave out --reference";
        return Err(Error::settings(message).into());
    }
    make_folder(&bench.references)?;
    let mut code = ExitCode::SUCCESS;
    for (at, entries) in &bench.present {
        let scene = bench.scene(*at);
        let names = distinct(entries);
        let wanted: Vec<(&str, Option<Means>)> = names
            .into_iter()
            .map(|name| Ok((name, best(bench, &scene.name, entries, name)?)))
            .collect::<Result<Vec<_>>>()?
            .into_iter()
            .filter(|(name, best)| args.reference_time.is_some() || !is_good(bench, entries, name, *best))
            .collect();
        if wanted.is_empty() {
            progress.line(&format!("{}: its references are complete", scene.name));
            continue;
        }
        let case = Case::load(&bench.suite, scene)?;
        let prepared = case.prepare(&bench.suite, scene)?;
        for (name, best) in wanted {
            let limit = args.reference_time.map_or(TIME_LIMIT_FACTOR * bench.suite.seconds, |time| time.0);
            let estimator = args.reference_estimator;
            let target = ReferenceTarget { seconds: bench.suite.seconds, estimator, limit, best };
            let sharing: Vec<&Entry> = case.entries.iter().filter(|entry| entry.reference == name).collect();
            let path = bench.references.join(name);
            let mut watch = |done: f64, what: &str| {
                progress.show(done, || what.to_string());
                !stop.load(Ordering::Relaxed)
            };
            let started = Instant::now();
            match reference::make(device, &case, &prepared, &sharing, target, &path, &mut watch)? {
                None => {
                    progress.line(&format!(
                        "interrupted: {} of work on the reference of {} is lost; a run with a shorter --reference-time writes what it \
                         has, and the next run extends it",
                        duration(started.elapsed().as_secs_f64()),
                        scene.name
                    ));
                    return Ok(ExitCode::from(INTERRUPTED));
                }
                Some(finished) => {
                    let mut rescue = Rescue::default();
                    rescue.write(&finished.path, |path| finished.write(path));
                    rescue.finish()?;
                    let good = report_outcome(&scene.name, &path, &finished.report, progress);
                    code = if good { code } else { ExitCode::from(1) };
                }
            }
        }
    }
    Ok(code)
}

/// Names of the references that the entries need, each once.
fn distinct(entries: &[Entry]) -> Vec<&str> {
    let mut names: Vec<&str> = vec![];
    for entry in entries {
        if !names.contains(&entry.reference.as_str()) {
            names.push(&entry.reference);
        }
    }
    names
}

/// The smallest relMSE that this version of the renderer reached against this reference, with any time per render and on any
/// device. Refused results count too. `None` without results.
fn best(bench: &Bench, scene: &str, entries: &[Entry], name: &str) -> Result<Option<Means>> {
    let mut rows = vec![];
    for path in [bench.results(), bench.refused()].iter().filter(|path| path.exists()) {
        rows.extend(table::read(path)?);
    }
    let of = |row: &Row, e: &Entry| e.variant == row.variant && row.fingerprint.starts_with(&e.fingerprint);
    let counts = |row: &&Row| row.scene == scene && entries.iter().any(|e| e.reference == name && of(row, e));
    let errors = rows.iter().filter(counts).map(|row| row.relmse);
    Ok(errors.reduce(Means::min))
}

fn is_good(bench: &Bench, entries: &[Entry], name: &str, best: Option<Means>) -> bool {
    let entry = entries.iter().find(|entry| entry.reference == name).expect("an entry has this reference");
    let found = reference::read(&bench.references, entry).ok().flatten();
    let best = best.unwrap_or(Means::INFINITE);
    let good = |own: f64, relmse: f64| trust(own, relmse) == Trust::Full;
    found.is_some_and(|r| r.current && good(r.own.all, best.all) && good(r.own.trimmed, best.trimmed))
}

/// Prints the outcome. Returns whether the reference was written.
fn report_outcome(scene: &str, path: &Path, report: &ReferenceReport, progress: &Progress) -> bool {
    let ReferenceReport { variant, seconds, before, other, samples, own, wanted, judge, agreement } = report;
    let taken = match *before > 0.0 {
        true => format!("{}, added to {} before", duration(*seconds), duration(*before)),
        false => duration(*seconds),
    };
    let old = "the reference by another version of the renderer";
    match other {
        OtherVersion::None => {}
        OtherVersion::Merged(agreement) => progress.line(&format!(
            "{scene}: {old} agrees with this version (|z| at most {:.1} of {:.1}) and is extended",
            agreement.max_z, agreement.threshold
        )),
        OtherVersion::Rejected(agreement) => progress.line(&format!(
            "{scene}: {old} differs from this version (|z| = {:.1}, where {:.1} is significant); a new one was started, and the old one is kept beside it",
            agreement.max_z, agreement.threshold
        )),
        OtherVersion::Unverified => progress.line(&format!("{scene}: {old} cannot be checked; a new one was started, and the old one is kept beside it")),
    }
    let Agreement { max_z, threshold, tests, .. } = agreement;
    if !agreement.is_within_noise() {
        progress.failure(&format!(
            "{scene}: no reference was written, because the render by {variant} in {taken} differs from {judge} (|z| = {max_z:.1} in \
             one of {tests} means of cells, where {threshold:.1} is significant); {} keeps it, and the next run has other seeds",
            reference::rejected(path).display()
        ));
        return false;
    }
    progress.line(&format!(
        "{}: {scene} by {variant}, {samples} samples per pixel in {taken}, own relMSE {:.2e}, trimmed {:.2e}; agrees with {judge} (|z| at most {max_z:.1} of {threshold:.1} in {tests} means of cells)",
        path.display(),
        own.all,
        own.trimmed
    ));
    if own.all > wanted.all || own.trimmed > wanted.trimmed {
        progress.line(&format!(
            "warning: {scene}: the time limit ended the render before the reference was accurate enough: for this suite its own relMSE \
             should be {:.2e}, trimmed {:.2e}; run --reference again to extend it, with --reference-time for a longer limit",
            wanted.all, wanted.trimmed
        ));
    }
    true
}
