//! The thread that renders for the viewer. It carries out the commands of the pages between two steps of work. During an iteration of
//! the full image it listens, and ends the iteration early for a command that needs this.

mod iteration;
mod lost;
mod pace;
mod probed;
mod publish;

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

use taugate::Result;
use taugate::internals::gpu::Device;
use taugate::internals::job::iterations::begin;
use taugate::internals::render::schedule::Schedule;
use taugate::internals::settings::{Budget, MAX_SECONDS};
use taugate::internals::tev::TevStream;

use super::board::{Board, Topic};
use super::message::{Change, Phase, Report, Welcome};
use super::picture::{BETWEEN_PICTURES, Picture};
use super::renderers::Renderers;
use super::viewed_scene::{Effect, ViewedScene};
use super::{Answers, describe};
use iteration::{change, sum};
use pace::Pace;
pub use pace::Preview;
use probed::Probed;

/// Minimum time between two pictures while no page is connected.
const WITHOUT_PAGE: Duration = Duration::from_secs(10);
/// The full image is prepared when the camera has not moved for this time.
const SETTLED: Duration = Duration::from_millis(300);
/// The time between two pictures is at least this many times the time that one picture takes.
const TIME_PER_PICTURE: u32 = 20;
/// Time between two attempts to show a finished image in tev, which the user may start again. tev gets only what it does not have. An
/// attempt takes at most one part in [`TIME_PER_PICTURE`] of the time.
const TEV_RETRY: Duration = Duration::from_secs(2);

/// A request of a page. Answers go to the queue `page`.
pub enum Command {
    Set {
        changes: BTreeMap<String, Change>,
        /// See [`Report::Answered`].
        number: u32,
        page: Answers,
    },
    Pause(bool),
    Save {
        name: String,
        page: Answers,
    },
    End,
    /// From the engine itself: its iteration is over.
    IterationOver,
}

/// What the engine does after a step.
enum Next {
    Step,
    /// Wait for a command.
    Wait,
    /// Wait for a command, at most this long.
    WaitFor(Duration),
    End,
}

pub struct Engine {
    pub device: Device,
    pub viewed: ViewedScene,
    pub board: Arc<Board>,
    pub inbox: Receiver<Command>,
    /// The other end of `inbox`.
    pub sender: SyncSender<Command>,
    /// Commands that came out of `inbox` during an iteration, and must wait until it is over.
    pub waiting: VecDeque<Command>,
    /// Changes that are not answered yet: their pages and numbers.
    pub unanswered: Vec<(Answers, u32)>,
    /// Set with each change of the image, so that the present preview is abandoned.
    pub stop: Arc<AtomicBool>,
    /// The file that the user named.
    pub input: PathBuf,
    /// Whether the viewer uses all settings of `input`.
    pub is_whole: bool,
    /// Folder for saved images.
    pub folder: PathBuf,
    /// A tev that also shows the image.
    pub tev: Option<TevStream>,
    pub work: Work,
}

/// How far the render of the present settings has come.
#[derive(Default)]
pub struct Work {
    pub(super) revision: u32,
    paused: bool,
    failed: bool,
    welcome: Option<Welcome>,
    pub(super) renderers: Option<Renderers>,
    /// Number of previews that are done or skipped, and the one with which the present series begins.
    previews: usize,
    first_preview: usize,
    pace: Pace,
    /// When the camera moved; `None` if the full image has the present camera.
    moved: Option<Instant>,
    /// Whether the histogram of arriving light was measured with the present camera, lights and [`Probed`].
    pub(super) has_arrivals: bool,
    probed: Option<Probed>,
    /// Whether the depth and the object of every pixel were found with the present camera, lights and resolution.
    pub(super) has_surfaces: bool,
    /// Time spent on the iterations of the full image.
    seconds: f64,
    /// When the last picture of these settings was made, and how long that took.
    last_picture: Option<(Instant, Duration)>,
    /// Whether samples were added since the last picture.
    has_news: bool,
    /// Estimated relMSE of the last picture of the full image.
    relmse: Option<f64>,
}

impl Engine {
    /// Renders until the command to end arrives.
    pub fn run(mut self) {
        self.announce(Effect::Restart);
        let mut next = Next::Step;
        loop {
            self.stop.store(false, Ordering::SeqCst);
            let command = match next {
                Next::End => return,
                _ if !self.waiting.is_empty() => self.waiting.pop_front(),
                Next::Step => self.inbox.try_recv().ok(),
                Next::Wait => match self.inbox.recv() {
                    Err(_) => return,
                    Ok(command) => Some(command),
                },
                Next::WaitFor(time) => match self.inbox.recv_timeout(time) {
                    Err(RecvTimeoutError::Disconnected) => return,
                    command => command.ok(),
                },
            };
            next = match command {
                Some(command) => self.obey(command),
                None => self.step().unwrap_or_else(|error| self.fail(&error.to_string())),
            };
        }
    }

