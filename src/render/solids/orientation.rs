//! Closed meshes of glass whose triangles face inwards. A closed mesh has an inside, so most of them are turned.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::parts::{Part, is_in, parts, surrounds};
use crate::scene::{Instance, Material, Scene, corners, surrounding_indices};

/// The closed meshes of glass, by mesh, with their parts. Null boundaries are left out.
#[derive(Default, Clone)]
pub struct ClosedGlass(BTreeMap<u32, Vec<Part>>);

/// Which triangles of glass are turned around.
#[derive(Default, Clone, PartialEq)]
pub struct Orientation {
    /// By instance: for each triangle of its mesh, whether it is turned.
    turned: BTreeMap<u32, Arc<[bool]>>,
    /// Instances that face inwards and are around all other objects, so that they may be meant so. They stay as they are.
    kept: Vec<u32>,
}

impl ClosedGlass {
    pub fn new(scene: &Scene) -> ClosedGlass {
        let [outside, _] = surrounding_indices(&scene.media);
        let is_glass = |&number: &u32| {
            let mesh = &scene.meshes[number as usize];
            let material = &scene.materials[mesh.material as usize];
            material.transmits() && !material.is_null_boundary(mesh, outside) && !material.is_sheet(mesh)
        };
        let meshes: Vec<u32> = (0..scene.meshes.len() as u32).filter(is_glass).collect();
        let closed = meshes.into_par_iter().filter_map(|number| {
            let mesh = &scene.meshes[number as usize];
            let is_closed = !mesh.triangles.is_empty() && mesh.open_edges() == 0;
            is_closed.then(|| (number, parts(mesh)))
        });
        ClosedGlass(closed.collect())
    }

    /// The instances of meshes that have a part inside of a part, both of which face outwards.
    pub fn nested_in_themselves(&self, scene: &Scene) -> Vec<u32> {
        let is_nested = |instance: &Instance| {
            self.0.get(&instance.mesh).is_some_and(|parts| {
                let is_outward = |part: &Part| part.is_inward == (part.depth % 2 == 1);
                parts.iter().any(|part| {
                    let parent = part.parent.map(|parent| &parts[parent]);
                    parent.is_some_and(|parent| parent.is_inward == part.is_inward && is_outward(parent))
                })
            })
        };
        let numbered = scene.instances.iter().enumerate();
        numbered.filter(|(_, instance)| is_nested(instance)).map(|(number, _)| number as u32).collect()
    }
}

impl Orientation {
    /// Depends on the transforms of all instances. `glass`: that of `scene`.
    pub fn new(scene: &Scene, glass: &ClosedGlass) -> Orientation {
        let mut orientation = Orientation::default();
        for (number, instance) in scene.instances.iter().enumerate() {
            let Some(parts) = glass.0.get(&instance.mesh) else { continue };
            let mut turned = vec![];
            for (k, part) in parts.iter().enumerate().filter(|(_, part)| part.is_inward && part.depth == 0) {
                let point = instance.transform.transform_point3(part.corner(&scene.meshes[instance.mesh as usize]));
                if is_cavity(scene, glass, number, point) {
                    continue;
                }
                if is_around_all(scene, number, part) {
                    orientation.kept.push(number as u32);
                    continue;
                }
                // Parts inside must face inwards and outwards in turns.
                let faces_wrong_way = |part: &Part| part.is_inward == part.depth.is_multiple_of(2);
                turned.extend(
                    (0..parts.len()).filter(|&other| outermost(parts, other) == k && faces_wrong_way(&parts[other])),
                );
            }
            if !turned.is_empty() {
                let mut list = vec![false; scene.meshes[instance.mesh as usize].triangles.len()];
                turned.iter().flat_map(|&part| &parts[part].triangles).for_each(|&t| list[t as usize] = true);
                orientation.turned.insert(number as u32, list.into());
            }
        }
        orientation
    }

    /// Whether a triangle of an instance is turned.
    pub fn turns(&self, instance: u32, triangle: usize) -> bool {
        self.turned.get(&instance).is_some_and(|turned| turned[triangle])
    }

    /// Whether the instances that `counts` selects are turned as in `other`.
    pub fn is_same_for(&self, other: &Orientation, counts: impl Fn(u32) -> bool) -> bool {
        let all = self.turned.keys().chain(other.turned.keys()).filter(|&&instance| counts(instance));
        all.into_iter().all(|instance| self.turned.get(instance) == other.turned.get(instance))
    }

    /// Instances that are turned.
    pub fn turned(&self) -> impl Iterator<Item = u32> {
        self.turned.keys().copied()
    }

    /// Instances that face inwards and stay so.
    pub fn kept(&self) -> impl Iterator<Item = u32> {
        self.kept.iter().copied()
    }
}

/// The outermost part around a part, or the part itself.
fn outermost(parts: &[Part], mut part: usize) -> usize {
    while let Some(parent) = parts[part].parent {
        part = parent;
    }
    part
}

