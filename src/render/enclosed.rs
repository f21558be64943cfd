//! Warnings about lamps and pinholes inside of glass. Subpaths learn that they are in glass only where they meet its surface.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::space::RenderSpace;
use super::travel_time_bounds::Box3;
use crate::scene::{Instance, Material, Scene, surrounding_indices};

/// At most this many warnings; a file may have thousands of bulbs.
const MAX_REPORTED: usize = 3;
/// Maximum number of points and triangles to look at, at most a second of work. After that, there are no further warnings.
const MAX_STEPS: usize = 1 << 25;

/// One text per piece of glass around the pinhole, or around both a lamp and a surface that is no glass. `sensor`: the points where
/// camera rays start. `powers`: powers of the emitters in use, by name.
pub fn warnings(scene: &Scene, space: &RenderSpace, sensor: Box3, powers: &BTreeMap<String, f64>) -> Vec<String> {
    let [outside, _] = surrounding_indices(&scene.media);
    let is_glass = |instance: &&Instance| {
        let material = material(scene, instance);
        material.transmits() && !material.is_null_boundary(&scene.meshes[instance.mesh as usize], outside)
    };
    let glass: Vec<&Instance> = scene.instances.iter().filter(is_glass).collect();
    if glass.is_empty() {
        return vec![];
    }
    let (points, mut steps) = (Points::new(scene, space.world(sensor.centre()), powers), MAX_STEPS);
    glass.into_iter().filter_map(|glass| warning(scene, glass, &points, &mut steps)).take(MAX_REPORTED).collect()
}

/// The points that may be inside of glass, with the names of their nodes.
struct Points<'a> {
    pinhole: [(&'a str, DVec3); 1],
    /// Lamps in use.
    lamps: Vec<(&'a str, DVec3)>,
    /// One point of each instance that neither transmits nor emits.
    others: Vec<(&'a str, DVec3)>,
}

impl<'a> Points<'a> {
    fn new(scene: &'a Scene, pinhole: DVec3, powers: &BTreeMap<String, f64>) -> Points<'a> {
        let point = |instance: &'a Instance| (instance.node.as_str(), first_corner(scene, instance));
        let emits = |instance: &&Instance| material(scene, instance).emission != [0.0; 3];
        let is_opaque = |instance: &&Instance| !material(scene, instance).transmits() && !emits(instance);
        let lights = scene.lights.iter().filter(|light| !light.kind.is_distant());
        let lights = lights.map(|light| (light.node.as_str(), light.position));
        let lamps = lights.chain(scene.instances.iter().filter(emits).map(point));
        Points {
            pinhole: [("", pinhole)],
            lamps: lamps.filter(|(node, _)| powers.contains_key(*node)).collect(),
            others: scene.instances.iter().filter(is_opaque).map(point).collect(),
        }
    }
}

fn warning(scene: &Scene, glass: &Instance, points: &Points, steps: &mut usize) -> Option<String> {
    let bounds = scene.bounds_of(glass);
    let mut inside = |points| inside(scene, glass, bounds, points, steps);
    let node = &glass.node;
    if inside(&points.pinhole).is_some() {
        return Some(format!(
            "the camera is inside of the glass '{node}', so refraction and travel times are wrong; move the camera out of it"
        ));
    }
    let lamp = inside(&points.lamps)?;
    let other = inside(&points.others)?;
    Some(format!(
        "the lamp '{lamp}' is inside of the glass '{node}', so its light reaches '{other}', which is inside too, too early; move one of \
         them out of the glass, or use --estimator pt"
    ))
}

/// The node of the first of the points that the mesh surrounds: its triangles cover more than three quarters of all directions,
/// counted with their orientation. `bounds`: lower and upper corner of a box around the glass in metres in the world. Subtracts from
/// `steps`, and stops when there are none left.
fn inside<'p>(
    scene: &Scene,
    glass: &Instance,
    [lo, hi]: [DVec3; 2],
    points: &[(&'p str, DVec3)],
    steps: &mut usize,
) -> Option<&'p str> {
    let triangles = &scene.meshes[glass.mesh as usize].triangles;
    for &(node, point) in points {
        let is_outside = point.cmplt(lo).any() || point.cmpgt(hi).any();
        *steps = steps.checked_sub(if is_outside { 1 } else { triangles.len() })?;
        let seen = |index: u32| corner(scene, glass, index) - point;
        let solid_angle = || triangles.iter().map(|triangle| signed_solid_angle(triangle.map(seen))).sum::<f64>();
        if !is_outside && solid_angle().abs() > 3.0 * PI {
            return Some(node);
        }
    }
    None
}

fn material<'a>(scene: &'a Scene, instance: &Instance) -> &'a Material {
    &scene.materials[scene.meshes[instance.mesh as usize].material as usize]
}

/// The position in the world of a vertex of the instance's mesh.
fn corner(scene: &Scene, instance: &Instance, index: u32) -> DVec3 {
    let position = scene.meshes[instance.mesh as usize].positions[index as usize];
    instance.transform.transform_point3(Vec3::from(position).as_dvec3())
}

/// The first corner of the first triangle.
fn first_corner(scene: &Scene, instance: &Instance) -> DVec3 {
    let first = scene.meshes[instance.mesh as usize].triangles.first();
    corner(scene, instance, first.map_or(0, |triangle| triangle[0]))
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
        let settings = Settings::default();
        PreparedScene::new(&scene, &settings).unwrap().warnings(&scene, &settings)
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
