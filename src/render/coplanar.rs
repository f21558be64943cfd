//! Warnings about lamps that lie in the plane of another surface or lamp. Where the two overlap, rounding decides which one a
//! ray hits. If both are lamps, a ray hits only one of them, but emitter sampling counts the light of both.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3, Vec3};
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;

use super::geometry::Geometry;
use super::space::RenderSpace;
use crate::scene::Scene;
use crate::wgsl::layout::Triangle;
use crate::wgsl::layout::constants::TRIANGLE_MATERIAL;

/// Two planes at most this far apart, relative to the coordinates, count as one plane: rounding hides the distance.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;
/// Triangles that overlap by at most this much, relative to the coordinates, only share an edge.
const TOUCHING: f64 = 64.0 * ROUNDING;
/// Maximum number of warnings about pairs.
const MAX_REPORTED: usize = 10;
/// Number of triangles that the triangles of all lamps together are compared with. The scenes of the benches need at most 132. Without a
/// limit, 40,000 triangles of overlapping lamps take half a minute of processor time.
const MAX_COMPARED: usize = 20_000_000;
/// Distance that separates a lamp from a surface in all cases, relative to the size of the scene.
const APART: f64 = 1e-4;

/// Returns one warning, with the remedy, per pair of nodes: a lamp, and another surface or lamp that overlaps it in the same
/// plane. The warnings are sorted. After [`MAX_REPORTED`] of them, a last sentence gives the number of the other pairs.
/// Triangles that only share edges or corners do not overlap. Pairs may be missing if that takes more than [`MAX_COMPARED`] comparisons.
pub fn warnings(scene: &Scene, geometry: &Geometry, space: &RenderSpace) -> Vec<String> {
    let emits = |t: &Triangle| geometry.materials[(t.material & TRIANGLE_MATERIAL) as usize].emission != [0.0; 3];
    // Instance of the lamp, instance of the other surface, whether the other surface is a lamp too. Two lamps are ordered by
    // instance, so that their pair is listed once.
    let lamps: Vec<&Triangle> = geometry.triangles.par_iter().filter(|t| emits(t)).collect();
    let limit = MAX_COMPARED / lamps.len().max(1);
    let pairs: BTreeSet<(u32, u32, bool)> = lamps
        .into_par_iter()
        .map(|t| (t, PlanarTriangle::new(t)))
        .filter(|(_, lamp)| lamp.normal != DVec3::ZERO)
        .flat_map_iter(|(t, lamp)| {
            let mut found = BTreeSet::new();
            near(geometry, &lamp, limit, |other| {
                let pair = match emits(other) {
                    true => (t.instance.min(other.instance), t.instance.max(other.instance), true),
                    false => (t.instance, other.instance, false),
                };
                if !std::ptr::eq(t, other) && !found.contains(&pair) && overlap(&lamp, &PlanarTriangle::new(other)) {
                    found.insert(pair);
                }
            });
            found
        })
        .collect();
    let node = |instance: u32| scene.instances[instance as usize].node.as_str();
    let named: BTreeSet<(&str, &str, bool)> =
        pairs.into_iter().map(|(lamp, other, both_emit)| (node(lamp), node(other), both_emit)).collect();
    let distance = APART * space.unit;
    let mut all: Vec<String> = named.iter().take(MAX_REPORTED).map(|&pair| sentence(pair, distance)).collect();
    if named.len() > MAX_REPORTED {
        all.push(format!(
            "and {} more pairs of a lamp and another surface overlap in one plane",
            named.len() - MAX_REPORTED
        ));
    }
    all
}

/// The pairs of instances, the lower number first, that have triangles in one plane which overlap. Only the triangles that `counts` selects
/// are compared. Pairs may be missing if that takes more than [`MAX_COMPARED`] comparisons.
pub fn instances_in_one_plane(geometry: &Geometry, counts: impl Fn(&Triangle) -> bool + Sync) -> BTreeSet<(u32, u32)> {
    let all: Vec<&Triangle> = geometry.triangles.par_iter().filter(|t| counts(t)).collect();
    let limit = MAX_COMPARED / all.len().max(1);
    let pairs = all.into_par_iter().map(|t| (t, PlanarTriangle::new(t))).filter(|(_, t)| t.normal != DVec3::ZERO);
    let found = pairs.flat_map_iter(|(t, plane)| {
        let mut found = BTreeSet::new();
        near(geometry, &plane, limit, |other| {
            let pair = (t.instance.min(other.instance), t.instance.max(other.instance));
            let is_pair = t.instance != other.instance && counts(other);
            if is_pair && !found.contains(&pair) && overlap(&plane, &PlanarTriangle::new(other)) {
                found.insert(pair);
            }
        });
        found
    });
    found.collect()
}

