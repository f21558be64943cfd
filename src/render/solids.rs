//! Which piece of glass the camera or a lamp is inside of. Subpaths that start there need its index of refraction and its medium.
//! Other subpaths learn these where they meet the surface of the glass.

pub mod nested;
mod orientation;
mod parts;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::geometry::Geometry;
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{NONE, Triangle};
pub use orientation::{ClosedGlass, Orientation};

/// The instances of glass in a scene, in render space. Null boundaries do not count, because rays find the media inside of them without
/// help.
#[derive(Default)]
pub struct Solids(Vec<Solid>);

/// Work of a triangle, relative to that of a box.
const TRIANGLE_STEPS: usize = 16;

/// All triangles of one instance.
struct Solid {
    /// Index in [`crate::scene::Scene::instances`].
    instance: u32,
    /// Index in [`Geometry::materials`].
    material: u32,
    lo: Vec3,
    hi: Vec3,
    /// Whether rays may pass through the surface because of its alpha.
    has_holes: bool,
    /// Counter-clockwise, seen from the front of the surface.
    triangles: Vec<[Vec3; 3]>,
}

impl Solids {
    pub fn new(geometry: &Geometry) -> Solids {
        if !geometry.features.transmission {
            return Solids::default();
        }
        let mut by_instance: BTreeMap<u32, Solid> = BTreeMap::new();
        let transmits = |t: &&Triangle| {
            let material = &geometry.materials[(t.material & TRIANGLE_MATERIAL) as usize];
            material.transmission > 0.0 && t.material & (TRIANGLE_NULL | TRIANGLE_SHEET) == 0
        };
        for t in geometry.triangles.iter().filter(transmits) {
            let material = t.material & TRIANGLE_MATERIAL;
            let instance = t.instance;
            let empty = || Solid {
                instance,
                material,
                lo: Vec3::INFINITY,
                hi: Vec3::NEG_INFINITY,
                has_holes: false,
                triangles: vec![],
            };
            by_instance.entry(instance).or_insert_with(empty).add(t);
        }
        Solids(by_instance.into_values().collect())
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The instances whose alpha lets rays pass through the surface.
    pub fn with_holes(&self) -> impl Iterator<Item = u32> {
        self.0.iter().filter(|solid| solid.has_holes).map(|solid| solid.instance)
    }

    /// Material of the glass around `point`, an index in [`Geometry::materials`]; NONE outside of glass. Where pieces of glass are
    /// nested, the smallest one around the point counts. If its surface faces inwards, it is a hole, so the point is outside.
    pub fn material_at(&self, point: Vec3) -> u32 {
        let mut steps = usize::MAX;
        self.material_within(point, &mut steps)
    }

    /// As [`Solids::material_at`], with a limit on the work. Each box around glass takes one from `steps`, and each triangle in a box around
    /// the point takes [`TRIANGLE_STEPS`]. If there are not enough left, the result is NONE and `steps` becomes 0.
    pub fn material_within(&self, point: Vec3, steps: &mut usize) -> u32 {
        let mut spend = |count: usize| {
            let left = steps.checked_sub(count);
            *steps = left.unwrap_or(0);
            left.is_some()
        };
        if !spend(self.0.len()) {
            return NONE;
        }
        let mut around: Vec<&Solid> = self.0.iter().filter(|solid| solid.may_contain(point)).collect();
        around.sort_by(|a, b| a.hi.distance(a.lo).total_cmp(&b.hi.distance(b.lo)));
        for solid in around {
            if !spend(TRIANGLE_STEPS * solid.triangles.len()) {
                return NONE;
            }
            let seen = solid.solid_angle(point);
            // More than three quarters of all directions, because small gaps in a mesh are common.
            if seen.abs() > 3.0 * PI {
                return if seen > 0.0 { solid.material } else { NONE };
            }
        }
        NONE
    }
}

impl Solid {
    fn add(&mut self, t: &Triangle) {
        let [a, b, c] = [t.v0, t.v1, t.v2].map(Vec3::from);
        self.lo = self.lo.min(a).min(b).min(c);
        self.hi = self.hi.max(a).max(b).max(c);
        self.has_holes |= t.material & TRIANGLE_ALPHA != 0;
        self.triangles.push(if t.material & TRIANGLE_MIRRORED != 0 { [a, c, b] } else { [a, b, c] });
    }

    fn may_contain(&self, point: Vec3) -> bool {
        point.cmpge(self.lo).all() && point.cmple(self.hi).all()
    }

