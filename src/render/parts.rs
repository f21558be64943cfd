//! An iteration in parts: rows of the image that show the scene at different moments. Most iterations have one part.

use super::Renderer;
use super::samples::SampleCounts;
use super::stats::Stats;
use super::sums::Image;
use crate::error::Result;

/// The image of some rows.
pub struct Part {
    /// As [`Image::splats`] and [`Image::seen`].
    pub splats: Vec<f32>,
    pub seen: Vec<[f32; 4]>,
    /// Mean luminance of the merged light.
    pub merged: f64,
}

/// An iteration that is not complete.
pub struct Begun {
    /// The statistics before it. Counts of a part of an iteration would contradict each other.
    before: Stats,
    pub counts: SampleCounts,
    /// Samples per pixel, averaged over the pixels.
    samples: u32,
    /// The rows so far.
    splats: Vec<f32>,
    seen: Vec<[f32; 4]>,
    /// The share of these rows in the mean luminance of the merged light.
    merged: f64,
}

impl Renderer {
    /// Begins an iteration with `samples` samples per pixel, on average.
    pub(super) fn begin(&mut self, samples: u32) -> Result<()> {
        self.keep_if_copied();
        let before = self.stats.clone();
        let counts = self.sample_counts(samples);
        if let Some(responses) = &mut self.responses {
            responses.begin(&self.plan, samples)?;
        }
        self.begun = Some(Begun { before, counts, samples, splats: vec![], seen: vec![], merged: 0.0 });
        Ok(())
    }

    /// Rows that no light can reach inside the gate.
    pub(super) fn black_part(&mut self, samples: u32) -> Part {
        let pixels = self.plan.crop_pixels as usize;
        self.stats.samples += pixels as u64 * u64::from(samples);
        Part { splats: vec![0.0; 3 * pixels], seen: vec![[0.0; 4]; pixels], merged: 0.0 }
    }

    /// Adds the next rows to the iteration. After the last ones, the iteration becomes part of the film.
    pub(super) fn add_part(&mut self, part: Part, is_last: bool) -> Result<()> {
        let mut begun = self.begun.take().expect("an iteration has begun");
        begun.merged += part.merged * (part.seen.len() as f64 / self.plan.crop_pixels as f64);
        if begun.seen.is_empty() {
            (begun.splats, begun.seen) = (part.splats, part.seen);
        } else {
            begun.splats.extend(part.splats);
            begun.seen.extend(part.seen);
        }
        if !is_last {
            self.begun = Some(begun);
            return Ok(());
        }
        let total = match self.responses.as_mut().map(|responses| responses.end(&mut self.stats)).transpose() {
            Ok(total) => total,
            Err(error) => {
                self.begun = Some(begun);
                self.abandon();
                return Err(error);
            }
        };
        let Begun { counts, samples, splats, seen, merged, .. } = begun;
        let max = counts.max();
        if !self.plan.observe.has_strategies() {
            self.add_image(Image { splats, seen, total, counts, samples });
        }
        self.finish_iteration(max, merged);
        self.copy_images_if_due()
    }

    /// Gives up an iteration that is not complete. A render of several responses may have to begin anew, see [`Renderer::iterate`]. If the
    /// device is lost, goes back to what the host has of the images, even if no iteration has begun.
    pub(crate) fn abandon(&mut self) {
        let begun = self.begun.take();
        if begun.is_none() && !self.device.is_lost() {
            return;
        }
        if let Some(begun) = begun {
            self.stats = begun.before;
        }
        self.restore_images();
    }
}
