//! `taugate render`: from the command line to the files.

mod errors;
mod outputs;
mod print;
mod scan;
mod sequence;

use std::collections::HashSet;
use std::io::IsTerminal;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file::Provenance;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve;
use taugate::internals::input::sequence::Sequence;
use taugate::internals::job::frames::Outcome;
use taugate::internals::job::iterations::Abandons;
use taugate::internals::job::preparation::Preparation;
use taugate::internals::job::ready::Ready;
use taugate::internals::job::ready_job::{ReadyJob, Step};
use taugate::internals::job::sum_files::SumFiles;
use taugate::internals::job::sums::{self, Identity, empty_shard};
use taugate::internals::job::{Job, exposure, frames, memory, read};
use taugate::internals::render::StrategyImages;
use taugate::internals::settings::table::OutputTable;
use taugate::internals::tev::TevStream;

use super::interrupts::{INTERRUPTED, Interrupt, Interrupts};
use super::live::Live;
use super::progress::{Position, Progress};
use super::report::Report;
use super::strategies::StrategyRender;
use super::{compiling, sample_time, strategies};
use crate::app::cli::RenderArgs;
pub use errors::NotFinite;
use errors::{failure, with_saved_results};
pub use outputs::check_inputs;
use outputs::check_outputs;

pub fn run(args: RenderArgs) -> anyhow::Result<ExitCode> {
    let (quiet, print_config) = (args.quiet, args.print_config);
    let experiment = match args.input.clone() {
        Some(input) => read::experiment(input, args.into_experiment())?,
        None => sums::read_experiment(args.into_experiment())?,
    };
    experiment.check_paths()?;
    if print_config {
        return print::print(&experiment);
    }
    // A file of messages has other lines to expect.
    if !quiet && std::io::stderr().is_terminal() {
        compiling::announce()?;
    }
    if experiment.scan.is_some() {
        return scan::run(experiment, &mut Session::new(quiet)?);
    }
    let sequence = Sequence::new(&experiment, || read::end_of_animations(&experiment))?;
    let mut session = Session::new(quiet)?;
    match sequence {
        Some(sequence) => sequence::run(sequence, &mut session),
        None => Ok(code(matches!(session.render(experiment)?, Outcome::Interrupted))),
    }
}

fn code(is_interrupted: bool) -> ExitCode {
    ExitCode::from(if is_interrupted { INTERRUPTED } else { 0 })
}

/// Renders one experiment after the other on one device, and keeps the compiled kernels of the device.
pub struct Session {
    pub interrupts: Interrupts,
    pub progress: Progress,
    device: Option<Device>,
    /// The renderer of the previous frame.
    ready: Option<Ready>,
    /// Whether the experiments are the frames of a sequence. If so, existing files are kept, black frames are allowed, and an
    /// interrupted frame is not written.
    pub is_sequence: bool,
    /// The stream of --tev; `None` before the first render, and without --tev.
    tev: Option<TevStream>,
    /// Notes and warnings that were printed already.
    said: HashSet<String>,
}

impl Session {
    pub fn new(quiet: bool) -> anyhow::Result<Session> {
        let (interrupts, progress) = (Interrupts::new()?, Progress::new(quiet));
        let said = HashSet::new();
        Ok(Session { interrupts, progress, device: None, ready: None, is_sequence: false, tev: None, said })
    }

    /// Prints a line, unless an earlier render of the session printed it.
    fn say(&mut self, line: String) {
        if !self.said.contains(&line) {
            self.progress.line(&line);
            self.said.insert(line);
        }
    }