/// `distance`: a sufficient distance between the two surfaces in metres.
fn sentence((lamp, other, both_emit): (&str, &str, bool), distance: f64) -> String {
    match (both_emit, lamp == other) {
        (false, own) => {
            let surface = if own { "another of its own surfaces".to_string() } else { format!("'{other}'") };
            format!(
                "the lamp '{lamp}' lies in the plane of {surface}: a ray hits either of them by chance, so the image of the lamp is \
                 speckled; move the lamp at least {distance:.0e} m in front of the other surface"
            )
        }
        (true, true) => format!(
            "the lamp '{lamp}' has surfaces that overlap in one plane: a ray hits only one of them, but both light the scene, so \
             the estimators disagree; remove one, or move one at least {distance:.0e} m away"
        ),
        (true, false) => format!(
            "the lamps '{lamp}' and '{other}' overlap in one plane: a ray hits only one of them, but both light the scene, so \
             the estimators disagree; remove one, or move one at least {distance:.0e} m away"
        ),
    }
}

/// A triangle with its plane.
struct PlanarTriangle {
    corners: [DVec3; 3],
    /// Unit normal; 0 for a triangle without area.
    normal: DVec3,
    /// Maximum absolute coordinate of the corners.
    size: f64,
}

impl PlanarTriangle {
    fn new(t: &Triangle) -> PlanarTriangle {
        let corners = [t.v0, t.v1, t.v2].map(|p| Vec3::from(p).as_dvec3());
        let [a, b, c] = corners;
        let size = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        PlanarTriangle { corners, normal: (b - a).cross(c - a).normalize_or_zero(), size }
    }

    /// Whether all corners of `other` lie at most `rounding` from this plane.
    fn holds(&self, other: &PlanarTriangle, rounding: f64) -> bool {
        self.normal != DVec3::ZERO
            && other.corners.iter().all(|&p| (p - self.corners[0]).dot(self.normal).abs() <= rounding)
    }
}

/// Whether two triangles lie in one plane and share more than an edge. Far from a small triangle, its plane is not accurate, so
/// it suffices that one triangle lies in the plane of the other.
fn overlap(a: &PlanarTriangle, b: &PlanarTriangle) -> bool {
    let size = a.size.max(b.size);
    let plane = if b.holds(a, ROUNDING * size) {
        b.normal
    } else if a.holds(b, ROUNDING * size) {
        a.normal
    } else {
        return false;
    };
    let x = plane.any_orthonormal_vector();
    let y = plane.cross(x);
    let flat = |t: &PlanarTriangle| t.corners.map(|p| DVec2::new(x.dot(p - a.corners[0]), y.dot(p - a.corners[0])));
    let (a, b) = (flat(a), flat(b));
    // Separating axis test: two convex polygons are disjoint if their projections on the normal of some edge are disjoint.
    let apart_along = |normal: DVec2| {
        let span = |t: &[DVec2; 3]| {
            let d = t.map(|p| p.dot(normal));
            (d[0].min(d[1]).min(d[2]), d[0].max(d[1]).max(d[2]))
        };
        let ((a0, a1), (b0, b1)) = (span(&a), span(&b));
        a1.min(b1) - a0.max(b0) <= TOUCHING * size
    };
    let edges = [a, b].into_iter().flat_map(|t| [t[1] - t[0], t[2] - t[1], t[0] - t[2]]);
    !edges.map(|e| e.perp().normalize_or_zero()).any(apart_along)
}

