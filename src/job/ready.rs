//! A renderer that is ready for its first iteration, and later for the first iterations of other frames.

use std::path::Path;

use super::feasible;
use super::preparation::Preparation;
use crate::error::Result;
use crate::gpu::Device;
use crate::image::layers::Layers;
use crate::render::space::RenderSpace;
use crate::render::{MemoryPlan, PreparedScene, Renderer, layers, missing_light, sheets};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::aov::Aov;

/// A renderer with the scene that it renders.
pub struct Ready {
    pub renderer: Renderer,
    pub scene: Scene,
    pub settings: Settings,
    /// The scene that the renderer was made from; `None` if no other frame follows.
    pub prepared: Option<PreparedScene>,
    /// Warnings about the surfaces of the scene, and about the memory of the device.
    pub warnings: Vec<String>,
    /// A warning about light that no strategy forms in this view.
    pub missing: Option<String>,
}

/// What a render needs besides its settings.
pub struct Wanted<'a> {
    /// The file of the scene, to name it in errors.
    pub path: Option<&'a Path>,
    /// Whether a gate that no light can meet is accepted.
    pub may_be_dark: bool,
    /// Whether several responses have variances.
    pub has_variance: bool,
    pub aov: Aov,
}

impl Ready {
    /// Checks the scene, and makes its auxiliary layers and a renderer. `open` opens the device. `say` gets each warning as soon as it is
    /// known, because an error or a long wait may follow. Fails if the scene, its gate or the settings do not allow a render, or if the
    /// device does not.
    pub fn new(
        scene: Scene,
        settings: &Settings,
        wanted: &Wanted,
        mut open: impl FnMut() -> Result<Device>,
        preparation: &mut Preparation,
        say: &mut dyn FnMut(&str),
    ) -> Result<(Ready, Layers)> {
        let prepared = preparation.timed("build BVH and tables", || PreparedScene::new(&scene, settings));
        let prepared = prepared.map_err(|error| error.in_scene(wanted.path))?;
        let mut warnings = preparation.timed("check lamps", || prepared.scene_warnings(&scene, settings));
        let missing = missing_light(&scene, settings, &prepared).map(|missing| missing.describe());
        warnings.iter().chain(&missing).for_each(|warning| say(warning));
        if !wanted.may_be_dark {
            preparation.timed("check gate", || feasible::check_gate(&scene, settings, &prepared, &mut open))?;
        }
        let device = preparation.timed("open device", open)?;
        let plan = MemoryPlan::new(&scene, settings, &prepared, Some(device.info()))?;
        plan.check(device.info())?;
        if let Some(warning) = plan.warning(device.info()) {
            say(&warning);
            warnings.push(warning);
        }
        // Render the layers before making the renderer, so that the device never holds two copies of the scene.
        let layers = match wanted.aov {
            none if none == Aov::default() => Layers::default(),
            aov => preparation.timed("auxiliary layers", || layers(&device, &scene, settings, &prepared, aov))?,
        };
        let mut renderer = Renderer::from_memory_plan(&device, plan, &scene, &prepared)?;
        if wanted.has_variance {
            renderer.estimate_response_variance();
        }
        let (settings, prepared) = (settings.clone(), Some(prepared));
        Ok((Ready { renderer, scene, settings, prepared, warnings, missing }, layers))
    }

    /// The scene alone. Frees the renderer, so that the device never holds two copies of the scene.
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// Ready for another frame, in which only cameras, lights, positions of surfaces, responses or the seed differ. The image has the
    /// same bits as with a new renderer. `None` if the frame needs new preparations or another device.
    pub fn follow(self, device: &Device, scene: Scene, settings: &Settings) -> Result<Option<Ready>> {
        let Ready { mut renderer, scene: before, settings: old, prepared, warnings, .. } = self;
        let Some(mut prepared) = prepared else { return Ok(None) };
        let (seed, responses) = (settings.seed(), settings.responses());
        // The old settings may not allow these responses.
        let is_same_render =
            old.change().seed(seed).responses(responses.clone()).build().is_ok_and(|same| same == *settings)
                && renderer.can_restart(responses)
                && renderer.device().is_same(device);
        // Materials on the device hold the thickness of thin glass, which changes with the scale of its mesh.
        if !is_same_render || !before.has_same_objects(&scene) || !sheets::have_same_thickness(&before, &scene) {
            return Ok(None);
        }
        if scene.velocities.is_none() && before.has_same_places(&scene) {
            if !prepared.follow(&scene, settings)? || !renderer.set_camera(&scene.cameras[settings.camera()])? {
                return Ok(None);
            }
            renderer.set_lights(&prepared)?;
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

    /// Shows another moment of the same animations from the next rows of an iteration on. The images so far stay. The render space is
    /// `home` for cameras in its reach. The device holds two copies of the scene for a moment if surfaces move.
    ///
    /// # Panics
    /// Without [`Ready::prepared`].
    pub fn show(&mut self, scene: Scene, settings: &Settings, home: RenderSpace) -> Result<()> {
        let Ready { renderer, scene: before, prepared, .. } = self;
        let prepared = prepared.as_mut().expect("another moment follows");
        let camera = &scene.cameras[settings.camera()];
        let space = home.or_of_camera(&scene, camera, settings.emitters());
        let has_same_objects = before.has_same_objects(&scene) && sheets::have_same_thickness(before, &scene);
        // The device holds the velocities as long as it holds the surfaces.
        let has_same_places = has_same_objects && scene.velocities.is_none() && before.has_same_places(&scene);
        if has_same_places && prepared.follow_in(&scene, settings, space)? && renderer.turn_to(camera)? {
            renderer.move_lights(prepared)?;
        } else {
            if !(has_same_objects && prepared.follow_surfaces_in(&scene, settings, space)?) {
                *prepared = PreparedScene::in_space(&scene, settings, |_| space)?;
            }
            renderer.go_on_in(Renderer::from_prepared(renderer.device(), &scene, settings, prepared)?)?;
        }
        self.scene = scene;
        Ok(())
    }
}
