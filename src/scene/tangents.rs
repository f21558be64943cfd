//! Tangents for normal maps, as glTF prescribes them for meshes without tangents: MikkTSpace (Mikkelsen 2008).

use std::collections::HashMap;

use glam::Vec3;

use super::Mesh;
use super::check::{check_arrays, in_the_scene};
use crate::error::Result;

/// Maximum number of triangles that may share a vertex: MikkTSpace needs stack space for each of them.
const MAX_SHARED: u64 = 4096;

impl Mesh {
    /// Computes [`Mesh::tangents`] from positions, normals and texture coordinates. Vertices whose triangles need different
    /// tangents are split. Without texture coordinates it does nothing. Fails without any change if an array of the mesh breaks a rule
    /// of [`Scene::check`](super::Scene::check), or if more than 4096 triangles share a vertex.
    pub fn add_tangents(&mut self) -> Result<()> {
        check_arrays(self).map_err(in_the_scene)?;
        if self.tangent_work().is_none() {
            return Err(in_the_scene(format!(
                "in mesh '{}' more than {MAX_SHARED} triangles share a vertex, which is too many for tangents; divide the mesh, or \
                 leave out its normal map",
                self.name
            )));
        }
        self.compute_tangents();
        Ok(())
    }

    /// As [`Mesh::add_tangents`], without its checks: the arrays must be valid, and [`Mesh::tangent_work`] must not be `None`.
    pub(super) fn compute_tangents(&mut self) {
        if self.uvs.is_empty() {
            return;
        }
        let mut corners = Corners { mesh: self, tangents: vec![[0.0; 4]; 3 * self.triangles.len()] };
        // This cannot fail: the error type has no values.
        let _ = bevy_mikktspace::generate_tangents(&mut corners);
        let tangents = corners.tangents;
        self.split_by_tangent(&tangents);
    }

    /// How long [`Mesh::add_tangents`] takes: the sum over all vertices of the square of the number of triangles that share the vertex.
    /// `None` if more than [`MAX_SHARED`] triangles share one.
    pub(crate) fn tangent_work(&self) -> Option<u64> {
        if self.uvs.is_empty() {
            return Some(0);
        }
        let corners = Corners { mesh: self, tangents: vec![] };
        // MikkTSpace joins vertices with the same position, normal and texture coordinates.
        let mut shared: HashMap<[u32; 8], u64> = HashMap::new();
        for face in 0..self.triangles.len() {
            let normal = self.normals.is_empty().then(|| corners.face_normal(face).to_array());
            for vertex in self.triangles[face].map(|corner| corner as usize) {
                let ([x, y, z], [u, v]) = (self.positions[vertex], self.uvs[vertex]);
                let [p, q, r] = normal.unwrap_or_else(|| self.normals[vertex]);
                *shared.entry([x, y, z, p, q, r, u, v].map(f32::to_bits)).or_default() += 1;
            }
        }
        shared.values().all(|&count| count <= MAX_SHARED).then(|| shared.values().map(|count| count * count).sum())
    }

    /// Gives every corner its tangent: a vertex becomes one vertex per distinct tangent of its corners.
    fn split_by_tangent(&mut self, tangents: &[[f32; 4]]) {
        let old = std::mem::take(self);
        let mut known: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
        let mut sources = vec![];
        for (&vertex, &tangent) in old.triangles.as_flattened().iter().zip(tangents) {
            known.entry((vertex, tangent.map(f32::to_bits))).or_insert_with(|| {
                sources.push(vertex as usize);
                self.tangents.push(tangent);
                sources.len() as u32 - 1
            });
        }
        let number = |corner: usize| {
            let vertex = old.triangles.as_flattened()[corner];
            known[&(vertex, tangents[corner].map(f32::to_bits))]
        };
        self.triangles = (0..old.triangles.len()).map(|i| [0, 1, 2].map(|k| number(3 * i + k))).collect();
        fn pick<T: Copy>(values: &[T], sources: &[usize]) -> Vec<T> {
            if values.is_empty() { vec![] } else { sources.iter().map(|&i| values[i]).collect() }
        }
        self.positions = pick(&old.positions, &sources);
        self.normals = pick(&old.normals, &sources);
        self.uvs = pick(&old.uvs, &sources);
        self.colors = pick(&old.colors, &sources);
        (self.name, self.material) = (old.name, old.material);
    }
}

/// The corners of a mesh, as MikkTSpace reads them.
struct Corners<'a> {
    mesh: &'a Mesh,
    /// One per corner, in the order of the triangles.
    tangents: Vec<[f32; 4]>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.triangles[face][corner] as usize
    }

    fn face_normal(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.mesh.triangles[face].map(|i| Vec3::from(self.mesh.positions[i as usize]).as_dvec3());
        (b - a).cross(c - a).normalize_or(glam::DVec3::Z).as_vec3()
    }
}

