//! What a sweep of scenes varies, and its value in a row of measurements.

use serde::Deserialize;

use super::table::Row;

/// What the scenes of a sweep differ in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// Instances counted.
    Triangles,
    /// Kept, an iteration.
    LightVertices,
    /// Metres.
    GateWidth,
    Pixels,
}

impl Sweep {
    pub const ALL: [Sweep; 4] = [Sweep::Triangles, Sweep::LightVertices, Sweep::GateWidth, Sweep::Pixels];

    /// As it is shown.
    pub fn name(self) -> &'static str {
        match self {
            Sweep::Triangles => "triangles",
            Sweep::LightVertices => "light vertices",
            Sweep::GateWidth => "gate width",
            Sweep::Pixels => "pixels",
        }
    }

    /// The value that `row` has of it.
    pub fn of(self, row: &Row) -> f64 {
        match self {
            Sweep::Triangles => row.triangles as f64,
            Sweep::LightVertices => row.light_vertices,
            Sweep::GateWidth => row.gate_m,
            Sweep::Pixels => row.pixels as f64,
        }
    }
}
