//! `taugate bench`: renders the scenes and variants of a suite in turns, and compares them with references.

mod kept;
mod references;
mod shown;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use taugate::internals::bench::case::{Case, Entry};
use taugate::internals::bench::growth;
use taugate::internals::bench::quality::{MARGIN, MARGIN_OF_BOUNDS, MAX_REFERENCE_RELMSE, Trust, trust};
use taugate::internals::bench::race::Race;
use taugate::internals::bench::reference::{self, Reference};
use taugate::internals::bench::report::{self, Page};
use taugate::internals::bench::suite::{Part, SceneEntry, Suite};
use taugate::internals::bench::summary;
use taugate::internals::bench::sweep::Sweep;
use taugate::internals::bench::table::{self, Row};
use taugate::internals::compare::metrics::Means;
use taugate::internals::files::check_readable;
use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::settings::MAX_SECONDS;
use taugate::{Error, Result};

use super::interrupts::{INTERRUPTED, Interrupt, Interrupts};
use super::progress::Progress;
use crate::app::cli::BenchArgs;
use shown::{SuiteProgress, command, text};

/// A suite, changed by the flags, with the scenes that are on this machine.
struct Bench {
    suite: Suite,
    out: PathBuf,
    references: PathBuf,
    /// For each scene on this machine: its index in `suite.scenes`, and its entries.
    present: Vec<(usize, Vec<Entry>)>,
    /// One sentence for each scene that is not on this machine.
    skipped: Vec<String>,
    /// The command that the user typed, without --resume and --reference.
    command: String,
}

pub fn run(args: &BenchArgs) -> anyhow::Result<ExitCode> {
    let mut progress = Progress::new(args.quiet);
    let bench = Bench::new(args, &progress)?;
    if bench.present.is_empty() {
        return Err(Error::settings(format!("no scene is left to measure: {}", bench.skipped.join("; "))).into());
    }
    let device = Device::open(args.device.as_deref())?;
    let interrupts = Interrupts::new()?;
    interrupts.end_the_process_at(Interrupt::Second);
    let stop = &*interrupts.stop;
    let outcome = match args.reference {
        true => references::make(&bench, args, &device, stop, &mut progress),
        false => bench.race(args, &device, stop, &mut progress),
    };
    progress.finish();
    let code = outcome?;
    if !bench.skipped.is_empty() {
        let scenes = if bench.skipped.len() == 1 { "scene" } else { "scenes" };
        progress.line(&format!("skipped {} {scenes}: {}", bench.skipped.len(), bench.skipped.join("; ")));
    }
    Ok(code)
}

impl Bench {
    /// Reads the suite and loads every scene once, so that mistakes are found before hours of work.
    fn new(args: &BenchArgs, progress: &Progress) -> Result<Bench> {
        check_readable(&args.suite)?;
        let mut suite = Suite::read(&args.suite)?;
        choose(&mut suite, &args.scenes)?;
        if let Some(time) = args.time {
            suite.seconds = time.0;
        }
        if suite.seconds > MAX_SECONDS {
            return Err(Error::settings("the time of a suite must be at most a year"));
        }
        suite.repetitions = args.repetitions.unwrap_or(suite.repetitions);
        if let Some(resolution) = args.resolution {
            // Scenes of a sweep over pixels keep their own resolution.
            let others = suite.scenes.iter_mut().filter(|scene| scene.sweep != Some(Sweep::Pixels));
            others.for_each(|scene| scene.experiment.camera.resolution = Some(resolution));
        }
        let out = args.out.clone().unwrap_or_else(|| format!("bench-{}", suite.name).into());
        let references = reference::folder(&out);
        let command = command(args);
        let mut bench = Bench { suite, out, references, present: vec![], skipped: vec![], command };
        for (at, scene) in bench.suite.scenes.iter().enumerate() {
            if !scene.exists() && !scene.folder_exists() {
                bench.skipped.push(format!("{} is not on this machine ({})", scene.name, scene.path().display()));
                continue;
            }
            if !scene.exists() {
                let message = format!("there is no scene {}; check the name", scene.path().display());
                return Err(bench.suite.error_at(scene, Part::Path, &message));
            }
            let case = Case::load(&bench.suite, scene)?;
            case.warnings.iter().for_each(|warning| progress.line(&format!("warning: {}: {warning}", scene.name)));
            bench.present.push((at, case.entries));
        }
        Ok(bench)
    }

    fn scene(&self, at: usize) -> &SceneEntry {
        &self.suite.scenes[at]
    }

    fn results(&self) -> PathBuf {
        self.out.join("results.csv")
    }

    /// The file of results that were too accurate for their reference. They decide how accurate the next reference must be.
    fn refused(&self) -> PathBuf {
        self.out.join("refused.csv")
    }

    /// The command that renders the references which are missing or too noisy.
    fn remedy(&self) -> String {
        format!("{} --reference", self.command)
    }

