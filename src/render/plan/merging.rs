//! How shade points gather photons: their number, and the radius.

use glam::Vec3;

use super::{Observe, Plan};
use crate::render::photons;
use crate::render::prepared_scene::PreparedScene;
use crate::settings::Settings;
use crate::wgsl::layout::Frame;
use crate::wgsl::layout::constants::{MEDIUM_FACTOR, TIME_SLOTS};

/// Largest width of pixels that look at points of their own, over the half angle of the narrowest spot, and largest width of all.
const SPOT_SHARE: f64 = 0.1;
const MAX_NARROW: f64 = 1e-3;

/// What does not change during a render.
pub struct Merging {
    /// Radius in pixels in the first iteration.
    pixels: f64,
    /// Upper bound of the width at distance 1 that counts for pixels which look at points of their own: a share of the narrowest spot.
    narrow: f64,
}

impl Merging {
    pub fn new(settings: &Settings, prepared: &PreparedScene) -> Merging {
        let cones = prepared.emitters.table.iter().filter_map(photons::half_angle);
        let narrow = cones.fold(MAX_NARROW / SPOT_SHARE, f64::min) * SPOT_SHARE;
        Merging { pixels: settings.merge_radius().get(), narrow }
    }
}

impl Plan {
    /// The radius within which shade points gather photons, over the length of their sensor subpath; with an orthographic camera, the
    /// radius itself. It falls with the sixth root of the number of iterations, so that bias and variance go to 0 (Knaus and Zwicker
    /// 2011). Depends on the index of the iteration alone. 0 if nothing merges.
    pub fn merge_radius(&self, iteration: u32) -> f32 {
        (self.merge_pixels(iteration).unwrap_or(0.0) * self.pixel_width()) as f32
    }

    /// The radius in pixels; `None` if nothing merges.
    pub fn merge_pixels(&self, iteration: u32) -> Option<f64> {
        Some(self.merging.as_ref()?.pixels * (f64::from(iteration) + 1.0).powf(-1.0 / 6.0))
    }

    /// Width of a pixel at distance 1; with an orthographic camera at any distance.
    pub fn pixel_width(&self) -> f64 {
        let width = f64::from(self.frame.pixel_area).sqrt();
        match &self.merging {
            // No other pixel sees the light that a radius beyond the spot would take away.
            Some(Merging { narrow, .. }) if self.camera_kind.aims > 0 && (width == 0.0 || *narrow < width) => *narrow,
            _ => width,
        }
    }

    /// The radius at the end of a sensor subpath that goes straight to `position`.
    pub fn straight_merge_radius(&self, iteration: u32, position: [f32; 3], in_medium: bool) -> f32 {
        let length = if self.is_orthographic() { 1.0 } else { Vec3::from(position).distance(self.frame.sensor.into()) };
        self.merge_radius(iteration) * if in_medium { MEDIUM_FACTOR } else { 1.0 } * length
    }

    /// Number of photons in an iteration of `samples` samples per pixel: one for each sample of the whole film.
    pub fn photons(&self, samples: u32) -> u32 {
        photons::count(u64::from(self.frame.width) * u64::from(self.frame.height) * u64::from(samples))
    }

    /// Number of entries of each shade point for the light of photons that the host observes (`shared/observed.wgsl`).
    pub fn merged_entries(&self) -> u32 {
        if self.merging.is_some() && self.observe == Observe::Responses { TIME_SLOTS } else { 0 }
    }

    /// The frame with the fields of the camera set.
    pub fn camera_frame(&self) -> &Frame {
        &self.frame
    }

    /// Whether the camera is orthographic.
    pub fn is_orthographic(&self) -> bool {
        self.camera_kind.is_orthographic
    }

    /// The seed of the random numbers.
    pub fn seed(&self) -> u32 {
        self.frame.seed
    }
}
