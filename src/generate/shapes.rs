//! Procedural meshes in their own space, counter-clockwise as seen from outside. The caller sets names and materials.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DAffine3, DVec3};

use super::numbers::sin_cos;
use crate::scene::Mesh;

/// Parallelogram with corners `corner`, `corner + u`, `corner + u + v` and `corner + v`; its front faces along u x v. Images
/// appear upright: texture coordinates are (0, 0) at `corner + v` and `uv` at `corner + u`.
pub fn quad(corner: DVec3, u: DVec3, v: DVec3, uv: [f32; 2]) -> Mesh {
    let corners = [corner, corner + u, corner + u + v, corner + v];
    Mesh {
        positions: corners.map(single).to_vec(),
        uvs: vec![[0.0, uv[1]], uv, [uv[0], 0.0], [0.0, 0.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// Closed box between two corners with flat faces. Texture coordinates on every face are in metres.
pub fn cuboid(min: DVec3, max: DVec3) -> Mesh {
    let size = max - min;
    let (x, y, z) = (DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z);
    let mut mesh = Mesh::default();
    let faces = [(min, y, x), (min + z, x, y), (min, z, y), (min + x, y, z), (min, x, z), (min + y, z, x)];
    for (corner, u, v) in faces {
        append(&mut mesh, &quad(corner, u, v, [u.length() as f32, v.length() as f32]), DAffine3::IDENTITY);
    }
    mesh
}

/// Splits every triangle into four, `times` times, without changing the surface. The mesh must have texture coordinates and no
/// normals.
pub fn divided(mut mesh: Mesh, times: u32) -> Mesh {
    for _ in 0..times {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let between = |p: &[f32], q: &[f32]| p.iter().zip(q).map(|(x, y)| 0.5 * (x + y)).collect::<Vec<f32>>();
                let p = between(&mesh.positions[a as usize], &mesh.positions[b as usize]);
                let uv = between(&mesh.uvs[a as usize], &mesh.uvs[b as usize]);
                mesh.positions.push([p[0], p[1], p[2]]);
                mesh.uvs.push([uv[0], uv[1]]);
                mesh.positions.len() as u32 - 1
            })
        };
        let quarters = |[a, b, c]: [u32; 3]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        mesh.triangles = mesh.triangles.iter().copied().flat_map(quarters).collect();
    }
    mesh
}

/// Icosahedron split `subdivisions` = n times, with its vertices on the sphere of `radius`: 20 * 4^n flat facets.
pub fn icosphere(radius: f64, subdivisions: u32) -> Mesh {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        vertices.push(DVec3::new(a, b, 0.0).normalize());
    }
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        vertices.push(DVec3::new(0.0, a, b).normalize());
    }
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        vertices.push(DVec3::new(b, 0.0, a).normalize());
    }
    #[rustfmt::skip]
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
        [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10],
        [8, 6, 7], [9, 8, 1],
    ];
    for _ in 0..subdivisions {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32, vertices: &mut Vec<DVec3>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
                vertices.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let ab = middle(a, b, &mut vertices);
            let bc = middle(b, c, &mut vertices);
            let ca = middle(c, a, &mut vertices);
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let positions = vertices.iter().map(|&v| single(v * radius)).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

/// Surface of revolution about the y axis. `profile` lists (radius, y) from the bottom up along the outside. A point given twice
/// is a crease; elsewhere shading is smooth. Points of radius 0 close the shape.
pub fn lathe(profile: &[[f64; 2]], segments: u32) -> Mesh {
    let normals = profile_normals(profile);
    let mut mesh = Mesh::default();
    let rows = profile.len() as u32;
    for column in 0..=segments {
        let turn = f64::from(column) / f64::from(segments);
        let (sin, cos) = if column == segments { (0.0, 1.0) } else { sin_cos(turn * TAU) };
        for (row, (&[radius, y], &[nr, ny])) in profile.iter().zip(&normals).enumerate() {
            mesh.positions.push(single(DVec3::new(radius * sin, y, radius * cos)));
            mesh.normals.push(single(DVec3::new(nr * sin, ny, nr * cos).normalize()));
            mesh.uvs.push([turn as f32, 1.0 - row as f32 / (rows - 1) as f32]);
        }
    }
    for column in 0..segments {
        for row in 0..rows - 1 {
            if profile[row as usize] == profile[row as usize + 1] {
                continue;
            }
            let a = column * rows + row;
            let b = a + rows;
            // At a pole one of the two triangles would be degenerate.
            if profile[row as usize][0] > 0.0 {
                mesh.triangles.push([a, b, a + 1]);
            }
            if profile[row as usize + 1][0] > 0.0 {
                mesh.triangles.push([b, b + 1, a + 1]);
            }
        }
    }
    mesh
}

/// Outward (radial, y) normals of a profile, not normalised. Each is the sum of the normals of the adjoining segments. At creases and
/// ends there is only one such segment.
fn profile_normals(profile: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let segment = |i: usize, j: usize| {
        let (dr, dy) = (profile[j][0] - profile[i][0], profile[j][1] - profile[i][1]);
        let length = (dr * dr + dy * dy).sqrt();
        if length > 0.0 { [dy / length, -dr / length] } else { [0.0, 0.0] }
    };
    let last = profile.len() - 1;
    (0..=last)
        .map(|i| {
            let before = if i > 0 { segment(i - 1, i) } else { [0.0, 0.0] };
            let after = if i < last { segment(i, i + 1) } else { [0.0, 0.0] };
            let sum = [before[0] + after[0], before[1] + after[1]];
            // At a pole the normal lies along the axis.
            if profile[i][0] == 0.0 { [0.0, if i == 0 { -1.0 } else { 1.0 }] } else { sum }
        })
        .collect()
}

/// Smooth ball around the origin, with 2 * segments * (rings - 1) triangles.
pub fn ball(radius: f64, segments: u32, rings: u32) -> Mesh {
    let profile: Vec<[f64; 2]> = (0..=rings)
        .map(|i| {
            let (sin, cos) = sin_cos(std::f64::consts::PI * f64::from(i) / f64::from(rings));
            [if i == 0 || i == rings { 0.0 } else { radius * sin }, -radius * cos]
        })
        .collect();
    lathe(&profile, segments)
}

/// Capped cylinder that stands on y = 0, with 4 * segments triangles.
pub fn cylinder(radius: f64, height: f64, segments: u32) -> Mesh {
    let (foot, head) = ([radius, 0.0], [radius, height]);
    lathe(&[[0.0, 0.0], foot, foot, head, head, [0.0, height]], segments)
}

/// Smooth torus around the y axis, with 2 * around * across triangles.
pub fn torus(major: f64, minor: f64, around: u32, across: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=around {
        let (sin, cos) = sin_cos(TAU * f64::from(i % around) / f64::from(around));
        let out = DVec3::new(sin, 0.0, cos);
        for j in 0..=across {
            let (up, outward) = sin_cos(TAU * f64::from(j % across) / f64::from(across));
            let normal = out * outward + DVec3::Y * up;
            mesh.positions.push(single(out * major + normal * minor));
            mesh.normals.push(single(normal));
            mesh.uvs.push([i as f32 / around as f32, j as f32 / across as f32]);
        }
    }
    for i in 0..around {
        for j in 0..across {
            let a = i * (across + 1) + j;
            let b = a + across + 1;
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    mesh
}

/// Adds `part` to `mesh`, transformed by `transform`, which must not mirror. Both meshes must have the same attributes.
pub fn append(mesh: &mut Mesh, part: &Mesh, transform: DAffine3) {
    let first = mesh.positions.len() as u32;
    let rotate = transform.matrix3.inverse().transpose();
    mesh.positions.extend(part.positions.iter().map(|&p| single(transform.transform_point3(double(p)))));
    mesh.normals.extend(part.normals.iter().map(|&n| single((rotate * double(n)).normalize())));
    mesh.uvs.extend(&part.uvs);
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
}

/// The same surface with front and back exchanged.
pub fn inside_out(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = n.map(|x| -x));
    mesh
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

fn double(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(v).as_dvec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed volume of a closed mesh: positive if every face is counter-clockwise as seen from outside.
    fn volume(mesh: &Mesh) -> f64 {
        let at = |i: u32| double(mesh.positions[i as usize]);
        mesh.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    #[test]
    fn closed_shapes_have_their_volume() {
        let pi = std::f64::consts::PI;
        assert!((volume(&cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0))) - 6.0).abs() < 1e-6);
        assert!((volume(&icosphere(1.0, 4)) - 4.0 / 3.0 * pi).abs() < 0.02);
        assert!((volume(&ball(1.0, 64, 32)) - 4.0 / 3.0 * pi).abs() < 0.03);
        assert!((volume(&cylinder(1.0, 2.0, 64)) - 2.0 * pi).abs() < 0.02);
        assert!((volume(&torus(1.0, 0.25, 64, 32)) - 2.0 * pi * pi * 0.0625).abs() < 0.02);
        assert!((volume(&inside_out(icosphere(1.0, 4))) + 4.0 / 3.0 * pi).abs() < 0.02);
    }

    #[test]
    fn counts_and_normals() {
        assert_eq!(icosphere(1.0, 6).triangles.len(), 81_920);
        assert_eq!(icosphere(1.0, 3).positions.len(), 642);
        assert_eq!(ball(1.0, 16, 8).triangles.len(), 2 * 16 * 7);
        assert_eq!(cylinder(1.0, 1.0, 12).triangles.len(), 48);
        for mesh in [ball(2.0, 16, 8), cylinder(1.0, 1.0, 12), torus(1.0, 0.2, 12, 8)] {
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|i| double(mesh.positions[i as usize]));
                let normal = (b - a).cross(c - a);
                assert!(normal.length() > 0.0);
                for &i in triangle {
                    assert!(normal.dot(double(mesh.normals[i as usize])) > 0.0);
                }
            }
        }
    }
}