    fn obey(&mut self, command: Command) -> Next {
        match command {
            Command::End => return Next::End,
            Command::Pause(on) => {
                self.work.paused = on;
                self.publish_state(false, true);
            }
            Command::Save { name, page } => page.send(&self.save(&name)),
            Command::Set { changes, number, page } => {
                let mut total = change(&mut self.viewed, &changes, &page);
                self.unanswered.push((page, number));
                // Changes that came meanwhile begin one render together.
                while let Some(command) = self.waiting.pop_front().or_else(|| self.inbox.try_recv().ok()) {
                    let Command::Set { changes, number, page } = command else {
                        self.waiting.push_front(command);
                        break;
                    };
                    total = sum(total, change(&mut self.viewed, &changes, &page));
                    self.unanswered.push((page, number));
                }
                self.follow(total);
            }
            Command::IterationOver => {}
        }
        Next::Step
    }

    /// Acts on the effect of changes that the viewed scene has accepted, if any, and answers all changes.
    fn follow(&mut self, effect: Option<Effect>) {
        match effect {
            None => {}
            Some(Effect::Nothing) => self.publish_state(false, true),
            Some(effect) => self.begin(effect),
        }
        // The board now has the new state.
        for (page, number) in self.unanswered.drain(..) {
            page.send(&Report::Answered { number });
        }
    }

    /// Begins a render with the present settings.
    fn begin(&mut self, effect: Effect) {
        let (scene, settings) = (self.viewed.scene(), &self.viewed.view().settings);
        let work = &mut self.work;
        let done = match (&mut work.renderers, effect) {
            (Some(renderers), Effect::Restart)
                if work.moved.is_none() && renderers.full.can_restart(settings.responses()) =>
            {
                renderers.restart(settings.seed(), settings.responses()).map(|()| true)
            }
            (Some(renderers), Effect::Restart | Effect::Settings) if work.moved.is_none() => {
                renderers.replace(scene, settings).map(|()| true)
            }
            (Some(renderers), Effect::Restart | Effect::Camera | Effect::CameraAndLights) => {
                work.moved = Some(Instant::now());
                renderers.aim_previews(scene, settings, effect == Effect::CameraAndLights)
            }
            _ => Ok(false),
        };
        if !done.is_ok_and(|done| done) {
            (work.renderers, work.moved) = (None, None);
        }
        work.failed = false;
        if matches!(effect, Effect::Settings | Effect::All) {
            work.pace = Pace::default();
        }
        let previews =
            work.renderers.as_ref().map_or(vec![], |renderers| renderers.list_previews(settings.resolution()));
        work.first_preview = work.pace.first(&previews);
        (work.previews, work.seconds, work.relmse) = (work.first_preview, 0.0, None);
        // The first picture of the new image is shown at once.
        (work.last_picture, work.has_news) = (None, false);
        self.announce(effect);
    }

    fn announce(&mut self, effect: Effect) {
        let work = &mut self.work;
        work.revision += 1;
        let probed = Probed::new(&self.viewed.view().settings);
        let is_same_view = matches!(effect, Effect::Restart | Effect::Settings);
        let is_like = |is_like: fn(&Probed, &Probed) -> bool| {
            is_same_view && work.probed.is_none_or(|before| is_like(&probed, &before))
        };
        let keeps_surfaces = is_like(Probed::has_size_of);
        work.has_arrivals &= is_like(Probed::has_light_of);
        work.has_surfaces &= keeps_surfaces;
        work.probed = Some(probed);
        let welcome = describe::welcome(&self.viewed, &self.device, &self.folder);
        if work.welcome.as_ref() != Some(&welcome) {
            self.board.report(Topic::Welcome, &Report::Welcome(welcome.clone()));
            work.welcome = Some(welcome);
        }
        self.publish_state(true, keeps_surfaces);
        if self.work.renderers.is_none() {
            self.report_progress(Phase::Preparing);
        }
    }

    fn fail(&mut self, message: &str) -> Next {
        self.work.renderers = None;
        self.work.failed = true;
        let remedy = if self.device.is_lost() { lost::REMEDY } else { "" };
        self.board.report(Topic::Failed, &Report::Failed { message: format!("{message}{remedy}") });
        Next::Wait
    }

