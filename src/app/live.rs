//! `--tev`: shows the image in tev while it is rendered.

use std::time::Duration;

use taugate::internals::image::channels;
use taugate::internals::render::Renderer;
use taugate::internals::settings::Responses;
use taugate::internals::tev::{Snapshot, TevStream};

use super::progress::Progress;

/// Maximum number of responses that are shown. An image file has all responses.
const MAX_RESPONSES: usize = 64;
/// Maximum time that the program waits for tev after the files of a render are written.
const PATIENCE: Duration = Duration::from_secs(5);

/// The image of one render in tev.
pub struct Live<'a> {
    pub stream: &'a mut TevStream,
    /// Name of the image.
    pub name: String,
    pub responses: &'a Responses,
}

impl Live<'_> {
    /// Sends the image so far, if it is time for that.
    pub fn update(&mut self, renderer: &Renderer, progress: &Progress) {
        let (name, responses) = (&self.name, self.responses);
        self.stream.offer(|| snapshot(name, responses, renderer));
        warn(self.stream.warning(), progress);
    }

    /// Sends the finished image, without waiting.
    pub fn send_last(&mut self, renderer: &Renderer) {
        let (name, responses) = (&self.name, self.responses);
        self.stream.offer_last(|| snapshot(name, responses, renderer));
    }

    /// Waits until tev has the whole image, at most [`PATIENCE`].
    pub fn finish(self, progress: &Progress) {
        warn(self.stream.finish(PATIENCE), progress);
    }
}

/// The channels of a render so far, under a name.
pub fn snapshot(name: &str, responses: &Responses, renderer: &Renderer) -> Snapshot {
    let film = renderer.film();
    // If the device is lost, the next iteration says so.
    let images = renderer.responses().ok().flatten();
    let groups = channels::of_render(film, images, responses, MAX_RESPONSES, None);
    Snapshot { name: name.into(), width: film.width(), height: film.height(), groups }
}

fn warn(warning: Option<String>, progress: &Progress) {
    if let Some(warning) = warning {
        progress.line(&format!("warning: {warning}"));
    }
}
