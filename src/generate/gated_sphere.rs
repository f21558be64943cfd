//! `gated-sphere`: the closed diffuse sphere whose gated radiance is known exactly.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::parts::{add, camera, diffuse, light, material};
use super::shapes::{icosphere, inside_out};
use crate::scene::{LightKind, Mesh, Scene};

/// A sphere of flat facets seen from inside, with the camera and a point light of intensity pi R^2 in W / sr at its centre. Flat
/// facets lie inside the sphere of their vertices. So the vertices lie slightly outside `radius`: the centroids of the facets,
/// weighted by area, then have the mean distance `radius`.
pub fn build(radius: f32, subdivisions: u32, albedo: f32) -> Scene {
    let mut scene = Scene::default();
    let radius = f64::from(radius);
    let wall = material(&mut scene, diffuse("wall", [albedo; 3]));
    let unit = mean_centroid_distance(&icosphere(1.0, subdivisions));
    let sphere = inside_out(icosphere(radius / unit, subdivisions));
    add(&mut scene, "sphere", wall, sphere);
    let intensity = [(PI * radius * radius) as f32; 3];
    light(&mut scene, "light", DVec3::ZERO, DVec3::NEG_Z, LightKind::Point { intensity });
    camera(&mut scene, DVec3::ZERO, DVec3::NEG_Z, PI / 2.0, [64, 64]);
    scene
}

/// Mean distance of the facets' centroids from the origin, weighted by area.
fn mean_centroid_distance(mesh: &Mesh) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| Vec3::from_array(mesh.positions[i as usize]).as_dvec3());
        let area = (b - a).cross(c - a).length() / 2.0;
        sum += area * ((a + b + c) / 3.0).length();
        weights += area;
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facets_are_at_the_radius_on_average_and_face_inwards() {
        let scene = build(2.0, 4, 0.5);
        let mesh = &scene.meshes[0];
        assert!((mean_centroid_distance(mesh) - 2.0).abs() < 1e-5);
        assert!(mesh.normals.is_empty());
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| Vec3::from_array(mesh.positions[i as usize]));
            assert!((b - a).cross(c - a).dot(a) < 0.0);
        }
    }
}
