//! Light that no strategy of a render forms: a warning with the share of the pixels.
//!
//! Write S for a smooth event (perfect reflection or refraction) and D for any other. A connection needs two neighbours of kind D on the
//! path; lamps without a surface and the camera count as D, but no ray can hit them. So the path lamp, S, D, S, camera is formed by no
//! strategy. Paths of beams are worse off, because no surface connects to a beam. The host looks for such paths: it follows camera rays
//! over smooth surfaces to the first D, and looks from there for the lamp, straight through panes and with light rays from the lamps.

mod lamps;
mod surfaces;
mod targets;
mod walk;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use rayon::prelude::*;

use super::prepared_scene::PreparedScene;
use crate::scene::{Projection, Scene};
use crate::settings::units::Gate;
use crate::settings::{Settings, Strategies};
use lamps::{Lamp, lamps};
use surfaces::nearest;
use targets::{Target, targets};
use walk::{Event, Ray, World};

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
/// A pixel is affected if it misses more than the first share of its light, and more than the second share of the brightest pixel.
const MIN_MISSED: f64 = 0.02;
const MIN_BRIGHTNESS: f64 = 1e-3;

/// Light that no strategy of a render forms.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingLight {
    /// Fraction of the pixels of the crop that miss light, in (0, 1].
    pub share: f64,
    /// Fraction of the light in these pixels that is missing, in (0, 1]. Counts the light of lamps without a surface that scatters once.
    pub loss: f64,
    /// Node of the lamp whose light is missing most.
    pub lamp: String,
    /// Node of the smooth glass or mirror on most of the paths.
    pub object: String,
    /// Whether the smooth surfaces are between lamp and scattering surface only. Estimators with light subpaths form these paths.
    pub only_before: bool,
    /// Whether --max-depth leaves out most of this light, because each crossing of solid glass is a segment.
    pub too_long: bool,
    /// Whether an estimator with light subpaths would form the paths of `only_before`: not for scans or fewer strategies.
    pub has_remedy: bool,
}

impl MissingLight {
    /// One sentence with the reason and the remedy.
    pub fn describe(&self) -> String {
        let MissingLight { share, loss, lamp, object, only_before, too_long, has_remedy } = self;
        let pixels = match 100.0 * share {
            percent if percent < 1.0 => "less than 1 % of the pixels miss".into(),
            percent => format!("{percent:.0} % of the pixels miss"),
        };
        let loss = format!("about {:.0} % of the direct light there", (100.0 * loss).max(1.0));
        if *too_long {
            return format!(
                "{pixels} light of '{lamp}' ({loss}): it passes smooth solid glass or mirrors, such as '{object}', where each crossing is a \
                 segment, and --max-depth leaves out paths with so many segments; use a single plane in place of a pane, which costs none, \
                 or a larger --max-depth"
            );
        }
        let remedy = match has_remedy {
            true => "use --estimator bdpt, or a lamp with a surface",
            false => "use a lamp with a surface, or a single plane in place of a pane",
        };
        match only_before {
            true => format!(
                "{pixels} light of '{lamp}' ({loss}): it passes smooth glass or mirrors, such as '{object}', before a surface scatters it to the \
                 camera, and this render forms no such paths; {remedy}"
            ),
            false => format!(
                "{pixels} light of '{lamp}' ({loss}), which has no surface: the light passes smooth glass or mirrors, such as '{object}', both before \
                 and after it is scattered, and no strategy forms such paths; use a single plane in place of a \
                 pane; or, with much more noise, a lamp with a surface (a small emissive mesh) or a roughness of at least 0.05"
            ),
        }
    }
}

