//! Lights without a surface: their kinds, and the properties of each kind that the rest of the program needs.

use glam::DVec3;

use super::check::{MAX_COORDINATE, is_unit};

/// Upper bound on the irradiance of a sun in W / m^2. The device represents a sun by a far point, whose intensity must be finite.
const MAX_IRRADIANCE: f32 = 1e20;

/// A light without a surface.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name of the node that carries it.
    pub node: String,
    /// World space, in metres; without effect for directional lights.
    pub position: DVec3,
    /// World-space unit vector along which it shines (-Z of its node); not used for point lights.
    pub direction: DVec3,
    /// Kind and strength of the emission.
    pub kind: LightKind,
}

impl Light {
    /// Fails with one sentence if a number is out of range.
    pub(crate) fn check(&self) -> Result<(), String> {
        let name = || format!("light '{}'", self.node);
        let is_point = matches!(self.kind, LightKind::Point { .. });
        let is_near = self.position.abs().max_element() <= MAX_COORDINATE;
        if !is_near || !(is_point || is_unit(self.direction)) {
            return Err(format!(
                "{} has a position farther than {MAX_COORDINATE:e} m from the origin, or a direction that is not of unit length",
                name()
            ));
        }
        let angles = match self.kind {
            LightKind::Point { .. } | LightKind::Directional { .. } => [0.0; 2],
            LightKind::Spot { inner, outer, .. } => [inner, outer],
            LightKind::Beam { radius, .. } => [radius, radius],
        };
        if !self.kind.strength().iter().chain(&angles).all(|x| x.is_finite() && *x >= 0.0) || angles[0] > angles[1] {
            return Err(format!("{} has a strength, angle or radius that is negative or not finite", name()));
        }
        if self.kind.is_sun() && self.kind.strength().iter().any(|&channel| channel > MAX_IRRADIANCE) {
            return Err(format!("{} has an irradiance above {MAX_IRRADIANCE:e} W/m^2", name()));
        }
        if matches!(self.kind, LightKind::Spot { outer, .. } if outer > std::f32::consts::PI) {
            return Err(format!("{} has an outer half angle above pi; angles are in radians", name()));
        }
        Ok(())
    }
}

/// Emission of a light without a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// The same in all directions.
    Point {
        /// Radiant intensity in W / sr.
        intensity: [f32; 3],
    },
    /// A cone. Its falloff follows KHR_lights_punctual: clamp((cos - cos outer) / (cos inner - cos outer))^2.
    Spot {
        /// Radiant intensity in W / sr, at angles below `inner`.
        intensity: [f32; 3],
        /// Half angle in radians up to which the intensity is constant.
        inner: f32,
        /// Half angle in radians beyond which the intensity is 0.
        outer: f32,
    },
    /// Parallel light through a disk around the light's position.
    Beam {
        /// Total power in W.
        power: [f32; 3],
        /// Radius of the disk in metres, >= 0.
        radius: f32,
    },
    /// A sun: infinitely far away, so its light is parallel and has no travel time. Only renders without a gate have it.
    Directional {
        /// Irradiance in W / m^2 on a surface that faces the light, at most 1e20.
        irradiance: [f32; 3],
    },
}

impl LightKind {
    /// A spot light with a cone from `inner` to `outer` (half angles in radians). Where they are equal, `inner` becomes slightly
    /// smaller: without room for the falloff, the falloff would divide by zero.
    pub fn spot(intensity: [f32; 3], inner: f32, outer: f32) -> LightKind {
        LightKind::Spot { intensity, inner: inner.min(0.999 * outer), outer }
    }

    /// Radiant intensity (W / sr), power (W) or irradiance (W / m^2), for red, green and blue.
    pub fn strength(&self) -> [f32; 3] {
        match *self {
            LightKind::Point { intensity } | LightKind::Spot { intensity, .. } => intensity,
            LightKind::Beam { power, .. } => power,
            LightKind::Directional { irradiance } => irradiance,
        }
    }

    /// Whether the light is infinitely far away.
    pub fn is_sun(&self) -> bool {
        matches!(self, LightKind::Directional { .. })
    }

    /// Radius in metres, around the light's position, of the region where all of its light starts. `None` for a directional
    /// light, which is infinitely far away.
    pub fn radius(&self) -> Option<f64> {
        match *self {
            LightKind::Point { .. } | LightKind::Spot { .. } => Some(0.0),
            LightKind::Beam { radius, .. } => Some(radius.into()),
            LightKind::Directional { .. } => None,
        }
    }

    /// Whether only light subpaths find its light: points on a beam cannot be connected to surfaces, and no ray hits a beam.
    pub fn needs_light_subpaths(&self) -> bool {
        matches!(self, LightKind::Beam { .. })
    }

    /// A short description for the user.
    pub fn describe(&self) -> String {
        match self {
            LightKind::Point { .. } => "point light".into(),
            LightKind::Spot { outer, .. } => format!("spot light, {:.1} degrees wide", 2.0 * outer.to_degrees()),
            LightKind::Beam { radius, .. } => format!("collimated beam, radius {radius} m"),
            LightKind::Directional { irradiance: [r, g, b] } => {
                format!("directional light (sun), irradiance ({r}, {g}, {b}) W/m^2")
            }
        }
    }
}
