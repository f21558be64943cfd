//! Travel times and ranges with their units: parsing and printing of gates.

/// A half-open interval of travel time [lo, hi), in metres of optical path (c = 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    pub lo: f64,
    /// Infinite for an open gate.
    pub hi: f64,
}

/// Speed of light in vacuum, metres per nanosecond (exact).
pub const METRES_PER_NS: f64 = 0.299_792_458;

impl Gate {
    /// Every travel time: the steady state.
    pub const OPEN: Gate = Gate { lo: 0.0, hi: f64::INFINITY };

    pub fn is_open(&self) -> bool {
        self.hi == f64::INFINITY && self.lo <= 0.0
    }
}
