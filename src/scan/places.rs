//! Where the laser, the sensor and the objects of a scan are at a shot.

use glam::DAffine3;

use super::{Measurement, PreparedScan};
use crate::error::Result;
use crate::input::scan_table::Scan;
use crate::render::space::RenderSpace;
use crate::render::{PreparedScene, Renderer, velocities};
use crate::scene::{Camera, Scene, Velocities};
use crate::settings::Settings;

impl Measurement {
    /// Moves the objects of the scene to where they are at shot `number`. The device holds two copies of the scene for a moment.
    pub(super) fn pose(&mut self, number: usize) -> Result<()> {
        let time = self.scan.times.as_ref().expect("objects move over time")[number];
        let moving = self.of.moving.as_ref().expect("the caller asks first");
        if self.posed == Some(time) {
            return Ok(());
        }
        let mut scene = moving.scene_at(time, &self.of.scene)?;
        if velocities::are_needed(&self.of.settings) {
            scene.velocities = Some(moving.velocities(time, &scene)?);
        }
        self.look_from(number, &mut scene);
        let PreparedScan { scene: before, settings, prepared, home, .. } = &mut self.of;
        let camera = &scene.cameras[settings.camera()];
        let space = home.or_of_camera(&scene, camera, settings.emitters());
        let can_follow = before.has_same_objects(&scene);
        self.posed = Some(time);
        if can_follow && prepared.follow_surfaces_in(&scene, settings, space)? {
            self.of.scene = scene;
            return self.renew();
        }
        self.prepare(number, scene, |_| space)
    }

    /// Prepares the scene again if the LiDAR is too far from the origin of render space at its shot `number`.
    pub(super) fn follow(&mut self, number: usize) -> Result<()> {
        let place = self.scan.places.as_ref().map(|places| places[number]);
        if place.is_none_or(|place| self.of.prepared.reaches(place)) {
            return Ok(());
        }
        let mut scene = self.of.scene.clone();
        self.look_from(number, &mut scene);
        let space =
            RenderSpace::of_camera(&scene, &scene.cameras[self.of.settings.camera()], self.of.settings.emitters());
        self.prepare(number, scene, |_| space)
    }

    /// Puts laser and sensor where they are at shot `number`.
    pub(super) fn look_from(&self, number: usize, scene: &mut Scene) {
        let PreparedScan { settings, beams, .. } = &self.of;
        *scene.lights.last_mut().expect("the laser is the last light") = self.scan.light(number);
        scene.cameras[settings.camera()] = match beams {
            Some(beams) => self.scan.beams(number..number + beams, settings.seed()).0,
            None => self.scan.camera(number),
        };
        set_own_velocity(&self.scan, settings, number, scene);
    }

    /// Prepares the scene of shot `number` anew.
    fn prepare(&mut self, number: usize, scene: Scene, space: impl FnOnce(&Camera) -> RenderSpace) -> Result<()> {
        let PreparedScan { settings, beams, .. } = &self.of;
        let prepared = PreparedScene::in_space(&scene, settings, space)?;
        let prepared = match beams {
            Some(beams) => prepared.with_own_lasers(&self.scan.beams(number..number + beams, settings.seed()).1),
            None => prepared,
        };
        (self.of.scene, self.of.prepared) = (scene, prepared);
        self.renew()
    }

    /// Makes a renderer of the prepared scene. The device holds two copies of the scene for a moment.
    fn renew(&mut self) -> Result<()> {
        let PreparedScan { scene, settings, prepared, .. } = &self.of;
        let mut renderer = Renderer::from_prepared(self.renderer.device(), scene, settings, prepared)?;
        if self.renderer.has_response_variance() {
            renderer.estimate_response_variance();
        }
        self.dropped_before = self.dropped();
        self.renderer = renderer;
        Ok(())
    }
}

/// Gives laser and sensor the velocity of the LiDAR at shot `number`, if the render depends on it.
pub(super) fn set_own_velocity(scan: &Scan, settings: &Settings, number: usize, scene: &mut Scene) {
    let is_at_rest = scan.places.is_none() && scene.velocities.is_none();
    if !velocities::are_needed(settings) || is_at_rest {
        return;
    }
    let instances = vec![Some(DAffine3::ZERO); scene.instances.len()];
    let velocities = scene.velocities.get_or_insert(Velocities { instances, ..Velocities::default() });
    velocities.cameras = vec![scan.velocity_at(number); scene.cameras.len()];
    velocities.lights = vec![scan.velocity_at(number); scene.lights.len()];
}
