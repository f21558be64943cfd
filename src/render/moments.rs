//! A render that goes on with the scene at another moment, as while the shutter of a camera is open. Images and counts stay.

use std::time::Duration;

use super::Renderer;
use super::prepared_scene::PreparedScene;
use crate::error::Result;
use crate::scene::Camera;

impl Renderer {
    /// Goes on with the scene of `other`, a new renderer with the same settings.
    pub(crate) fn go_on_in(&mut self, other: Renderer) -> Result<()> {
        let Renderer { plan, scene, light, sensor, stats, .. } = other;
        self.stats.scene_bytes = self.stats.scene_bytes.max(stats.scene_bytes);
        if let Some(responses) = &mut self.responses {
            responses.follow(&plan)?;
        }
        (self.plan, self.scene, self.light, self.sensor) = (plan, scene, light, sensor);
        self.forget_ahead();
        Ok(())
    }

    /// As [`Renderer::set_camera`], and goes on.
    pub(crate) fn turn_to(&mut self, camera: &Camera) -> Result<bool> {
        camera.check()?;
        let frame = self.plan.camera_frame();
        camera.lens_limit([frame.width, frame.height])?;
        if !self.plan.takes(camera) {
            return Ok(false);
        }
        // This may fail, so it comes before the plan changes.
        let aims = self.plan.space.aims(camera);
        self.scene.write_aims(&aims)?;
        self.plan.set_camera(camera);
        self.light.set_camera(aims);
        self.forget_ahead();
        Ok(true)
    }

    /// As [`Renderer::set_lights`], and goes on.
    pub(crate) fn move_lights(&mut self, prepared: &PreparedScene) -> Result<()> {
        self.scene.write_emitters(&prepared.emitters.table)?;
        self.scene.write_velocities(&prepared.velocities)?;
        self.light.set_lights(prepared);
        self.plan.set_lights(prepared);
        self.forget_ahead();
        Ok(())
    }

    /// Light that was traced for the next iteration is that of the scene before.
    fn forget_ahead(&mut self) {
        (self.ahead, self.counts_ahead) = (None, None);
    }

    /// Turns the phases of a heterodyne sensor, until the next call.
    pub(crate) fn turn_waves(&mut self, turns: f64) {
        if let Some(responses) = &mut self.responses {
            responses.turn_waves(turns);
        }
    }

    /// Adds wall time of work on the host to a stage of the statistics.
    pub(crate) fn add_time(&mut self, stage: &str, time: Duration) {
        self.stats.add_host(stage, time);
    }
}
