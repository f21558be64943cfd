//! Paths that follow smooth surfaces: from the camera or a lamp over perfect reflections and refractions to the surfaces and media that
//! scatter.

use glam::{DVec3, Vec3};

pub use super::surfaces::AtSheets;
use super::surfaces::{Hit, Lobes, lobes, nearest, refracted};
use crate::render::emitters::luminance;
use crate::render::geometry::Geometry;
use crate::render::media::Media;
use crate::wgsl::layout::constants::{TRIANGLE_MATERIAL, TRIANGLE_SHEET};
use crate::wgsl::layout::{Medium, NONE};

/// Maximum number of smooth surfaces on a path.
const MAX_SMOOTH: u32 = 8;
/// A path ends when it carries less than this share of its light.
const MIN_SHARE: f64 = 0.01;
/// The same where thin glass reflects, because it reflects little.
const MIN_REFLECTED: f64 = 1e-3;
/// Maximum number of sheets of thin glass that a path passes.
const MAX_SHEETS: u32 = 16;
/// Events that are placed on a segment in a medium that scatters.
const MEDIUM_EVENTS: u32 = 4;

/// A ray under way, in render space.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// The triangle that the ray leaves.
    pub leaves: Option<usize>,
    /// Share of the light.
    pub weight: f64,
    /// Optical and geometric length of the path so far.
    pub tau: f64,
    pub length: f64,
    /// Number of smooth surfaces so far, and the instance of the first one.
    pub smooth: u32,
    pub object: Option<u32>,
    /// Whether the first of them is thin glass, which has reflected the path.
    pub is_by_sheet: bool,
    /// Number of sheets of thin glass that the path has passed.
    pub passed_sheets: u32,
    /// Index in `Geometry::materials` of the solid around the ray, or NONE.
    pub solid: u32,
}

impl Ray {
    /// A ray that begins at a lamp or at the camera, and carries all of its light. `solid`: see [`Ray::solid`].
    pub fn start(origin: DVec3, direction: DVec3, solid: u32) -> Ray {
        Ray {
            origin,
            direction,
            leaves: None,
            weight: 1.0,
            tau: 0.0,
            length: 0.0,
            smooth: 0,
            object: None,
            is_by_sheet: false,
            passed_sheets: 0,
            solid,
        }
    }
}

/// A place where the light of a path scatters: at the end of `path`.
#[derive(Clone, Copy)]
pub struct Event {
    /// The path up to the event: `origin` is the place, `weight` contains the scattering.
    pub path: Ray,
    /// The weight without the scattering.
    pub arriving: f64,
    /// Unit normal on the side of the path; `None` in a medium.
    pub normal: Option<DVec3>,
}

/// The way from an event to a lamp.
pub struct Line {
    /// Number of smooth surfaces in between.
    pub smooth: u32,
    /// Share of the light that passes them.
    pub share: f64,
    /// Optical length.
    pub tau: f64,
    /// Instance of the first smooth surface.
    pub object: Option<u32>,
    /// Whether the smooth surface next to the lamp is thin glass, which has reflected the light.
    pub is_by_sheet: bool,
}

/// The scene for these paths.
pub struct World<'a> {
    pub geometry: &'a Geometry,
    pub media: &'a Media,
    /// What rays of [`World::walk`] do at smooth thin glass. If they stop, they divide into what passes and what is reflected.
    pub sheets: AtSheets,
}

