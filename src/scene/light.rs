//! Lights without a surface: their kinds, and the properties of each kind that the rest of the program needs.

use glam::DVec3;

use super::check::{MAX_COORDINATE, is_unit};

/// A light without a surface.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name of the node that carries it.
    pub node: String,
    /// World space, in metres.
    pub position: DVec3,
    /// World-space unit vector along which it shines (-Z of its node); not used for point lights.
    pub direction: DVec3,
    /// Kind and strength of the emission.
    pub kind: LightKind,
}

impl Light {
    /// Fails with one sentence if a number is out of range.
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
    /// Infinitely far away, so its light has no travel time. The scene keeps it so that a gated render can refuse it by name.
    Directional {
        /// Irradiance in W / m^2 on a surface that faces the light.
        irradiance: [f32; 3],
    },
}

impl LightKind {
    /// Radius in metres, around the light's position, of the region where all of its light starts. `None` for a directional
    /// light, which is infinitely far away and not rendered yet.
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
            LightKind::Directional { .. } => "directional light (not rendered yet)".into(),
        }
    }
}
