//! The terminal output of `taugate bench`: progress and results.

use std::time::Instant;

use taugate::internals::bench::quality::Trust;
use taugate::internals::bench::summary::{ErrorSummary, VariantSummary};

use crate::app::cli::BenchArgs;
use crate::app::progress::duration;

/// How far the suite has come.
pub struct SuiteProgress {
    pub repetitions: u32,
    pub started: Instant,
    /// Seconds of rendering in this run so far, and in all.
    pub done: f64,
    pub all: f64,
}

impl SuiteProgress {
    pub fn part(&self) -> f64 {
        (self.done / self.all).min(1.0)
    }

    pub fn describe(&self, scene: &str, repetition: u32) -> String {
        let left = self.started.elapsed().as_secs_f64() * (1.0 - self.part()) / self.part().max(1e-9);
        let all = self.repetitions;
        format!("{scene}, repetition {} of {all}, {} left", repetition + 1, duration(left))
    }
}

/// The results of a scene, one line per variant.
pub fn text(scene: &str, summaries: &[VariantSummary]) -> String {
    let width = summaries.iter().map(|summary| summary.variant.len()).max().unwrap_or(0);
    let mut text = if summaries.is_empty() { String::new() } else { format!("{scene}\n") };
    for summary in summaries {
        if summary.all.relmse.median.is_nan() {
            let cost = summary.us_per_sample;
            text += &format!(
                "  {:width$}  {:.3} us per pixel sample ({:.3} to {:.3})  {:.0} samples in {:.1} s\n",
                summary.variant, cost.median, cost.min, cost.max, summary.samples, summary.seconds
            );
            continue;
        }
        text += &format!(
            "  {:width$}  {}  {}  FLIP {:.4}  {:.0} samples in {:.1} s\n",
            summary.variant,
            error("relMSE", &summary.all),
            error("trimmed", &summary.trimmed),
            summary.flip.median,
            summary.samples,
            summary.seconds
        );
    }
    text
}

fn error(name: &str, summary: &ErrorSummary) -> String {
    let least = if summary.ratio_is_bound { "at least " } else { "" };
    let ratio = summary
        .ratio
        .map_or(String::new(), |r| format!(", {least}{:.2} times lower ({:.2} to {:.2})", r.median, r.min, r.max));
    match summary.trust {
        Trust::Full => format!("{name} {:.3e}{ratio}", summary.relmse.median),
        Trust::Bound => format!("{name} at most {:.3e}{ratio}", summary.relmse.median),
        Trust::Nothing => format!("{name} -"),
    }
}

/// The command that the user typed, without --resume and --reference.
pub fn command(args: &BenchArgs) -> String {
    let mut text = format!("taugate bench {}", args.suite.display());
    if !args.scenes.is_empty() {
        text += &format!(" --scenes '{}'", args.scenes.join(","));
    }
    if let Some(resolution) = args.resolution {
        text += &format!(" --resolution {resolution}");
    }
    if let Some(time) = args.time {
        text += &format!(" --time {time}");
    }
    if let Some(out) = &args.out {
        text += &format!(" --out {}", out.display());
    }
    text
}
