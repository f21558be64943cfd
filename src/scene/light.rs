//! Lights without surface: what they are, and what the rest of the program asks of each kind.

use glam::DVec3;

use super::check::{MAX_COORDINATE, is_unit};

/// A light without surface.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name of the node that carries it.
    pub node: String,
    /// In metres, in the world.
    pub position: DVec3,
    /// Unit vector along which it shines (-Z of its node); meaningless for points.
    pub direction: DVec3,
    /// What it sends out.
    pub kind: LightKind,
}

impl Light {
    /// Fails with a sentence if a number is out of range.
    pub(super) fn check(&self) -> Result<(), String> {
        let name = || format!("light '{}'", self.node);
        let is_point = matches!(self.kind, LightKind::Point { .. });
        let is_near = self.position.abs().max_element() <= MAX_COORDINATE;
        if !is_near || !(is_point || is_unit(self.direction)) {
            return Err(format!(
                "{} has a position farther than {MAX_COORDINATE:e} m from the origin, or a direction that is not of unit length",
                name()
            ));
        }
        let (strength, angles) = match self.kind {
            LightKind::Point { intensity } => (intensity, [0.0; 2]),
            LightKind::Spot { intensity, inner, outer } => (intensity, [inner, outer]),
            LightKind::Beam { power, radius } => (power, [radius, radius]),
            LightKind::Directional { irradiance } => (irradiance, [0.0; 2]),
        };
        if !strength.iter().chain(&angles).all(|x| x.is_finite() && *x >= 0.0) || angles[0] > angles[1] {
            return Err(format!("{} has a strength, angle or radius that is negative or not finite", name()));
        }
        if matches!(self.kind, LightKind::Spot { outer, .. } if outer > std::f32::consts::PI) {
            return Err(format!("{} has an outer half angle above pi; angles are in radians", name()));
        }
        Ok(())
    }
}

/// What a light without surface sends out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// The same in all directions.
    Point {
        /// Radiant intensity in W / sr.
        intensity: [f32; 3],
    },
    /// A cone whose edge is as KHR_lights_punctual says: clamp((cos - cos outer) / (cos inner - cos outer))^2.
    Spot {
        /// Radiant intensity in W / sr inside `inner`.
        intensity: [f32; 3],
        /// Half angle in radians up to which the intensity is full.
        inner: f32,
        /// Half angle in radians from which it is 0.
        outer: f32,
    },
    /// Parallel light through a disk around the light's position.
    Beam {
        /// W in all.
        power: [f32; 3],
        /// Of the disk, in metres, >= 0.
        radius: f32,
    },
    /// Infinitely far away: has no travel time. Kept so that a gated render can refuse it by name.
    Directional {
        /// W / m^2 on a surface that faces it.
        irradiance: [f32; 3],
    },
}

impl LightKind {
    /// Metres around its position within which all of its light starts; `None` for a light infinitely far away, which no render
    /// shows yet.
    pub fn radius(&self) -> Option<f64> {
        match *self {
            LightKind::Point { .. } | LightKind::Spot { .. } => Some(0.0),
            LightKind::Beam { radius, .. } => Some(radius.into()),
            LightKind::Directional { .. } => None,
        }
    }

    /// Whether only light subpaths carry its light: no point of a beam can be connected to a surface, and no ray finds one.
    pub fn needs_light_subpaths(&self) -> bool {
        matches!(self, LightKind::Beam { .. })
    }

    /// A few words for people.
    pub fn describe(&self) -> String {
        match self {
            LightKind::Point { .. } => "point light".into(),
            LightKind::Spot { outer, .. } => format!("spot light, {:.1} degrees wide", 2.0 * outer.to_degrees()),
            LightKind::Beam { radius, .. } => format!("collimated beam, radius {radius} m"),
            LightKind::Directional { .. } => "directional light (not rendered yet)".into(),
        }
    }
}