impl bevy_mikktspace::Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)]
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        match self.mesh.normals.get(self.vertex(face, corner)) {
            Some(&normal) => normal,
            None => self.face_normal(face).to_array(),
        }
    }

    /// The v axis of glTF points down in the image, but the green channel of a normal map points up.
    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let [u, v] = self.mesh.uvs[self.vertex(face, corner)];
        [u, -v]
    }

    fn set_tangent(&mut self, tangent: Option<bevy_mikktspace::TangentSpace>, face: usize, corner: usize) {
        let normal = Vec3::from(self.normal(face, corner));
        let [x, y, z, w] = tangent.unwrap_or_default().tangent_encoded();
        // A triangle without extent in the texture may have no tangent. Then any vector perpendicular to the normal serves.
        let along = Vec3::new(x, y, z);
        let unit = along.try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        self.tangents[3 * face + corner] = [unit.x, unit.y, unit.z, w];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quad in the plane z = 0 with u along x and, as images are stored, v along -y.
    fn quad(mirrored: bool) -> Mesh {
        let u = |x: f32| if mirrored { -x } else { x };
        Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            uvs: vec![[u(0.0), 0.0], [u(1.0), 0.0], [u(1.0), -1.0], [u(0.0), -1.0]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn red_points_right_and_green_points_up() {
        for (mirrored, tangent) in [(false, [1.0, 0.0, 0.0, 1.0]), (true, [-1.0, 0.0, 0.0, -1.0])] {
            for normals in [vec![], vec![[0.0, 0.0, 1.0]; 4]] {
                let mut mesh = Mesh { normals, ..quad(mirrored) };
                mesh.add_tangents().unwrap();
                assert_eq!((mesh.tangents.len(), mesh.positions.len(), mesh.uvs.len()), (4, 4, 4));
                // cross(normal, tangent) w is the direction of green: +y in both cases.
                assert!(mesh.tangents.iter().all(|t| *t == tangent), "{mirrored}: {:?}", mesh.tangents);
            }
        }
    }

    #[test]
    fn vertices_between_mirrored_halves_are_split() {
        // Two quads share an edge, across which the texture is mirrored.
        let mut mesh = quad(false);
        mesh.positions.extend([[2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]);
        mesh.uvs.extend([[0.0, 0.0], [0.0, -1.0]]);
        mesh.colors = (0..6).map(|i| [i as f32 / 5.0, 0.0, 0.0, 1.0]).collect();
        mesh.triangles.extend([[1, 4, 5], [1, 5, 2]]);
        let before = mesh.clone();
        mesh.add_tangents().unwrap();
        assert_eq!((mesh.positions.len(), mesh.tangents.len(), mesh.colors.len()), (8, 8, 8));
        for (old, new) in before.triangles.as_flattened().iter().zip(mesh.triangles.as_flattened()) {
            let (old, new) = (*old as usize, *new as usize);
            assert_eq!((before.positions[old], before.uvs[old]), (mesh.positions[new], mesh.uvs[new]));
            assert_eq!(before.colors[old], mesh.colors[new]);
        }
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let w = if i < 2 { 1.0 } else { -1.0 };
            assert!(triangle.iter().all(|&v| mesh.tangents[v as usize] == [w, 0.0, 0.0, w]));
        }
    }

    #[test]
    fn degenerate_texture_coordinates_give_unit_tangents() {
        let mut mesh = Mesh { uvs: vec![[0.5, 0.5]; 4], ..quad(false) };
        mesh.add_tangents().unwrap();
        assert!(mesh.tangents.iter().all(|&[x, y, z, _]| (Vec3::new(x, y, z).length() - 1.0).abs() < 1e-6));
        let mut plain = Mesh { uvs: vec![], ..quad(false) };
        plain.add_tangents().unwrap();
        assert!(plain.tangents.is_empty());
    }

    #[test]
    fn a_mesh_without_valid_tangents_is_refused() {
        let lost = Mesh { triangles: vec![[0, 1, 9]], ..quad(false) };
        let short = Mesh { uvs: vec![[0.0; 2]; 3], ..quad(false) };
        // A fan of triangles around one vertex.
        let around = |i: u32| [f64::from(i).cos() as f32, f64::from(i).sin() as f32, 0.0];
        let positions: Vec<[f32; 3]> = [[0.0; 3]].into_iter().chain((0..5000).map(around)).collect();
        let uvs = positions.iter().map(|&[x, y, _]| [x, y]).collect();
        let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
        let triangles = (1..4999).map(|i| [0, i, i + 1]).collect();
        let fan = Mesh { positions, normals, uvs, triangles, ..Mesh::default() };
        for (mesh, part) in [
            (lost, "a triangle with corner 9, but only 4 positions"),
            (short, "3 uvs for 4 positions"),
            (fan, "more than 4096 triangles share a vertex"),
        ] {
            let mut same = mesh.clone();
            let error = same.add_tangents().unwrap_err().to_string();
            assert!(error.contains(part) && same == mesh, "{error}");
        }
    }
}
