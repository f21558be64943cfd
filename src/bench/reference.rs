//! References: the images that the results of a suite are compared with. They are rendered until their own error is negligible.
//!
//! A reference is the mean of two independent halves a and b with different seeds. Half of their difference is a sample of its
//! error, so (a - b)^2 / 4 is an unbiased estimate of the squared error in every pixel. The file stores this estimate as its
//! variance layer.
//!
//! Short pilot renders choose the settings with the smallest error per second, which need not be settings of the suite. If a
//! reference is not accurate enough for a later race, two more halves with other seeds are added. A reference by another
//! version of the renderer is extended too if it agrees with this version. If not, it is kept beside the new one as
//! `NAME.other.exr`. A render that fails its check is kept as `NAME.rejected.exr`, and the next one has other seeds.

use std::path::{Path, PathBuf};

use super::case::{Case, Entry};
use super::pilot::{Pilot, fastest, frugal, pilots, with_defaults_of};
use super::quality::{MARGIN, MAX_REFERENCE_RELMSE, ReferenceTarget, relative};
use super::timed_renderer::TimedRenderer;
use crate::compare::agreement::{Agreement, MIN_BATCHES, agreement};
use crate::compare::metrics::Means;
use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::image::batches::{CellBatches, MAX_BATCHES};
use crate::image::exr_file::{self, Picture, Provenance, read_picture};
use crate::image::film::Film;
use crate::image::fingerprint;
use crate::render::PreparedScene;
use crate::settings::Estimator;

/// Rendering continues until the error is this fraction of the required one, because the next race may reach a smaller error by
/// luck or on a less busy machine. A smaller fraction would be expensive, and a reference can be extended later.
const TARGET_FRACTION: f64 = 0.8;
/// The error is estimated again after the rendering time has grown by this factor.
const CHECK_INTERVAL: f64 = 1.05;
/// Seeds of the two halves, which differ from the seeds of races. Each extension adds [`EXTENSION`] to all seeds.
const HALVES: [u32; 2] = [0x4000_0001, 0x4000_0002];
const EXTENSION: u32 = 0x1000;
/// Minimum number of iterations of a half; the judge needs twice as many. With fewer iterations, the noise cannot be estimated.
const MIN_ITERATIONS: u32 = MAX_BATCHES as u32 / 2;
/// The judge is another estimator, which checks the reference. Its renders have these seeds, and take these fractions of the
/// reference's time. One alarm in a thousand is false, so the first alarm counts only if the second, longer render confirms it.
const JUDGES: [(u32, f64); 2] = [(0x4000_0003, 0.25), (0x4000_0004, 1.0)];
/// A reference by another version of the renderer is compared with a render that takes this fraction of its time. A difference
/// that stays undetected is smaller than the noise of that render.
const VERSION_CHECK_FRACTION: f64 = 0.1;

/// A reference, read from the folder of references.
pub struct Reference {
    pub picture: Picture,
    /// relMSE of the reference itself, estimated from its halves.
    pub own: Means,
    /// Whether this version of the renderer rendered it; see [`fingerprint::RENDERER`].
    pub current: bool,
}

/// How the rendering of a reference ended.
#[derive(Debug, Clone)]
pub struct ReferenceReport {
    /// Name of the settings that rendered it.
    pub variant: String,
    /// Seconds of rendering, both halves together.
    pub seconds: f64,
    /// Seconds of an earlier reference that was extended; 0 without one.
    pub before: f64,
    /// Whether a reference by another version of the renderer was used.
    pub other: OtherVersion,
    /// Samples per pixel. An earlier reference counts with as many samples as its seconds would render now.
    pub samples: u64,
    pub own: Means,
    /// Upper bound that the suite requires for [`ReferenceReport::own`].
    pub wanted: Means,
    /// The estimator that checked the reference, and the result. The reference was written if they agree.
    pub judge: Estimator,
    pub agreement: Agreement,
}

