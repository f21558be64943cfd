//! What the engine tells the pages and tev: the state, the progress, pictures, and saved files.

use std::path::Path;
use std::time::Instant;

use taugate::internals::render::Renderer;

use super::super::super::live::snapshot;
use super::super::board::Topic;
use super::super::message::{Phase, Progress, Report};
use super::super::picture::Picture;
use super::super::{describe, save};
use super::Engine;

impl Engine {
    pub(super) fn publish_state(&self, is_new: bool, keeps_surfaces: bool) {
        let work = &self.work;
        let warnings = work.renderers.as_ref().map_or(&[][..], |renderers| &renderers.warnings);
        let state = describe::state(&self.viewed, work.revision, work.paused, warnings, (&self.input, self.is_whole));
        let resolution = state.resolution;
        self.board.state(&Report::State(Box::new(state)), resolution, is_new, keeps_surfaces);
    }

    /// Publishes the progress, and the full image if it has new samples. Also offers the image to tev.
    pub(super) fn publish_picture(&mut self, phase: Phase) {
        let work = &mut self.work;
        let full = &work.renderers.as_ref().expect("the scene is prepared").full;
        if let Some(tev) = &mut self.tev {
            let (scene, responses) = (self.viewed.start().scene.as_deref(), self.viewed.view().settings.responses());
            let name = scene.and_then(Path::file_name).unwrap_or_default().to_string_lossy();
            let make = || snapshot(&name, responses, full);
            if phase == Phase::Rendering {
                tev.offer(make)
            } else {
                tev.offer_last(make)
            }
            if let Some(warning) = tev.warning() {
                crate::app::say(&format!("warning: {warning}"));
            }
        }
        if work.has_news {
            let start = Instant::now();
            let picture = Picture::new(full, work.revision);
            work.relmse = picture.relmse();
            self.board.picture(picture);
            (work.last_picture, work.has_news) = (Some((Instant::now(), start.elapsed())), false);
        }
        self.report_progress(phase);
    }

    pub(super) fn report_progress(&self, phase: Phase) {
        let work = &self.work;
        let full = work.renderers.as_ref().filter(|_| work.moved.is_none()).map(|renderers| &renderers.full);
        let [min_samples, max_samples] = full.map_or([0; 2], Renderer::samples_in_pixels);
        let rays = full.map_or(0, |full| full.stats().rays());
        let progress = Progress {
            revision: work.revision,
            phase,
            samples: full.map_or(0, |full| full.film().samples()),
            min_samples,
            max_samples,
            iterations: full.map_or(0, |full| full.film().iterations()),
            seconds: work.seconds,
            rays_per_second: rays as f64 / work.seconds.max(1e-9),
            host_share: full.map_or(0.0, |full| full.stats().host_share(work.seconds)),
            device_share: full.and_then(|full| full.stats().device_share(work.seconds)),
            relmse: work.relmse,
        };
        self.board.report(Topic::Progress, &Report::Progress(progress));
    }

    /// Saves the image so far. Returns the answer for the page.
    pub(super) fn save(&self, name: &str) -> Report {
        let work = &self.work;
        let full = work.renderers.as_ref().filter(|_| work.moved.is_none()).map(|renderers| &renderers.full);
        let saved = full.filter(|full| full.film().samples() > 0).map_or_else(
            || {
                Err(match work.failed {
                    true => "there is no image, because the render failed; change its settings".to_string(),
                    false => "there is no image yet; save again after the first samples".to_string(),
                })
            },
            |full| {
                let finished = save::Finished { renderer: full, viewed: &self.viewed, seconds: work.seconds };
                finished.save(&self.folder, name).map_err(|error| format!("{error:#}"))
            },
        );
        match saved {
            Ok(files) => Report::Saved { files: files.iter().map(|file| file.display().to_string()).collect() },
            Err(message) => Report::Problem { message },
        }
    }
}
