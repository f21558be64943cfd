//! A renderer that is ready for its first iteration, and later for those of other frames.

use taugate::internals::error::Result;
use taugate::internals::render::{PreparedScene, Renderer};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;

/// A renderer with the scene that it renders.
pub struct Ready {
    pub renderer: Renderer,
    pub scene: Scene,
    pub settings: Settings,
    /// The scene that the renderer was made from; `None` if no other frame follows.
    pub prepared: Option<PreparedScene>,
    /// Warnings about the surfaces of the scene.
    pub warnings: Vec<String>,
}

impl Ready {
    /// The scene alone.
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// The same renderer for another frame, in which only the camera, the lights, the responses or the seed are others. Its image has
    /// the bits of a new renderer's. `None` if the frame needs a new renderer.
    pub fn follow(mut self, scene: Scene, settings: &Settings) -> Result<Option<Ready>> {
        let Some(prepared) = &mut self.prepared else { return Ok(None) };
        let (seed, responses) = (settings.seed(), settings.responses());
        let is_same_render = self.settings.change().seed(seed).responses(responses.clone()).build()? == *settings
            && self.settings.responses().is_single_box() == responses.is_single_box();
        if !is_same_render || !self.scene.has_same_surfaces(&scene) || !prepared.follow(&scene, settings)? {
            return Ok(None);
        }
        if !self.renderer.set_camera(&scene.cameras[settings.camera()])? {
            return Ok(None);
        }
        self.renderer.set_lights(prepared, settings)?;
        self.renderer.restart(seed, responses.clone())?;
        self.renderer.clear_stats();
        Ok(Some(Ready { scene, settings: settings.clone(), ..self }))
    }
}
