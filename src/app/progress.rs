//! Progress on stderr: a bar on a terminal, a plain line every few seconds otherwise.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use taugate::internals::job::ready_job;
use taugate::internals::job::sum_files::Before;
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
    /// What earlier processes did. `samples` contains their samples; `elapsed` and `rays` are of this process.
    pub before: Before,
}

impl Position {
    pub fn of(renderer: &Renderer, elapsed: Duration, before: Before) -> Position {
        Position { samples: renderer.rendered().samples, elapsed, rays: renderer.stats().rays(), before }
    }

    pub fn rays_per_second(&self) -> f64 {
        self.rays as f64 / self.elapsed.as_secs_f64().max(1e-9)
    }

    /// Fraction of the budget that is used, 0 to 1.
    fn done(&self, budget: &Budget) -> f64 {
        let seconds = self.before.seconds + self.elapsed.as_secs_f64();
        ready_job::Progress::new(budget, self.samples, seconds).fraction
    }

    /// Seconds until the budget is used, at the samples per second of this process. `None` if these are not known yet.
    fn left(&self, budget: &Budget) -> Option<f64> {
        let elapsed = self.elapsed.as_secs_f64();
        let left = match *budget {
            Budget::Spp(spp) => {
                let new = self.samples.saturating_sub(self.before.samples);
                elapsed * u64::from(spp).saturating_sub(self.samples) as f64 / new as f64
            }
            Budget::Seconds(seconds) => seconds - self.before.seconds - elapsed,
        };
        left.is_finite().then_some(left.max(0.0))
    }

    fn describe(&self, budget: &Budget) -> String {
        let of = match budget {
            Budget::Spp(spp) => format!(" of {spp}"),
            Budget::Seconds(_) => String::new(),
        };
        let left = self.left(budget).map_or(String::new(), |seconds| format!(", {} left", duration(seconds)));
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

    /// Prints why the command ends with an error, also if all else is quiet.
    pub fn failure(&self, text: &str) {
        match self {
            Progress::Quiet => super::say(text),
            _ => self.line(text),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_render_that_goes_on_knows_how_long_it_will_take() {
        // 60 of 100 samples are there; this process made 20 of them in 10 s, after 400 s of another process.
        let before = |seconds| Before { samples: 40, seconds };
        let position = Position { samples: 60, elapsed: Duration::from_secs(10), rays: 1000, before: before(400.0) };
        let [samples, time] = [Budget::Spp(100), Budget::Seconds(500.0)];
        assert_eq!((position.done(&samples), position.left(&samples)), (0.6, Some(20.0)));
        assert_eq!((position.done(&time), position.left(&time)), (0.82, Some(90.0)));
        assert_eq!(position.rays_per_second(), 100.0);
        let start = Position { samples: 40, elapsed: Duration::ZERO, ..position };
        assert_eq!(start.left(&samples), None);
        let past = Position { samples: 120, before: before(600.0), ..start };
        assert_eq!((past.left(&samples), past.left(&time)), (Some(0.0), Some(0.0)));
    }
}
