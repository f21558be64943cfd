//! The shape of a mesh: whether it is closed or flat. Glass on meshes that can bound a solid refracts light; other glass is thin.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::Mesh;

/// A mesh is flat if its thickness is below this part of its size.
const FLATNESS: f64 = 1e-6;

impl Mesh {
    /// Whether the mesh can bound a solid: it is closed and has a volume.
    pub(crate) fn is_closed(&self) -> bool {
        self.open_edges() == 0 && !self.is_flat()
    }

    /// Number of edges that lack a partner: a triangle that runs along the edge in the other direction. Corners at the same position
    /// count as one.
    pub(crate) fn open_edges(&self) -> usize {
        self.edges_where(|sum, _| sum != 0)
    }

    /// Number of edges with an odd number of triangles. 0 for a closed mesh, also if some of its faces are turned around.
    pub(crate) fn unpaired_edges(&self) -> usize {
        self.edges_where(|_, count| count % 2 == 1)
    }

    /// Number of edges with a property: of the triangles that run along the edge, each counted as 1 or -1 by its direction, and of their
    /// number.
    fn edges_where(&self, has: impl Fn(i64, i64) -> bool) -> usize {
        // The sum turns -0 into 0.
        let place = |corner: u32| self.positions[corner as usize].map(|x| (x + 0.0).to_bits());
        let mut edges: HashMap<_, (i64, i64)> = HashMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(place);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (sum, count) = edges.entry((from.min(to), from.max(to))).or_default();
                *sum += if from < to { 1 } else { -1 };
                *count += 1;
            }
        }
        // An edge whose two ends have the same position has no direction, so it does not count.
        edges.into_iter().filter(|((a, b), (sum, count))| a != b && has(*sum, *count)).count()
    }

    /// Whether all triangles lie in one plane, as those of a window that is modelled as one plane.
    pub(crate) fn is_flat(&self) -> bool {
        self.triangles.is_empty() || self.plane_normal().is_some()
    }

    /// Unit normal of the plane in which all triangles lie; `None` if there is no such plane. Zero if no triangle has an area.
    pub(crate) fn plane_normal(&self) -> Option<DVec3> {
        let position = |corner: u32| Vec3::from(self.positions[corner as usize]).as_dvec3();
        let origin = position(self.triangles.first()?[0]);
        let corners = || self.triangles.iter().flatten().map(|&corner| position(corner) - origin);
        let normals = self.triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(position);
            (b - a).cross(c - a)
        });
        let largest = normals.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let normal = largest.unwrap_or(DVec3::ZERO).normalize_or_zero();
        let size = corners().map(|corner| corner.length()).fold(0.0, f64::max);
        corners().all(|corner| corner.dot(normal).abs() <= FLATNESS * size).then_some(normal)
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::generate::shapes::{append, cuboid, icosphere, inside_out};

    #[test]
    fn a_closed_mesh_with_a_volume_can_bound_a_solid() {
        let cube = cuboid(DVec3::ZERO, DVec3::ONE);
        assert!(cube.is_closed() && inside_out(cube.clone()).is_closed() && icosphere(1.0, 2).is_closed());
        let mut open = cube.clone();
        open.triangles.pop();
        assert!(!open.is_closed() && !open.is_flat());
    }

    /// Two windows back to back have no open edge, but nothing is between them.
    #[test]
    fn a_plane_cannot_bound_a_solid() {
        let quad = Mesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 2.0, 1.0], [0.0, 2.0, 0.0]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        assert!(quad.is_flat() && quad.open_edges() == 4);
        let mut both = quad.clone();
        append(&mut both, &inside_out(quad), DAffine3::IDENTITY);
        assert!(both.open_edges() == 0 && !both.is_closed());
    }
}