impl World<'_> {
    /// Calls `visit` with all events of the paths that begin with `ray`. At each smooth surface, a path divides into its reflection and
    /// its refraction.
    pub fn walk(&self, ray: Ray, visit: &mut impl FnMut(Event)) {
        let World { geometry, .. } = *self;
        let least = ray.weight * if self.sheets == AtSheets::Stop { MIN_REFLECTED } else { MIN_SHARE };
        let mut open = vec![ray];
        while let Some(mut ray) = open.pop() {
            let hit = nearest(geometry, ray.origin, ray.direction, f64::INFINITY, ray.leaves, self.sheets);
            ray.weight *= self.scatter_in_media(&ray, hit.as_ref().map(|hit| hit.distance), visit);
            let Some(hit) = hit else { continue };
            let lobes = lobes(geometry, &hit, ray.direction);
            let triangle = &geometry.triangles[hit.triangle];
            let end = Ray { leaves: Some(hit.triangle), ..self.moved(&ray, hit.distance) };
            let is_sheet = triangle.material & TRIANGLE_SHEET != 0;
            if is_sheet && ray.passed_sheets < MAX_SHEETS {
                let passed = ray.weight * lobes.refracted;
                open.push(Ray { weight: passed, passed_sheets: ray.passed_sheets + 1, ..end });
            }
            if lobes.rough * ray.weight >= least {
                let path = Ray { weight: ray.weight * lobes.rough, ..end };
                visit(Event { path, arriving: ray.weight, normal: Some(hit.normal) });
            }
            if ray.smooth < MAX_SMOOTH {
                let mirrored = self.mirrored(&ray, &hit, &lobes);
                open.push(mirrored);
                if let Some(direction) = refracted(ray.direction, hit.normal, lobes.eta).filter(|_| !is_sheet) {
                    let solid = if hit.is_front { triangle.material & TRIANGLE_MATERIAL } else { NONE };
                    open.push(Ray { direction, weight: ray.weight * lobes.refracted, solid, ..mirrored });
                }
            }
            open.retain(|ray| ray.weight >= least);
        }
    }

    /// The perfect reflection of `ray` at `hit`.
    pub fn mirrored(&self, ray: &Ray, hit: &Hit, lobes: &Lobes) -> Ray {
        let triangle = &self.geometry.triangles[hit.triangle];
        let direction = ray.direction - 2.0 * ray.direction.dot(hit.normal) * hit.normal;
        Ray {
            direction: direction.normalize(),
            leaves: Some(hit.triangle),
            weight: ray.weight * lobes.mirrored,
            smooth: ray.smooth + 1,
            object: ray.object.or(Some(triangle.instance)),
            is_by_sheet: ray.is_by_sheet || (ray.smooth == 0 && triangle.material & TRIANGLE_SHEET != 0),
            ..self.moved(ray, hit.distance)
        }
    }

    /// The straight line from `event` along `direction` to a lamp at `distance`. `None` if a surface blocks it, or if smooth surfaces
    /// bend it: two of them that are not parallel.
    pub fn line(&self, event: &Event, direction: DVec3, distance: f64) -> Option<Line> {
        let World { geometry, .. } = *self;
        if event.normal.is_some_and(|normal| normal.dot(direction) <= 0.0) {
            return None;
        }
        let mut ray = Ray { direction, weight: 1.0, tau: 0.0, smooth: 0, object: None, ..event.path };
        let (mut left, mut first, mut entered) = (distance, None::<DVec3>, None);
        while let Some(hit) = nearest(geometry, ray.origin, direction, left, ray.leaves, AtSheets::Pass) {
            let is_bent = first.is_some_and(|normal| normal.dot(hit.normal).abs() < 0.999);
            // The ray leaves a pane at the angle at which it has entered it, so as much light passes.
            let share = match entered.filter(|_| !hit.is_front) {
                Some(share) => share,
                None => lobes(geometry, &hit, direction).refracted,
            };
            if share <= 0.0 || is_bent || ray.smooth >= MAX_SMOOTH {
                return None;
            }
            entered = hit.is_front.then_some(share);
            let triangle = &geometry.triangles[hit.triangle];
            let solid = if hit.is_front { triangle.material & TRIANGLE_MATERIAL } else { NONE };
            ray = Ray {
                leaves: Some(hit.triangle),
                weight: ray.weight * share,
                smooth: ray.smooth + 1,
                object: ray.object.or(Some(triangle.instance)),
                solid,
                ..self.moved(&ray, hit.distance)
            };
            left -= hit.distance;
            first = first.or(Some(hit.normal));
        }
        let rest = if left.is_finite() { left * self.eta(ray.solid) } else { 0.0 };
        let Ray { smooth, weight: share, tau, object, .. } = ray;
        Some(Line { smooth, share, tau: tau + rest, object, is_by_sheet: false })
    }

    /// Travel time per length inside a solid of this material; NONE outside of solids.
    fn eta(&self, solid: u32) -> f64 {
        self.geometry.around(solid, self.media.surrounding[1]).0.into()
    }

    /// The ray after `distance`.
    fn moved(&self, ray: &Ray, distance: f64) -> Ray {
        let origin = ray.origin + distance * ray.direction;
        Ray { origin, tau: ray.tau + distance * self.eta(ray.solid), length: ray.length + distance, ..*ray }
    }

    /// Visits events in the media along `ray`, which ends after `distance`. Returns the share of light that passes. A density grid
    /// counts as if it were full.
    fn scatter_in_media(&self, ray: &Ray, distance: Option<f64>, visit: &mut impl FnMut(Event)) -> f64 {
        let World { geometry, media, .. } = *self;
        if media.list.is_empty() {
            return 1.0;
        }
        let inside = geometry.materials.get(ray.solid as usize).map(|material| material.interior);
        let mut passed = 1.0;
        let candidates: Vec<&Medium> = match inside {
            Some(interior) => media.list.get(interior as usize).into_iter().collect(),
            None => media.list[..media.outside].iter().collect(),
        };
        for medium in candidates {
            let Some([start, end]) = overlap(ray, distance.unwrap_or(f64::INFINITY), medium, inside.is_some()) else {
                continue;
            };
            let (scattering, absorption) = (luminance(medium.sigma_s), luminance(medium.sigma_a));
            let extinction = scattering + absorption;
            if extinction <= 0.0 {
                continue;
            }
            let depth = (extinction * (end - start)).min(30.0);
            let stopped = 1.0 - (-depth).exp();
            let share = passed * stopped * scattering / extinction / f64::from(MEDIUM_EVENTS);
            if share > 0.0 {
                for k in 0..MEDIUM_EVENTS {
                    let u = (f64::from(k) + 0.5) / f64::from(MEDIUM_EVENTS);
                    let at = start - (1.0 - u * stopped).ln() / extinction;
                    let path = Ray { leaves: None, weight: ray.weight * share, ..self.moved(ray, at) };
                    visit(Event { path, arriving: ray.weight * passed, normal: None });
                }
            }
            passed *= 1.0 - stopped;
        }
        passed
    }
}

/// Where `ray`, which ends after `distance`, is in the medium: two distances. `is_interior`: the medium fills a solid around the ray.
fn overlap(ray: &Ray, distance: f64, medium: &Medium, is_interior: bool) -> Option<[f64; 2]> {
    if is_interior {
        return distance.is_finite().then_some([0.0, distance]);
    }
    let [lo, hi] = [medium.lo, medium.hi].map(|corner| Vec3::from(corner).as_dvec3());
    let [a, b] = [lo, hi].map(|corner| (corner - ray.origin) / ray.direction);
    let (start, end) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(distance));
    (start < end).then_some([start, end])
}
