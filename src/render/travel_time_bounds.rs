//! Conservative bounds on the travel times of all paths, from bounding boxes alone. A gate outside the bounds is certainly
//! dark, so no gate that receives light is ever refused.

use glam::Vec3;
use rayon::prelude::*;

use super::geometry::Geometry;
use super::media;
use super::prepared_scene::PreparedScene;
use crate::settings::units::Gate;
use crate::wgsl::layout::Triangle;

/// Relative widening of the bounds: the device sums travel times in f32, with rounding.
const SLACK: f64 = 1e-5;
/// Maximum number of lights without a surface whose boxes are used one by one. If there are more, their common box is used.
const MAX_EMITTERS: usize = 64;

/// Bounds on the travel time of every path, in metres of optical path.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct TravelTimeBounds {
    /// No light arrives before this time. Infinite if no path exists.
    #[serde(rename = "least")]
    pub min: f64,
    /// No light arrives at or after this time: `max_depth` times `max_segment`. Infinite in a medium without bounds.
    #[serde(rename = "greatest")]
    pub max: f64,
    /// Upper bound on the optical length of one segment.
    #[serde(rename = "segment")]
    pub max_segment: f64,
    pub max_depth: u32,
    /// Minimum and maximum travel time per length.
    #[serde(skip)]
    indices: [f64; 2],
}

/// A box along the axes of render space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Box3 {
    lo: Vec3,
    hi: Vec3,
}

impl TravelTimeBounds {
    /// Bounds for paths of one segment, from two passes over all triangles. The lower bound is a Euclidean length, times the
    /// group index if there are no solids. Every index is at least 1, so optical lengths are not shorter.
    pub(super) fn new(prepared: &PreparedScene) -> TravelTimeBounds {
        let PreparedScene { geometry, emitters, media, space, sensor, .. } = prepared;
        let direct = nearest_emissive_triangle(prepared);
        let lights = punctual_emitters(prepared);
        let outside = &media.list[..media.outside];
        let no_fog = outside.is_empty() && !geometry.features.null_boundaries;
        let scattered = if no_fog { f64::INFINITY } else { nearest(sensor, &lights) };
        let min = direct.min(shortest_by_one_surface(geometry, sensor, &lights)).min(scattered);
        let all = geometry.triangles.par_iter().map(Box3::of).reduce(|| *sensor, Box3::with);
        let all = all.with(Box3 { lo: emitters.lo, hi: emitters.hi });
        let all = outside.iter().map(|m| Box3 { lo: m.lo.into(), hi: m.hi.into() }).fold(all, Box3::with);
        let diameter = (all.hi.as_dvec3() - all.lo.as_dvec3()).length();
        // A solid may be faster than its surroundings, as an air bubble in water is.
        let least_index = if geometry.features.transmission { 1.0 } else { f64::from(media.surrounding[1]) };
        let indices = [least_index, geometry.max_ior.into()];
        // A medium without bounds scatters light at any distance.
        let is_bounded = outside.iter().all(|m| [m.lo, m.hi].as_flattened().iter().all(|x| x.abs() < media::FAR));
        let diameter = if is_bounded { diameter } else { f64::INFINITY };
        let max_segment = space.unit * (diameter * indices[1] + geometry.max_delay) * (1.0 + SLACK);
        let min = space.unit * min * least_index * (1.0 - SLACK);
        TravelTimeBounds { min, max_segment, indices, ..TravelTimeBounds::default() }.to_depth(1)
    }

    /// Bounds after the sensor, or the lights, have moved by at most `distance` metres. They follow from the triangle inequality
    /// alone, so they are wider than bounds computed from the scene.
    pub fn moved(&self, distance: f64) -> TravelTimeBounds {
        let min = (self.min - distance * self.indices[0]).max(0.0);
        let max_segment = self.max_segment + distance * self.indices[1] * (1.0 + SLACK);
        TravelTimeBounds { min, max_segment, ..*self }.to_depth(self.max_depth)
    }

    /// Bounds if up to `uncounted` metres of a path do not count.
    pub fn without(&self, uncounted: f64) -> TravelTimeBounds {
        TravelTimeBounds { min: (self.min - uncounted * self.indices[1] * (1.0 + SLACK)).max(0.0), ..*self }
    }

