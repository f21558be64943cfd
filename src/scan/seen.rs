//! What the beams of a scan meet first: its auxiliary layers.

use std::collections::{BTreeMap, HashMap};
use std::mem::take;
use std::ops::Range;

use glam::DVec3;

use super::{Measurement, PreparedScan};
use crate::error::Result;
use crate::gpu::Device;
use crate::image::scan_layers::{Hit, ScanLayers};
use crate::input::scan_table::Scan;
use crate::render::{FirstSurface, aimed_surfaces, first_surfaces, object_ids};
use crate::scene::{Scene, Velocities};
use crate::settings::aov::Aov;

/// The first surfaces of the beams of a scan, and the names of their objects.
pub(super) struct Seen {
    hits: Vec<Hit>,
    objects: BTreeMap<u32, String>,
    /// Numbers of the objects by name. An object that is scaled to nothing is missing in the scene, but keeps its number.
    ids: HashMap<String, u32>,
    /// Whether the user wants velocities, which need the scene just before and after each shot.
    has_velocity: bool,
}

impl Seen {
    /// Nothing yet, for `count` beams. Objects have their numbers in `scene`.
    fn new(count: usize, scene: &Scene, has_velocity: bool) -> Seen {
        let nodes = scene.instances.iter().map(|instance| instance.node.clone());
        let ids = nodes.zip(object_ids(scene)).collect();
        Seen { hits: vec![Hit::NONE; count], objects: BTreeMap::new(), ids, has_velocity }
    }

    /// `point`: number of the beam. `velocity`: see [`Hit::velocity`].
    fn set(&mut self, point: usize, surface: &FirstSurface, scene: &Scene, velocity: f32) {
        let FirstSurface { distance, normal, albedo, instance, .. } = *surface;
        let node = &scene.instances[instance as usize].node;
        let next = self.ids.len() as u32 + 1;
        let object = *self.ids.entry(node.clone()).or_insert(next);
        self.hits[point] = Hit { range: distance, normal, albedo, object, velocity };
        self.objects.entry(object).or_insert_with(|| node.clone());
    }
}

impl Measurement {
    /// What each point of the sensor shows on the axis of its line of sight. Fails if the device is lost.
    pub fn layers(&self, device: &Device, chosen: Aov) -> Result<ScanLayers> {
        let chosen = Aov { arrival: false, ..chosen };
        if let Some(Seen { hits, objects, .. }) = &self.seen {
            return Ok(ScanLayers { chosen, hits: hits.clone(), objects: objects.clone() });
        }
        let (scene, settings) = self.scene();
        let points = self.scan.sensor_points.as_ref().unwrap_or(&self.scan.laser_points);
        let mut seen = Seen::new(points.len(), scene, chosen.velocity);
        let camera = Scan::camera_at(self.scan.sensor, points);
        aimed_surfaces(device, scene, settings, &camera, &mut |point, surface| {
            // All shots see the same moment, and the LiDAR stands still.
            let direction = (points[point] - self.scan.sensor).normalize();
            let there = self.scan.sensor + direction * f64::from(surface.distance);
            let of = |velocities: &Velocities| velocities.of(surface.instance as usize, there).dot(direction);
            seen.set(point, &surface, scene, scene.velocities.as_ref().map_or(0.0, of) as f32);
        })?;
        Ok(ScanLayers { chosen, hits: seen.hits, objects: seen.objects })
    }

    /// Also notes what each beam meets first, for [`Measurement::layers`] with the same choice. Call it before the first point. It has no
    /// effect on a scan without motion, whose layers need not be noted.
    pub fn look_at_surfaces(&mut self, chosen: Aov) {
        if self.scan.places.is_some() || self.of.moving.is_some() {
            self.seen = Some(Seen::new(self.scan.laser_points.len(), &self.of.scene, chosen.velocity));
        }
    }

    /// Notes what the beams `points`, which are fired at once, meet first.
    pub(super) fn see(&mut self, points: Range<usize>) -> Result<()> {
        let Some(seen) = &self.seen else { return Ok(()) };
        let time = self.scan.times.as_ref().map(|times| times[points.start]);
        let moving = self.of.moving.as_ref().zip(time).filter(|_| seen.has_velocity);
        let velocities = moving.map(|(moving, time)| moving.velocities(time, &self.of.scene)).transpose()?;
        let Some(mut seen) = self.seen.take() else { return Ok(()) };
        let mut scene = take(&mut self.of.scene);
        self.look_from(points.start, &mut scene);
        let PreparedScan { settings, prepared, .. } = &mut self.of;
        let place = self.scan.laser_at(points.start);
        let own = self.scan.velocity_at(points.start);
        prepared.aim(&scene.cameras[settings.camera()]);
        let device = self.renderer.device();
        let looked = first_surfaces(device, &scene, settings, prepared, &mut |pixel, surface| {
            let Some(point) = points.clone().nth(pixel) else { return };
            let direction = (self.scan.laser_points[point] - place).normalize();
            let there = place + direction * f64::from(surface.distance);
            let of = |velocities: &Velocities| velocities.of(surface.instance as usize, there);
            let velocity = velocities.as_ref().map_or(DVec3::ZERO, of) - own;
            seen.set(point, &surface, &scene, velocity.dot(direction) as f32);
        });
        (self.of.scene, self.seen) = (scene, Some(seen));
        looked
    }
}
