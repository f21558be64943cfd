//! Nodes with a scale of 0 along the normal of a flat mesh.

use glam::{DAffine3, DMat3, DVec3};

use crate::scene::Mesh;

/// A mesh is flat if its thickness is at most this fraction of its largest coordinate. Rounding can cause such a thickness.
const FLAT: f64 = 1e-6;
/// Smallest area of the largest parallelogram that two axes of the transform span, divided by the square of its longest axis.
const MIN_AREA: f64 = 1e-6;

/// `transform` flattens space. Returns an invertible transform that moves all points of `mesh` to the same places. `None` if there is
/// none: the mesh is not flat in the direction that is lost, or `transform` flattens space to a line.
///
/// Any scale may replace the 0 in the lost direction, because all points of the mesh have the same coordinate there.
pub fn invertible(transform: &DAffine3, mesh: &Mesh) -> Option<DAffine3> {
    let matrix = transform.matrix3;
    let size = matrix.x_axis.length().max(matrix.y_axis.length()).max(matrix.z_axis.length());
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis / size);
    // If a matrix loses only the direction `lost`, its cofactor matrix is c * normal * lost^T with c > 0. Here, `normal` is the normal
    // of the plane that remains. With this sign, the result mirrors nothing.
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let longest = [cofactors.x_axis, cofactors.y_axis, cofactors.z_axis]
        .into_iter()
        .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
        .filter(|column| column.length() > MIN_AREA)?;
    let normal = longest.normalize();
    let lost = (cofactors.transpose() * normal).normalize();
    let (mut low, mut high, mut reach) = (f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
    for position in &mesh.positions {
        let position = DVec3::from(position.map(f64::from));
        let height = position.dot(lost);
        (low, high, reach) = (low.min(height), high.max(height), reach.max(position.abs().max_element()));
    }
    let added = size * normal;
    let matrix3 = matrix + DMat3::from_cols(added * lost.x, added * lost.y, added * lost.z);
    let translation = transform.translation - added * (0.5 * (low + high));
    (high - low <= FLAT * reach).then_some(DAffine3 { matrix3, translation })
}