    fn race(
        &self,
        args: &BenchArgs,
        device: &Device,
        stop: &AtomicBool,
        progress: &mut Progress,
    ) -> anyhow::Result<ExitCode> {
        let mut rows = self.kept(args.resume, device, progress)?;
        self.check_references()?;
        self.check_gates(&rows)?;
        make_folder(&self.out.join("images"))?;

        let mut suite_progress = SuiteProgress {
            started: Instant::now(),
            done: 0.0,
            all: self.work(&rows),
            repetitions: self.suite.repetitions,
        };
        let mut code = ExitCode::SUCCESS;
        for (at, entries) in &self.present {
            if self.missing(&rows, *at, entries).is_empty() {
                continue;
            }
            if self.race_scene(device, *at, &mut rows, &mut suite_progress, stop, progress)? == Verdict::Refused {
                code = ExitCode::from(1);
            }
            if stop.load(Ordering::Relaxed) {
                code = ExitCode::from(INTERRUPTED);
                break;
            }
        }
        rows.retain(|row| self.shows(row));
        if rows.is_empty() {
            progress.line("nothing was finished; no report was written");
            return Ok(code);
        }
        self.report(args, device, &rows, progress)?;
        Ok(code)
    }

    /// Fails unless every entry has a reference by this version of the renderer. Another version may render another image.
    fn check_references(&self) -> Result<()> {
        for (at, entries) in self.present.iter().filter(|_| self.suite.errors) {
            let (scene, folder) = (&self.scene(*at).name, self.references.display());
            for entry in entries {
                let wrong = match reference::read(&self.references, entry)? {
                    Some(Reference { current: true, .. }) => continue,
                    Some(_) => format!(
                        "the reference for {scene} ({}) in {folder} is by another version of the renderer (its code or its version differs); \
                         check it, and keep it if it still agrees, with: {}",
                        entry.variant,
                        self.remedy()
                    ),
                    None => format!(
                        "there is no reference for {scene} ({}) in {folder}; make it with: {}",
                        entry.variant,
                        self.remedy()
                    ),
                };
                return Err(Error::settings(wrong));
            }
        }
        Ok(())
    }

    /// Fails if a gate meets no light, before hours of work on other scenes.
    fn check_gates(&self, rows: &[Row]) -> Result<()> {
        for (at, entries) in &self.present {
            let scene = self.scene(*at);
            if entries[0].settings.responses().are_steady() || self.missing(rows, *at, entries).is_empty() {
                continue;
            }
            Case::load(&self.suite, scene)?.prepare(&self.suite, scene)?;
        }
        Ok(())
    }

    /// Whether the report shows a row. Rows of scenes that this run leaves out stay in the table alone. Rows of further repetitions
    /// come from an earlier run.
    fn shows(&self, row: &Row) -> bool {
        row.repetition < self.suite.repetitions && self.present.iter().any(|(at, _)| self.scene(*at).name == row.scene)
    }

    /// Repetitions in which a row is missing for at least one entry.
    fn missing(&self, rows: &[Row], at: usize, entries: &[Entry]) -> Vec<u32> {
        let scene = &self.scene(at).name;
        let has = |repetition: u32, entry: &Entry| {
            rows.iter().any(|r| r.scene == *scene && r.variant == entry.variant && r.repetition == repetition)
        };
        (0..self.suite.repetitions).filter(|&r| !entries.iter().all(|entry| has(r, entry))).collect()
    }

    /// Seconds of rendering that are left.
    fn work(&self, rows: &[Row]) -> f64 {
        let races = |(at, entries): &(usize, Vec<Entry>)| self.missing(rows, *at, entries).len() * entries.len();
        self.suite.seconds * self.present.iter().map(races).sum::<usize>() as f64
    }

    /// Renders all missing repetitions of a scene, and writes the table after each.
    fn race_scene(
        &self,
        device: &Device,
        at: usize,
        rows: &mut Vec<Row>,
        suite_progress: &mut SuiteProgress,
        stop: &AtomicBool,
        progress: &mut Progress,
    ) -> Result<Verdict> {
        let scene = self.scene(at);
        let case = Case::load(&self.suite, scene)?;
        let found = |entry: &Entry| match self.suite.errors {
            true => reference::read(&self.references, entry),
            false => Ok(None),
        };
        let references = case.entries.iter().map(found).collect::<Result<Vec<_>>>()?;
        let prepared = case.prepare(&self.suite, scene)?;
        let mut race = Race::new(device, &case, &prepared, references)?;
        drop(prepared);
        for repetition in self.missing(rows, at, &case.entries) {
            let mut watch = |seconds: f64| {
                suite_progress.done += seconds;
                progress.show(suite_progress.part(), || suite_progress.describe(&scene.name, repetition));
                !stop.load(Ordering::Relaxed)
            };
            let Some(mut new) = race.run(repetition, self.suite.seconds, &mut watch)? else {
                return Ok(Verdict::Measured);
            };
            let poor = MEASURES.map(|(_, part)| too_near(&new, part).filter(|_| self.suite.errors));
            if let [Some((_, Trust::Nothing)), Some((trimmed, Trust::Nothing))] = poor {
                progress.failure(&format!(
                    "refused: {}: trimmed, {}; relMSE over all pixels fails too; make a better reference with: {}",
                    scene.name,
                    nearness(trimmed, summary::trimmed),
                    self.remedy()
                ));
                self.keep_refused(&scene.name, new)?;
                return Ok(Verdict::Refused);
            }
            for ((name, part), near) in MEASURES.into_iter().zip(poor) {
                if let Some((row, trust)) = near.filter(|_| repetition == 0) {
                    progress.line(&format!(
                        "note: {}: {name}, {}; {} make a better reference with: {}",
                        scene.name,
                        nearness(row, part),
                        match trust {
                            Trust::Nothing => "the report leaves it out;",
                            _ => "the report has bounds;",
                        },
                        self.remedy()
                    ));
                }
            }
            if repetition == 0 && self.suite.errors {
                self.keep_images(&case, &race)?;
            }
            for row in &mut new {
                row.fingerprint = self.fingerprint(&row.fingerprint, device);
            }
            rows.retain(|row| row.scene != scene.name || row.repetition != repetition);
            rows.extend(new);
            table::write(&self.results(), rows)?;
        }
        Ok(Verdict::Measured)
    }