    /// Bounds for paths with at most `max_depth` segments.
    pub(super) fn to_depth(self, max_depth: u32) -> TravelTimeBounds {
        TravelTimeBounds { max: f64::from(max_depth) * self.max_segment, max_depth, ..self }
    }

    /// Whether the gate overlaps the bounds. If not, no light can arrive inside the gate.
    pub fn overlaps(&self, gate: &Gate) -> bool {
        gate.hi > self.min && gate.lo < self.max
    }

    /// Explains why `gate` does not overlap the bounds. `write` formats a length in metres.
    pub fn explain_miss(&self, gate: &Gate, write: impl Fn(f64) -> String) -> String {
        match gate.hi <= self.min {
            true if self.min.is_infinite() => "no surface brings light to the sensor".into(),
            true => format!("none arrives before {}", write(self.min)),
            false => {
                format!("no path of {} segments (--max-depth) is longer than {}", self.max_depth, write(self.max))
            }
        }
    }
}

impl Box3 {
    fn of(t: &Triangle) -> Box3 {
        let [a, b, c] = [t.v0, t.v1, t.v2].map(Vec3::from);
        Box3 { lo: a.min(b).min(c), hi: a.max(b).max(c) }
    }

    fn point(p: Vec3) -> Box3 {
        Box3 { lo: p, hi: p }
    }

    /// Bounding box of four points.
    pub(super) fn around(points: [Vec3; 4]) -> Box3 {
        let [a, b, c, d] = points.map(Box3::point);
        a.with(b).with(c.with(d))
    }

    /// Whether the box consists of this point alone.
    pub(super) fn is_at(&self, p: Vec3) -> bool {
        self.lo == p && self.hi == p
    }

    /// Distance of a point from the box; 0 inside.
    pub(super) fn distance_to(&self, p: Vec3) -> f64 {
        self.distance(&Box3::point(p))
    }