    /// Solid angle in sr of all triangles, seen from `point`. Triangles that are seen from the front count as negative. The result is 4 pi
    /// in a closed mesh that faces outwards, and 0 outside of it.
    fn solid_angle(&self, point: Vec3) -> f64 {
        let of = |triangle: &[Vec3; 3]| solid_angle(triangle.map(|corner| (corner - point).as_dvec3()));
        self.triangles.par_iter().map(of).sum()
    }
}

/// Solid angle in sr of a triangle, seen from the origin (van Oosterom and Strackee 1983). Positive if it is seen from behind, where its
/// corners run clockwise.
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::generate::parts::{add, camera, emitter, glass, material, mesh, place};
    use crate::generate::shapes::{cuboid, icosphere, inside_out};
    use crate::render::prepared_scene::PreparedScene;
    use crate::scene::{Material, Scene};
    use crate::settings::Settings;

    /// A ball of glass of radius 1 around the origin. It contains a lamp and a smaller ball of other glass, which has a hole. Another lamp
    /// is outside. The camera is at `eye`.
    fn balls(eye: DVec3, transform: DAffine3) -> PreparedScene {
        let mut scene = Scene::default();
        let [outer, inner] = ["outer", "inner"].map(|name| material(&mut scene, glass(name)));
        scene.materials[inner as usize] = Material { ior: 1.8, ..glass("inner") };
        let shine = material(&mut scene, emitter("shine", [1.0; 3]));
        let mut ball = |material, radius: f64, is_hole: bool, at: DAffine3| {
            let shape = icosphere(radius, 2);
            let ball = mesh(&mut scene, "ball", material, if is_hole { inside_out(shape) } else { shape });
            place(&mut scene, "ball", ball, at);
        };
        ball(outer, 1.0, false, transform);
        ball(inner, 0.5, false, transform);
        ball(inner, 0.2, true, transform);
        ball(shine, 0.1, false, DAffine3::from_translation(DVec3::Y * 3.0));
        ball(shine, 0.1, false, DAffine3::from_translation(DVec3::X * 0.7));
        camera(&mut scene, eye, eye + DVec3::Z, 0.5, [8, 8]);
        PreparedScene::new(&scene, &Settings::default()).unwrap()
    }

    /// The index of refraction around the camera; 1 outside of glass.
    fn index_around(eye: DVec3, transform: DAffine3) -> f32 {
        let prepared = balls(eye, transform);
        let found = prepared.solids.material_at(prepared.space.point(eye));
        prepared.geometry.around(found, 1.0).0
    }

    #[test]
    fn the_innermost_glass_around_a_point_counts() {
        let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        for transform in [DAffine3::IDENTITY, mirrored] {
            for (x, index) in [(0.1, 1.0), (0.35, 1.8), (0.8, 1.5), (2.0, 1.0)] {
                assert_eq!(index_around(DVec3::new(0.0, 0.0, x), transform), index, "{x}");
            }
            // In the box around the ball, but outside of the ball.
            assert_eq!(index_around(DVec3::splat(0.7), transform), 1.0);
        }
    }

    #[test]
    fn emitters_know_the_glass_around_them() {
        let prepared = balls(DVec3::Z * 4.0, DAffine3::IDENTITY);
        let table = &prepared.emitters.table;
        let indices = table.iter().map(|entry| prepared.geometry.around(entry.solid, 1.0).0);
        let in_glass = indices.filter(|&index| index == 1.5).count();
        assert_eq!((in_glass, table.len()), (table.len() / 2, 640));
    }

    /// Glass that shines is not around its own light.
    #[test]
    fn light_leaves_the_front_of_shining_glass() {
        for shape in [cuboid(DVec3::splat(-0.3), DVec3::splat(0.5)), icosphere(0.5, 1)] {
            let mut scene = Scene::default();
            let shade = material(&mut scene, Material { emission: [1.0; 3], ..glass("shade") });
            add(&mut scene, "shade", shade, shape);
            camera(&mut scene, DVec3::Z * 4.0, DVec3::ZERO, 0.5, [8, 8]);
            let prepared = PreparedScene::new(&scene, &Settings::default()).unwrap();
            assert!(!prepared.emitters.table.is_empty());
            assert!(prepared.emitters.table.iter().all(|entry| entry.solid == NONE));
        }
    }

    /// There are three balls of glass. The smallest one around the point has 320 triangles.
    #[test]
    fn the_work_is_limited() {
        let prepared = balls(DVec3::Z * 4.0, DAffine3::IDENTITY);
        let point = prepared.space.point(DVec3::Z * 0.35);
        for (mut steps, found, left) in [(5122, false, 0), (5123, true, 0), (6000, true, 877)] {
            let material = prepared.solids.material_within(point, &mut steps);
            assert_eq!((material != NONE, steps), (found, left));
        }
    }
}