/// Whether `point`, a corner of a closed part of instance `number`, is inside of another solid with the same optics. The part is then
/// the inner surface of this solid.
fn is_cavity(scene: &Scene, glass: &ClosedGlass, number: usize, point: DVec3) -> bool {
    let material = |instance: &Instance| &scene.materials[scene.meshes[instance.mesh as usize].material as usize];
    let is_like = |a: &Material, b: &Material| a.ior == b.ior && a.interior == b.interior;
    let own = material(&scene.instances[number]);
    scene.instances.iter().enumerate().any(|(other, instance)| {
        let Some(parts) = glass.0.get(&instance.mesh).filter(|_| other != number && is_like(own, material(instance)))
        else {
            return false;
        };
        let local = instance.transform.inverse().transform_point3(point);
        let mesh = &scene.meshes[instance.mesh as usize];
        let is_around = |part: &&Part| is_in([local, local], part.bounds) && surrounds(mesh, &part.triangles, local);
        // An even number of surfaces around the point: it is in a cavity of the other solid.
        parts.iter().filter(is_around).count() % 2 == 1
    })
}

/// Whether the boxes of all other instances are in the box of a part of instance `number`.
fn is_around_all(scene: &Scene, number: usize, part: &Part) -> bool {
    let bounds = |instance: &Instance, bounds: [DVec3; 2]| {
        let all = corners(bounds, &instance.transform);
        all.into_iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], p| [lo.min(p), hi.max(p)])
    };
    let around = bounds(&scene.instances[number], part.bounds);
    let mut others = scene.instances.iter().enumerate().filter(|(other, _)| *other != number).peekable();
    others.peek().is_some()
        && others.all(|(_, other)| is_in(bounds(other, scene.meshes[other.mesh as usize].bounds()), around))
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::generate::parts::{add, diffuse, glass, material};
    use crate::generate::shapes::{append, cuboid, icosphere, inside_out, quad};
    use crate::scene::Mesh;

    /// The share of the triangles of the first instance that is turned, and the number of instances that stay inside out.
    fn turned(scene: &Scene) -> (f64, usize) {
        let orientation = Orientation::new(scene, &ClosedGlass::new(scene));
        let count = scene.meshes[0].triangles.len();
        let turned = (0..count).filter(|&t| orientation.turns(0, t)).count();
        (turned as f64 / count as f64, orientation.kept().count())
    }

    /// A piece of glass of the shape `first`, with more pieces, and a floor of 20 m unless the scene is bare.
    fn scene(first: Mesh, more: Vec<(Mesh, Material)>, has_floor: bool) -> Scene {
        let mut scene = Scene::default();
        let clear = material(&mut scene, glass("clear"));
        add(&mut scene, "first", clear, first);
        for (shape, kind) in more {
            let kind = material(&mut scene, kind);
            add(&mut scene, "more", kind, shape);
        }
        if has_floor {
            let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
            add(&mut scene, "floor", grey, quad(DVec3::splat(-10.0), 20.0 * DVec3::Z, 20.0 * DVec3::X, [1.0; 2]));
        }
        scene
    }

    fn hollow() -> Mesh {
        let mut hollow = icosphere(1.0, 1);
        append(&mut hollow, &inside_out(icosphere(0.5, 1)), DAffine3::IDENTITY);
        hollow
    }

    #[test]
    fn closed_glass_that_faces_inwards_is_turned() {
        let cube = || cuboid(DVec3::ZERO, DVec3::ONE);
        assert_eq!(turned(&scene(cube(), vec![], true)), (0.0, 0));
        assert_eq!(turned(&scene(inside_out(cube()), vec![], true)), (1.0, 0));
        assert_eq!(turned(&scene(hollow(), vec![], true)), (0.0, 0));
        assert_eq!(turned(&scene(inside_out(hollow()), vec![], true)), (1.0, 0));
        // Only the outer surface faces the wrong way.
        let mut outer = inside_out(icosphere(1.0, 1));
        append(&mut outer, &inside_out(icosphere(0.5, 1)), DAffine3::IDENTITY);
        assert_eq!(turned(&scene(outer, vec![], true)), (0.5, 0));
        // One of two parts beside each other.
        let mut pair = inside_out(icosphere(1.0, 1));
        append(&mut pair, &icosphere(1.0, 1), DAffine3::from_translation(DVec3::X * 5.0));
        assert_eq!(turned(&scene(pair, vec![], true)), (0.5, 0));
        // An open mesh has no inside.
        let mut open = inside_out(cube());
        open.triangles.pop();
        assert_eq!(turned(&scene(open, vec![], true)), (0.0, 0));
        // A mirrored placement changes nothing.
        let mut mirrored = scene(inside_out(cube()), vec![], true);
        mirrored.instances[0].transform = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        assert_eq!(turned(&mirrored), (1.0, 0));
    }

    #[test]
    fn the_inner_surface_of_glass_in_another_mesh_stays() {
        let inner = inside_out(icosphere(0.5, 1));
        let around = |ior| (icosphere(1.0, 2), Material { ior, ..glass("around") });
        assert_eq!(turned(&scene(inner.clone(), vec![around(1.5)], true)), (0.0, 0));
        // Another index: this is no inner surface.
        assert_eq!(turned(&scene(inner.clone(), vec![around(1.33)], true)), (1.0, 0));
        // A solid in the cavity of another one.
        assert_eq!(turned(&scene(inside_out(icosphere(0.2, 1)), vec![(hollow(), glass("hollow"))], true)), (1.0, 0));
    }

    #[test]
    fn glass_around_everything_stays() {
        let room = || inside_out(cuboid(DVec3::splat(-20.0), DVec3::splat(20.0)));
        assert_eq!(turned(&scene(room(), vec![], true)), (0.0, 1));
        assert_eq!(turned(&scene(room(), vec![], false)), (1.0, 0));
    }
}
