//! Writes the files of a render and prints its summary.

use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use taugate::Result;
use taugate::internals::files::write_atomically;
use taugate::internals::image::exr_file::{Merged, Provenance, version};
use taugate::internals::image::layers::Layers;
use taugate::internals::input::resolve::Outputs;
use taugate::internals::job::preparation::Preparation;
use taugate::internals::job::sum_files::Before;
use taugate::internals::render::{Renderer, Stage, Stats};
use taugate::internals::settings::{Rays, Settings};

use super::images::Images;
use super::progress::{Position, Progress, duration, rays};
use super::rescue::Rescue;

/// The warning about an image without light.
pub const BLACK: &str = "the image is black; taugate info lists the emitters, the times at which light arrives, and surfaces that are \
                         black from behind";

/// A warning if samples were not finite.
pub fn dropped(samples: u64) -> Option<String> {
    (samples > 0).then(|| format!("{samples} samples were not finite and count as 0"))
}

/// A finished render.
pub struct Report<'a> {
    pub renderer: &'a Renderer,
    pub settings: &'a Settings,
    pub provenance: &'a Provenance,
    /// Seconds of the iterations of this process. [`Provenance::seconds`] also counts earlier processes.
    pub seconds: f64,
    /// Work of earlier processes, which is in the image.
    pub before: Before,
    /// Auxiliary layers of the image file.
    pub layers: &'a Layers,
    pub preparation: &'a Preparation,
    /// Warnings that were printed before the first iteration.
    pub warnings: &'a [String],
    /// The one of them about the width of the gate.
    pub gate_warning: Option<&'a str>,
    /// Whether the image is a frame of a sequence. Its picture then gets its exposure from all frames, after the last one.
    pub is_frame: bool,
}

/// The contents of the file that --stats writes.
#[derive(Serialize)]
struct Numbers<'a> {
    version: String,
    gate: String,
    samples_per_pixel: u64,
    /// The smallest and the largest number of samples in a pixel. They differ with --sampling adaptive.
    min_samples_per_pixel: u64,
    max_samples_per_pixel: u64,
    iterations: u32,
    /// The part of the samples per pixel that earlier processes rendered, and their seconds; 0 unless the render goes on from a file.
    earlier_samples_per_pixel: u64,
    earlier_seconds: f64,
    /// Seconds from the loading of the scene to the first iteration, and their stages.
    prepare_seconds: f64,
    prepare_stages: Vec<Stage>,
    /// Seconds of all iterations of this process, and their stages. The last stage is the rest of the time.
    render_seconds: f64,
    stages: Vec<Stage>,
    /// Share of these seconds in which the device ran kernels; null if it has no timestamps.
    device_share: Option<f64>,
    /// Seconds of work of all host threads per second of these.
    host_share: f64,
    /// What traces the rays: kernels, or ray queries of the device.
    rays: Rays,
    rays_per_second: f64,
    /// Mean over all pixels and channels. The standard error is estimated from whole iterations; it is null with fewer than two.
    image_mean: f64,
    image_mean_standard_error: Option<f64>,
    /// Light that merging found in this process; null if the render does not merge.
    merged: Option<Merged>,
    /// Share of the light that damping took away.
    damped_share: Option<f64>,
    /// How often the host waited for the device during iterations.
    waits: u64,
    /// Non-finite samples of all processes, which count as 0.
    samples_dropped: u64,
    /// Fraction of the attempted connections that pass the tests of gate, facing and depth; null if none was attempted.
    connections_inside_gate: Option<f64>,
    /// Contributions inside the gate per sample; above 1 if several bounces of a path contribute.
    inside_gate_per_sample: f64,
    warnings: &'a [String],
    settings: &'a str,
    renderer: &'a Stats,
}

