//! Solids that overlap, touch, or lie inside of each other. A surface of glass does not know the glass on its other side: it counts as
//! the surroundings.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

use glam::Vec3;

use super::{Solid, Solids};

/// Triangles that the search looks at.
const MAX_STEPS: usize = 100_000_000;
/// Corners of a solid that are searched for in others.
const CORNERS: usize = 8;

/// How two solids share space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// The first one is inside of the second one.
    Nested,
    /// A part of one is inside of the other.
    Overlapping,
    /// They have surfaces in one plane.
    Touching,
}

impl Solids {
    /// The pairs of instances that share space. An inner surface of a solid, in a mesh of its own, does not count. `is_like`: whether two
    /// materials have the same index and medium. Pairs may be missing after [`MAX_STEPS`].
    pub fn nested(&self, is_like: impl Fn(u32, u32) -> bool) -> BTreeMap<(u32, u32), Sharing> {
        let mut steps = MAX_STEPS;
        let mut pairs = BTreeMap::new();
        let holes: Vec<&Solid> = self.0.iter().filter(|solid| solid.faces_inwards()).collect();
        for inner in &self.0 {
            let points = inner.some_corners();
            for outer in self.0.iter().filter(|outer| outer.instance != inner.instance && outer.meets(inner)) {
                let work = points.len() * outer.triangles.len();
                let Some(left) = steps.checked_sub(work) else { return pairs };
                steps = left;
                // A point in an inner surface of `outer`, in a mesh of its own, is outside.
                let is_in_hole = |point: Vec3| {
                    holes.iter().any(|hole| {
                        hole.instance != inner.instance
                            && is_like(hole.material, outer.material)
                            && hole.may_contain(point)
                            && hole.solid_angle(point) < -3.0 * PI
                    })
                };
                let is_inside = |point: &&Vec3| {
                    outer.may_contain(**point) && outer.solid_angle(**point) > 3.0 * PI && !is_in_hole(**point)
                };
                let count = points.iter().filter(is_inside).count();
                let is_hole = || inner.faces_inwards() && is_like(inner.material, outer.material);
                let sharing = match count {
                    0 => continue,
                    count if count == points.len() => Sharing::Nested,
                    _ => Sharing::Overlapping,
                };
                if !is_hole() {
                    pairs.insert((inner.instance, outer.instance), sharing);
                }
            }
        }
        pairs
    }

    /// The instances whose boxes meet the box of another solid.
    pub fn close(&self) -> BTreeSet<u32> {
        let others = |solid: &Solid| self.0.iter().any(|o| o.instance != solid.instance && o.meets(solid));
        self.0.iter().filter(|solid| others(solid)).map(|solid| solid.instance).collect()
    }
}

impl Solid {
    fn meets(&self, other: &Solid) -> bool {
        self.lo.cmple(other.hi).all() && other.lo.cmple(self.hi).all()
    }

    /// Corners of evenly chosen triangles.
    fn some_corners(&self) -> Vec<Vec3> {
        let count = self.triangles.len();
        (0..CORNERS.min(count)).map(|k| self.triangles[k * count / CORNERS.min(count)][k % 3]).collect()
    }

    fn faces_inwards(&self) -> bool {
        let volume = |corners: &[Vec3; 3]| {
            let [a, b, c] = corners.map(|corner| (corner - self.lo).as_dvec3());
            a.dot(b.cross(c))
        };
        self.triangles.iter().map(volume).sum::<f64>() < 0.0
    }
}
