//! The gate in f32: what rounding may do to the travel times that are compared with it.

use crate::settings::units::Gate;

/// Length, in the unit of the gate, by which the bounds of a query are widened so that no vertex whose travel time rounds into
/// the gate is pruned.
/// A travel time is a sum of a few dozen rounded terms, each no greater than the gate's last finite end, of points whose coordinates
/// are no greater than that end and the distance of the sensor from the origin of render space.
pub fn rounding_allowance(gate: Gate, sensor: f64) -> f32 {
    let edge = if gate.hi.is_finite() { gate.hi } else { gate.lo };
    (edge + sensor) as f32 * 4e-6
}
