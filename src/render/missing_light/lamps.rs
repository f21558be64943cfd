//! Lamps without a surface, as the search for missing light sees them.

use std::f64::consts::PI;

use glam::DVec3;

use super::targets::{GOLDEN, Place};
use super::walk::{Event, Line, Ray, World};
use crate::render::emitters::luminance;
use crate::render::prepared_scene::PreparedScene;
use crate::scene::{Light, LightKind, Scene};
use crate::settings::Emitters;

/// The strongest lamps that the search considers.
const MAX_LAMPS: usize = 32;

/// A lamp in render space. Strengths are in an arbitrary unit, the same for all lamps.
pub struct Lamp<'a> {
    pub light: &'a Light,
    pub position: DVec3,
    /// Index in `Geometry::materials` of the solid around the lamp, or NONE.
    solid: u32,
    /// Intensity, power or irradiance.
    strength: f64,
    /// Radius of a beam.
    radius: f64,
}

/// Light of a lamp that arrives straight at an event.
pub struct Arrival {
    pub line: Line,
    /// Irradiance at the event; in a medium the fluence, divided by 4.
    pub irradiance: f64,
}

/// The lamps that are switched on and have no surface, without the sky, which rays can hit.
pub fn lamps<'a>(scene: &'a Scene, emitters: &Emitters, prepared: &PreparedScene) -> Vec<Lamp<'a>> {
    let is_lamp = |light: &&Light| emitters.include(&light.node) && !light.kind.is_sky();
    let strength = |light: &Light| {
        let area = if light.kind.is_distant() { 1.0 } else { prepared.space.unit * prepared.space.unit };
        luminance(light.kind.strength()) / area
    };
    let mut lights: Vec<(f64, &Light)> =
        scene.lights.iter().filter(is_lamp).map(|light| (strength(light), light)).collect();
    lights.retain(|(strength, _)| *strength > 0.0);
    lights.sort_by(|a, b| b.0.total_cmp(&a.0));
    lights.truncate(MAX_LAMPS);
    let lamp = |(strength, light): (f64, &'a Light)| {
        let position = prepared.space.point(light.position);
        Lamp {
            light,
            position: position.as_dvec3(),
            solid: prepared.solids.material_at(position),
            strength,
            radius: prepared.space.length(light.kind.radius().unwrap_or(0.0)),
        }
    };
    lights.into_iter().map(lamp).collect()
}

impl Lamp<'_> {
    /// Whether all light leaves the lamp in one direction, so that no surface can be connected to it.
    pub fn is_beam(&self) -> bool {
        self.light.kind.needs_light_subpaths()
    }

    /// Whether the light has no travel time.
    pub fn is_distant(&self) -> bool {
        self.light.kind.is_distant()
    }

    /// Radiant intensity along the unit vector `direction`.
    fn intensity(&self, direction: DVec3) -> f64 {
        match self.light.kind {
            LightKind::Spot { inner, outer, .. } => {
                let (full, none) = (f64::from(inner).cos(), f64::from(outer).cos());
                let cosine = direction.dot(self.light.direction);
                self.strength * ((cosine - none) / (full - none)).clamp(0.0, 1.0).powi(2)
            }
            LightKind::Point { .. }
            | LightKind::Beam { .. }
            | LightKind::Directional { .. }
            | LightKind::Sky { .. } => self.strength,
        }
    }

    /// Light that comes straight from the lamp to `event`, also through parallel smooth surfaces. `None` if there is none.
    pub fn straight(&self, world: &World, event: &Event) -> Option<Arrival> {
        let offset = self.position - event.path.origin;
        let (direction, distance, strength) = match self.light.kind {
            LightKind::Directional { .. } => (-self.light.direction, f64::INFINITY, self.strength),
            LightKind::Beam { .. } => {
                let along = -offset.dot(self.light.direction);
                let aside = (offset + along * self.light.direction).length();
                if along <= 0.0 || aside >= self.radius {
                    return None;
                }
                (-self.light.direction, along, self.strength / (PI * self.radius * self.radius))
            }
            LightKind::Point { .. } | LightKind::Spot { .. } | LightKind::Sky { .. } => {
                let distance = offset.length();
                let direction = offset / distance;
                if !direction.is_finite() {
                    return None;
                }
                (direction, distance, self.intensity(-direction) / (distance * distance))
            }
        };
        if strength <= 0.0 {
            return None;
        }
        let line = world.line(event, direction, distance)?;
        let cosine = event.normal.map_or(0.25, |normal| normal.dot(direction));
        let irradiance = strength * cosine * line.share;
        Some(Arrival { line, irradiance })
    }

    /// The ray towards `place`, with the light that a surface of this `area` around it receives. `far`: a distance beyond the scene.
    /// `None` if the lamp does not shine there.
    pub fn ray_to(&self, place: &Place, area: f64, far: f64) -> Option<Ray> {
        let offset = place.position - self.position;
        let (origin, direction, density) = match self.light.kind {
            LightKind::Directional { .. } => {
                (place.position - far * self.light.direction, self.light.direction, self.strength)
            }
            LightKind::Point { .. } | LightKind::Spot { .. } | LightKind::Beam { .. } | LightKind::Sky { .. } => {
                let direction = offset.try_normalize()?;
                (self.position, direction, self.intensity(direction) / offset.length_squared())
            }
        };
        self.start(origin, direction, density * area * direction.dot(place.normal).abs())
    }

    /// Ray `number` of the `count` rays of a beam.
    pub fn beam_ray(&self, number: u32, count: u32) -> Option<Ray> {
        let axis = self.light.direction;
        let u = (f64::from(number) + 0.5) / f64::from(count);
        // The golden ratio spreads the angles evenly.
        let angle = 2.0 * PI * (f64::from(number) * GOLDEN).fract();
        let x = axis.any_orthonormal_vector();
        let aside = angle.cos() * x + angle.sin() * axis.cross(x);
        self.start(self.position + self.radius * u.sqrt() * aside, axis, self.strength / f64::from(count))
    }

    fn start(&self, origin: DVec3, direction: DVec3, weight: f64) -> Option<Ray> {
        (weight > 0.0).then_some(Ray { weight, ..Ray::start(origin, direction, self.solid) })
    }
}