    /// Writes the rows of a refused scene over those of its earlier refusal, and keeps the rows of other scenes.
    fn keep_refused(&self, scene: &str, new: Vec<Row>) -> Result<()> {
        let path = self.refused();
        let mut rows = if path.exists() { table::read(&path)? } else { vec![] };
        rows.retain(|row| row.scene != scene);
        rows.extend(new);
        table::write(&path, &rows)
    }

    fn keep_images(&self, case: &Case, race: &Race) -> Result<()> {
        for (entry, film, seconds) in race.films() {
            let settings = &entry.settings;
            let provenance = Provenance {
                seed: taugate::internals::bench::race::seed(0),
                ..Provenance::new(settings, seconds, entry.config.clone())
            };
            exr_file::write(&report::image_path(&self.out, &case.name, &entry.variant), film, &provenance)?;
        }
        Ok(())
    }

    fn report(&self, args: &BenchArgs, device: &Device, rows: &[Row], progress: &Progress) -> anyhow::Result<()> {
        let scenes: Vec<(String, Vec<Entry>)> =
            self.present.iter().map(|(at, entries)| (self.scene(*at).name.clone(), entries.clone())).collect();
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        let page = Page {
            suite: &self.suite,
            rows,
            scenes: &scenes,
            references: &self.references,
            missing: &self.skipped,
            machine: format!("{} and {threads} host threads", device.info().name),
            command: self.command.clone(),
            seconds: self.suite.seconds,
            repetitions: self.suite.repetitions,
        };
        let path = report::write(&self.out, &page)?;
        progress.finish();
        if args.quiet {
            return Ok(());
        }
        for (scene, _) in &scenes {
            super::print(&text(scene, &summary::summarise(rows, scene)))?;
        }
        super::print(&growth::section(&growth::growth(&self.suite, rows)))?;
        progress.line(&format!("{}, {}", path.display(), self.results().display()));
        Ok(())
    }
}

/// One of the two relMSE.
type Measure = fn(Means) -> f64;
const MEASURES: [(&str, Measure); 2] = [("relMSE over all pixels", summary::all), ("trimmed", summary::trimmed)];

/// The result with the smallest relMSE among those that are trusted least, and the trust in it. `None` if all are fully trusted.
fn too_near(rows: &[Row], part: Measure) -> Option<(&Row, Trust)> {
    let trusted = rows.iter().map(|row| (row, trust(part(row.own), part(row.relmse))));
    trusted
        .filter(|(_, trust)| *trust < Trust::Full)
        .min_by(|(a, of_a), (b, of_b)| of_a.cmp(of_b).then(part(a.relmse).total_cmp(&part(b.relmse))))
}

fn nearness(row: &Row, part: Measure) -> String {
    format!(
        "{} reached a relMSE of {:.2e}; the relMSE of the reference itself is {:.2e}, but must be {MARGIN} times smaller ({MARGIN_OF_BOUNDS} times for bounds) and at most {MAX_REFERENCE_RELMSE}",
        row.variant,
        part(row.relmse),
        part(row.own)
    )
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Measured,
    Refused,
}

/// Removes the scenes that are not in `names` from the suite. An empty `names` keeps all.
fn choose(suite: &mut Suite, names: &[String]) -> Result<()> {
    let known = |name: &String| suite.scenes.iter().any(|scene| scene.name == *name);
    if let Some(name) = names.iter().find(|name| !known(name)) {
        let all: Vec<&str> = suite.scenes.iter().map(|scene| scene.name.as_str()).collect();
        return Err(Error::settings(format!("the suite has no scene '{name}': choose from {}", all.join(", "))));
    }
    suite.scenes.retain(|scene| names.is_empty() || names.contains(&scene.name));
    Ok(())
}

fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| Error::File {
        path: path.into(),
        message: format!("this folder cannot be created: {e}; choose another --out"),
    })
}
