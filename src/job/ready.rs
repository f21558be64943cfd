//! A renderer that is ready for its first iteration, and later for the first iterations of other frames.

use crate::error::Result;
use crate::gpu::Device;
use crate::render::{PreparedScene, Renderer, missing_light};
use crate::scene::Scene;
use crate::settings::Settings;

/// A renderer with the scene that it renders.
pub struct Ready {
    pub renderer: Renderer,
    pub scene: Scene,
    pub settings: Settings,
    /// The scene that the renderer was made from; `None` if no other frame follows.
    pub prepared: Option<PreparedScene>,
    /// Warnings about the surfaces of the scene.
    pub warnings: Vec<String>,
    /// A warning about light that no strategy forms in this view.
    pub missing: Option<String>,
}

impl Ready {
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// Ready for another frame, in which only cameras, lights, positions of surfaces, responses or the seed differ. The image has the
    /// same bits as with a new renderer. `None` if the frame needs new preparations or another device.
    pub fn follow(self, device: &Device, scene: Scene, settings: &Settings) -> Result<Option<Ready>> {
        let Ready { mut renderer, scene: before, settings: old, prepared, warnings, .. } = self;
        let Some(mut prepared) = prepared else { return Ok(None) };
        let (seed, responses) = (settings.seed(), settings.responses());
        let is_same_render = old.change().seed(seed).responses(responses.clone()).build()? == *settings
            && renderer.can_restart(responses)
            && renderer.device().is_same(device);
        if !is_same_render || !before.has_same_objects(&scene) {
            return Ok(None);
        }
        if before.has_same_places(&scene) {
            if !prepared.follow(&scene, settings)? || !renderer.set_camera(&scene.cameras[settings.camera()])? {
                return Ok(None);
            }
            renderer.set_lights(&prepared, settings)?;
            renderer.restart(seed, responses.clone())?;
            renderer.clear_stats();
        } else {
            let has_variance = renderer.has_response_variance();
            // Free the old scene first, so that the device never holds two copies.
            drop((before, renderer));
            if !prepared.follow_surfaces(&scene, settings)? {
                return Ok(None);
            }
            renderer = Renderer::from_prepared(device, &scene, settings, &prepared)?;
            if has_variance {
                renderer.estimate_response_variance();
            }
        }
        let missing = missing_light(&scene, settings, &prepared).map(|missing| missing.describe());
        Ok(Some(Ready { renderer, scene, settings: settings.clone(), prepared: Some(prepared), warnings, missing }))
    }
}
