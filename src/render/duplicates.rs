//! Removes triangles that a file lists more than once. A ray hits only one of the copies. If every copy of a lamp were an
//! emitter, emitter sampling would count the lamp's light once per copy. Rays that hit the lamp would count the light only once.

use rayon::prelude::*;

use crate::bvh::hash::hash;
use crate::wgsl::layout::Triangle;

/// Shading data that distinguishes two triangles with the same corners and material: normal, texture coordinates, colour and
/// tangent per corner, and the matrix that transforms the normals to world space. Values that the material does not use are 0.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct ShadingAttributes {
    pub corners: [[u32; 6]; 3],
    pub normal_matrix: [u32; 9],
}

/// Removes every triangle whose corners, orientation, material and shading attributes equal those of an earlier triangle. A
/// triangle without attributes (`None`) stays: it is a translucent layer, and each layer dims the light behind it. Returns the number of
/// removed triangles and the instance of the first one; `None` if no triangle was removed.
pub fn drop_copies(
    triangles: &mut Vec<Triangle>,
    attributes: impl Fn(&Triangle) -> Option<ShadingAttributes>,
) -> Option<(usize, u32)> {
    let mut keys: Vec<(u64, u32)> =
        triangles.par_iter().enumerate().map(|(i, t)| (hash(position_key(t).0.map(u64::from)), i as u32)).collect();
    keys.par_sort_unstable();
    let identity = |t: &Triangle| {
        let (key, first) = position_key(t);
        let ShadingAttributes { corners, normal_matrix } = attributes(t)?;
        Some((key, [0, 1, 2].map(|k| corners[(first + k) % 3]), normal_matrix))
    };
    let mut copies = vec![];
    for run in keys.chunk_by(|a, b| a.0 == b.0).filter(|run| run.len() > 1) {
        let mut seen = std::collections::HashSet::new();
        let mut is_copy = |i: u32| identity(&triangles[i as usize]).is_some_and(|identity| !seen.insert(identity));
        copies.extend(run.iter().map(|&(_, i)| i).filter(|&i| is_copy(i)));
    }
    copies.sort_unstable();
    let first = triangles[*copies.first()? as usize].instance;
    let mut index = 0;
    triangles.retain(|_| {
        index += 1;
        copies.binary_search(&(index - 1)).is_err()
    });
    Some((copies.len(), first))
}

/// Key that is equal for triangles with the same corners, orientation and material: the bits of the corners, rotated so that
/// the smallest comes first, then the material. Also returns the index of that smallest corner.
fn position_key(t: &Triangle) -> ([u32; 10], usize) {
    // Adding 0.0 turns -0.0 into 0.0, which is the same position with other bits.
    let corner = |p: [f32; 3]| p.map(|x| (x + 0.0).to_bits());
    let [a, b, c] = [t.v0, t.v1, t.v2].map(corner);
    let rotations = [([a, b, c], 0), ([b, c, a], 1), ([c, a, b], 2)];
    let ([a, b, c], first) = rotations.into_iter().min().expect("three rotations");
    let mut all = [t.material; 10];
    all[..3].copy_from_slice(&a);
    all[3..6].copy_from_slice(&b);
    all[6..9].copy_from_slice(&c);
    (all, first)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::generate::{shapes, stage};
    use crate::render::albedo::AlbedoTable;
    use crate::render::geometry::Geometry;
    use crate::render::space::RenderSpace;
    use crate::scene::{AlphaMode, Material, Scene};
    use crate::settings::Emitters;

    /// Two quads in one place. Each translucent layer dims the light behind it, but a lamp must not shine twice.
    #[test]
    fn translucent_layers_in_one_place_stay() {
        let cases = [
            (AlphaMode::Blend, 0.5, 0.0, 4),
            (AlphaMode::Blend, 0.5, 1.0, 2),
            (AlphaMode::Blend, 1.0, 0.0, 2),
            (AlphaMode::Mask(0.6), 0.5, 0.0, 2),
        ];
        for (alpha_mode, alpha, emission, expected) in cases {
            let mut scene = Scene::default();
            let film = Material { alpha_mode, emission: [emission; 3], ..stage::diffuse("film", [0.5; 3]) };
            let film = Material { base_color: [0.5, 0.5, 0.5, alpha], ..film };
            let film = stage::material(&mut scene, film);
            for name in ["front", "back"] {
                stage::add(&mut scene, name, film, shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]));
            }
            let space = RenderSpace::metres(DVec3::ZERO);
            let geometry = Geometry::new(&scene, &space, &Emitters::Scene, AlbedoTable::shared());
            assert_eq!(geometry.triangles.len(), expected, "{alpha_mode:?}, alpha {alpha}, emission {emission}");
        }
    }

    #[test]
    fn copies_are_those_that_cannot_be_told_apart() {
        let [a, b, c] = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let triangle = |[v0, v1, v2]: [[f32; 3]; 3], instance, material| Triangle {
            v0,
            instance,
            v1,
            corner: 7 * instance,
            v2,
            material,
        };
        let plain = |_: &Triangle| Some(ShadingAttributes::default());
        let one = triangle([a, b, c], 0, 5);
        let others = [
            triangle([b, a, c], 1, 5),
            triangle([a, b, c], 2, 6),
            triangle([a, b, [0.0, 1.0, 1.0f32.next_up()]], 3, 5),
        ];
        let copies = [triangle([a, b, c], 4, 5), triangle([b, c, a], 5, 5), triangle([[-0.0, 0.0, 1.0], b, c], 6, 5)];
        let mut all = [&[one], &others[..], &copies, &[one]].concat();
        assert_eq!(drop_copies(&mut all, plain), Some((4, 4)));
        assert_eq!(all, [&[one], &others[..]].concat());
        assert_eq!(drop_copies(&mut all, plain), None);
        assert_eq!(drop_copies(&mut vec![], plain), None);
    }
    #[test]
    fn layers_with_textures_of_their_own_are_no_copies() {
        let [a, b, c] = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let triangle =
            |[v0, v1, v2]: [[f32; 3]; 3], instance| Triangle { v0, instance, v1, corner: 0, v2, material: 5 };
        // Instance 1 lists the same corners with the same texture coordinates, but starts at another corner. Instance 2 has
        // other texture coordinates.
        let coordinates = [[[7; 6], [8; 6], [9; 6]], [[8; 6], [9; 6], [7; 6]], [[7; 6], [8; 6], [1; 6]]];
        let attributes = |t: &Triangle| {
            let corners = coordinates[t.instance as usize];
            Some(ShadingAttributes { corners, ..ShadingAttributes::default() })
        };
        let mut all = vec![triangle([a, b, c], 0), triangle([b, c, a], 1), triangle([a, b, c], 2)];
        assert_eq!(drop_copies(&mut all, attributes), Some((1, 1)));
        assert_eq!(all, [triangle([a, b, c], 0), triangle([a, b, c], 2)]);
    }
}
