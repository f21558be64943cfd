//! Warnings about surfaces that are so large that the offset of ray origins on them is visible at the scale of the rest of
//! the scene.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;

use super::geometry::Geometry;
use super::space::RenderSpace;
use crate::scene::Scene;
use crate::wgsl::layout::Triangle;
use crate::wgsl::layout::constants::OFFSET_SCALE;

/// Maximum offset of a ray origin from a triangle, relative to the size of the rest of the scene. A larger offset visibly
/// removes light.
const MAX_OFFSET_FRACTION: f32 = 0.1;
/// The warning recommends a size that is smaller by this factor than the largest coordinate without a warning. The coordinates of
/// a surface may be larger than its size, because they are relative to the pinhole.
const SIZE_MARGIN: f32 = 10.0;
/// Maximum number of warnings about nodes.
const MAX_REPORTED: usize = 10;

/// Returns one warning, with the remedy, per node with triangles whose ray offset is too large for the objects near them. After
/// [`MAX_REPORTED`] of them, a last sentence gives the number of the other nodes.
pub fn warnings(scene: &Scene, geometry: &Geometry, space: &RenderSpace) -> Vec<String> {
    // Bounding boxes of the triangles and lights, grouped by the exponent of their maximum coordinate.
    let mut boxes: BTreeMap<i32, [Vec3; 2]> = BTreeMap::new();
    let mut enclose = |coordinate: f32, points: &[Vec3]| {
        let all = boxes.entry(coordinate.log2().floor() as i32).or_insert([Vec3::INFINITY, Vec3::NEG_INFINITY]);
        points.iter().for_each(|&p| *all = [all[0].min(p), all[1].max(p)]);
    };
    for triangle in &geometry.triangles {
        enclose(max_coordinate(triangle), &corners(triangle));
    }
    for light in scene.lights.iter().filter(|light| !light.kind.is_distant()) {
        let position = space.point(light.position);
        // A light at the pinhole would be a scene of size 0, for which every ray offset is too large.
        if position != Vec3::ZERO {
            enclose(position.abs().max_element(), &[position]);
        }
    }

    // The rest of the scene: the groups from the pinhole (the origin) outwards, up to the first with too large an offset.
    let mut rest = [Vec3::ZERO; 2];
    let mut inner = 0;
    for (exponent, [lo, hi]) in &boxes {
        if inner > 0 && offset_exceeds((*exponent as f32).exp2(), rest) {
            break;
        }
        rest = [rest[0].min(*lo), rest[1].max(*hi)];
        inner += 1;
    }
    if inner == boxes.len() {
        return vec![];
    }
    let size = (rest[1] - rest[0]).length();
    let near = [rest[0] - size, rest[1] + size];
    let is_near = |t: &Triangle| {
        let [a, b, c] = corners(t);
        let [lo, hi] = [a.min(b).min(c), a.max(b).max(c)];
        lo.cmple(near[1]).all() && hi.cmpge(near[0]).all()
    };
    let nodes: BTreeSet<&str> = geometry
        .triangles
        .iter()
        .filter(|t| offset_exceeds(max_coordinate(t), rest) && is_near(t))
        .map(|t| scene.instances[t.instance as usize].node.as_str())
        .collect();
    let metres = |length: f32| f64::from(length) * space.unit;
    let sentence = |node: &&str| {
        format!(
            "'{node}' has triangles so large that light is lost where the rest of the scene, {:.2e} m in size, touches them: make \
             the surface smaller than {:.0e} m, or divide it into smaller triangles",
            metres(size),
            metres(MAX_OFFSET_FRACTION / SIZE_MARGIN / OFFSET_SCALE * size)
        )
    };
    let mut all: Vec<String> = nodes.iter().take(MAX_REPORTED).map(sentence).collect();
    if nodes.len() > MAX_REPORTED {
        all.push(format!("and {} more nodes have triangles that are too large", nodes.len() - MAX_REPORTED));
    }
    all
}

fn corners(t: &Triangle) -> [Vec3; 3] {
    [t.v0, t.v1, t.v2].map(Vec3::from)
}

/// Largest absolute coordinate of the triangle, in units of render space.
pub(super) fn max_coordinate(t: &Triangle) -> f32 {
    corners(t).iter().map(|p| p.abs().max_element()).fold(0.0, f32::max)
}

/// Whether the ray offset on a triangle with this maximum coordinate is too large for the objects in the box.
fn offset_exceeds(max_coordinate: f32, [lo, hi]: [Vec3; 2]) -> bool {
    OFFSET_SCALE * max_coordinate > MAX_OFFSET_FRACTION * (hi - lo).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::parts::{add, diffuse, material};
    use crate::generate::shapes::{divided, quad};
    use crate::generate::{Kind, build};
    use crate::render::albedo::AlbedoTable;
    use crate::scene::LightKind;
    use crate::settings::Emitters;
    use glam::DVec3;

    /// The warnings for the Cornell box on a square floor with the given side length and height. Each floor triangle is split
    /// `times` times.
    fn warnings_of_floor(side: f64, height: f64, times: u32) -> Vec<String> {
        let mut scene = build(Kind::CornellBox);
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        let corner = DVec3::new(-0.5 * side, height, -0.5 * side);
        let floor = quad(corner, DVec3::Z * side, DVec3::X * side, [1.0; 2]);
        add(&mut scene, "country", grey, divided(floor, times));
        let space = RenderSpace::new(&scene, scene.cameras[0].transform.translation, &Emitters::Scene);
        let geometry = Geometry::new(&scene, &space, &Emitters::Scene, AlbedoTable::shared());
        warnings(&scene, &geometry, &space)
    }

    #[test]
    fn a_floor_that_swallows_the_room_is_named() {
        let found = warnings_of_floor(2e6, -0.01, 0);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains("'country'") && found[0].contains("divide it"), "{found:?}");
        // The size in the warning is sufficient.
        assert_eq!(warnings_of_floor(2e4, -0.01, 0), Vec::<String>::new());
        // A floor far below the room needs no warning.
        assert_eq!(warnings_of_floor(2e6, -1e6, 0), Vec::<String>::new());
    }

    /// A light at the pinhole must not count as a scene of size 0, for which every ray offset is too large.
    #[test]
    fn a_light_at_the_pinhole_changes_nothing() {
        let mut scene = build(Kind::CornellBox);
        let grey = material(&mut scene, diffuse("grey", [0.5; 3]));
        let eye = scene.cameras[0].transform.translation;
        let wall = quad(eye - 2.0 * DVec3::ONE, DVec3::new(4.0, 4.0, 0.0), DVec3::new(0.0, 3.0, 4.0), [1.0; 2]);
        add(&mut scene, "around the eye", grey, wall);
        scene.add_light("headlamp", eye, DVec3::NEG_Z, LightKind::Point { intensity: [1.0; 3] });
        let space = RenderSpace::new(&scene, eye, &Emitters::Scene);
        let geometry = Geometry::new(&scene, &space, &Emitters::Scene, AlbedoTable::shared());
        assert_eq!(warnings(&scene, &geometry, &space), Vec::<String>::new());
    }

    #[test]
    fn a_floor_of_small_triangles_gives_no_warning() {
        assert_eq!(warnings_of_floor(2e6, -0.01, 9).len(), 0);
    }
}