/// Calls `visit` with the triangles of every leaf whose box meets the plane of `lamp` inside the box of `lamp`, until it was called about
/// `limit` times.
fn near<'g>(geometry: &'g Geometry, lamp: &PlanarTriangle, limit: usize, mut visit: impl FnMut(&'g Triangle)) {
    let slack = 4.0 * ROUNDING * lamp.size;
    let low = lamp.corners.into_iter().reduce(DVec3::min).expect("three corners") - slack;
    let high = lamp.corners.into_iter().reduce(DVec3::max).expect("three corners") + slack;
    let overlaps = |node: &CwBvhNode, child: usize| {
        let bounds = node.child_aabb(child);
        let (min, max) = (low.max(bounds.min.as_dvec3()), high.min(bounds.max.as_dvec3()));
        let half = 0.5 * (max - min);
        let distance = (0.5 * (min + max) - lamp.corners[0]).dot(lamp.normal).abs();
        min.cmple(max).all() && distance <= half.dot(lamp.normal.abs()) + slack
    };
    let nodes = &geometry.bvh.host.nodes;
    let mut open: Vec<usize> = if nodes.is_empty() { vec![] } else { vec![0] };
    let mut visited = 0;
    while visited <= limit
        && let Some(i) = open.pop()
    {
        let node = &nodes[i];
        for child in (0..8).filter(|&c| !node.is_child_empty(c)).filter(|&c| overlaps(node, c)) {
            if node.is_leaf(child) {
                let (first, count) = node.child_primitives(child);
                geometry.triangles[first as usize..(first + count) as usize].iter().for_each(&mut visit);
                visited += count as usize;
            } else {
                open.push(node.child_node_index(child) as usize);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::parts::{about, add, camera, emitter, material};
    use crate::generate::shapes::{append, inside_out, quad};
    use crate::generate::{Kind, build};
    use crate::render::albedo::AlbedoTable;
    use crate::scene::Mesh;
    use crate::settings::Emitters;
    use glam::DAffine3;

    /// The warnings for a scene whose origin of render space is `origin`.
    fn warnings_of(scene: &Scene, origin: DVec3, emitters: &Emitters) -> Vec<String> {
        let space = RenderSpace::new(scene, origin, emitters);
        let geometry = Geometry::new(scene, &space, emitters, AlbedoTable::shared());
        warnings(scene, &geometry, &space)
    }

    /// The warnings for a Cornell box whose lamp is at `height` and moved sideways by `aside`. The whole scene is rotated and
    /// scaled.
    fn warnings_of_box(height: f64, aside: f64, scale: f64, emitters: &Emitters) -> Vec<String> {
        let mut scene = build(Kind::CornellBox);
        let turn = DAffine3::from_mat3(scale * about(DVec3::new(0.48, 0.6, 0.64), 0.7));
        for i in &mut scene.instances {
            if i.node == "light" {
                i.transform = DAffine3::from_translation(DVec3::new(aside, height - 1.99, 0.0));
            }
            i.transform = turn * i.transform;
        }
        let origin = turn.transform_point3(scene.cameras[0].transform.translation);
        warnings_of(&scene, origin, emitters)
    }

    #[test]
    fn a_lamp_in_the_plane_of_the_ceiling_is_named() {
        for scale in [1e-3, 1.0, 1e4] {
            let found = warnings_of_box(2.0, 0.0, scale, &Emitters::Scene);
            assert_eq!(found.len(), 1, "{scale}: {found:?}");
            assert!(found[0].contains("'light'") && found[0].contains("'ceiling'") && found[0].contains("in front"));
            // The distance in the warning is sufficient, and so is the lamp's usual height of 1.99 m.
            for height in [2.0 - 1e-4, 2.0 + 1e-4, 1.99] {
                assert_eq!(
                    warnings_of_box(height, 0.0, scale, &Emitters::Scene),
                    Vec::<String>::new(),
                    "{scale} {height}"
                );
            }
        }
    }

    /// The warnings for two lamps of the same size, `aside` apart in the plane and `height` apart along its normal. The second
    /// lamp faces the other way if `turned`.
    fn warnings_of_two_lamps(double_sided: bool, turned: bool, aside: f64, height: f64) -> Vec<String> {
        let mut scene = Scene::default();
        let lamp = emitter("lamp", [1.0; 3]);
        let lamp = material(&mut scene, crate::scene::Material { double_sided, ..lamp });
        let first = quad(DVec3::Y, DVec3::X, DVec3::Z, [1.0; 2]);
        let second = quad(DVec3::new(aside, 1.0 + height, 0.0), DVec3::X, DVec3::Z, [1.0; 2]);
        add(&mut scene, "first", lamp, first);
        add(&mut scene, "second", lamp, if turned { inside_out(second) } else { second });
        camera(&mut scene, DVec3::ZERO, DVec3::Y, 1.0, [8, 8]);
        warnings_of(&scene, DVec3::ZERO, &Emitters::Scene)
    }

    #[test]
    fn lamps_that_overlap_in_one_plane_are_named_once() {
        for (double_sided, turned, aside) in
            [(true, true, 0.0), (true, false, 0.5), (true, true, 0.5), (false, true, 0.0), (false, false, 0.5)]
        {
            let found = warnings_of_two_lamps(double_sided, turned, aside, 0.0);
            assert_eq!(found.len(), 1, "{double_sided} {turned} {aside}: {found:?}");
            assert!(found[0].contains("'first'") && found[0].contains("'second'") && found[0].contains("move one"));
            for (aside, height) in [(1.0, 0.0), (aside, 1e-3)] {
                assert_eq!(warnings_of_two_lamps(double_sided, turned, aside, height), Vec::<String>::new());
            }
        }
        // A copy with the same orientation is dropped before, so no pair is left.
        assert_eq!(warnings_of_two_lamps(true, false, 0.0, 0.0), Vec::<String>::new());
    }

    /// Every lamp overlaps every other one, but a lamp is compared with few of them.
    #[test]
    fn a_crowd_of_lamps_in_one_plane_is_found_soon() {
        let mut crowd = Mesh::default();
        for k in 0..20_000 {
            let lamp = quad(DVec3::Y, DVec3::X, DVec3::Z, [1.0; 2]);
            append(&mut crowd, &lamp, DAffine3::from_scale(DVec3::new(1.0 + 1e-4 * f64::from(k), 1.0, 1.0)));
        }
        let mut scene = Scene::default();
        let lamp = material(&mut scene, emitter("lamp", [1.0; 3]));
        add(&mut scene, "crowd", lamp, crowd);
        camera(&mut scene, DVec3::ZERO, DVec3::Y, 1.0, [8, 8]);
        let found = warnings_of(&scene, DVec3::ZERO, &Emitters::Scene);
        assert!(found.len() == 1 && found[0].contains("'crowd' has surfaces that overlap"), "{found:?}");

        // The work: a lamp is compared with about `limit` triangles, although it overlaps all 40,000.
        let space = RenderSpace::new(&scene, DVec3::ZERO, &Emitters::Scene);
        let geometry = Geometry::new(&scene, &space, &Emitters::Scene, AlbedoTable::shared());
        let lamp = PlanarTriangle::new(&geometry.triangles[0]);
        let compared = |limit: usize| {
            let mut count = 0;
            near(&geometry, &lamp, limit, |_| count += 1);
            count
        };
        let limit = MAX_COMPARED / geometry.triangles.len();
        assert!((limit..=limit + 100).contains(&compared(limit)), "{} instead of {limit}", compared(limit));
        assert!(compared(usize::MAX) >= 20_000, "without a limit: {}", compared(usize::MAX));
    }

    #[test]
    fn of_many_lamps_ten_are_named() {
        let mut scene = build(Kind::CornellBox);
        let lamp = scene.instances.iter().position(|i| i.node == "light").expect("the box has a lamp");
        for k in 0..14 {
            let mut another = scene.instances[lamp].clone();
            another.node = format!("lamp {k:02}");
            another.transform = DAffine3::from_translation(DVec3::new(0.02 * f64::from(k), 2.0 - 1.99, 0.0));
            scene.instances.push(another);
        }
        // Each of the 14 lamps overlaps the ceiling, and every pair of lamps overlaps: 14 + 91 = 105 pairs.
        let found = warnings_of(&scene, scene.cameras[0].transform.translation, &Emitters::Scene);
        assert_eq!(
            (found.len(), found.last().unwrap().as_str()),
            (11, "and 95 more pairs of a lamp and another surface overlap in one plane")
        );
    }

    #[test]
    fn a_lamp_beside_the_ceiling_or_switched_off_is_not() {
        assert_eq!(warnings_of_box(2.0, 5.0, 1.0, &Emitters::Scene), Vec::<String>::new());
        assert_eq!(warnings_of_box(2.0, 0.0, 1.0, &Emitters::Nodes(vec!["another".into()])), Vec::<String>::new());
    }

    #[test]
    fn triangles_in_a_plane() {
        let flat = |c: [[f32; 3]; 3]| {
            PlanarTriangle::new(&Triangle { v0: c[0], v1: c[1], v2: c[2], ..bytemuck::Zeroable::zeroed() })
        };
        let a = flat([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]);
        let other_half = flat([[1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]);
        let inside = flat([[0.1, 0.1, 1.0], [0.2, 0.1, 1.0], [0.1, 0.2, 1.0]]);
        let across = flat([[0.2, 0.2, 0.0], [0.2, 0.3, 2.0], [0.3, 0.2, 2.0]]);
        let line = flat([[0.1, 0.1, 1.0], [0.2, 0.2, 1.0], [0.3, 0.3, 1.0]]);
        assert!(overlap(&a, &a) && overlap(&a, &inside) && overlap(&inside, &a));
        assert!(!overlap(&a, &other_half) && !overlap(&a, &across) && !overlap(&inside, &other_half));
        assert!(!overlap(&a, &line));
    }
}
