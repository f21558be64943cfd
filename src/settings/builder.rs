//! The builder of [`Settings`]: values are chosen in any order, and checked at the end.

#![warn(missing_docs)]

use crate::error::{Error, Result};
use crate::settings::doppler::Doppler;
use crate::settings::table::RenderTable;
use crate::settings::units::Gate;
use crate::settings::values::Seconds;
use crate::settings::{
    Budget, Crop, DEFAULT_WIDTH, Emitters, Estimator, Fireflies, MAX_SECONDS, Responses, Settings, check_resolution,
};

/// Settings that are not checked yet; see [`Settings`].
#[derive(Debug, Clone)]
pub struct SettingsBuilder {
    pub(super) camera: usize,
    pub(super) resolution: [u32; 2],
    pub(super) crop: Option<Crop>,
    pub(super) emitters: Emitters,
    pub(super) responses: Responses,
    /// `device` and `strict` are always `None`, because the image does not depend on them.
    pub(super) render: RenderTable,
}

impl Default for SettingsBuilder {
    fn default() -> SettingsBuilder {
        SettingsBuilder {
            camera: 0,
            resolution: [DEFAULT_WIDTH; 2],
            crop: None,
            emitters: Emitters::Scene,
            responses: Responses::default(),
            render: RenderTable::default(),
        }
    }
}

impl SettingsBuilder {
    /// Replaces all settings of `[render]` that were chosen before.
    #[doc(hidden)]
    pub fn table(self, render: &RenderTable) -> SettingsBuilder {
        SettingsBuilder { render: RenderTable { device: None, strict: None, ..render.clone() }, ..self }
    }

    /// The estimator. The default is `bdpt`, which finds the light of every kind of emitter. `pt` finds no light of beams, see
    /// [`Settings::missed_lights`].
    pub fn estimator(mut self, estimator: Estimator) -> SettingsBuilder {
        self.render.estimator = Some(estimator);
        self
    }

    /// The travel times that count; [`Gate::OPEN`] (the default) is the steady state. A gate of fewer than 16 steps of 32-bit
    /// travel times is accepted, but rounding may change its brightness by more than 6 %.
    pub fn gate(self, gate: Gate) -> SettingsBuilder {
        SettingsBuilder { responses: gate.into(), ..self }
    }

    /// The responses to measure, instead of one gate. Each becomes an image of its own; see
    /// [`crate::Renderer::responses`].
    pub fn responses(self, responses: impl Into<Responses>) -> SettingsBuilder {
        SettingsBuilder { responses: responses.into(), ..self }
    }

    /// Width and height of the whole image in pixels.
    pub fn resolution(self, resolution: [u32; 2]) -> SettingsBuilder {
        SettingsBuilder { resolution, ..self }
    }

    /// The part of the image to render. The default is the whole image.
    pub fn crop(self, crop: impl Into<Option<Crop>>) -> SettingsBuilder {
        SettingsBuilder { crop: crop.into(), ..self }
    }

    /// The number of samples per pixel (64 by default), or the time, after which a render stops. A program passes
    /// [`Settings::budget`] to [`crate::Renderer::render`]. [`crate::Renderer::iterate`] does not read it.
    pub fn budget(mut self, budget: Budget) -> SettingsBuilder {
        (self.render.spp, self.render.time) = match budget {
            Budget::Spp(spp) => (Some(spp), None),
            Budget::Seconds(seconds) => (None, Some(Seconds(seconds))),
        };
        self
    }

    /// Index into `Scene::cameras`.
    pub fn camera(self, camera: usize) -> SettingsBuilder {
        SettingsBuilder { camera, ..self }
    }

    /// The emitters of the scene that are switched on. The default is all.
    pub fn emitters(self, emitters: Emitters) -> SettingsBuilder {
        SettingsBuilder { emitters, ..self }
    }

    /// Checks the settings. Fails if a value is outside its limits; the message names the flag and the limits.
    pub fn build(self) -> Result<Settings> {
        self.responses.check()?;
        check_resolution("the resolution", self.resolution)?;
        self.render.check()?;
        if self.render.time.is_some_and(|Seconds(seconds)| !(seconds > 0.0 && seconds <= MAX_SECONDS)) {
            return Err(Error::settings("--time must be more than 0 and at most a year"));
        }
        if self.render.fireflies == Some(Fireflies::Damp) && self.responses.len() > 1 {
            return Err(Error::advice(
                "--fireflies damp is only for a single gate, because the bins of a histogram have too few samples to tell fireflies from light; ",
                "leave it out, or render one gate",
            )
            .about("fireflies"));
        }
        if self.render.doppler.is_some_and(|doppler| doppler != Doppler::OFF) {
            let refuse = |message: &str, remedy: &str| Err(Error::advice(message, remedy).about("doppler"));
            if self.render.fireflies == Some(Fireflies::Damp) {
                return refuse(
                    "--doppler needs all the light that --fireflies damp takes away: ",
                    "leave out one of them",
                );
            }
            if self.responses.frequencies().is_some() {
                return refuse(
                    "the images of --cw have phases, and those of --doppler velocities: ",
                    "leave out one of them",
                );
            }
        }
        let [width, height] = self.resolution;
        let is_inside = |crop: Crop| crop.x0 < crop.x1 && crop.x1 <= width && crop.y0 < crop.y1 && crop.y1 <= height;
        if let Some(crop) = self.crop.filter(|&crop| !is_inside(crop)) {
            return Err(Error::advice(
                format!("--crop {crop} does not lie inside the image of {width}x{height}; "),
                format!("it is x0,x1,y0,y1 with x1 <= {width} and y1 <= {height}"),
            ));
        }
        Ok(Settings { chosen: self })
    }
}
