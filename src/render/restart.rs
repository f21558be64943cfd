//! A renderer begins again with another seed, gate, camera or other lights, and keeps the scene and the kernels.

#![warn(missing_docs)]

use super::prepared_scene::{PreparedScene, set_seeds};
use super::schedule::Following;
use super::sums::Added;
use super::{Iterations, Renderer, Stats};
use crate::error::{Error, Result};
use crate::image::accumulation::MergedLight;
use crate::scene::Camera;
#[cfg(doc)]
use crate::scene::Scene;
use crate::settings::Responses;

impl Renderer {
    /// Clears the film and begins a new render with another seed and other responses. The scene, the kernels and the
    /// statistics stay. Fails without any change if the responses are invalid ([`Responses::new`]), or if there is a gate and a light
    /// is infinitely far away. Also fails if the responses need other kernels, as several responses do after a single box, and
    /// another number of gates in a scan in fog.
    ///
    /// The new gate does not decide whether there are ellipsoidal connections: the gate that the renderer was made for did.
    pub fn restart(&mut self, seed: u32, responses: impl Into<Responses>) -> Result<()> {
        let responses = responses.into();
        responses.check()?;
        if self.plan.has_distant && !responses.are_steady() {
            return Err(Error::advice(
                "a light is infinitely far away, so its light has no travel time to gate; ",
                "select other emitters",
            ));
        }
        if !self.plan.can_have(&responses) {
            return Err(Error::advice(
                "these responses need other kernels than those of the render so far; ",
                "make a new renderer",
            ));
        }
        self.plan.set(seed, responses);
        self.clear();
        Ok(())
    }

    /// Whether [`Renderer::restart`] accepts these responses, and the image then has the bits of a new renderer. Kernels differ
    /// between one box and several responses, between long and short histograms, and between thin and wide gates.
    #[doc(hidden)]
    pub fn can_restart(&self, responses: &Responses) -> bool {
        self.plan.has_bits_of(responses)
    }

    /// Clears the film and begins a new render with another camera and a film of the same size. The scene, the BVH, the
    /// kernels and the statistics stay. Fails without any change to the render if [`Scene::check`] would refuse the camera, or if the
    /// device is lost.
    ///
    /// Returns false and changes nothing in two cases; create a new renderer then. `camera` is too far from the camera that the
    /// scene was prepared for, so positions would be imprecise. Or the two are of different kinds, such as perspective and
    /// orthographic, or aim at different numbers of points.
    pub fn set_camera(&mut self, camera: &Camera) -> Result<bool> {
        let has_turned = self.turn_to(camera)?;
        if has_turned {
            self.clear();
        }
        Ok(has_turned)
    }

    /// As [`Renderer::set_camera`], for a renderer whose pixels have lasers of their own ([`PreparedScene::with_own_lasers`]): the beams
    /// turn, and get new seeds.
    ///
    /// # Panics
    /// If there is not one seed per aimed ray.
    #[doc(hidden)]
    pub fn set_beams(&mut self, camera: &Camera, seeds: &[u32]) -> Result<bool> {
        camera.check()?;
        if !self.plan.takes(camera) {
            return Ok(false);
        }
        let mut aims = self.plan.space.aims(camera);
        set_seeds(&mut aims, seeds);
        self.scene.write_aims(&aims)?;
        self.plan.set_camera(camera);
        self.clear();
        Ok(true)
    }

    /// Clears the film and begins a new render with lights that have moved. The BVH, the kernels and the statistics stay.
    /// `prepared` is the scene that the renderer was made from, after [`PreparedScene::follow`] or [`PreparedScene::follow_nearby`]. Fails if the device is lost.
    #[doc(hidden)]
    pub fn set_lights(&mut self, prepared: &PreparedScene) -> Result<()> {
        self.move_lights(prepared)?;
        self.clear();
        Ok(())
    }

    /// Forgets the counts and times so far, except the counts of the scene: its bytes on the device, and its triangles.
    #[doc(hidden)]
    pub fn clear_stats(&mut self) {
        let Stats { scene_bytes, triangles, .. } = self.stats;
        self.stats = Stats { scene_bytes, triangles, ..Stats::default() };
    }

    /// Counts of work, and seconds of each part of it, over all iterations since the renderer was made or since
    /// [`Renderer::clear_stats`].
    #[doc(hidden)]
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    pub(super) fn clear(&mut self) {
        let Added { film, allocation } = self.sums.get_mut();
        if film.iterations() > 0 {
            *film = film.cleared();
        }
        if let Some(allocation) = allocation {
            allocation.restart();
        }
        if let Some(responses) = &mut self.responses {
            responses.clear(&self.device, &self.plan);
        }
        (self.done, self.begun, self.kept) = (Iterations::default(), None, None);
        (self.next, self.first_sample, self.dropped_before) = (0, 0, 0);
        (self.following, self.ahead, self.counts_ahead) = (Following::Unknown, None, None);
        self.merged = MergedLight::default();
    }
}
