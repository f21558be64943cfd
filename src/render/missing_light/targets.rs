//! Smooth objects that light rays are sent to.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use crate::render::geometry::Geometry;

/// The fractional part of the golden ratio. Its multiples are evenly spread on a line.
pub const GOLDEN: f64 = 0.618_033_988_749_895;
/// Multiples of these two numbers are evenly spread on a square (the sequence R2).
pub const ON_SQUARE: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// The smooth triangles of one instance: of solids and mirrors, or of thin glass.
pub struct Target {
    /// Indices in [`Geometry::triangles`], and the area of all triangles up to each.
    triangles: Vec<(usize, f64)>,
    lo: Vec3,
    hi: Vec3,
}

/// A point on a smooth triangle.
pub struct Place {
    pub triangle: usize,
    pub position: DVec3,
    /// Unit normal, on either side.
    pub normal: DVec3,
}

/// All smooth objects, and smooth thin glass.
pub fn targets(geometry: &Geometry) -> Vec<Target> {
    let mut targets: BTreeMap<u32, Target> = BTreeMap::new();
    for (number, t) in
        geometry.triangles.iter().enumerate().filter(|(_, t)| geometry.is_smooth(t) || geometry.is_smooth_sheet(t))
    {
        let empty = || Target { triangles: vec![], lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY };
        let target = targets.entry(t.instance).or_insert_with(empty);
        let [a, b, c] = [t.v0, t.v1, t.v2].map(Vec3::from);
        (target.lo, target.hi) = (target.lo.min(a).min(b).min(c), target.hi.max(a).max(b).max(c));
        let area = 0.5 * (b - a).as_dvec3().cross((c - a).as_dvec3()).length();
        target.triangles.push((number, target.area() + area));
    }
    targets.into_values().collect()
}

impl Target {
    /// Area of all triangles.
    pub fn area(&self) -> f64 {
        self.triangles.last().map_or(0.0, |(_, area)| *area)
    }

    /// Size of the object as seen from `point`, in radians; approximate.
    pub fn size_from(&self, point: DVec3) -> f64 {
        let centre = 0.5 * (self.lo + self.hi).as_dvec3();
        0.5 * f64::from(self.hi.distance(self.lo)) / centre.distance(point).max(1e-9)
    }

    /// Point `number` of `count` evenly spread points on the triangles. `None` if they have no area.
    pub fn place(&self, geometry: &Geometry, number: u32, count: u32) -> Option<Place> {
        let wanted = (f64::from(number) + 0.5) / f64::from(count) * self.area();
        let index = self.triangles.partition_point(|(_, area)| *area < wanted).min(self.triangles.len() - 1);
        let triangle = self.triangles[index].0;
        let t = &geometry.triangles[triangle];
        let [a, b, c] = [t.v0, t.v1, t.v2].map(|corner| Vec3::from(corner).as_dvec3());
        let [u, v] = ON_SQUARE.map(|step| (f64::from(number) * step).fract());
        let root = u.sqrt();
        let position = a + root * (1.0 - v) * (b - a) + root * v * (c - a);
        Some(Place { triangle, position, normal: (b - a).cross(c - a).try_normalize()? })
    }
}