impl Report<'_> {
    fn position(&self) -> Position {
        Position::of(self.renderer, Duration::from_secs_f64(self.seconds), self.before)
    }

    /// Fails if the device has the images of several gates and is lost.
    fn images(&self) -> Result<Images<'_>> {
        let Report { renderer, provenance, layers, .. } = self;
        Ok(Images { film: renderer.film(), responses: renderer.responses()?, provenance, layers })
    }

    /// Writes all files; `sums` writes the file of sums. A file that cannot be written is saved elsewhere if possible, and the error
    /// says where.
    pub fn write(&self, outputs: &Outputs, sums: impl Fn(&Path) -> Result<()>) -> anyhow::Result<()> {
        let mut rescue = Rescue::default();
        self.images()?.write(outputs, &mut rescue);
        for path in outputs.sums() {
            rescue.write(path, |path| sums(path));
        }
        if let Some(path) = &outputs.stats {
            let numbers = self.numbers();
            rescue.write(path, |path| {
                write_atomically(path, |writer| Ok(serde_json::to_writer_pretty(writer, &numbers)?))
            });
        }
        rescue.finish()
    }

    fn numbers(&self) -> Numbers<'_> {
        let (film, stats) = (self.renderer.film(), self.renderer.stats());
        let (image_mean, image_mean_standard_error) = film.image_mean();
        let [min_samples_per_pixel, max_samples_per_pixel] = self.renderer.samples_in_pixels();
        Numbers {
            version: version(),
            gate: self.provenance.responses.support().to_string(),
            samples_per_pixel: film.samples(),
            min_samples_per_pixel,
            max_samples_per_pixel,
            iterations: film.iterations(),
            earlier_samples_per_pixel: self.before.samples,
            earlier_seconds: self.before.seconds,
            prepare_seconds: self.preparation.seconds(),
            prepare_stages: self.preparation.stages(stats),
            render_seconds: self.seconds,
            stages: stats.stages(self.seconds),
            device_share: stats.device_share(self.seconds),
            host_share: stats.host_share(self.seconds),
            rays: self.renderer.rays(),
            rays_per_second: self.position().rays_per_second(),
            image_mean,
            image_mean_standard_error,
            merged: self.provenance.merged,
            damped_share: film.damped().map(|damped| damped.share),
            waits: stats.waits,
            samples_dropped: self.renderer.dropped(),
            connections_inside_gate: stats.live_share(),
            inside_gate_per_sample: stats.inside_gate_per_sample(),
            warnings: self.warnings,
            settings: &self.provenance.settings,
            renderer: stats,
        }
    }

    /// Prints warnings about the image, then what was rendered, its mean and the standard error of the mean.
    pub fn summarise(&self, outputs: &Outputs, progress: &Progress) {
        let (film, stats) = (self.renderer.film(), self.renderer.stats());
        if let Some(warning) = dropped(self.renderer.dropped()) {
            progress.line(&format!("warning: {warning}"));
        }
        // The one at the start may be out of sight.
        if let Some(warning) = self.gate_warning {
            progress.line(&format!("warning: {warning}"));
        }
        // Without a sample there is nothing to explain.
        if film.samples() > 0 && self.renderer.is_black() {
            progress.line(&format!("warning: {BLACK}"));
        }
        let spread = match self.renderer.samples_in_pixels() {
            [min, max] if min < max => format!(" ({min} to {max})"),
            _ => String::new(),
        };
        let names: Vec<String> = outputs.files().iter().map(|path| path.display().to_string()).collect();
        progress.line(&format!(
            "{}: {}x{}, {}, {}, {} samples per pixel{spread} in {}, {}",
            names.join(", "),
            film.width(),
            film.height(),
            self.settings.responses().describe(),
            self.settings.estimator(),
            film.samples(),
            duration(self.provenance.seconds),
            rays(self.position().rays_per_second()),
        ));
        let images = self.images().ok().filter(|_| !self.is_frame);
        if let Some(line) = images.and_then(|images| images.describe_exposure(outputs)) {
            progress.line(&line);
        }
        let (mean, error) = film.image_mean();
        let error = match error {
            Some(error) if mean > 0.0 => format!("+- {error:.1e} ({:.2} %)", 100.0 * error / mean),
            Some(_) => "+- 0".into(),
            None => "with an unknown error (one iteration)".into(),
        };
        let share = stats.live_share().map_or("none tried".into(), |share| format!("{:.3} %", 100.0 * share));
        progress.line(&format!(
            "mean {mean:.6e} {error}; connections inside the gate: {share}; contributions per sample: {:.4}; non-finite \
             samples dropped: {}",
            stats.inside_gate_per_sample(),
            self.renderer.dropped()
        ));
        if let Some(damped) = film.damped() {
            progress.line(&format!(
                "--fireflies damp took away {:.2} % of the light; the mean above is that of the image without damping",
                100.0 * damped.share
            ));
        }
    }
}