/// A rendered reference, which is not written yet.
pub struct Finished {
    pub report: ReferenceReport,
    /// The file of the reference.
    pub path: PathBuf,
    film: Film,
    provenance: Provenance,
    /// Where an earlier reference that was left out is kept.
    aside: Option<PathBuf>,
}

impl Finished {
    /// Writes the reference to `target`: to [`Finished::path`], or to another file if that fails.
    pub fn write(&self, target: &Path) -> Result<()> {
        if let Some(aside) = self.aside.as_ref().filter(|_| target == self.path) {
            std::fs::rename(target, aside).map_err(|e| Error::File { path: aside.clone(), message: e.to_string() })?;
        }
        exr_file::write(target, &self.film, &self.provenance)
    }
}

/// Whether a reference by another version of the renderer was used.
#[derive(Debug, Clone)]
pub enum OtherVersion {
    /// There was none.
    None,
    /// It agrees with this version and was extended.
    Merged(Agreement),
    /// It differs from this version and was left out.
    Rejected(Agreement),
    /// It has no estimate of its noise and was left out.
    Unverified,
}

/// Reads the reference of an entry; `None` if there is none.
pub fn read(folder: &Path, entry: &Entry) -> Result<Option<Reference>> {
    let path = folder.join(&entry.reference);
    if !path.exists() {
        return Ok(None);
    }
    let picture = read_picture(&path)?;
    let own = picture.variance.as_ref().map_or(Means::INFINITE, |variance| relative(variance, &picture.rgb));
    let current = picture.renderer.as_deref() == Some(fingerprint::RENDERER);
    Ok(Some(Reference { picture, own, current }))
}

