//! What a render leaves: its files, and the lines at the end.

use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;
use taugate::internals::error::Result;
use taugate::internals::files::write_atomically;
use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::image::png_file;
use taugate::internals::input::resolve::{Outputs, gate_warning};
use taugate::internals::render::{Renderer, Stage, Stats};
use taugate::internals::settings::Settings;

use super::preparation::Preparation;
use super::progress::{Position, Progress, duration, rays};

/// A render that has ended.
pub struct Report<'a> {
    pub renderer: &'a Renderer,
    pub settings: &'a Settings,
    pub provenance: &'a Provenance,
    pub preparation: &'a Preparation,
    /// What was said before it began.
    pub warnings: &'a [String],
}

/// What --stats writes.
#[derive(Serialize)]
struct Numbers<'a> {
    version: String,
    gate: String,
    samples_per_pixel: u64,
    /// Of the pixels: fewer and more than that by --sampling adaptive.
    least_samples_in_a_pixel: u64,
    most_samples_in_a_pixel: u64,
    iterations: u32,
    /// From the scene's file to the first iteration, and where they went.
    prepare_seconds: f64,
    prepare_stages: Vec<Stage>,
    /// All iterations, and where their time went; the last stage is what the others do not explain.
    render_seconds: f64,
    stages: Vec<Stage>,
    rays_per_second: f64,
    /// Over all pixels and channels; its standard error comes from whole iterations and is null with fewer than two.
    image_mean: f64,
    image_mean_standard_error: Option<f64>,
    /// How often the host waited for the device during iterations.
    waits: u64,
    /// Non-finite samples, which count as 0.
    samples_dropped: u64,
    /// Part of the connections tried that survived gate, facing and depth; null if none was tried.
    connections_inside_gate: Option<f64>,
    /// Contributions a sample, more than 1 where several bounces contribute.
    inside_gate_per_sample: f64,
    warnings: &'a [String],
    settings: &'a str,
    renderer: &'a Stats,
}

pub fn files(outputs: &Outputs) -> impl Iterator<Item = &PathBuf> {
    [Some(&outputs.exr), outputs.png.as_ref(), outputs.stats.as_ref()].into_iter().flatten()
}

pub fn is_black(renderer: &Renderer) -> bool {
    renderer.stats().inside_gate == 0 && renderer.film().mean().iter().all(|&v| v == 0.0)
}

impl Report<'_> {
    fn seconds(&self) -> f64 {
        self.provenance.seconds
    }

    fn position(&self) -> Position {
        Position::of(self.renderer, Duration::from_secs_f64(self.seconds()))
    }

    pub fn write(&self, outputs: &Outputs) -> Result<()> {
        let film = self.renderer.film();
        exr_file::write(&outputs.exr, film, self.provenance)?;
        if let Some(path) = &outputs.png {
            png_file::write(path, film.width(), film.height(), &film.mean())?;
        }
        if let Some(path) = &outputs.stats {
            let numbers = self.numbers();
            write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &numbers)?))?;
        }
        Ok(())
    }

    fn numbers(&self) -> Numbers<'_> {
        let (film, stats) = (self.renderer.film(), self.renderer.stats());
        let (image_mean, image_mean_standard_error) = film.image_mean();
        let [least_samples_in_a_pixel, most_samples_in_a_pixel] = self.renderer.samples_in_pixels();
        Numbers {
            version: exr_file::version(),
            gate: self.provenance.responses.support().to_string(),
            samples_per_pixel: film.samples(),
            least_samples_in_a_pixel,
            most_samples_in_a_pixel,
            iterations: film.iterations(),
            prepare_seconds: self.preparation.seconds(),
            prepare_stages: self.preparation.stages(stats),
            render_seconds: self.seconds(),
            stages: stats.stages(self.seconds()),
            rays_per_second: self.position().rays_per_second(),
            image_mean,
            image_mean_standard_error,
            waits: stats.waits,
            samples_dropped: stats.dropped,
            connections_inside_gate: stats.live_share(),
            inside_gate_per_sample: stats.inside_gate_per_sample(),
            warnings: self.warnings,
            settings: &self.provenance.settings,
            renderer: stats,
        }
    }

    /// What was rendered, how well it is known, and what must not be missed.
    pub fn summarise(&self, outputs: &Outputs, progress: &Progress) {
        let (film, stats) = (self.renderer.film(), self.renderer.stats());
        if stats.dropped > 0 {
            progress.line(&format!("warning: {} samples were not finite and count as 0", stats.dropped));
        }
        for warning in self.settings.responses().iter().filter_map(|response| gate_warning(&response.gate())) {
            progress.line(&format!("warning: {warning}"));
        }
        if is_black(self.renderer) {
            progress.line(
                "warning: the image is black: taugate info shows when light arrives and which emitters there are",
            );
        }
        let spread = match self.renderer.samples_in_pixels() {
            [min, max] if min < max => format!(" ({min} to {max})"),
            _ => String::new(),
        };
        let names: Vec<String> = files(outputs).map(|path| path.display().to_string()).collect();
        progress.line(&format!(
            "{}: {}x{}, {}, {}, {} samples a pixel{spread} in {}, {}",
            names.join(", "),
            film.width(),
            film.height(),
            self.settings.responses().describe(),
            self.settings.estimator(),
            film.samples(),
            duration(self.seconds()),
            rays(self.position().rays_per_second()),
        ));
        let (mean, error) = film.image_mean();
        let error = match error {
            Some(error) if mean > 0.0 => format!("+- {error:.1e} ({:.2} %)", 100.0 * error / mean),
            Some(_) => "+- 0".into(),
            None => "with an unknown error (one iteration)".into(),
        };
        let share = stats.live_share().map_or("none tried".into(), |share| format!("{:.3} %", 100.0 * share));
        progress.line(&format!(
            "mean {mean:.6e} {error}; connections inside the gate: {share}; contributions a sample: {:.4}; samples dropped as \
             not finite: {}",
            stats.inside_gate_per_sample(),
            stats.dropped
        ));
    }
}
