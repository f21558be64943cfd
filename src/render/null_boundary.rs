//! The meshes that bound a medium. Rays find out which side they are on only if the mesh is closed and its triangles face outwards.

use glam::{DVec3, Vec3};

use crate::error::{Error, Result};
use crate::scene::{Material, Mesh, Scene, surrounding_indices};

/// Fails if a mesh that [`must_be_closed`] is open.
pub fn check(scene: &Scene) -> Result<()> {
    let [outside, _] = surrounding_indices(&scene.media);
    for mesh in &scene.meshes {
        let material = &scene.materials[mesh.material as usize];
        let edges = if must_be_closed(material, mesh, outside) { mesh.open_edges() } else { 0 };
        if edges > 0 {
            return Err(Error::settings(format!(
                "mesh '{}' bounds a medium but is not closed ({edges} of its edges belong to one triangle only); close it, or \
                 remove the medium of material '{}'",
                mesh.name, material.name
            )));
        }
    }
    Ok(())
}

/// Whether `mesh`, which has this material, is a null boundary (see [`Material::is_null_boundary`]), or glass with a medium inside that
/// scatters. Open glass that only absorbs is common in files of other programs, such as the surface of a pool.
fn must_be_closed(material: &Material, mesh: &Mesh, outside: f32) -> bool {
    let scatters = material.interior.as_ref().is_some_and(|medium| medium.sigma_s != [0.0; 3]);
    (scatters && material.transmits()) || material.is_null_boundary(mesh, outside)
}

/// Whether the triangles of a closed mesh face inwards: its signed volume is negative. A cavity counts as negative volume, so a hollow
/// mesh is not inside out.
pub fn is_inside_out(mesh: &Mesh) -> bool {
    let position = |corner: u32| Vec3::from(mesh.positions[corner as usize]).as_dvec3();
    // Far from the origin, volumes of tetrahedra with a corner there would lose digits.
    let first = mesh.triangles.first().map_or(DVec3::ZERO, |triangle| position(triangle[0]));
    let six_volumes = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|corner| position(corner) - first);
        a.dot(b.cross(c))
    });
    six_volumes.sum::<f64>() < 0.0
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::generate::shapes::{append, ball, cuboid, icosphere, inside_out, torus};
    use crate::scene::Medium;

    /// The colours of a mesh tint the light that passes through.
    #[test]
    fn a_mesh_with_colours_is_no_null_boundary() {
        let smoke = Material { interior: Some(Medium::default()), ior: 1.0, ..Material::glass("smoke") };
        let with = |color: [f32; 4]| {
            let plain = cuboid(DVec3::ZERO, DVec3::ONE);
            Mesh { colors: vec![color; plain.positions.len()], ..plain }
        };
        assert!(smoke.is_null_boundary(&cuboid(DVec3::ZERO, DVec3::ONE), 1.0));
        assert!(smoke.is_null_boundary(&with([1.0, 1.0, 1.0, 0.5]), 1.0));
        assert!(!smoke.is_null_boundary(&with([1.0, 0.9, 1.0, 1.0]), 1.0));
    }

    #[test]
    fn glass_around_a_medium_that_scatters_must_be_closed() {
        let milk = Medium { sigma_s: [0.0, 0.0, 1.0], ..Medium::default() };
        let juice = Medium { sigma_a: [1.0; 3], ..Medium::default() };
        let (closed, mut open) = (cuboid(DVec3::ZERO, DVec3::ONE), cuboid(DVec3::ZERO, DVec3::ONE));
        open.triangles.truncate(10);
        let fails = |mesh: &Mesh, ior: f32, interior: &Medium, metallic: f32| {
            let interior = Some(interior.clone());
            let material = Material { interior, ior, metallic, ..Material::glass("bottle") };
            check(&Scene { meshes: vec![mesh.clone()], materials: vec![material], ..Scene::default() }).is_err()
        };
        assert!(fails(&open, 1.33, &milk, 0.0) && fails(&open, 1.0, &milk, 0.0) && fails(&open, 1.0, &juice, 0.0));
        // No light enters metal.
        assert!(!fails(&open, 1.33, &juice, 0.0) && !fails(&open, 1.33, &milk, 1.0));
        assert!(!fails(&closed, 1.33, &milk, 0.0) && !fails(&closed, 1.0, &milk, 0.0));
    }

    #[test]
    fn shapes_are_closed_until_a_triangle_is_missing() {
        let shapes = [cuboid(DVec3::ZERO, DVec3::ONE), icosphere(1.0, 2), ball(1.0, 8, 4), torus(1.0, 0.3, 8, 6)];
        for mut mesh in shapes {
            assert_eq!(mesh.open_edges(), 0);
            mesh.triangles.pop();
            assert!(mesh.open_edges() > 0);
        }
        // A triangle that faces the other way.
        let mut turned = cuboid(DVec3::ZERO, DVec3::ONE);
        turned.triangles[0].reverse();
        assert_eq!(turned.open_edges(), 3);
    }

    #[test]
    fn a_mesh_whose_triangles_face_inwards_is_inside_out() {
        let far = DVec3::splat(1e4);
        for mesh in [cuboid(far, far + DVec3::ONE), icosphere(1.0, 2), torus(1.0, 0.3, 8, 6)] {
            assert!(!is_inside_out(&mesh));
            assert!(is_inside_out(&inside_out(mesh)));
        }
        // A hollow ball: the inner surface faces the cavity.
        let mut hollow = icosphere(1.0, 2);
        append(&mut hollow, &inside_out(icosphere(0.5, 2)), DAffine3::IDENTITY);
        assert!(!is_inside_out(&hollow) && is_inside_out(&inside_out(hollow)));
    }
}
