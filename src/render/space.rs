//! Render space, the coordinate system of the device: its origin and its unit of length.

use glam::{DVec3, Vec3};

use crate::scene::{Camera, Medium, Scene};
use crate::settings::Emitters;

/// World space, translated and scaled. The origin is at or near a sensor, so that f32 coordinates near the sensor are precise.
/// The unit of length is near the size of the scene. MIS weights contain squares of densities per area, which are fourth powers
/// of lengths. With this unit they neither overflow nor underflow in f32. The unit is a power of two, so scaling changes no bit
/// of a mantissa, and a scene twice as large gives the same image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderSpace {
    /// The origin in world space, in metres.
    pub origin: DVec3,
    /// Metres per unit, > 0.
    pub unit: f64,
}

impl RenderSpace {
    /// Render space with its origin at `origin` and the metre as its unit.
    pub fn metres(origin: DVec3) -> RenderSpace {
        RenderSpace { origin, unit: 1.0 }
    }

    /// Render space with its origin at `origin`. Its unit is the largest power of two (in metres) that is at most the maximum
    /// distance of the scene from `origin` along an axis. 1 m for an empty scene.
    pub fn new(scene: &Scene, origin: DVec3, selected: &Emitters) -> RenderSpace {
        let size = max_coordinate(scene, origin, selected);
        // Beyond these exponents the square of the unit, which divides fluxes, would leave the range of f32.
        let exponent = if size > 0.0 { size.log2().floor().clamp(-60.0, 60.0) } else { 0.0 };
        RenderSpace { origin, unit: exponent.exp2() }
    }

    /// Render space for a camera of `scene`. Its origin is the camera, or in a scene that moves, the nearest point of a grid. So
    /// frames from nearby cameras have the same render space.
    pub fn of_camera(scene: &Scene, camera: &Camera, selected: &Emitters) -> RenderSpace {
        let place = camera.transform.translation;
        let space = RenderSpace::new(scene, place, selected);
        if scene.moving.is_none() {
            return space;
        }
        // No point is farther than MAX_SENSOR_DISTANCE from the nearest point of the grid.
        let step = f64::from(MAX_SENSOR_DISTANCE) * space.unit;
        RenderSpace { origin: (place / step).round() * step, ..space }
    }

    /// The point `world` (m) in render space.
    pub fn point(&self, world: DVec3) -> Vec3 {
        ((world - self.origin) / self.unit).as_vec3()
    }

    /// The sensor position `world` (m) in render space. `None` if the sensor is so far from the origin that coordinates near
    /// it would be imprecise: the scene must be prepared again.
    pub fn sensor(&self, world: DVec3) -> Option<Vec3> {
        let sensor = self.point(world);
        (sensor.length() <= MAX_SENSOR_DISTANCE).then_some(sensor)
    }

    /// The rays of a camera with [`crate::scene::Projection::Aimed`] as the kernels read them: unit direction, and the length that
    /// does not count. Empty for other cameras.
    pub fn aims(&self, camera: &Camera) -> Vec<[f32; 4]> {
        let aims = camera.projection.aims().unwrap_or_default().iter();
        let entry = aims.map(|aim| {
            let direction = (aim.point - camera.transform.translation).normalize();
            direction.extend(self.length(aim.omitted)).as_vec4().to_array()
        });
        entry.collect()
    }

    /// A length or travel time in units of the render space.
    pub fn length(&self, metres: f64) -> f64 {
        metres / self.unit
    }

    /// A flux (W) or an intensity (W / sr) in render space. Radiance has the same value in both spaces; flux and intensity
    /// scale with area.
    pub fn flux(&self, watts: f32) -> f32 {
        (f64::from(watts) / (self.unit * self.unit)) as f32
    }
}

/// Maximum distance of a sensor from the origin, in units. At this distance the rounding error of a coordinate is 2^-26 units
/// and the offset of a ray origin from its surface is 2^-21 units. For a Cornell box of 2 m, the image then differs by 1e-6 of
/// its light from the image with the sensor at the origin. With an origin 60 m away from the box, it would differ by 1e-3.
const MAX_SENSOR_DISTANCE: f32 = 0.25;

/// Maximum distance along an axis from `origin` to the bounding boxes of the meshes and media and to the selected lights, in
/// metres.
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
    for corner in scene.media.iter().filter_map(Medium::extent).flatten() {
        max = max.max(distance(corner));
    }
    max
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};

    #[test]
    fn the_unit_is_the_power_of_two_below_the_size_of_the_scene() {
        // The camera is 3.9 m from the centre of a box of 2 m, so the back of the box is 4.9 m away.
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
    fn cameras_of_a_moving_scene_share_an_origin() {
        let mut scene = build(Kind::CornellBox);
        let at = |scene: &mut Scene, x: f64| {
            scene.cameras[0].transform.translation.x = x;
            RenderSpace::of_camera(scene, &scene.cameras[0], &Emitters::Scene)
        };
        assert_ne!(at(&mut scene, 0.1), at(&mut scene, 0.2));
        scene.moving = Some([].into());
        assert_eq!(at(&mut scene, 0.1), at(&mut scene, 0.2));
        assert_eq!(at(&mut scene, 0.1).origin, DVec3::new(0.0, 1.0, 4.0));
        for x in [-0.499, 0.0, 0.3, 0.51, 7.3] {
            let space = at(&mut scene, x);
            assert!(space.sensor(scene.cameras[0].transform.translation).is_some(), "{x}");
        }
    }

    #[test]
    fn a_scene_twice_as_large_is_the_same_scene() {
        let space = RenderSpace { origin: DVec3::ONE, unit: 8.0 };
        assert_eq!(space.point(DVec3::new(9.0, 1.0, 1.0)), Vec3::X);
        assert_eq!((space.length(24.0), space.flux(32.0)), (3.0, 0.5));
    }
}
