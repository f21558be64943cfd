//! References: what the images of a suite are measured against, rendered until their own error no longer matters.
//!
//! A reference is the mean of two independent halves with seeds of their own. Half their difference is a sample of its error,
//! so (a - b)^2 / 4 is an unbiased estimate of its squared error in every pixel; the file carries it as its variance layer.

use std::path::{Path, PathBuf};

use super::check::{self, Agreement, Cells};
use super::job::{Entry, Job};
use super::lane::Lane;
use crate::error::Result;
use crate::exr_file::{self, Picture, Provenance, read_picture};
use crate::film::Film;
use crate::gpu::Device;
use crate::render::Prepared;
use crate::settings::{Estimator, Settings};

/// A reference's own relMSE must be this many times below the best result it is compared with.
pub const MARGIN: f64 = 20.0;
/// Rendering goes on to this part of what is needed: the next race may be lucky, or the machine less busy.
const AIM: f64 = 0.7;
/// Above this, a reference's own relMSE says nothing: the error of a dark pixel that is bright by chance is measured against
/// that very brightness.
pub const TRUSTED: f64 = 0.02;
/// Seeds, far from those of races.
const HALVES: [u32; 2] = [0x4000_0001, 0x4000_0002];
const JUDGE: u32 = 0x4000_0003;
const PILOTS: u32 = 0x4000_0100;
/// A pilot takes this part of a variant's time in the suite, within bounds in seconds.
const PILOT: (f64, f64, f64) = (0.25, 0.2, 15.0);
/// The judge renders for this part of the reference's time.
const JUDGED: f64 = 0.25;

/// A reference from the folder of references.
pub struct Reference {
    pub picture: Picture,
    /// Its own relMSE, estimated from its halves.
    pub own: f64,
}

/// Whether a result of this relMSE may be compared with a reference of that own relMSE.
pub fn is_good(own: f64, relmse: f64) -> bool {
    own <= TRUSTED && own * MARGIN <= relmse
}

/// How the making of a reference went.
#[derive(Debug, Clone)]
pub struct Made {
    /// Whose settings rendered it.
    pub variant: String,
    /// Seconds of rendering, both halves.
    pub seconds: f64,
    pub samples: u64,
    pub own: f64,
    /// What [`Made::own`] must be at most.
    pub wanted: f64,
    /// The estimator that checked it and what it found. The reference was written if they agree.
    pub judge: Estimator,
    pub agreement: Agreement,
}

/// What a reference is to be good enough for.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// Time of each variant in the suite.
    pub seconds: f64,
    /// Rendering stops after so many seconds in any case.
    pub limit: f64,
    /// The best relMSE that was measured so far, if any was.
    pub best: Option<f64>,
}

/// Reads the reference of an entry; `None` if there is none.
pub fn read(folder: &Path, entry: &Entry) -> Result<Option<Reference>> {
    let path = folder.join(&entry.reference);
    if !path.exists() {
        return Ok(None);
    }
    let picture = read_picture(&path)?;
    let own = picture.variance.as_ref().map_or(f64::INFINITY, |variance| relative(variance, &picture.rgb));
    Ok(Some(Reference { picture, own }))
}

/// Mean of squared errors over r^2 + eps, as relMSE has it; infinite for a black reference.
fn relative(squared: &[f32], reference: &[f32]) -> f64 {
    let n = reference.len() as f64;
    let mean = reference.iter().map(|&r| f64::from(r)).sum::<f64>() / n;
    if mean <= 0.0 {
        return f64::INFINITY;
    }
    let eps = (0.01 * mean).powi(2);
    squared.iter().zip(reference).map(|(&s, &r)| f64::from(s) / (f64::from(r).powi(2) + eps)).sum::<f64>() / n
}

/// A short render that tells how fast settings converge.
struct Pilot {
    variant: String,
    settings: Settings,
    variance: Vec<f32>,
    mean: Vec<f32>,
    seconds: f64,
}

