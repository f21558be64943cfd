//! Warnings about lamps and pinholes inside of glass. Subpaths learn that they are in glass only where they meet its surface.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::DVec3;

use super::space::RenderSpace;
use super::travel_time_bounds::Box3;
use crate::scene::{Instance, Mesh, Scene, surrounding_indices};

/// At most this many warnings; a file may have thousands of bulbs.
const MAX_REPORTED: usize = 3;

/// One text per piece of glass around the pinhole, or around both a lamp and a surface that is no glass. `sensor`: the points where
/// camera rays start. `powers`: powers of the emitters in use, by name.
pub fn warnings(scene: &Scene, space: &RenderSpace, sensor: Box3, powers: &BTreeMap<String, f64>) -> Vec<String> {
    let [outside, _] = surrounding_indices(&scene.media);
    let is_glass = |instance: &&Instance| {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        material.transmits() && !material.is_null_boundary(mesh, outside)
    };
    let glass = scene.instances.iter().filter(is_glass).map(|instance| Solid::new(scene, instance));
    let pinhole = space.world(sensor.centre());
    glass.filter_map(|solid| solid.warning(scene, pinhole, powers)).take(MAX_REPORTED).collect()
}

/// A mesh in the world.
struct Solid<'a> {
    instance: &'a Instance,
    mesh: &'a Mesh,
    /// Lower and upper corner in the world.
    bounds: [DVec3; 2],
}

impl<'a> Solid<'a> {
    fn new(scene: &'a Scene, instance: &'a Instance) -> Solid<'a> {
        Solid { instance, mesh: &scene.meshes[instance.mesh as usize], bounds: scene.bounds_of(instance) }
    }

    fn warning(&self, scene: &Scene, pinhole: DVec3, powers: &BTreeMap<String, f64>) -> Option<String> {
        let glass = &self.instance.node;
        if self.contains(pinhole) {
            return Some(format!(
                "the camera is inside of the glass '{glass}', so refraction and travel times are wrong; move the camera out of it"
            ));
        }
        let lamp = self.lamp(scene, powers)?;
        let other = self.surface(scene)?;
        Some(format!(
            "the lamp '{lamp}' is inside of the glass '{glass}', so its light reaches '{other}', which is inside too, too early; move \
             one of them out of the glass, or use --estimator pt"
        ))
    }

    /// Name of a lamp inside.
    fn lamp<'s>(&self, scene: &'s Scene, powers: &BTreeMap<String, f64>) -> Option<&'s str> {
        let lights = scene.lights.iter().filter(|light| !light.kind.is_distant());
        let lights = lights.map(|light| (light.node.as_str(), light.position));
        let surfaces = scene.instances.iter().filter(|instance| emits(scene, instance));
        let surfaces = surfaces.map(|instance| (instance.node.as_str(), corner(scene, instance)));
        let mut all = lights.chain(surfaces).filter(|(node, _)| powers.contains_key(*node));
        all.find(|&(_, position)| self.contains(position)).map(|(node, _)| node)
    }

    /// Name of an instance inside that neither transmits nor emits.
    fn surface<'s>(&self, scene: &'s Scene) -> Option<&'s str> {
        let transmits = |i: &Instance| scene.materials[scene.meshes[i.mesh as usize].material as usize].transmits();
        let mut others = scene.instances.iter().filter(|i| !transmits(i) && !emits(scene, i));
        others.find(|instance| self.contains(corner(scene, instance))).map(|instance| instance.node.as_str())
    }

    /// Whether the mesh surrounds the point: its triangles cover more than three quarters of all directions, counted
    /// with their orientation.
    fn contains(&self, point: DVec3) -> bool {
        let [lo, hi] = self.bounds;
        if point.cmplt(lo).any() || point.cmpgt(hi).any() {
            return false;
        }
        let at = |corner: u32| {
            let position = glam::Vec3::from(self.mesh.positions[corner as usize]).as_dvec3();
            self.instance.transform.transform_point3(position) - point
        };
        let covered: f64 = self.mesh.triangles.iter().map(|triangle| signed_solid_angle(triangle.map(at))).sum();
        covered.abs() > 3.0 * PI
    }
}

/// Whether the instance has an emissive material.
fn emits(scene: &Scene, instance: &Instance) -> bool {
    scene.materials[scene.meshes[instance.mesh as usize].material as usize].emission != [0.0; 3]
}

/// A corner of a triangle of the instance.
fn corner(scene: &Scene, instance: &Instance) -> DVec3 {
    let mesh = &scene.meshes[instance.mesh as usize];
    let first = mesh.triangles.first().map_or(0, |triangle| triangle[0]);
    instance.transform.transform_point3(glam::Vec3::from(mesh.positions[first as usize]).as_dvec3())
}

/// Solid angle of a triangle seen from the origin, in sr; negative for the other orientation (van Oosterom and Strackee 1983).
fn signed_solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::shapes::{cuboid, icosphere, inside_out};
    use crate::generate::stage::{add, camera, diffuse, glass, light, material};
    use crate::render::PreparedScene;
    use crate::scene::LightKind;
    use crate::settings::Settings;

    /// A ball of glass of radius 1 m with a chip in it, a lamp at `lamp` and a camera at `eye`.
    fn warnings_of(lamp: DVec3, eye: DVec3, chip: DVec3, turned: bool) -> Vec<String> {
        let mut scene = Scene::default();
        let clear = material(&mut scene, glass("epoxy"));
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        let ball = icosphere(1.0, 2);
        add(&mut scene, "dome", clear, if turned { inside_out(ball) } else { ball });
        add(&mut scene, "chip", grey, cuboid(chip - DVec3::splat(0.1), chip + DVec3::splat(0.1)));
        light(&mut scene, "bulb", lamp, DVec3::NEG_Y, LightKind::Point { intensity: [1.0; 3] });
        camera(&mut scene, eye, DVec3::ZERO, 0.5, [8, 8]);
        PreparedScene::new(&scene, &Settings::default()).unwrap().warnings(&scene)
    }

    #[test]
    fn lamps_and_pinholes_in_glass_are_named() {
        let (inside, outside) = (DVec3::new(0.3, 0.4, 0.0), DVec3::new(0.9, 0.9, 0.0));
        let far = DVec3::Z * 5.0;
        for turned in [false, true] {
            let found = warnings_of(inside, far, DVec3::ZERO, turned);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].contains("'bulb'") && found[0].contains("'dome'") && found[0].contains("'chip'"));
            let found = warnings_of(far, inside, DVec3::X * 3.0, turned);
            assert!(found.len() == 1 && found[0].contains("the camera is inside of the glass 'dome'"), "{found:?}");
        }
        // In the box around the ball, but outside of it; and a bulb alone in the glass, which is right.
        assert_eq!(warnings_of(outside, far, DVec3::ZERO, false), Vec::<String>::new());
        assert_eq!(warnings_of(inside, far, DVec3::X * 3.0, false), Vec::<String>::new());
    }
}