    /// Does the next piece of work: previews, then the histogram of arriving light, then iterations of the full image.
    fn step(&mut self) -> Result<Next> {
        if self.work.failed {
            return Ok(Next::Wait);
        }
        let is_moving = self.work.moved.filter(|moved| moved.elapsed() < SETTLED);
        let Some(renderers) = &self.work.renderers else { return self.prepare(0) };
        if self.work.previews < renderers.previews.len() {
            return self.preview_step();
        }
        if let Some(moved) = is_moving {
            return Ok(Next::WaitFor(SETTLED.saturating_sub(moved.elapsed())));
        }
        if self.work.moved.is_some() {
            // The page already has the previews of this camera.
            return self.prepare(usize::MAX);
        }
        if !self.work.has_arrivals {
            self.measure_arrivals();
            return Ok(Next::Step);
        }
        self.full_step()
    }

    /// Prepares the scene for the present settings. `previews`: how many previews are done.
    fn prepare(&mut self, previews: usize) -> Result<Next> {
        let before = self.work.renderers.as_ref().map_or(vec![], |renderers| renderers.warnings.clone());
        // Free the old scene first, so that the device never holds two copies.
        self.work.renderers = None;
        self.reopen_lost_device()?;
        let renderers = Renderers::new(&self.device, self.viewed.scene(), &self.viewed.view().settings)?;
        let work = &mut self.work;
        (work.moved, work.first_preview) = (None, 0);
        work.previews = previews.min(renderers.previews.len());
        let has_other_warnings = renderers.warnings != before;
        work.renderers = Some(renderers);
        if has_other_warnings {
            self.publish_state(false, true);
        }
        // Render the first preview before the next command. Otherwise a camera that moves all the time would never be shown.
        if self.work.previews == 0 && self.has_previews() { self.preview_step() } else { Ok(Next::Step) }
    }

    fn has_previews(&self) -> bool {
        self.work.renderers.as_ref().is_some_and(|renderers| !renderers.previews.is_empty())
    }

    /// Renders the next preview and publishes it. The first one of a series is never abandoned. [`Pace`] decides which ones follow.
    fn preview_step(&mut self) -> Result<Next> {
        let work = &mut self.work;
        let renderers = work.renderers.as_mut().expect("the scene is prepared");
        let whole = self.viewed.view().settings.resolution();
        let (previews, at) = (renderers.list_previews(whole), work.previews);
        let start = Instant::now();
        let never = Arc::default();
        let stop = if at == work.first_preview { &never } else { &self.stop };
        let preview = &mut renderers.previews[at];
        if !preview.iterate_unless(previews[at].samples, stop)? {
            return Ok(Next::Step);
        }
        self.board.picture(Picture::new(preview, work.revision));
        work.pace.note(previews[at], start.elapsed().as_secs_f64());
        let goes_on = work.pace.goes_on(&previews, at, work.moved.is_none().then_some(whole));
        work.previews = if goes_on { at + 1 } else { usize::MAX };
        self.report_progress(Phase::Coarse);
        Ok(Next::Step)
    }

    fn full_step(&mut self) -> Result<Next> {
        let view = self.viewed.view();
        let render = &view.experiment.render;
        let budget = match render.spp.is_some() || render.time.is_some() {
            true => view.settings.budget(),
            false => Budget::Seconds(MAX_SECONDS),
        };
        let work = &mut self.work;
        let full = &mut work.renderers.as_mut().expect("the scene is prepared").full;
        // Commands come between two iterations and during them, so the viewer has a loop of its own.
        let samples = begin(full, &Schedule::whole(budget), Duration::from_secs_f64(work.seconds));
        let has_image = full.film().iterations() > 0;
        let phase = match samples {
            _ if full.is_dark() && has_image => Phase::Dark,
            None => Phase::Done,
            _ if work.paused && has_image => Phase::Paused,
            Some(samples) => return self.full_iteration(samples),
        };
        let start = Instant::now();
        self.publish_picture(phase);
        let retry = TEV_RETRY.max(start.elapsed() * TIME_PER_PICTURE);
        Ok(if self.tev.is_some() { Next::WaitFor(retry) } else { Next::Wait })
    }

    fn full_iteration(&mut self, samples: u32) -> Result<Next> {
        let start = Instant::now();
        let (is_added, effect) = self.iterate(samples)?;
        if effect.is_some_and(|effect| effect != Effect::Nothing) {
            self.follow(effect);
            return Ok(Next::Step);
        }
        self.follow(effect);
        if !is_added {
            return Ok(Next::Step);
        }
        let work = &mut self.work;
        work.seconds += start.elapsed().as_secs_f64();
        work.has_news = true;
        let pause = if self.board.has_pages() { BETWEEN_PICTURES } else { WITHOUT_PAGE };
        let is_due = |(time, cost): (Instant, Duration)| time.elapsed() >= pause.max(cost * TIME_PER_PICTURE);
        if work.last_picture.is_none_or(is_due) {
            self.publish_picture(Phase::Rendering);
        }
        if !self.work.has_surfaces {
            self.find_surfaces();
        }
        Ok(Next::Step)
    }
}
