//! Lights without a surface: their kinds, and the properties of each kind that the rest of the program needs.

use std::f64::consts::PI;

use glam::DVec3;

use super::check::{MAX_COORDINATE, is_unit};

/// Upper bound on the irradiance of a sun in W / m^2, and on the radiance of a sky in W / (m^2 sr). The device represents a sun by
/// a far point, whose intensity must be finite.
pub(crate) const MAX_DISTANT: f32 = 1e20;
/// Maximum of the inner half angle of a spot, relative to the outer one.
const SHARPEST: f32 = 0.999;

/// A light without a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Name of the node that carries it.
    pub node: String,
    /// World space, in metres; without effect for directional lights and skies.
    pub position: DVec3,
    /// World-space unit vector along which it shines (-Z of its node); not used for point lights and skies.
    pub direction: DVec3,
    /// Kind and strength of the emission.
    pub kind: LightKind,
}

impl Light {
    /// Fails with one sentence if a number is out of range.
    pub(crate) fn check(&self) -> Result<(), String> {
        let name = || format!("light '{}'", self.node);
        let has_axis = !matches!(self.kind, LightKind::Point { .. } | LightKind::Sky { .. });
        let is_near = self.position.abs().max_element() <= MAX_COORDINATE;
        if !is_near || (has_axis && !is_unit(self.direction)) {
            return Err(format!(
                "{} has a position farther than {MAX_COORDINATE:e} m from the origin, or a direction that is not of unit length",
                name()
            ));
        }
        let angles_or_radius = match self.kind {
            LightKind::Point { .. } | LightKind::Directional { .. } | LightKind::Sky { .. } => [0.0; 2],
            LightKind::Spot { inner, outer, .. } => [inner, outer],
            LightKind::Beam { radius, .. } => [radius, radius],
        };
        if !self.kind.strength().iter().chain(&angles_or_radius).all(|x| x.is_finite() && *x >= 0.0)
            || angles_or_radius[0] > angles_or_radius[1]
        {
            return Err(format!(
                "{} has a strength, angle or radius that is negative or not finite, or an inner angle above the outer one",
                name()
            ));
        }
        if self.kind.is_distant() && self.kind.strength().iter().any(|&channel| channel > MAX_DISTANT) {
            let strength = if self.kind.is_sky() { "a radiance" } else { "an irradiance" };
            let unit = if self.kind.is_sky() { "W/(m^2 sr)" } else { "W/m^2" };
            return Err(format!("{} has {strength} above {MAX_DISTANT:e} {unit}", name()));
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
    /// A sun: infinitely far away, so its light is parallel and has no travel time. Only renders without a gate include it.
    Directional {
        /// Irradiance in W / m^2 on a surface that faces the light, at most 1e20.
        irradiance: [f32; 3],
    },
    /// A sky: light from all directions, infinitely far away, so it has no travel time. Only renders without a gate include
    /// it. A scene has at most one sky.
    Sky {
        /// Radiance in W / (m^2 sr), at most 1e20. It multiplies [`super::Scene::sky`], if there is such an image.
        radiance: [f32; 3],
    },
}

impl LightKind {
    /// A spot light with a cone from `inner` to `outer` (half angles in radians). `inner` becomes at most
    /// 0.999 times `outer`: with equal angles, the falloff would divide by zero.
    pub fn spot(intensity: [f32; 3], inner: f32, outer: f32) -> LightKind {
        LightKind::Spot { intensity, inner: inner.min(SHARPEST * outer), outer }
    }

    /// A spot light with the half angle `half` in radians. Its intensity is the same up to SHARPEST times `half`. It emits `power` W per channel.
    pub(crate) fn cone(power: f64, half: f64) -> LightKind {
        let outer = half as f32;
        let inner = SHARPEST * outer;
        let intensity = (power / spot_solid_angle(cap_height(inner), cap_height(outer))) as f32;
        LightKind::Spot { intensity: [intensity; 3], inner, outer }
    }

    /// Radiant intensity (W / sr), power (W), irradiance (W / m^2) or radiance (W / (m^2 sr)), for red, green and blue.
    pub fn strength(&self) -> [f32; 3] {
        match *self {
            LightKind::Point { intensity } | LightKind::Spot { intensity, .. } => intensity,
            LightKind::Beam { power, .. } => power,
            LightKind::Directional { irradiance } => irradiance,
            LightKind::Sky { radiance } => radiance,
        }
    }

    /// The same light with the strength 0.
    pub(crate) fn off(self) -> LightKind {
        let dark = [0.0; 3];
        match self {
            LightKind::Point { .. } => LightKind::Point { intensity: dark },
            LightKind::Spot { inner, outer, .. } => LightKind::Spot { intensity: dark, inner, outer },
            LightKind::Beam { radius, .. } => LightKind::Beam { power: dark, radius },
            LightKind::Directional { .. } => LightKind::Directional { irradiance: dark },
            LightKind::Sky { .. } => LightKind::Sky { radiance: dark },
        }
    }

    /// Whether the light is infinitely far away: a sun or a sky.
    pub fn is_distant(&self) -> bool {
        matches!(self, LightKind::Directional { .. } | LightKind::Sky { .. })
    }

    /// Whether the light comes from all directions.
    pub fn is_sky(&self) -> bool {
        matches!(self, LightKind::Sky { .. })
    }

    /// Whether all light starts at the light's position and spreads from there: a point or a spot.
    pub fn spreads_from_a_point(&self) -> bool {
        matches!(self, LightKind::Point { .. } | LightKind::Spot { .. })
    }

    /// Radius in metres, around the light's position, of the region where all of its light starts. `None` for a light that
    /// is infinitely far away.
    pub fn radius(&self) -> Option<f64> {
        match *self {
            LightKind::Point { .. } | LightKind::Spot { .. } => Some(0.0),
            LightKind::Beam { radius, .. } => Some(radius.into()),
            LightKind::Directional { .. } | LightKind::Sky { .. } => None,
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
            LightKind::Sky { radiance: [r, g, b] } => format!("sky, radiance ({r}, {g}, {b}) W/(m^2 sr)"),
        }
    }
}

/// 1 - cosine of `angle` in radians, as 2 sin^2(angle / 2), which stays accurate for small angles.
pub(crate) fn cap_height(angle: f32) -> f64 {
    2.0 * (0.5 * f64::from(angle)).sin().powi(2)
}

/// Power of a spot over its intensity, in sr. `inner` and `outer`: 1 - cosine of the half angles. The falloff is 1 inside the inner
/// cone. Between the cones it is the square of a ramp from 1 to 0 that is linear in the cosine. The integral of this square is 1/3 of
/// the solid angle between the cones.
pub(crate) fn spot_solid_angle(inner: f64, outer: f64) -> f64 {
    2.0 * PI * (inner + (outer - inner) / 3.0)
}
