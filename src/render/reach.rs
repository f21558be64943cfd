//! Which travel times a path can have at all: exact bounds from boxes alone, so nothing that renders is ever refused.

use glam::Vec3;
use rayon::prelude::*;

use super::geometry::Geometry;
use super::prepared::Prepared;
use crate::settings::Settings;
use crate::settings::units::Gate;
use crate::wgsl::layout::Triangle;

/// Bounds are widened by this part of themselves: device travel times are sums of rounded f32 terms.
const SLACK: f64 = 1e-5;
/// Punctual emitters that are looked at one by one; of more, their common box.
const MAX_EMITTERS: usize = 64;

/// Bounds on the travel time of every path, metres of optical path.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Reach {
    /// No light arrives before. Infinite where no path exists.
    pub least: f64,
    /// No light arrives at or after: `max_depth` times `segment`.
    pub greatest: f64,
    /// Optical length of the longest possible segment.
    pub segment: f64,
    pub max_depth: u32,
    /// Greatest refractive index that light travels in.
    #[serde(skip)]
    max_ior: f64,
}

#[derive(Debug, Clone, Copy)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
}

impl Reach {
    /// Bounds for paths of at most `settings.max_depth()` segments. Every refractive index is at least 1, so optical lengths
    /// are at least Euclidean ones.
    pub fn new(prepared: &Prepared, settings: &Settings) -> Reach {
        let Prepared { geometry, emitters, space, .. } = prepared;
        let direct = nearest_emissive_triangle(prepared);
        let least = direct.min(shortest_by_one_surface(geometry, &punctual_emitters(prepared)));
        let all = geometry.triangles.par_iter().map(Bounds::of).reduce(|| Bounds::point(Vec3::ZERO), Bounds::with);
        let all = all.with(Bounds { lo: emitters.lo, hi: emitters.hi });
        let diameter = (all.hi.as_dvec3() - all.lo.as_dvec3()).length();
        let max_ior = f64::from(geometry.max_ior);
        let segment = space.unit * diameter * max_ior * (1.0 + SLACK);
        let least = space.unit * least * (1.0 - SLACK);
        Reach { least, segment, max_ior, ..Reach::default() }.to_depth(settings.max_depth())
    }

    /// Bounds for a sensor `distance` metres away: by the triangle inequality, without another look at the scene.
    pub fn moved(&self, distance: f64) -> Reach {
        let least = (self.least - distance).max(0.0);
        let segment = self.segment + distance * self.max_ior * (1.0 + SLACK);
        Reach { least, segment, ..*self }.to_depth(self.max_depth)
    }

    fn to_depth(self, max_depth: u32) -> Reach {
        Reach { greatest: f64::from(max_depth) * self.segment, max_depth, ..self }
    }

    /// Can any light fall inside the gate, as far as these bounds tell?
    pub fn meets(&self, gate: &Gate) -> bool {
        gate.hi > self.least && gate.lo < self.greatest
    }

    /// For a gate that it does not meet: which bound says so, with lengths (metres) as `write` has them.
    pub fn why_not(&self, gate: &Gate, write: impl Fn(f64) -> String) -> String {
        match gate.hi <= self.least {
            true if self.least.is_infinite() => "no surface brings light to the sensor".into(),
            true => format!("none arrives before {}", write(self.least)),
            false => {
                format!("no path of {} segments (--max-depth) is longer than {}", self.max_depth, write(self.greatest))
            }
        }
    }
}

impl Bounds {
    fn of(t: &Triangle) -> Bounds {
        let [a, b, c] = [t.v0, t.v1, t.v2].map(Vec3::from);
        Bounds { lo: a.min(b).min(c), hi: a.max(b).max(c) }
    }

    fn point(p: Vec3) -> Bounds {
        Bounds { lo: p, hi: p }
    }