/// Renders and checks the reference that `entries` share. `watch` gets the fraction that is done and a description, and returns whether
/// to continue. `None` if `watch` stopped the work. If the check fails, [`Finished::path`] is the file for rejected renders.
pub fn make(
    device: &Device,
    case: &Case,
    prepared: &PreparedScene,
    entries: &[&Entry],
    target: ReferenceTarget,
    path: &Path,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Finished>> {
    let Some(pilots) = pilots(device, case, prepared, entries, target, watch)? else { return Ok(None) };
    let measured = || pilots.iter().filter(|pilot| pilot.measured);
    let cheapest = |mean: &[f32]| measured().map(|p| p.cost(mean)).fold(Means::INFINITE, Means::min);
    let may_render = |pilot: &&Pilot| target.estimator.is_none_or(|wanted| pilot.settings.estimator() == wanted);
    let chosen = fastest(pilots.iter().filter(may_render));
    // Pilots are slower than long renders because their iterations have few samples. The long render shows by which factor the
    // chosen settings improved. Assume that the other settings would improve by the same factor.
    let wanted = |mean: &[f32], own: Means, seconds: f64| {
        let (cheapest, chosen, known) = (cheapest(mean), chosen.cost(mean), target.best.unwrap_or(Means::INFINITE));
        let of = |of: fn(Means) -> f64| {
            let gained = (of(own) * seconds / of(chosen)).min(1.0);
            ((of(cheapest) * gained / target.seconds).min(of(known)) / MARGIN).min(MAX_REFERENCE_RELMSE)
        };
        Means { all: of(|means| means.all), trimmed: of(|means| means.trimmed) }
    };

    // Render two halves in turns.
    let mut previous = PreviousReference::read(path)?;
    let extension = next_extension(path)?;
    let mut other = OtherVersion::None;
    if previous.as_ref().is_some_and(|previous| !previous.current && previous.cells.len() < MIN_BATCHES) {
        (previous, other) = (None, OtherVersion::Unverified);
    }
    let mut doubtful = previous.as_ref().is_some_and(|previous| !previous.current);
    let mut halves = vec![];
    for seed in HALVES {
        let mut timed = case.timed(device, &chosen.settings, prepared)?;
        timed.restart(seed + extension);
        halves.push(timed);
    }
    let mut next = 2.0 * chosen.seconds;
    let (mut own, mut needed) = (Means::INFINITE, Means { all: 0.0, trimmed: 0.0 });
    let size = [halves[0].renderer.film().width(), halves[0].renderer.film().height()];
    let before = |previous: &Option<PreviousReference>| previous.as_ref().map_or(0.0, |previous| previous.seconds);
    let spent = |halves: &[TimedRenderer]| halves.iter().map(|timed| timed.clock).sum::<f64>();
    loop {
        for timed in &mut halves {
            advance(timed)?;
        }
        let seconds = spent(&halves);
        let enough = halves.iter().all(|timed| timed.renderer.film().iterations() >= MIN_ITERATIONS);
        let checked = if doubtful {
            VERSION_CHECK_FRACTION * previous.as_ref().map_or(0.0, |previous| previous.seconds)
        } else {
            0.0
        };
        let over = seconds >= target.limit.max(checked);
        if enough && (seconds >= next.max(checked) || over) {
            next = CHECK_INTERVAL * seconds;
            if let Some(another) = previous.take_if(|_| doubtful) {
                let agreement = agreement(size, &another.cells, &cells_of(&halves))?;
                (previous, other) = match agreement.is_within_noise() {
                    true => (Some(another), OtherVersion::Merged(agreement)),
                    false => (None, OtherVersion::Rejected(agreement)),
                };
                doubtful = false;
            }
            let film = join(&halves, previous.as_ref());
            let mean = film.mean();
            own = relative(&film.variance_of_mean(), &mean);
            needed = wanted(&mean, own, before(&previous) + seconds);
            if (own.all <= TARGET_FRACTION * needed.all && own.trimmed <= TARGET_FRACTION * needed.trimmed) || over {
                break;
            }
        }
        let done = (seconds / target.limit).max((needed.all / own.all).min(needed.trimmed / own.trimmed).min(1.0));
        let reached = match own.all.is_finite() {
            true => format!(
                ", own relMSE {:.2e} of {:.2e}, trimmed {:.2e} of {:.2e}",
                own.all, needed.all, own.trimmed, needed.trimmed
            ),
            false => String::new(),
        };
        if !watch(done, &format!("{}: reference by {}{reached}", case.name, chosen.variant)) {
            return Ok(None);
        }
    }
    let (seconds, mut film) = (spent(&halves), join(&halves, previous.as_ref()));
    let (variant, samples, before) = (chosen.variant.clone(), film.samples(), before(&previous));
    let cells = cells_of(&halves);

    // Another estimator, the judge, checks the new halves.
    let judge = chosen.settings.estimator().record().judge;
    let mut verdict = None;
    for (seed, part) in JUDGES {
        let needed = (judge, seed + extension);
        let Some(judge_cells) = judge_cells(device, case, prepared, entries[0], needed, part * seconds, watch)? else {
            return Ok(None);
        };
        let found = verdict.insert(agreement(size, &cells, &judge_cells)?);
        if found.is_within_noise() {
            break;
        }
    }
    let agreement = verdict.expect("there is a judge");
    // Keep only the batches of the longer render, the previous or the new one. They may have different estimators, and then the
    // spread of all batches together would not give the noise of the mean.
    film.set_cells(previous.filter(|previous| previous.seconds > seconds).map_or(cells, |previous| previous.cells));
    let is_left_out = matches!(other, OtherVersion::Rejected(_) | OtherVersion::Unverified);
    let aside = (agreement.is_within_noise() && is_left_out).then(|| path.with_extension("other.exr"));
    let path = if agreement.is_within_noise() { path.into() } else { rejected(path) };
    let provenance = provenance(entries[0], before + seconds, &variant, HALVES[0] + extension);
    let report = ReferenceReport { variant, seconds, before, other, samples, own, wanted: needed, judge, agreement };
    Ok(Some(Finished { report, path, film, provenance, aside }))
}

/// The file for a render that failed the check of the reference `path`.
pub fn rejected(path: &Path) -> PathBuf {
    path.with_extension("rejected.exr")
}

/// What to add to the seeds of a render, so that it is independent of the reference `path` and of renders that failed its check. A
/// check that fails by chance would fail again with the same seeds.
fn next_extension(path: &Path) -> Result<u32> {
    let known = [path, &rejected(path)].map(PreviousReference::read);
    let mut last = None;
    for previous in known {
        last = last.max(previous?.map(|previous| previous.extensions));
    }
    Ok(last.map_or(0, |last| last + 1).wrapping_mul(EXTENSION))
}

/// Renders one turn: a sixteenth of the time so far, from 0.01 s to 2 s.
fn advance(timed: &mut TimedRenderer) -> Result<()> {
    timed.run_until(timed.clock + (timed.clock / 16.0).clamp(0.01, 2.0))
}

/// A reference from an earlier run that was not accurate enough.
struct PreviousReference {
    /// Two images with the mean and the variance of the reference: the mean plus and minus its standard error.
    halves: [Vec<f32>; 2],
    seconds: f64,
    /// Number of times it was extended.
    extensions: u32,
    /// The batches in the file; none if the file has no valid ones.
    cells: CellBatches,
    /// Whether this version of the renderer rendered it.
    current: bool,
}

impl PreviousReference {
    /// `None` if there is none, or if its file lacks the variance, the seconds or the seed that an extension needs.
    fn read(path: &Path) -> Result<Option<PreviousReference>> {
        if !path.exists() {
            return Ok(None);
        }
        let Picture { width, height, rgb, variance, seconds, seed, cell_batches, renderer, .. } = read_picture(path)?;
        let extensions = seed.and_then(|seed| Some(seed.parse::<u32>().ok()?.checked_sub(HALVES[0])? / EXTENSION));
        let (Some(variance), Some(seconds), Some(extensions)) = (variance, seconds, extensions) else {
            return Ok(None);
        };
        let cells = CellBatches::from_floats(width, height, &cell_batches.unwrap_or_default());
        let cells = cells.unwrap_or_else(|_| CellBatches::new(width, height));
        let current = renderer.as_deref() == Some(fingerprint::RENDERER);
        Ok(Some(PreviousReference { halves: two_batches(&rgb, &variance), seconds, extensions, cells, current }))
    }

    /// Adds the reference to a film that took `seconds`, weighted by time. Weights from the estimated errors would favour halves
    /// that miss rare bright samples.
    fn add_to(&self, film: &mut Film, seconds: f64) {
        let rate = film.samples() as f64 / seconds;
        for half in &self.halves {
            film.add(half, count(0.5 * self.seconds * rate));
        }
    }
}

/// Two batches with this mean, and with this variance of the mean.
fn two_batches(mean: &[f32], variance: &[f32]) -> [Vec<f32>; 2] {
    [1.0, -1.0].map(|sign| mean.iter().zip(variance).map(|(&mean, &v)| mean + sign * v.sqrt()).collect())
}

fn cells_of(timed_renderers: &[TimedRenderer]) -> CellBatches {
    let mut cells = timed_renderers[0].renderer.film().cells().clone();
    cells.merge(timed_renderers[1].renderer.film().cells());
    cells
}

fn count(samples: f64) -> u32 {
    samples.round().clamp(1.0, f64::from(u32::MAX)) as u32
}

/// Both halves as a film with two batches, or with four if an earlier reference is added.
fn join(halves: &[TimedRenderer], previous: Option<&PreviousReference>) -> Film {
    let first = halves[0].renderer.film();
    let mut film = Film::new(first.width(), first.height());
    for timed in halves {
        let half = timed.renderer.film();
        film.add(&half.mean(), count(half.samples() as f64));
    }
    if let Some(previous) = previous {
        previous.add_to(&mut film, halves.iter().map(|timed| timed.clock).sum());
    }
    film
}

/// Batches of cells of an independent render with another estimator. `None` if `watch` stops the work.
fn judge_cells(
    device: &Device,
    case: &Case,
    prepared: &PreparedScene,
    entry: &Entry,
    (estimator, seed): (Estimator, u32),
    seconds: f64,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<CellBatches>> {
    let mut timed = case.timed(device, &frugal(with_defaults_of(entry, estimator)), prepared)?;
    timed.restart(seed);
    while timed.clock < seconds || timed.renderer.film().iterations() < 2 * MIN_ITERATIONS {
        advance(&mut timed)?;
        if !watch(1.0, &format!("{}: checking the reference with {estimator}", case.name)) {
            return Ok(None);
        }
    }
    Ok(Some(timed.renderer.film().cells().clone()))
}

fn provenance(entry: &Entry, seconds: f64, variant: &str, seed: u32) -> Provenance {
    let settings = &entry.settings;
    let note =
        format!("# A reference: two independent halves, rendered with the settings of the variant '{variant}'.\n");
    Provenance { seed, ..Provenance::new(settings, seconds, note + &entry.config) }
}

/// The folder of references. It lies beside the folder of results, so that suites share references.
pub fn folder(out: &Path) -> PathBuf {
    match out.parent() {
        Some(parent) if parent != Path::new("") => parent.join("references"),
        _ => "references".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Budget, Settings};

    #[test]
    fn seeds_differ_from_those_of_references_and_of_renders_that_failed() {
        let here = tempfile::tempdir().unwrap();
        let path = here.path().join("a.exr");
        assert_eq!(next_extension(&path).unwrap(), 0);
        let settings = Settings::builder().resolution([1, 1]).budget(Budget::Spp(2)).build().unwrap();
        let mut film = Film::new(1, 1);
        (0..2).for_each(|_| film.add(&[1.0; 3], 1));
        let write = |path: &Path, extension: u32| {
            let seed = HALVES[0] + extension * EXTENSION;
            exr_file::write(path, &film, &Provenance { seed, ..Provenance::new(&settings, 1.0, String::new()) })
                .unwrap();
        };
        write(&path, 0);
        assert_eq!(next_extension(&path).unwrap(), EXTENSION);
        write(&rejected(&path), 1);
        assert_eq!(next_extension(&path).unwrap(), 2 * EXTENSION);
        write(&path, 2);
        assert_eq!(next_extension(&path).unwrap(), 3 * EXTENSION);
    }

    /// A film that is extended from the mean and variance in a file equals the film of all four original halves.
    #[test]
    fn an_extended_reference_is_what_four_halves_make() {
        let halves: [&[f32]; 4] = [&[1.0, 5.0, 0.0], &[3.0, 4.0, 0.0], &[2.5, 0.0, 1.0], &[0.5, 8.0, 3.0]];
        let film = |batches: &[(&[f32], u32)]| {
            let mut film = Film::new(1, 1);
            batches.iter().for_each(|(image, samples)| film.add(image, *samples));
            film
        };
        // Ten samples in 2 s, then 20 in 4 s.
        let old = film(&[(halves[0], 5), (halves[1], 5)]);
        let mut extended = film(&[(halves[2], 10), (halves[3], 10)]);
        let both = two_batches(&old.mean(), &old.variance_of_mean());
        let cells = CellBatches::new(1, 1);
        PreviousReference { halves: both, seconds: 2.0, extensions: 0, cells, current: true }
            .add_to(&mut extended, 4.0);
        let all = film(&[(halves[0], 5), (halves[1], 5), (halves[2], 10), (halves[3], 10)]);
        assert_eq!((extended.samples(), extended.iterations()), (30, 4));
        for (a, b) in [(extended.mean(), all.mean()), (extended.variance_of_mean(), all.variance_of_mean())] {
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} {b:?}");
        }
    }
}
