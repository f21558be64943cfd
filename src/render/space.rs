//! Render space, the coordinates of the device: where it begins and what it counts.

use glam::{DVec3, Vec3};

use crate::scene::Scene;
use crate::settings::Emitters;

/// A sensor is the origin, so that coordinates near it keep their digits wherever it stands; lengths count in a unit near
/// the size of the scene, so that fourth powers of them (MIS weights are squared densities per area) neither overflow nor
/// vanish in f32. The unit is a power of two: it changes no bit of a mantissa, and a scene twice as large is the same image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSpace {
    pub origin: DVec3,
    /// Metres a unit of the device, > 0.
    pub unit: f64,
}

impl RenderSpace {
    /// Around `origin`, in metres.
    pub fn metres(origin: DVec3) -> RenderSpace {
        RenderSpace { origin, unit: 1.0 }
    }

    /// Around `origin`, in the greatest power of two that no coordinate of the scene stays below.
    pub fn new(scene: &Scene, origin: DVec3, selected: &Emitters) -> RenderSpace {
        let size = max_coordinate(scene, origin, selected);
        // Beyond these no f32 could hold the squares of lengths in metres on their way in.
        let exponent = if size > 0.0 { size.log2().floor().clamp(-60.0, 60.0) } else { 0.0 };
        RenderSpace { origin, unit: exponent.exp2() }
    }

    /// A point of the world on the device.
    pub fn point(&self, world: DVec3) -> Vec3 {
        ((world - self.origin) / self.unit).as_vec3()
    }

    /// A sensor on the device. None where it stands so far from the origin that too many digits of what is near it are lost.
    pub fn sensor(&self, world: DVec3) -> Option<Vec3> {
        let sensor = self.point(world);
        (sensor.length() <= MAX_SENSOR_DISTANCE).then_some(sensor)
    }

    /// A length or travel time in metres on the device.
    pub fn length(&self, metres: f64) -> f64 {
        metres / self.unit
    }

    /// A flux or intensity (W, W / sr) on the device, where radiance stays what it is and areas count in square units.
    pub fn flux(&self, watts: f32) -> f32 {
        (f64::from(watts) / (self.unit * self.unit)) as f32
    }
}

/// Distance from the origin at which a sensor may stand, in units. Coordinates near it are rounded as those of surfaces that far away
/// are for any camera: to a part of 2^-26 of the unit, with rays that start 2^-21 of it off their surfaces. Of the light of a Cornell
/// box 1e-6 falls to other samples there, 1e-3 where the origin is 60 m away from the box of 2 m.
const MAX_SENSOR_DISTANCE: f32 = 0.25;

/// Greatest distance along an axis from `origin` to the boxes around the meshes and to the lights.
fn max_coordinate(scene: &Scene, origin: DVec3, selected: &Emitters) -> f64 {
    let boxes: Vec<Option<[DVec3; 2]>> = scene
        .meshes
        .iter()
        .map(|mesh| {
            let points = mesh.positions.iter().map(|p| DVec3::from(p.map(f64::from)));
            points.fold(None, |found: Option<[DVec3; 2]>, p| {
                Some(found.map_or([p, p], |[lo, hi]| [lo.min(p), hi.max(p)]))
            })
        })
        .collect();
    let distance = |p: DVec3| (p - origin).abs().max_element();
    let mut max = 0.0f64;
    for instance in &scene.instances {
        let Some(ends) = boxes[instance.mesh as usize] else { continue };
        for i in 0..8 {
            let corner = DVec3::new(ends[i & 1].x, ends[(i >> 1) & 1].y, ends[i >> 2].z);
            max = max.max(distance(instance.transform.transform_point3(corner)));
        }
    }
    for light in scene.lights.iter().filter(|light| selected.include(&light.node)) {
        let Some(radius) = light.kind.radius() else { continue };
        max = max.max(distance(light.position) + radius);
    }
    max
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};

    #[test]
    fn the_unit_is_the_power_of_two_below_the_size_of_the_scene() {
        // The camera stands 3.9 m before the middle of a box of 2 m; its back is 4.9 m away.
        let mut scene = build(Kind::CornellBox);
        let space = |scene: &Scene| RenderSpace::new(scene, scene.cameras[0].transform.translation, &Emitters::Scene);
        assert_eq!(space(&scene).unit, 4.0);
        for instance in &mut scene.instances {
            instance.transform.translation.z -= 1e6;
        }
        assert_eq!(space(&scene).unit, 2f64.powi(19));
        assert_eq!(space(&scene).point(DVec3::new(0.0, 1.0, 3.9 - 2f64.powi(19))), Vec3::NEG_Z);
        assert_eq!(RenderSpace::new(&Scene::default(), DVec3::ONE, &Emitters::Scene).unit, 1.0);
    }

    #[test]
    fn a_scene_twice_as_large_is_the_same_scene() {
        let space = RenderSpace { origin: DVec3::ONE, unit: 8.0 };
        assert_eq!(space.point(DVec3::new(9.0, 1.0, 1.0)), Vec3::X);
        assert_eq!((space.length(24.0), space.flux(32.0)), (3.0, 0.5));
    }
}
