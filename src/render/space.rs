//! Render space, the coordinate system of the device: its origin and its unit of length.

use glam::{DVec3, Vec3};

use crate::scene::{Camera, Medium, Scene};
use crate::settings::Emitters;

/// World space, translated and scaled. The origin is at or near a sensor, so that f32 coordinates near the sensor are precise.
/// The unit of length is near the size of the scene, or between the distances of its nearest and farthest objects if these differ
/// very much. MIS weights contain squares of densities per area, which are fourth powers of lengths. With this unit they neither
/// overflow nor underflow in f32. The unit is a power of two, so scaling changes no bit of a mantissa, and a scene twice as large
/// gives the same image.
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
    /// distance of the scene from `origin` along an axis. If this distance is over [`WIDEST`] times the minimum distance, the
    /// geometric mean of both takes its place. 1 m for an empty scene.
    pub fn new(scene: &Scene, origin: DVec3, selected: &Emitters) -> RenderSpace {
        let [near, far] = distances(scene, origin, selected);
        let size = if far > WIDEST * near { (near * far).sqrt().max(far / FARTHEST) } else { far };
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

    /// This space if `camera` is in its reach, else [`RenderSpace::of_camera`]. So moments of a scene that moves have the same space
    /// whatever came before them.
    pub fn or_of_camera(self, scene: &Scene, camera: &Camera, selected: &Emitters) -> RenderSpace {
        match self.sensor(camera.transform.translation) {
            Some(_) => self,
            None => RenderSpace::of_camera(scene, camera, selected),
        }
    }

    /// Distance in metres of `camera` from the origin of [`RenderSpace::of_camera`].
    pub fn distance_of_camera(scene: &Scene, camera: &Camera, selected: &Emitters) -> f64 {
        if scene.moving.is_none() {
            return 0.0;
        }
        RenderSpace::of_camera(scene, camera, selected).origin.distance(camera.transform.translation)
    }

    /// The point `world` (m) in render space.
    pub fn point(&self, world: DVec3) -> Vec3 {
        ((world - self.origin) / self.unit).as_vec3()
    }

    /// The position in the world, in metres, of a point of render space.
    pub fn world(&self, point: Vec3) -> DVec3 {
        self.origin + self.unit * point.as_dvec3()
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
            direction.extend(self.length(aim.uncounted)).as_vec4().to_array()
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

/// Maximum ratio of the distances of the farthest and the nearest object for which the unit is the distance of the farthest object.
/// From a ratio of about 1e7 on, fourth powers of lengths between near objects would underflow.
const WIDEST: f64 = (1 << 16) as f64;

/// Maximum distance of the farthest object, relative to the distance that determines the unit. Fourth powers of its distance in units
/// are then far below the upper limit of the MIS sums, 1e30.
pub(super) const FARTHEST: f64 = (1 << 20) as f64;

/// Distances along an axis from `origin` to the nearest and to the farthest object, in metres: meshes, media and selected lights.
/// Lights are never the nearest object. The minimum is only searched below the maximum divided by [`WIDEST`]; if nothing is nearer,
/// it is this quotient.
fn distances(scene: &Scene, origin: DVec3, selected: &Emitters) -> [f64; 2] {
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
    let mut nearest_of_boxes = vec![f64::INFINITY; scene.instances.len()];
    for (instance, nearest) in scene.instances.iter().zip(&mut nearest_of_boxes) {
        let Some(ends) = boxes[instance.mesh as usize] else { continue };
        let [mut lo, mut hi] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for i in 0..8 {
            let corner = DVec3::new(ends[i & 1].x, ends[(i >> 1) & 1].y, ends[i >> 2].z);
            let corner = instance.transform.transform_point3(corner);
            max = max.max(distance(corner));
            (lo, hi) = (lo.min(corner), hi.max(corner));
        }
        *nearest = (lo - origin).max(origin - hi).max_element();
    }
    for light in scene.lights.iter().filter(|light| selected.include(&light.node)) {
        let Some(radius) = light.kind.radius() else { continue };
        max = max.max(distance(light.position) + radius);
    }
    for corner in scene.media.iter().filter_map(Medium::extent).flatten() {
        max = max.max(distance(corner));
    }

    // The distance of a triangle or a medium is that of its farthest corner. So a camera in a corner of a room is no special case.
    let farthest = |corners: &[DVec3]| corners.iter().map(|&p| distance(p)).fold(0.0, f64::max);
    let limit = max / WIDEST;
    let mut min = limit;
    for corners in scene.media.iter().filter_map(Medium::extent) {
        min = min.min(farthest(&corners));
    }
    for (instance, nearest) in scene.instances.iter().zip(nearest_of_boxes) {
        let mesh = &scene.meshes[instance.mesh as usize];
        let point =
            |i: u32| instance.transform.transform_point3(DVec3::from(mesh.positions[i as usize].map(f64::from)));
        if nearest < min {
            let near = mesh.triangles.iter().filter(|corners| distance(point(corners[0])) < limit);
            min = near.map(|corners| farthest(&corners.map(point))).fold(min, f64::min);
        }
    }
    [min, max]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Kind, build};
    use crate::scene::{Instance, Mesh};
    use glam::DAffine3;

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
    fn the_unit_lies_between_near_and_far_objects() {
        let unit = |far: f64| {
            let mut scene = build(Kind::CornellBox);
            let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            let triangle = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
            scene.meshes.push(triangle);
            let (mesh, transform) = (scene.meshes.len() as u32 - 1, DAffine3::from_translation(DVec3::Z * far));
            scene.instances.push(Instance { mesh, transform, node: "far".into() });
            RenderSpace::new(&scene, scene.cameras[0].transform.translation, &Emitters::Scene).unit
        };
        assert_eq!(unit(1e5), 2f64.powi(16));
        // The nearest triangles are between 2.9 m and 4.9 m away.
        assert_eq!(unit(1e10), 2f64.powi(17));
        assert_eq!(unit(2f64.powi(60)), 2f64.powi(40));
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