    fn with(self, other: Box3) -> Box3 {
        Box3 { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// Minimum distance between the points of the two boxes; 0 if they overlap.
    fn distance(&self, other: &Box3) -> f64 {
        let gap = (self.lo - other.hi).max(other.lo - self.hi).max(Vec3::ZERO);
        gap.as_dvec3().length()
    }
}

/// Minimum distance from the prepared sensor to an emissive triangle, because the sensor may see the triangle directly. Infinite
/// if there is none.
fn nearest_emissive_triangle(prepared: &PreparedScene) -> f64 {
    let triangles = prepared.emitters.triangles.iter();
    let distances = triangles.map(|&i| Box3::of(&prepared.geometry.triangles[i as usize]).distance(&prepared.sensor));
    distances.fold(f64::INFINITY, f64::min)
}

/// Boxes of the lights without a surface; of more than [`MAX_EMITTERS`] lights, their common box.
fn punctual_emitters(prepared: &PreparedScene) -> Vec<Box3> {
    let lights = prepared.emitters.lights.iter();
    let boxes: Vec<Box3> = lights.map(|&(p, radius)| Box3 { lo: p - radius, hi: p + radius }).collect();
    match boxes.len() {
        0..=MAX_EMITTERS => boxes,
        _ => boxes.into_iter().reduce(Box3::with).into_iter().collect(),
    }
}

/// Minimum distance from the sensor to a light without a surface. It is a lower bound on the length of paths through a medium,
/// because a medium may scatter light anywhere between the two.
fn nearest(sensor: &Box3, emitters: &[Box3]) -> f64 {
    emitters.iter().map(|emitter| emitter.distance(sensor)).fold(f64::INFINITY, f64::min)
}

/// Minimum length of a path from the sensor over one surface to an emitter without a surface. The sensor cannot see such an
/// emitter directly. Infinite if there is no such path.
fn shortest_by_one_surface(geometry: &Geometry, sensor: &Box3, emitters: &[Box3]) -> f64 {
    let by = |t: &Triangle| {
        let surface = Box3::of(t);
        let to_emitter = emitters.iter().map(|e| e.distance(&surface)).fold(f64::INFINITY, f64::min);
        surface.distance(sensor) + to_emitter
    };
    match emitters {
        [] => f64::INFINITY,
        _ => geometry.triangles.par_iter().map(by).reduce(|| f64::INFINITY, f64::min),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::generate::parts::diffuse;
    use crate::input::experiment::Experiment;
    use crate::scene::{Camera, Instance, Light, LightKind, Material, Mesh, Projection, Scene};

    /// A triangle in the plane x = 2 in front of the sensor, in coordinates relative to the sensor. In world space the sensor
    /// is not at the origin.
    fn scene(emission: f32, transmission: f32, light: Option<DVec3>) -> Scene {
        let sensor = DVec3::new(100.0, 20.0, 3.0);
        let base = Material { emission: [emission; 3], transmission, ior: 1.5, thin: Some(false), ..material() };
        Scene {
            meshes: vec![Mesh {
                positions: vec![[2.0, -1.0, -1.0], [2.0, 1.0, -1.0], [2.0, 0.0, 1.0]],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            }],
            instances: vec![Instance { mesh: 0, transform: DAffine3::from_translation(sensor), node: "wall".into() }],
            materials: vec![base],
            cameras: vec![Camera {
                name: "camera".into(),
                transform: DAffine3::from_translation(sensor),
                projection: Projection::Perspective { yfov: 1.0 },
                aspect: None,
                resolution: None,
                principal_point: Camera::CENTRED,
                lens: crate::scene::Lens::PINHOLE,
            }],
            lights: light
                .map(|p| Light {
                    node: "light".into(),
                    position: sensor + p,
                    direction: DVec3::NEG_Z,
                    kind: LightKind::Point { intensity: [1.0; 3] },
                })
                .into_iter()
                .collect(),
            ..Scene::default()
        }
    }

    fn material() -> Material {
        Material { double_sided: false, ..diffuse("", [0.5; 3]) }
    }

    fn travel_time_bounds(scene: &Scene) -> TravelTimeBounds {
        let settings = crate::input::resolve::resolve(&Experiment::default(), scene).unwrap().settings;
        let settings = settings.change().max_depth(3).build().unwrap();
        PreparedScene::new(scene, &settings).unwrap().travel_time_bounds(settings.max_depth())
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 3e-5 * b
    }

    #[test]
    fn a_point_light_is_seen_by_way_of_a_surface() {
        // 2 m from the sensor to the wall and 1 m from the wall to the light. The bounding box is 2 m in all three directions.
        let r = travel_time_bounds(&scene(0.0, 0.0, Some(DVec3::X)));
        assert!(close(r.min, 3.0) && r.min < 3.0, "{r:?}");
        assert!(close(r.max, 3.0 * 12f64.sqrt()), "{r:?}");
    }

    #[test]
    fn an_emissive_surface_is_seen_directly() {
        let r = travel_time_bounds(&scene(1.0, 0.0, None));
        assert!(close(r.min, 2.0) && r.min < 2.0, "{r:?}");
        // The nearer of the two emitters decides.
        assert_eq!(travel_time_bounds(&scene(1.0, 0.0, Some(DVec3::X))).min, r.min);
    }

    /// The wall is 2 m away from the plane of an orthographic sensor, wherever it stands beside the camera's axis.
    #[test]
    fn an_orthographic_sensor_is_as_near_as_its_nearest_point() {
        let mut scene = scene(1.0, 0.0, None);
        let camera = &mut scene.cameras[0];
        camera.transform = crate::scene::build::look(camera.transform.translation + 5.0 * DVec3::Y, DVec3::X);
        let beside = travel_time_bounds(&scene).min;
        assert!(close(beside, 20f64.sqrt()), "{beside}");
        scene.cameras[0].projection = Projection::Orthographic { height: 20.0 };
        let above = travel_time_bounds(&scene);
        assert!(close(above.min, 2.0) && above.min < 2.0, "{above:?}");
        // The sensor is 20 m wide and high; the wall and the whole sensor are in a box of 2 m x 20 m x 20 m.
        assert!(close(above.max_segment, 804f64.sqrt()), "{above:?}");
    }

    #[test]
    fn only_what_light_passes_through_makes_paths_optically_longer() {
        let opaque = travel_time_bounds(&scene(1.0, 0.0, None)).max_segment;
        assert!(close(travel_time_bounds(&scene(1.0, 1.0, None)).max_segment, 1.5 * opaque));
        // Light passes straight through thin glass; only its thickness delays light.
        let mut thin = scene(1.0, 1.0, None);
        thin.materials.iter_mut().for_each(|material| material.thin = Some(true));
        assert!(close(travel_time_bounds(&thin).max_segment, opaque));
        thin.materials.iter_mut().for_each(|material| material.thickness = 0.1);
        assert!(travel_time_bounds(&thin).max_segment >= opaque + 0.1 * 1.25f64.sqrt());
    }

    #[test]
    fn fog_without_bounds_delays_light_without_limit() {
        let mut scene = scene(1.0, 0.0, None);
        let fog = crate::scene::Medium { sigma_s: [0.1; 3], ..crate::scene::Medium::default() };
        scene.media.push(fog.clone());
        let without = travel_time_bounds(&scene);
        assert!(without.max.is_infinite() && without.min > 0.0, "{without:?}");
        assert!(without.overlaps(&Gate { lo: 1e30, hi: 1e31 }) && without.moved(1.0).max.is_infinite());
        scene.media[0] = crate::scene::Medium { bounds: Some([DVec3::splat(90.0), DVec3::splat(110.0)]), ..fog };
        assert!(travel_time_bounds(&scene).max.is_finite());
    }

    #[test]
    fn a_moved_sensor_has_wider_bounds() {
        let here = travel_time_bounds(&scene(1.0, 1.0, Some(DVec3::X)));
        assert_eq!(here.moved(0.0), here);
        let there = here.moved(0.5);
        assert!(close(there.min, here.min - 0.5) && close(there.max_segment, here.max_segment + 0.75), "{there:?}");
        assert_eq!((here.moved(9.0).min, there.max), (0.0, 3.0 * there.max_segment));
        // If no path exists, none exists for a moved sensor.
        let dark = TravelTimeBounds { min: f64::INFINITY, ..here };
        assert_eq!(dark.moved(1.0).min, f64::INFINITY);
    }

    /// The bounds of a prepared scene are those of its lights, after these have moved too.
    #[test]
    fn the_bounds_of_a_prepared_scene_follow_its_lights() {
        let [here, there] = [DVec3::X, 0.5 * DVec3::X].map(|light| scene(0.0, 0.0, Some(light)));
        let settings = crate::input::resolve::resolve(&Experiment::default(), &here).unwrap().settings;
        let of = |scene: &Scene| PreparedScene::new(scene, &settings).unwrap();
        let (before, after) = (of(&here).travel_time_bounds(3), of(&there).travel_time_bounds(3));
        let mut prepared = of(&here);
        assert_eq!(prepared.travel_time_bounds(3), before);
        assert_eq!(prepared.travel_time_bounds(6).max, 2.0 * before.max);
        assert!(prepared.follow(&there, &settings).unwrap());
        assert!(prepared.travel_time_bounds(3) == after && before != after, "{before:?}, {after:?}");
        // Previews get wider bounds at once, if the old ones are known.
        let mut preview = of(&here);
        preview.travel_time_bounds(3);
        assert!(preview.follow_nearby(&there, &settings).unwrap());
        let wide = preview.travel_time_bounds(3);
        assert!(close(wide.min, before.min - 0.5) && wide.max > after.max, "{wide:?}, {after:?}");
    }

    #[test]
    fn a_gate_is_met_unless_it_lies_wholly_outside() {
        let r = TravelTimeBounds { min: 2.0, max_segment: 3.0, ..TravelTimeBounds::default() }.to_depth(3);
        for (lo, hi, met) in
            [(0.0, 2.0, false), (0.0, 2.1, true), (8.9, 20.0, true), (9.0, 20.0, false), (3.0, 4.0, true)]
        {
            assert_eq!(r.overlaps(&Gate { lo, hi }), met, "{lo}..{hi}");
        }
    }
}
