//! Nodes whose transform flattens space to a plane: a scale of 0 along one axis.

use glam::{DAffine3, DMat3, DVec3};

use super::clean::{drop_unused, has_zero_area};
use crate::scene::Mesh;

/// A mesh is flat if its thickness is at most this fraction of its largest coordinate. Rounding can cause such a thickness.
const FLAT: f64 = 1e-6;
/// Smallest area of the largest parallelogram that two axes of the transform span, divided by the square of its longest axis.
const MIN_AREA: f64 = 1e-6;

/// A transform that flattens space to a plane.
pub struct Flattening<'a> {
    transform: &'a DAffine3,
    /// Length of the longest axis of the transform.
    size: f64,
    /// Unit vector: the direction that the transform loses.
    pub lost: DVec3,
    /// Unit normal of the plane that remains. With this sign, [`Flattening::invertible`] mirrors nothing.
    normal: DVec3,
}

impl<'a> Flattening<'a> {
    /// `None` if the transform, which is singular, flattens space to a line or a point.
    pub fn new(transform: &'a DAffine3) -> Option<Flattening<'a>> {
        let matrix = transform.matrix3;
        let size = matrix.x_axis.length().max(matrix.y_axis.length()).max(matrix.z_axis.length());
        let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis / size);
        // If a matrix loses only the direction `lost`, its cofactor matrix is c * normal * lost^T with c > 0.
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let longest = [cofactors.x_axis, cofactors.y_axis, cofactors.z_axis]
            .into_iter()
            .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
            .filter(|column| column.length() > MIN_AREA)?;
        let normal = longest.normalize();
        let lost = (cofactors.transpose() * normal).normalize();
        Some(Flattening { transform, size, lost, normal })
    }

    /// An invertible transform that moves all points of `mesh` to the same places. `None` if there is none, because the mesh is not
    /// flat in the direction that is lost.
    ///
    /// Any scale may replace the 0 in the lost direction, because all points of the mesh have the same coordinate there.
    pub fn invertible(&self, mesh: &Mesh) -> Option<DAffine3> {
        let Flattening { transform, size, lost, normal } = *self;
        let (mut low, mut high, mut reach) = (f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
        for position in &mesh.positions {
            let position = DVec3::from(position.map(f64::from));
            let height = position.dot(lost);
            (low, high, reach) = (low.min(height), high.max(height), reach.max(position.abs().max_element()));
        }
        let added = size * normal;
        let matrix3 = transform.matrix3 + DMat3::from_cols(added * lost.x, added * lost.y, added * lost.z);
        let translation = transform.translation - added * (0.5 * (low + high));
        (high - low <= FLAT * reach).then_some(DAffine3 { matrix3, translation })
    }

    /// A copy of `mesh` that is flat in the lost direction, without normals and tangents: all its normals are those of the plane.
    /// `None` if all triangles vanish, because they are seen edge-on.
    pub fn flatten(&self, mesh: &Mesh) -> Option<Mesh> {
        let mut flat = Mesh { normals: vec![], tangents: vec![], ..mesh.clone() };
        for position in &mut flat.positions {
            let p = DVec3::from(position.map(f64::from));
            *position = (p - self.lost * p.dot(self.lost)).as_vec3().to_array();
        }
        let Mesh { positions, triangles, .. } = &mut flat;
        triangles.retain(|triangle| !has_zero_area(triangle.map(|index| positions[index as usize])));
        drop_unused(&mut flat);
        (!flat.triangles.is_empty()).then_some(flat)
    }
}