    fn with(self, other: Bounds) -> Bounds {
        Bounds { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// Least distance between points of the two boxes.
    fn distance(&self, other: &Bounds) -> f64 {
        let gap = (self.lo - other.hi).max(other.lo - self.hi).max(Vec3::ZERO);
        gap.as_dvec3().length()
    }
}

/// The sensor may see these directly. The origin is the sensor that the scene was prepared for.
fn nearest_emissive_triangle(prepared: &Prepared) -> f64 {
    let sensor = Bounds::point(Vec3::ZERO);
    let triangles = prepared.emitters.triangles.iter();
    let distances = triangles.map(|&i| Bounds::of(&prepared.geometry.triangles[i as usize]).distance(&sensor));
    distances.fold(f64::INFINITY, f64::min)
}

/// Lights without surface.
fn punctual_emitters(prepared: &Prepared) -> Vec<Bounds> {
    let lights = prepared.emitters.lights.iter();
    let boxes: Vec<Bounds> = lights.map(|&(p, radius)| Bounds { lo: p - radius, hi: p + radius }).collect();
    match boxes.len() {
        0..=MAX_EMITTERS => boxes,
        _ => boxes.into_iter().reduce(Bounds::with).into_iter().collect(),
    }
}

/// Such an emitter has no surface that the sensor could see: its light comes by another one.
fn shortest_by_one_surface(geometry: &Geometry, emitters: &[Bounds]) -> f64 {
    let sensor = Bounds::point(Vec3::ZERO);
    let by = |t: &Triangle| {
        let surface = Bounds::of(t);
        let to_emitter = emitters.iter().map(|e| e.distance(&surface)).fold(f64::INFINITY, f64::min);
        surface.distance(&sensor) + to_emitter
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
    use crate::generate::stage::diffuse;
    use crate::input::experiment::Experiment;
    use crate::scene::{Camera, Instance, Light, LightKind, Material, Mesh, Scene};

    /// A triangle in the plane x = 2 before a sensor at the origin, as seen from a world in which the sensor is elsewhere.
    fn scene(emission: f32, transmission: f32, light: Option<DVec3>) -> Scene {
        let sensor = DVec3::new(100.0, 20.0, 3.0);
        let base = Material { emission: [emission; 3], transmission, ior: 1.5, ..material() };
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
                yfov: 1.0,
                aspect: None,
                resolution: None,
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

    fn reach(scene: &Scene) -> Reach {
        let settings = crate::input::resolve::resolve(&Experiment::default(), scene).unwrap().settings;
        let settings = settings.change().max_depth(3).build().unwrap();
        Reach::new(&Prepared::new(scene, &settings).unwrap(), &settings)
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 3e-5 * b
    }

    #[test]
    fn a_point_light_is_seen_by_way_of_a_surface() {
        // 2 m from the sensor to the wall, 1 m from there to the light; the box is 2 m in all three directions.
        let r = reach(&scene(0.0, 0.0, Some(DVec3::X)));
        assert!(close(r.least, 3.0) && r.least < 3.0, "{r:?}");
        assert!(close(r.greatest, 3.0 * 12f64.sqrt()), "{r:?}");
    }

    #[test]
    fn an_emissive_surface_is_seen_directly() {
        let r = reach(&scene(1.0, 0.0, None));
        assert!(close(r.least, 2.0) && r.least < 2.0, "{r:?}");
        // The nearer of the two counts.
        assert_eq!(reach(&scene(1.0, 0.0, Some(DVec3::X))).least, r.least);
    }

    #[test]
    fn only_what_light_passes_through_makes_paths_optically_longer() {
        let opaque = reach(&scene(1.0, 0.0, None)).segment;
        assert!(close(reach(&scene(1.0, 1.0, None)).segment, 1.5 * opaque));
    }

    #[test]
    fn a_moved_sensor_has_wider_bounds() {
        let here = reach(&scene(1.0, 1.0, Some(DVec3::X)));
        assert_eq!(here.moved(0.0), here);
        let there = here.moved(0.5);
        assert!(close(there.least, here.least - 0.5) && close(there.segment, here.segment + 0.75), "{there:?}");
        assert_eq!((here.moved(9.0).least, there.greatest), (0.0, 3.0 * there.segment));
        // Where no path exists there is none from elsewhere.
        let dark = Reach { least: f64::INFINITY, ..here };
        assert_eq!(dark.moved(1.0).least, f64::INFINITY);
    }

    #[test]
    fn a_gate_is_met_unless_it_lies_wholly_outside() {
        let r = Reach { least: 2.0, segment: 3.0, ..Reach::default() }.to_depth(3);
        for (lo, hi, met) in
            [(0.0, 2.0, false), (0.0, 2.1, true), (8.9, 20.0, true), (9.0, 20.0, false), (3.0, 4.0, true)]
        {
            assert_eq!(r.meets(&Gate { lo, hi }), met, "{lo}..{hi}");
        }
    }
}
