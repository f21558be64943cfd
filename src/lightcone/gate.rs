//! The gate in f32: how far rounding can move the travel times that kernels compare with the gate.

use crate::settings::units::Gate;

/// Length by which queries widen their travel-time bounds, so that they prune no vertex whose travel time rounds into the gate.
/// It is in the unit of `gate` and `sensor`. `sensor` is the distance of the sensor's farthest point from the origin of render
/// space, plus the length that travel times omit in scans.
///
/// A travel time is a sum of a few dozen rounded terms. Each term is at most the last finite end of the gate. The coordinates of
/// the points are at most that end plus `sensor`.
pub fn rounding_allowance(gate: Gate, sensor: f64) -> f32 {
    let edge = if gate.hi.is_finite() { gate.hi } else { gate.lo };
    (edge + sensor) as f32 * 4e-6
}