    /// Renders an experiment and writes its files.
    pub fn render(&mut self, experiment: Experiment) -> anyhow::Result<Outcome> {
        let scene_path = experiment.scene.clone().expect("the experiment names a scene");
        let outputs = resolve::outputs(&experiment)?;
        if self.is_sequence {
            frames::remove_cut_off(&outputs)?;
        }
        check_outputs(&outputs)?;
        check_inputs(&outputs.replaced(), &scene_path, &experiment)?;
        // Measure before the earlier sums are read, and count the images of the previous frame as free. The images of this render
        // take the place of both.
        let free = memory::free_without(self.ready.as_ref().map_or(0, |ready| ready.renderer.response_bytes()));
        let mut sums = SumFiles::open(experiment.output.resume.as_deref(), outputs.checkpoint.as_ref())?;
        // There is no result to keep yet.
        self.interrupts.end_the_process_at(Interrupt::First);

        // Load the scene and resolve the settings.
        let mut preparation = Preparation::start();
        let scene = preparation.timed("load scene", || read::scene(&experiment))?;
        // All frames have the same settings, so a mistake in one frame is one of its scene.
        let of_frame = |error: taugate::Error| error.in_scene(Some(&*scene_path).filter(|_| self.is_sequence));
        let mut job = Job::new(experiment, scene).map_err(of_frame)?;
        job.is_frame = self.is_sequence;
        let (config, settings) = (job.config(), &job.settings().clone());
        let OutputTable { shard, tev, .. } = job.experiment.output.clone();
        let shard = sums.shard(shard)?;
        resolve::check_shard(shard, &outputs)?;
        if self.is_sequence || outputs.sums().next().is_some() || sums.has_earlier() {
            sums.identify(Identity::new(config.clone(), settings, shard)?);
        }
        let mut printed = config.to_toml();
        if let Some(identity) = sums.identity().filter(|_| self.is_sequence) {
            printed = frames::with_inputs(&printed, identity);
            if frames::is_finished(&outputs, identity)? {
                return Ok(Outcome::Kept);
            }
        }
        sums.check(outputs.has_variance())?;
        let parts = memory::ImageParts { variance: outputs.has_variance(), exr: outputs.exr.is_some() };
        memory::check(settings, parts, free)?;
        if outputs.strategy_images.is_some() {
            StrategyImages::check(settings)?;
            if job.experiment.input.shutter.is_some() {
                let message = "--strategy-images shows a single moment: ";
                return Err(
                    taugate::Error::advice(message, "leave out --shutter, and choose the moment with --at").into()
                );
            }
        }
        if self.tev.is_none() {
            // The stream connects while the device is prepared.
            self.tev = tev.map(TevStream::new);
        }

        // Prepare the device. The renderer of the previous frame also renders this frame if only cameras, lights or gates moved.
        let lengths = exposure::lengths(&job.experiment.input);
        let without_work = empty_shard(shard, &settings.budget(), lengths);
        job.notes.iter().chain(&without_work).for_each(|note| self.say(format!("note: {note}")));
        job.warnings().iter().for_each(|warning| self.say(format!("warning: {warning}")));
        let gate_warning = job.resolved.gate_warning.clone();
        let mut job = self.prepare(job, outputs.has_variance(), &mut preparation)?;
        preparation.finish();

        // Render.
        let before = sums.before();
        if let Some((line, note)) = job.continue_sums(sums, shard)? {
            self.progress.line(&line);
            note.iter().for_each(|note| self.progress.line(&format!("note: {note}")));
        }
        self.interrupts.end_the_process_at(Interrupt::Second);
        let stop = &self.interrupts.stop;
        let (name, responses) = (outputs.name(), settings.responses());
        let mut live = self.tev.as_mut().map(|stream| Live { stream, name, responses });
        let progress = &mut self.progress;
        let own_budget = lengths.budget_of(shard, settings.budget());
        let rendered = job.iterate(stop, Abandons::LaterOnes, |Step { renderer, elapsed, not_written, .. }| {
            if let Some(live) = &mut live {
                live.update(renderer, progress);
            }
            if let Some(error) = not_written {
                progress.line(&format!("warning: {error}; the render goes on, and tries it again later"));
            }
            progress.update(&Position::of(renderer, elapsed, before), &own_budget);
        });
        self.progress.finish();
        let failure = failure(rendered?)?;
        if self.is_sequence
            && let Some(failure) = failure
        {
            return Err(failure.into());
        }
        let interrupted = stop.load(Ordering::Relaxed) || failure.is_some();
        if interrupted && (self.is_sequence || job.film().samples() == 0) {
            self.progress.line(match self.is_sequence {
                true => "interrupted; the finished frames are kept, and the same command continues after them",
                false => "interrupted before the first image; nothing was written",
            });
            return Ok(Outcome::Interrupted);
        }

        if !interrupted {
            job.check_light()?;
        }

        if let Some(warning) = job.warn_of_moments() {
            self.progress.line(&format!("warning: {warning}"));
        }

        // Write.
        let renderer = &job.ready.renderer;
        let provenance = Provenance { merged: renderer.merged(), ..Provenance::new(settings, job.seconds(), printed) };
        let warnings: Vec<String> = job.warnings().map(String::from).collect();
        let report = Report {
            renderer,
            settings,
            provenance: &provenance,
            seconds: job.elapsed.as_secs_f64(),
            before,
            layers: &job.layers,
            preparation: &preparation,
            warnings: &warnings,
            gate_warning: gate_warning.as_deref(),
            is_frame: self.is_sequence,
        };
        self.interrupts.end_the_process_at(Interrupt::None);
        if let Some(live) = &mut live {
            live.send_last(renderer);
        }
        report.write(&outputs, |path| job.sums.write(path, renderer, &job.layers, job.seconds()))?;
        report.summarise(&outputs, &self.progress);
        if let Some(live) = live {
            self.interrupts.end_the_process_at(Interrupt::Second);
            live.finish(&self.progress);
            self.interrupts.end_the_process_at(Interrupt::None);
        }
        if let Some(path) = job.sums.checkpoint().filter(|_| interrupted) {
            self.progress.line(&format!("interrupted; the same command goes on from {}", path.display()));
        }
        if interrupted && outputs.strategy_images.is_some() {
            strategies::report_interrupted(&self.progress);
        }
        if let Some(failure) = failure {
            let results = format!("the {} samples per pixel before the error", renderer.film().samples());
            return Err(with_saved_results(failure, &results).into());
        }
        if self.is_sequence {
            self.ready = Some(job.ready);
        } else if let Some(folder) = outputs.strategy_images.as_ref().filter(|_| !interrupted) {
            let (samples, device) = (renderer.film().samples(), &renderer.device().clone());
            let (scene, interrupts) = (&job.ready.into_scene(), &self.interrupts);
            let images = StrategyRender { device, scene, settings, samples, interrupts };
            images.write(folder, &provenance, &self.progress)?;
        }
        let interrupted = self.interrupts.stop.load(Ordering::Relaxed);
        Ok(if interrupted { Outcome::Interrupted } else { Outcome::Done })
    }
}

impl Session {
    /// Makes a renderer and the auxiliary layers, or takes over the renderer of the previous frame. Opens the device at the first call.
    fn prepare(&mut self, job: Job, has_variance: bool, preparation: &mut Preparation) -> anyhow::Result<ReadyJob> {
        let (before, mut device) = (self.ready.take(), self.device.take());
        let (is_first, name) = (before.is_none(), job.experiment.render.device.clone());
        let open = || match &device {
            Some(device) => Ok(device.clone()),
            None => Ok(device.insert(Device::open(name.as_deref())?).clone()),
        };
        let mut say = |warning: &str| self.say(format!("warning: {warning}"));
        let made = job.ready(before, has_variance, open, preparation, &mut say);
        self.device = device;
        let mut job = made?;
        if is_first
            && let Some(note) = preparation.timed("measure seconds per sample", || sample_time::note(&job.ready))?
        {
            self.progress.line(&note);
        }
        if !self.is_sequence {
            job.no_job_follows();
        }
        Ok(job)
    }
}
