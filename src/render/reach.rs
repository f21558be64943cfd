//! Which travel times a path can have at all: exact bounds from boxes alone, so nothing that renders is ever refused.

use glam::Vec3;
use rayon::prelude::*;

use super::geometry::Geometry;
use super::prepared::Prepared;
use crate::gpu::layout::Triangle;
use crate::gpu::layout::constants::EMITTER_TRIANGLE;
use crate::settings::Settings;
use crate::units::Gate;

/// Bounds are widened by this part of themselves: device travel times are sums of rounded f32 terms.
const SLACK: f64 = 1e-5;
/// Punctual emitters that are looked at one by one; of more, their common box.
const MOST_EMITTERS: usize = 64;

/// Bounds on the travel time of every path, metres of optical path.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Reach {
    /// No light arrives before. Infinite where no path exists.
    pub least: f64,
    /// No light arrives at or after: `max_depth` times `segment`.
    pub greatest: f64,
    /// Optical length of the longest possible segment.
    pub segment: f64,
    pub max_depth: u32,
}

#[derive(Debug, Clone, Copy)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
}

impl Reach {
    /// Bounds for paths of at most `settings.max_depth` segments. Every refractive index is at least 1, so optical lengths
    /// are at least Euclidean ones.
    pub fn new(prepared: &Prepared, settings: &Settings) -> Reach {
        let Prepared { geometry, emitters, .. } = prepared;
        let direct = nearest_emissive_triangle(prepared);
        let least = direct.min(shortest_by_one_surface(geometry, &punctual_emitters(prepared)));
        let all = geometry.triangles.par_iter().map(Bounds::of).reduce(|| Bounds::point(Vec3::ZERO), Bounds::with);
        let all = all.with(Bounds { lo: emitters.lo, hi: emitters.hi });
        let diameter = (all.hi.as_dvec3() - all.lo.as_dvec3()).length();
        let segment = diameter * f64::from(geometry.greatest_ior) * (1.0 + SLACK);
        let greatest = f64::from(settings.max_depth) * segment;
        Reach { least: least * (1.0 - SLACK), greatest, segment, max_depth: settings.max_depth }
    }

    /// Can any light fall inside the gate, as far as these bounds tell?
    pub fn meets(&self, gate: &Gate) -> bool {
        gate.hi > self.least && gate.lo < self.greatest
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

/// The sensor may see these directly. It is the origin.
fn nearest_emissive_triangle(prepared: &Prepared) -> f64 {
    let sensor = Bounds::point(Vec3::ZERO);
    let triangles = prepared.emitters.table.iter().filter(|e| e.kind == EMITTER_TRIANGLE);
    let distances = triangles.map(|e| Bounds::of(&prepared.geometry.triangles[e.triangle as usize]).distance(&sensor));
    distances.fold(f64::INFINITY, f64::min)
}

/// Points, spots and beams.
fn punctual_emitters(prepared: &Prepared) -> Vec<Bounds> {
    let punctual = prepared.emitters.table.iter().filter(|e| e.kind != EMITTER_TRIANGLE);
    let boxes: Vec<Bounds> = punctual
        .map(|e| {
            // `outer` is the radius of a beam and the cosine of a spot: too large a box is still a bound.
            let (p, radius) = (Vec3::from(e.position), e.outer.max(0.0));
            Bounds { lo: p - radius, hi: p + radius }
        })
        .collect();
    match boxes.len() {
        0..=MOST_EMITTERS => boxes,
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
