//! Progress on stderr: a bar on a terminal, a plain line every few seconds otherwise.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use taugate::internals::printable::escaped;
use taugate::internals::render::Renderer;
use taugate::internals::settings::Budget;

/// Time between two plain lines.
const PERIOD: Duration = Duration::from_secs(5);

pub enum Progress {
    Quiet,
    Bar(ProgressBar),
    Lines { last: Instant },
}

/// How far a render has come.
pub struct Position {
    pub samples: u64,
    pub elapsed: Duration,
    pub rays: u64,
}

impl Position {
    pub fn of(renderer: &Renderer, elapsed: Duration) -> Position {
        Position { samples: renderer.film().samples(), elapsed, rays: renderer.stats().rays() }
    }

    pub fn rays_per_second(&self) -> f64 {
        self.rays as f64 / self.elapsed.as_secs_f64().max(1e-9)
    }

    /// Fraction of the budget that is used, 0 to 1.
    fn done(&self, budget: &Budget) -> f64 {
        let done = match *budget {
            Budget::Spp(spp) => self.samples as f64 / f64::from(spp),
            Budget::Seconds(seconds) => self.elapsed.as_secs_f64() / seconds,
        };
        done.min(1.0)
    }

    fn describe(&self, budget: &Budget) -> String {
        let of = match budget {
            Budget::Spp(spp) => format!(" of {spp}"),
            Budget::Seconds(_) => String::new(),
        };
        let done = self.done(budget);
        let left = match done > 0.0 {
            true => format!(", {} left", duration(self.elapsed.as_secs_f64() * (1.0 - done) / done)),
            false => String::new(),
        };
        format!("{}{of} samples{left}, {}", self.samples, rays(self.rays_per_second()))
    }
}

impl Progress {
    pub fn new(quiet: bool) -> Progress {
        if quiet {
            return Progress::Quiet;
        }
        if !std::io::stderr().is_terminal() {
            return Progress::Lines { last: Instant::now() };
        }
        let bar = ProgressBar::new(1000);
        bar.set_style(ProgressStyle::with_template("{bar:30} {msg}").expect("the template is valid"));
        Progress::Bar(bar)
    }

    pub fn update(&mut self, position: &Position, budget: &Budget) {
        self.show(position.done(budget), || position.describe(budget));
    }

    /// Shows the fraction that is done, 0 to 1, and the text that `describe` returns.
    pub fn show(&mut self, done: f64, describe: impl Fn() -> String) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => {
                bar.set_position((1000.0 * done) as u64);
                bar.set_message(escaped(&describe()).into_owned());
            }
            Progress::Lines { last } => {
                if last.elapsed() >= PERIOD {
                    *last = Instant::now();
                    super::say(&describe());
                }
            }
        }
    }

    /// Prints a line that stays, such as a warning or the summary.
    pub fn line(&self, text: &str) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => bar.suspend(|| super::say(text)),
            Progress::Lines { .. } => super::say(text),
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Progress::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// `1.25 Mrays/s`
pub fn rays(per_second: f64) -> String {
    match per_second {
        r if r >= 1e9 => format!("{:.2} Grays/s", r / 1e9),
        r if r >= 1e6 => format!("{:.2} Mrays/s", r / 1e6),
        r => format!("{:.1} krays/s", r / 1e3),
    }
}

/// `0.4 s`, `12 s`, `3 min 5 s`, `2 h 10 min`
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..10 => format!("{seconds:.1} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole / 60 % 60),
    }
}
