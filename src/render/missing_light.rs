//! Light that no strategy of a render forms: a warning with the share of the pixels.
//!
//! Write S for a smooth event (perfect reflection or refraction) and D for any other. A connection needs two neighbours of kind D on the
//! path; lamps without a surface and the camera count as D, but no ray can hit them. So the path lamp, S, D, S, camera is formed by no
//! strategy. Paths of beams are worse off, because no surface connects to a beam. The host looks for such paths: it follows camera rays
//! over smooth surfaces to the first D, and looks from there for the lamp, straight through panes and with light rays from the lamps.

mod found;
mod lamps;
mod message;
mod surfaces;
mod targets;
pub mod walk;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use rayon::prelude::*;

use super::photons;
use super::prepared_scene::PreparedScene;
use crate::scene::{Projection, Scene};
use crate::settings::units::Gate;
use crate::settings::{Merge, Settings, Strategies};
use found::{Contribution, Found, Pixel};
use lamps::{Lamp, lamps};
pub use message::MissingLight;
use surfaces::{AtSheets, hit_at, lobes, nearest};
pub use targets::ON_SQUARE;
use targets::{Target, targets};
use walk::{Event, Line, Ray, World};

/// Camera rays along each side of the crop.
const SIDE: u32 = 48;
/// Light rays of all lamps, and the minimum for each pair of a lamp and a smooth object.
const LIGHT_RAYS: u32 = 8192;
const MIN_LIGHT_RAYS: u32 = 64;
/// Smooth objects that light rays are sent to, the largest as seen from the lamp.
const MAX_TARGETS: usize = 32;
/// Events per pixel for which light rays are searched, those of the largest weight.
const MAX_EVENTS: usize = 4;
/// Light that is collected around an event: the largest distance relative to the length of the camera's path, the number of light rays,
/// and the least number.
const REACH: f64 = 0.3;
const GATHERED: usize = 8;
const MIN_FOUND: usize = 3;