impl Pilot {
    /// relMSE times seconds: what stays the same as a render goes on.
    fn cost(&self, truth: &[f32]) -> f64 {
        self.seconds * relative(&self.variance, truth)
    }
}

/// The pilot with the least cost. Each is measured against the mean of the others: its own noise would hide its error.
fn fastest(pilots: &[Pilot]) -> &Pilot {
    let cost = |at: usize| {
        let others: Vec<&Pilot> = pilots.iter().enumerate().filter(|(i, _)| *i != at).map(|(_, p)| p).collect();
        let mean = |i: usize| others.iter().map(|p| p.mean[i]).sum::<f32>() / others.len() as f32;
        pilots[at].cost(&(0..pilots[at].mean.len()).map(mean).collect::<Vec<f32>>())
    };
    match pilots.len() {
        1 => &pilots[0],
        n => &pilots[(0..n).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).expect("there is a pilot")],
    }
}

/// Renders, checks and writes the reference that `entries` share. `watch` hears which part is done and what is going on, and
/// says whether to continue; `None` if it does not. Nothing is written if the check fails.
pub fn make(
    device: &Device,
    job: &Job,
    prepared: &Prepared,
    entries: &[&Entry],
    goal: Goal,
    path: &Path,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Made>> {
    let Some(pilots) = pilots(device, job, prepared, entries, goal, watch)? else { return Ok(None) };
    let cheapest = |truth: &[f32]| pilots.iter().map(|p| p.cost(truth)).fold(f64::INFINITY, f64::min);
    let chosen = fastest(&pilots);
    // What the reference itself tells counts too: short renders are slower, with few samples an iteration.
    let wanted = |truth: &[f32], own: f64, seconds: f64| {
        let best = cheapest(truth).min(own * seconds) / goal.seconds;
        (best.min(goal.best.unwrap_or(f64::INFINITY)) / MARGIN).min(TRUSTED)
    };

    // Two halves in turns.
    let mut halves = vec![];
    for seed in HALVES {
        let mut lane = job.lane(device, &chosen.settings, prepared)?;
        lane.restart(seed);
        halves.push((lane, Cells::new()));
    }
    let mut next = 2.0 * chosen.seconds;
    let (mut own, mut asked) = (f64::INFINITY, 0.0);
    let spent = |halves: &[(Lane, Cells)]| halves.iter().map(|(lane, _)| lane.clock).sum::<f64>();
    loop {
        for (lane, cells) in &mut halves {
            turn(lane, cells, goal.limit)?;
        }
        let seconds = spent(&halves);
        let enough = halves.iter().all(|(_, cells)| 2 * cells.batches() >= check::LEAST_BATCHES);
        let over = seconds >= goal.limit;
        if enough && (seconds >= next || over) {
            next = 1.25 * seconds;
            let film = join(&halves);
            let mean = film.mean();
            own = relative(&film.variance_of_mean(), &mean);
            asked = wanted(&mean, own, seconds);
            if own <= AIM * asked || over {
                break;
            }
        }
        let done = (seconds / goal.limit).max((asked / own).min(1.0));
        let reached = if own.is_finite() { format!(", own relMSE {own:.2e} of {asked:.2e}") } else { String::new() };
        if !watch(done, &format!("{}: reference by {}{reached}", job.name, chosen.variant)) {
            return Ok(None);
        }
    }
    let (seconds, film) = (spent(&halves), join(&halves));
    let (variant, samples) = (chosen.variant.clone(), film.samples());
    let cells = halves.into_iter().map(|(_, cells)| cells).reduce(Cells::and).expect("there are two halves");

    // Another estimator is the judge.
    let judge = if chosen.settings.estimator == Estimator::Bdpt { Estimator::LcsPaper } else { Estimator::Bdpt };
    let Some(judged) = judged(device, job, prepared, entries[0], judge, JUDGED * seconds, watch)? else {
        return Ok(None);
    };
    let agreement = check::compare(&cells, &judged);
    if agreement.holds() {
        write(path, &film, entries[0], seconds, &variant)?;
    }
    Ok(Some(Made { variant, seconds, samples, own, wanted: asked, judge, agreement }))
}

/// One turn of a lane: a sixteenth of what it has rendered so far.
fn turn(lane: &mut Lane, cells: &mut Cells, whole: f64) -> Result<()> {
    lane.run_until(lane.clock + (lane.clock / 16.0).clamp(0.01, 2.0), whole)?;
    cells.note(lane.renderer.film());
    Ok(())
}

/// Both halves as one film with two batches.
fn join(halves: &[(Lane, Cells)]) -> Film {
    let first = halves[0].0.renderer.film();
    let mut film = Film::new(first.width(), first.height());
    for (lane, _) in halves {
        let half = lane.renderer.film();
        film.add(&half.mean(), u32::try_from(half.samples()).unwrap_or(u32::MAX));
    }
    film
}

/// Renders every variant that sees all the light, and plain `bdpt`, for a short while each, in turns.
fn pilots(
    device: &Device,
    job: &Job,
    prepared: &Prepared,
    entries: &[&Entry],
    goal: Goal,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Vec<Pilot>>> {
    let (part, least, most) = PILOT;
    let seconds = (part * goal.seconds).clamp(least, most);
    let mut candidates: Vec<(String, Settings)> =
        entries.iter().filter(|e| e.sees_all).map(|e| (e.variant.clone(), e.settings.clone())).collect();
    if candidates.iter().all(|(_, settings)| settings.estimator != Estimator::Bdpt) {
        candidates.push(("bdpt".into(), with(entries[0], Estimator::Bdpt)));
    }
    let mut pilots = vec![];
    for (i, (variant, settings)) in candidates.into_iter().enumerate() {
        let mut lane = job.lane(device, &settings, prepared)?;
        lane.restart(PILOTS + i as u32);
        while lane.clock < seconds || lane.renderer.film().iterations() < 4 {
            lane.run_until(lane.clock + seconds / 8.0, seconds)?;
            if !watch(0.0, &format!("{}: trying {variant}", job.name)) {
                return Ok(None);
            }
        }
        let film = lane.renderer.film();
        let (variance, mean) = (film.variance_of_mean(), film.mean());
        pilots.push(Pilot { variant, settings, variance, mean, seconds: lane.clock });
    }
    Ok(Some(pilots))
}

/// An entry's settings with another estimator as it is by default.
fn with(entry: &Entry, estimator: Estimator) -> Settings {
    let (queries, leaf_size) = (estimator.default_queries(), estimator.leaf_size());
    Settings { estimator, queries, leaf_size, single_tree: false, ..entry.settings.clone() }
}

/// Cells of an independent render with another estimator.
fn judged(
    device: &Device,
    job: &Job,
    prepared: &Prepared,
    entry: &Entry,
    estimator: Estimator,
    seconds: f64,
    watch: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Option<Cells>> {
    let mut lane = job.lane(device, &with(entry, estimator), prepared)?;
    lane.restart(JUDGE);
    let mut cells = Cells::new();
    while lane.clock < seconds || cells.batches() < check::LEAST_BATCHES {
        turn(&mut lane, &mut cells, seconds)?;
        if !watch(1.0, &format!("{}: checking the reference with {estimator}", job.name)) {
            return Ok(None);
        }
    }
    Ok(Some(cells))
}

fn write(path: &Path, film: &Film, entry: &Entry, seconds: f64, variant: &str) -> Result<()> {
    let settings = &entry.settings;
    let note =
        format!("# A reference: two independent halves, rendered with the settings of the variant '{variant}'.\n");
    let provenance = Provenance {
        resolution: settings.resolution,
        crop: settings.crop,
        gate: settings.gate,
        seed: HALVES[0],
        seconds,
        settings: note + &entry.config,
    };
    exr_file::write(path, film, &provenance)
}

/// Where references are kept: beside the folder of results, so that suites share them.
pub fn folder(out: &Path) -> PathBuf {
    match out.parent() {
        Some(parent) if parent != Path::new("") => parent.join("references"),
        _ => "references".into(),
    }
}
