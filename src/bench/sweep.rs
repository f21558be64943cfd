//! The quantity that a sweep of scenes varies, and its value in a row of measurements.

use serde::Deserialize;

use super::table::Row;

/// The quantity in which the scenes of a sweep differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// Triangles of all instances.
    Triangles,
    /// Light vertices that are kept per iteration.
    LightVertices,
    /// Width of the gate in metres.
    GateWidth,
    /// Optical thickness of the media along the scene's diagonal.
    OpticalThickness,
    Pixels,
}

impl Sweep {
    pub const ALL: [Sweep; 5] =
        [Sweep::Triangles, Sweep::LightVertices, Sweep::GateWidth, Sweep::OpticalThickness, Sweep::Pixels];

    /// The name that reports show.
    pub fn name(self) -> &'static str {
        match self {
            Sweep::Triangles => "triangles",
            Sweep::LightVertices => "light vertices",
            Sweep::GateWidth => "gate width",
            Sweep::OpticalThickness => "optical thickness",
            Sweep::Pixels => "pixels",
        }
    }

    /// The value of the quantity in `row`.
    pub fn of(self, row: &Row) -> f64 {
        match self {
            Sweep::Triangles => row.triangles as f64,
            Sweep::LightVertices => row.light_vertices,
            Sweep::GateWidth => row.gate_m,
            Sweep::OpticalThickness => row.optical_thickness,
            Sweep::Pixels => row.pixels as f64,
        }
    }
}