/// As [`missing_light`], whatever the gate.
pub fn missing_light_at_any_time(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Option<MissingLight> {
    let open = settings.change().gate(Gate::OPEN).build().ok()?;
    missing_light(scene, &open, prepared)
}

/// A light ray that has scattered at an event, and its lamp.
struct Photon {
    event: Event,
    lamp: usize,
}

/// Looks for light inside the gate that no strategy of a render with these settings forms. The result is the same in each call. `None` if
/// all lamps have surfaces, if nothing is smooth, or if no pixel is affected. `prepared` is the prepared `scene`; lamps and camera may have
/// moved since.
pub fn missing_light(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Option<MissingLight> {
    let search = Search::new(scene, settings, prepared)?;
    search.run(scene, settings, prepared)?.summary(scene, &search)
}

/// The light that only merging finds, at any time: travel times in metres, and luminance averaged over the pixels of the crop.
/// Empty if the render does not merge. An estimate.
pub fn merged_light(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Vec<(f64, f64)> {
    let open = settings.change().gate(Gate::OPEN).build().ok();
    let search = open.filter(|_| photons::merges(scene, settings, prepared));
    let search = search.and_then(|open| Search::new(scene, &open, prepared));
    let found = search.and_then(|search| search.run(scene, settings, prepared));
    found.map_or(vec![], |found| {
        let share = 1.0 / (PI * found.pixels.len() as f64);
        found.merged.into_iter().map(|(tau, light)| (tau, light * share)).collect()
    })
}

impl Search<'_> {
    /// Looks at camera rays of the crop. `None` if none of them could miss light.
    fn run(&self, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Option<Found> {
        let mut found = Found::new(self.lamps.len());
        let rays = camera_rays(scene, settings, prepared);
        let events: Vec<Vec<Event>> = rays
            .par_iter()
            .map(|ray| {
                let mut events = vec![];
                self.world.walk(*ray, &mut |event| events.push(event));
                events
            })
            .collect();
        let is_candidate = |event: &Event| event.path.smooth > 0 || !self.connects_camera;
        if !events.iter().flatten().any(is_candidate) {
            return None;
        }

        // Light that comes straight from the lamps, also through panes.
        found.pixels = vec![Pixel::default(); rays.len()];
        let straight: Vec<Vec<Contribution>> =
            events.par_iter().map(|events| events.iter().flat_map(|event| self.straight(event)).collect()).collect();
        for (number, contributions) in straight.into_iter().enumerate() {
            contributions.into_iter().for_each(|contribution| found.add(number, contribution));
        }

        // Light over mirrors and bent glass.
        let open: Vec<usize> = (0..rays.len())
            .filter(|&number| events[number].iter().any(is_candidate))
            .filter(|&number| !found.pixels[number].is_affected(0.0) && !found.pixels[number].is_merged)
            .collect();
        if !open.is_empty() {
            let photons = self.photons();
            let gather = |&number: &usize| {
                let on_surface = |event: &&Event| is_candidate(event) && event.normal.is_some();
                let mut events: Vec<&Event> = events[number].iter().filter(on_surface).collect();
                events.sort_by(|a, b| b.path.weight.total_cmp(&a.path.weight));
                let events = events.into_iter().take(MAX_EVENTS);
                (number, events.flat_map(|event| self.gather(event, &photons)).collect())
            };
            let gathered: Vec<(usize, Vec<Contribution>)> = open.par_iter().map(gather).collect();
            for (number, contributions) in gathered {
                contributions.into_iter().for_each(|contribution| found.add(number, contribution));
            }
        }
        Some(found)
    }
}

struct Search<'a> {
    world: World<'a>,
    lamps: Vec<Lamp<'a>>,
    targets: Vec<Target>,
    /// Whether light subpaths are connected to the camera (t = 1), and whether those of other estimators would be.
    connects_camera: bool,
    /// Whether there are light subpaths, and photons of beams.
    has_light_subpaths: bool,
    may_connect_camera: bool,
    /// Whether surfaces gather the light of all paths.
    merges: bool,
    /// Whether they would, but for `--merge off`.
    is_switched_off: bool,
    gate: Gate,
    max_depth: u32,
    unit: f64,
}

impl<'a> Search<'a> {
    /// `None` if there is nothing to look for.
    fn new(scene: &'a Scene, settings: &Settings, prepared: &'a PreparedScene) -> Option<Search<'a>> {
        let targets = targets(&prepared.geometry);
        if targets.is_empty() {
            return None;
        }
        let geometry = &prepared.geometry;
        let has_sheets = geometry.triangles.iter().any(|t| geometry.is_smooth_sheet(t));
        let sheets = if has_sheets { AtSheets::Stop } else { AtSheets::Pass };
        let lamps = lamps(scene, settings.emitters(), prepared);
        if lamps.is_empty() {
            return None;
        }
        let is_aimed = scene.cameras[settings.camera()].projection.aims().is_some();
        let has_light_subpaths = settings.estimator().record().light_subpaths && settings.max_depth() >= 2;
        Some(Search {
            world: World { geometry: &prepared.geometry, media: &prepared.media, sheets },
            lamps,
            targets,
            has_light_subpaths,
            connects_camera: has_light_subpaths && settings.strategies() == Strategies::All && !is_aimed,
            may_connect_camera: settings.strategies() == Strategies::All && !is_aimed,
            merges: photons::merges(scene, settings, prepared),
            is_switched_off: settings.merge() == Merge::Off && photons::can_merge(scene, settings, prepared),
            gate: settings.responses().support(),
            max_depth: settings.max_depth(),
            unit: prepared.space.unit,
        })
    }

    /// The contribution of light at `event` that arrives along `line`. `None` outside of the gate, and if not even paths of two segments
    /// count.
    fn contribution(&self, event: &Event, lamp: usize, irradiance: f64, line: &Line) -> Option<Contribution> {
        let &Line { smooth, tau, object, is_by_sheet, .. } = line;
        let is_in_gate = self.lamps[lamp].is_distant() || self.gate.contains(self.unit * (event.path.tau + tau));
        let crossings = event.path.smooth + smooth;
        let is_too_long = crossings + 2 > self.max_depth;
        if !is_in_gate || (is_too_long && crossings == 0) {
            return None;
        }
        let after = event.path.smooth > 0;
        let is_beam = self.lamps[lamp].is_beam();
        let is_cut_off_from_lamp = smooth > 0 || is_beam;
        let is_cut_off_from_camera = after || !self.connects_camera;
        // Photons of other lamps are not aimed at thin glass.
        let has_photons = if is_beam { self.has_light_subpaths } else { !is_by_sheet };
        let is_gathered = self.merges && has_photons;
        let is_cut_off = is_cut_off_from_lamp && is_cut_off_from_camera && !is_gathered;
        let is_missing = crossings > 0 && (is_too_long || is_cut_off);
        let is_merged = is_gathered && is_cut_off_from_lamp && is_cut_off_from_camera && !is_missing;
        let object = if is_by_sheet { object } else { event.path.object.or(object) };
        Some(Contribution {
            light: event.path.weight * irradiance,
            tau: self.unit * (event.path.tau + tau),
            is_missing,
            is_merged,
            on_both_sides: after,
            is_too_long,
            is_by_sheet,
            lamp,
            object,
        })
    }

    fn straight(&self, event: &Event) -> Vec<Contribution> {
        let of_lamp = |(lamp, l): (usize, &Lamp)| {
            let arrival = l.straight(&self.world, event)?;
            self.contribution(event, lamp, arrival.irradiance, &arrival.line)
        };
        self.lamps.iter().enumerate().filter_map(of_lamp).collect()
    }

    /// The events of light rays that have passed at least one smooth surface, and those of beams. Sorted by x.
    fn photons(&self) -> Vec<Photon> {
        let mut pairs: Vec<(usize, Option<&Target>)> = vec![];
        for (number, lamp) in self.lamps.iter().enumerate() {
            if lamp.is_beam() {
                pairs.push((number, None));
                continue;
            }
            let mut targets: Vec<&Target> = self.targets.iter().collect();
            targets.sort_by(|a, b| b.size_from(lamp.position).total_cmp(&a.size_from(lamp.position)));
            pairs.extend(targets.into_iter().take(MAX_TARGETS).map(|target| (number, Some(target))));
        }
        let count = (LIGHT_RAYS / pairs.len().max(1) as u32).max(MIN_LIGHT_RAYS);
        let World { geometry, .. } = self.world;
        let far = geometry.far();
        let rays = pairs.par_iter().flat_map_iter(|&(number, target)| {
            let lamp = &self.lamps[number];
            let ray = |k: u32| {
                let Some(target) = target else { return lamp.beam_ray(k, count) };
                let place = target.place(geometry, k, count)?;
                let ray = lamp.ray_to(&place, target.area() / f64::from(count), far)?;
                let first = nearest(geometry, ray.origin, ray.direction, f64::INFINITY, None, AtSheets::Pass);
                if !geometry.is_smooth_sheet(&geometry.triangles[place.triangle]) {
                    // Else another surface receives this light.
                    return first.is_some_and(|first| first.triangle == place.triangle).then_some(ray);
                }
                let distance = ray.origin.distance(place.position);
                let sheet = hit_at(geometry, place.triangle, distance, ray.direction);
                let is_free = first.is_none_or(|first| first.distance > distance);
                is_free.then(|| self.world.mirrored(&ray, &sheet, &lobes(geometry, &sheet, ray.direction)))
            };
            let mut photons = vec![];
            for ray in (0..count).filter_map(ray) {
                // Rays that are aimed at thin glass stand for what it reflects first, and no others do.
                let is_by_sheet = ray.is_by_sheet;
                self.world.walk(ray, &mut |event| {
                    let is_aimed = event.path.smooth > 0 && event.path.is_by_sheet == is_by_sheet;
                    if event.normal.is_some() && (is_aimed || target.is_none()) {
                        photons.push(Photon { event, lamp: number });
                    }
                });
            }
            photons
        });
        let mut photons: Vec<Photon> = rays.collect();
        photons.sort_by(|a, b| a.event.path.origin.x.total_cmp(&b.event.path.origin.x));
        photons
    }

    /// The light of photons around `event`, one contribution per lamp.
    fn gather(&self, event: &Event, photons: &[Photon]) -> Vec<Contribution> {
        let reach = REACH * event.path.length;
        let (place, normal) = (event.path.origin, event.normal.unwrap_or_default());
        let is_near = |photon: &&Photon| {
            let offset = photon.event.path.origin - place;
            let is_facing = photon.event.normal.is_some_and(|other| other.dot(normal) > 0.7);
            offset.length_squared() < reach * reach && is_facing && offset.dot(normal).abs() < 0.3 * reach
        };
        let mut by_lamp: BTreeMap<usize, Vec<(f64, &Photon)>> = BTreeMap::new();
        let first = photons.partition_point(|photon| photon.event.path.origin.x < place.x - reach);
        let in_slab = photons[first..].iter().take_while(|photon| photon.event.path.origin.x <= place.x + reach);
        for photon in in_slab.filter(is_near) {
            by_lamp.entry(photon.lamp).or_default().push((photon.event.path.origin.distance_squared(place), photon));
        }
        let mut all = vec![];
        for (lamp, mut near) in by_lamp.into_iter().filter(|(_, near)| near.len() >= MIN_FOUND) {
            near.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            let radius2 = near.get(GATHERED).map_or(reach * reach, |(distance2, _)| *distance2);
            for (_, Photon { event: photon, .. }) in near.into_iter().take(GATHERED) {
                let irradiance = photon.arriving / (PI * radius2);
                let Ray { smooth, tau, object, is_by_sheet, .. } = photon.path;
                let line = Line { smooth, share: 1.0, tau, object, is_by_sheet };
                all.extend(self.contribution(event, lamp, irradiance, &line));
            }
        }
        all
    }
}

/// Evenly spaced camera rays of the crop, or one ray per pixel of aimed cameras, at most SIDE^2 of them.
fn camera_rays(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Vec<Ray> {
    let camera = &scene.cameras[settings.camera()];
    let (crop, resolution) = (settings.crop(), settings.resolution());
    let [width, height] = [crop.width(), crop.height()];
    let is_aimed = matches!(camera.projection, Projection::Aimed { .. });
    let [across, down] = match is_aimed {
        true => [width.min(SIDE), height.min(SIDE)],
        false => [SIDE; 2],
    };
    let solid = prepared.solids.material_at(prepared.space.point(camera.transform.translation));
    let ray = |column: u32, row: u32| {
        let at = |k: u32, count: u32, first: u32, size: u32| {
            f64::from(first) + (f64::from(k) + 0.5) / f64::from(count) * f64::from(size)
        };
        let film = [at(column, across, crop.x0, width), at(row, down, crop.y0, height)];
        let uncounted = match camera.projection.aims() {
            None => 0.0,
            Some(aims) => {
                let [x, y] = film.map(|x| x as usize);
                aims.get(y * resolution[0] as usize + x).map_or(0.0, |aim| aim.uncounted)
            }
        };
        let origin = prepared.space.point(camera.origin(resolution, film)).as_dvec3();
        let tau = -prepared.space.length(uncounted) * f64::from(prepared.media.surrounding[1]);
        let direction = camera.direction(resolution, film);
        Ray { tau, ..Ray::start(origin, direction, solid) }
    };
    (0..down)
        .flat_map(|row| (0..across).map(move |column| (column, row)))
        .map(|(column, row)| ray(column, row))
        .collect()
}

#[cfg(test)]
mod tests;