/// As [`missing_light`], whatever the gate.
pub fn missing_light_at_any_time(scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Option<MissingLight> {
    let open = settings.change().gate(Gate::OPEN).build().ok()?;
    missing_light(scene, &open, prepared)
}

/// Light of one pixel, formed and missing.
#[derive(Default, Clone)]
struct Pixel {
    formed: f64,
    missing: f64,
    /// Part of `missing` whose smooth surfaces are on both sides of the scattering event.
    on_both_sides: f64,
    /// Part of `missing` whose paths have more than max_depth segments.
    too_long: f64,
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
    let mut found = Found { pixels: vec![], lamps: vec![0.0; search.lamps.len()], objects: BTreeMap::new() };
    let rays = camera_rays(scene, settings, prepared);
    let events: Vec<Vec<Event>> = rays
        .par_iter()
        .map(|ray| {
            let mut events = vec![];
            search.world.walk(*ray, &mut |event| events.push(event));
            events
        })
        .collect();
    let is_candidate = |event: &Event| event.path.smooth > 0 || !search.connects_camera;
    if !events.iter().flatten().any(is_candidate) {
        return None;
    }

    // Light that comes straight from the lamps, also through panes.
    found.pixels = vec![Pixel::default(); rays.len()];
    let straight: Vec<Vec<Contribution>> =
        events.par_iter().map(|events| events.iter().flat_map(|event| search.straight(event)).collect()).collect();
    for (number, contributions) in straight.into_iter().enumerate() {
        contributions.into_iter().for_each(|contribution| found.add(number, contribution));
    }

    // Light over mirrors and bent glass.
    let open: Vec<usize> = (0..rays.len())
        .filter(|&number| events[number].iter().any(is_candidate) && !found.pixels[number].is_affected(0.0))
        .collect();
    if !open.is_empty() {
        let photons = search.photons();
        let gather = |&number: &usize| {
            let on_surface = |event: &&Event| is_candidate(event) && event.normal.is_some();
            let mut events: Vec<&Event> = events[number].iter().filter(on_surface).collect();
            events.sort_by(|a, b| b.path.weight.total_cmp(&a.path.weight));
            let events = events.into_iter().take(MAX_EVENTS);
            (number, events.flat_map(|event| search.gather(event, &photons)).collect())
        };
        let gathered: Vec<(usize, Vec<Contribution>)> = open.par_iter().map(gather).collect();
        for (number, contributions) in gathered {
            contributions.into_iter().for_each(|contribution| found.add(number, contribution));
        }
    }
    found.summary(scene, &search)
}

/// Light of a lamp at an event, times the share of the event.
struct Contribution {
    light: f64,
    is_missing: bool,
    on_both_sides: bool,
    is_too_long: bool,
    lamp: usize,
    object: Option<u32>,
}

struct Search<'a> {
    world: World<'a>,
    lamps: Vec<Lamp<'a>>,
    targets: Vec<Target>,
    /// Whether light subpaths are connected to the camera (t = 1), and whether those of other estimators would be.
    connects_camera: bool,
    may_connect_camera: bool,
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
        let lamps = lamps(scene, settings.emitters(), prepared);
        if lamps.is_empty() {
            return None;
        }
        let is_aimed = scene.cameras[settings.camera()].projection.aims().is_some();
        let has_light_subpaths = settings.estimator().record().light_subpaths && settings.max_depth() >= 2;
        Some(Search {
            world: World(prepared),
            lamps,
            targets,
            connects_camera: has_light_subpaths && settings.strategies() == Strategies::All && !is_aimed,
            may_connect_camera: settings.strategies() == Strategies::All && !is_aimed,
            gate: settings.responses().support(),
            max_depth: settings.max_depth(),
            unit: prepared.space.unit,
        })
    }

    /// The contribution of light at `event` that arrives over `smooth` smooth surfaces. `None` outside of the gate, and if not even paths of
    /// two segments count.
    fn contribution(
        &self,
        event: &Event,
        lamp: usize,
        irradiance: f64,
        smooth: u32,
        tau: f64,
        object: Option<u32>,
    ) -> Option<Contribution> {
        let is_in_gate = self.lamps[lamp].is_distant() || self.gate.contains(self.unit * (event.path.tau + tau));
        let crossings = event.path.smooth + smooth;
        let is_too_long = crossings + 2 > self.max_depth;
        if !is_in_gate || (is_too_long && crossings == 0) {
            return None;
        }
        let after = event.path.smooth > 0;
        let is_cut_off_from_lamp = smooth > 0 || self.lamps[lamp].is_beam();
        let is_cut_off_from_camera = after || !self.connects_camera;
        let is_missing = crossings > 0 && (is_too_long || is_cut_off_from_lamp && is_cut_off_from_camera);
        let object = event.path.object.or(object);
        Some(Contribution {
            light: event.path.weight * irradiance,
            is_missing,
            on_both_sides: after,
            is_too_long,
            lamp,
            object,
        })
    }

    fn straight(&self, event: &Event) -> Vec<Contribution> {
        let of_lamp = |(lamp, l): (usize, &Lamp)| {
            let arrival = l.straight(&self.world, event)?;
            self.contribution(
                event,
                lamp,
                arrival.irradiance,
                arrival.line.smooth,
                arrival.line.tau,
                arrival.line.object,
            )
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
        let geometry = &self.world.0.geometry;
        let bounds = geometry.bvh.host.total_aabb;
        let far = 2.0 * f64::from((bounds.max - bounds.min).length()).max(1e-9);
        let rays = pairs.par_iter().flat_map_iter(|&(number, target)| {
            let lamp = &self.lamps[number];
            let ray = |k: u32| {
                let Some(target) = target else { return lamp.beam_ray(k, count) };
                let place = target.place(geometry, k, count)?;
                let ray = lamp.ray_to(&place, target.area() / f64::from(count), far)?;
                let first = nearest(geometry, ray.origin, ray.direction, f64::INFINITY, None)?;
                // Another surface receives this light.
                (first.triangle == place.triangle).then_some(ray)
            };
            let mut photons = vec![];
            for ray in (0..count).filter_map(ray) {
                self.world.walk(ray, &mut |event| {
                    if event.normal.is_some() && (event.path.smooth > 0 || target.is_none()) {
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
                let Ray { smooth, tau, object, .. } = photon.path;
                all.extend(self.contribution(event, lamp, irradiance, smooth, tau, object));
            }
        }
        all
    }
}

/// What the search has found so far.
struct Found {
    pixels: Vec<Pixel>,
    /// Missing light by lamp and by instance.
    lamps: Vec<f64>,
    objects: BTreeMap<u32, f64>,
}

impl Found {
    fn add(&mut self, pixel: usize, contribution: Contribution) {
        let Contribution { light, is_missing, on_both_sides, is_too_long, lamp, object } = contribution;
        let pixel = &mut self.pixels[pixel];
        if !is_missing {
            pixel.formed += light;
            return;
        }
        pixel.missing += light;
        pixel.on_both_sides += if on_both_sides { light } else { 0.0 };
        pixel.too_long += if is_too_long { light } else { 0.0 };
        self.lamps[lamp] += light;
        if let Some(object) = object {
            *self.objects.entry(object).or_default() += light;
        }
    }

    fn summary(&self, scene: &Scene, search: &Search) -> Option<MissingLight> {
        let brightest = self.pixels.iter().map(|pixel| pixel.formed + pixel.missing).fold(0.0, f64::max);
        let affected: Vec<&Pixel> = self.pixels.iter().filter(|pixel| pixel.is_affected(brightest)).collect();
        if affected.is_empty() {
            return None;
        }
        let lamp = (0..self.lamps.len()).max_by(|&a, &b| self.lamps[a].total_cmp(&self.lamps[b]))?;
        let object = self.objects.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(instance, _)| *instance);
        let object = object.map_or(String::new(), |instance| scene.instances[instance as usize].node.clone());
        let sum = |of: fn(&Pixel) -> f64| affected.iter().map(|pixel| of(pixel)).sum::<f64>();
        Some(MissingLight {
            loss: sum(|pixel| pixel.missing) / sum(|pixel| pixel.missing + pixel.formed),
            share: affected.len() as f64 / self.pixels.len() as f64,
            lamp: search.lamps[lamp].light.node.clone(),
            object,
            too_long: sum(|pixel| pixel.too_long) > 0.5 * sum(|pixel| pixel.missing),
            has_remedy: search.may_connect_camera,
            only_before: affected.iter().all(|pixel| pixel.on_both_sides <= MIN_MISSED * pixel.missing),
        })
    }
}

impl Pixel {
    fn is_affected(&self, brightest: f64) -> bool {
        let all = self.formed + self.missing;
        self.missing > MIN_MISSED * all && self.missing > MIN_BRIGHTNESS * brightest
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
        let omitted = match camera.projection.aims() {
            None => 0.0,
            Some(aims) => {
                let [x, y] = film.map(|x| x as usize);
                aims.get(y * resolution[0] as usize + x).map_or(0.0, |aim| aim.omitted)
            }
        };
        let origin = prepared.space.point(camera.origin(resolution, film)).as_dvec3();
        let tau = -prepared.space.length(omitted) * f64::from(prepared.media.surrounding[1]);
        let direction = camera.direction(resolution, film);
        Ray { origin, direction, leaves: None, weight: 1.0, tau, length: 0.0, smooth: 0, object: None, solid }
    };
    (0..down)
        .flat_map(|row| (0..across).map(move |column| (column, row)))
        .map(|(column, row)| ray(column, row))
        .collect()
}

#[cfg(test)]
mod tests;
