//! Lights without surface: what they are, and what the rest of the program asks of each kind.

use glam::DVec3;

/// A light without surface.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name of the node that carries it.
    pub node: String,
    pub position: DVec3,
    /// Unit vector along which it shines (-Z of its node); meaningless for points.
    pub direction: DVec3,
    pub kind: LightKind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// Radiant intensity in W / sr, the same in all directions.
    Point { intensity: [f32; 3] },
    /// Radiant intensity in W / sr inside `inner` (half angle, radians), falling to 0 at `outer` as KHR_lights_punctual
    /// says: clamp((cos - cos outer) / (cos inner - cos outer))^2.
    Spot { intensity: [f32; 3], inner: f32, outer: f32 },
    /// Parallel light through a disk of `radius` >= 0 metres around `position`; `power` in W in all.
    Beam { power: [f32; 3], radius: f32 },
    /// Infinitely far away: has no travel time. Kept so that a gated render can refuse it by name.
    Directional { irradiance: [f32; 3] },
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
