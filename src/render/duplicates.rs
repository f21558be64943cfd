//! Removes triangles that a file lists more than once. A ray hits only one of the copies. If every copy of a lamp were an
//! emitter, emitter sampling would count the lamp's light once per copy. Rays that hit the lamp would count the light only once.
//! Some files list a face a second time with the opposite orientation, as its back. A ray hits only one of these two as well, and
//! would often see the black back of the wrong one. They become one triangle with two sides.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use crate::bvh::hash::hash;
use crate::wgsl::layout::Triangle;

/// Shading data that distinguishes two triangles with the same corners and material: normal, texture coordinates, colour and
/// tangent per corner, and the matrix that transforms the normals to world space. Values that the material does not use are 0.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct ShadingAttributes {
    /// Normal, u, v, colour (two words) and tangent.
    pub corners: [[u32; 6]; 3],
    pub normal_matrix: [u32; 9],
    /// Whether the triangle only reflects, and only on its front. Then a triangle that faces the other way may become its back.
    pub may_get_back: bool,
}

/// The effect of [`drop_copies`].
#[derive(Debug, Default, PartialEq)]
pub struct Dropped {
    /// Number of copies, and the instance of the first one; `None` without copies. Backs do not count.
    pub copies: Option<(usize, u32)>,
    /// Indices of the remaining triangles whose backs were removed, so that they must be double-sided.
    pub double_sided: Vec<usize>,
}

/// Removes every triangle whose corners, orientation, material and shading attributes equal those of an earlier triangle. Also
/// removes backs: triangles that only reflect, and differ from an earlier one only in orientation, normals and tangents. A triangle
/// without attributes (`None`) stays: it is a translucent layer, and each layer dims the light behind it.
pub fn drop_copies(
    triangles: &mut Vec<Triangle>,
    attributes: impl Fn(&Triangle) -> Option<ShadingAttributes>,
) -> Dropped {
    let face_hash = |t: &Triangle| hash(Face::new(t).key.map(u64::from));
    let mut keys: Vec<(u64, u32)> = triangles.par_iter().enumerate().map(|(i, t)| (face_hash(t), i as u32)).collect();
    keys.par_sort_unstable();
    let (mut copies, mut backs, mut with_back) = (vec![], vec![], vec![]);
    for run in keys.chunk_by(|a, b| a.0 == b.0).filter(|run| run.len() > 1) {
        let mut seen = HashSet::new();
        let mut fronts = HashMap::new();
        for &(_, i) in run {
            let face = Face::new(&triangles[i as usize]);
            let Some(ShadingAttributes { corners, normal_matrix, may_get_back }) = attributes(&triangles[i as usize])
            else {
                continue;
            };
            let corners = face.order.map(|k| corners[k]);
            if !seen.insert((face.key, face.is_turned, corners, normal_matrix)) {
                copies.push(i);
            } else if may_get_back && let Some(is_turned) = face.is_turned {
                let paint =
                    corners.map(|[_normal, u, v, red_green, blue_alpha, _tangent]| [u, v, red_green, blue_alpha]);
                match fronts.entry((face.key, paint)) {
                    Entry::Vacant(new) => drop(new.insert((i, is_turned))),
                    Entry::Occupied(known) => {
                        let &(front, front_is_turned) = known.get();
                        if is_turned != front_is_turned {
                            backs.push(i);
                            with_back.push(front);
                        }
                    }
                }
            }
        }
    }
    copies.sort_unstable();
    with_back.sort_unstable();
    with_back.dedup();
    let copies_of = copies.first().map(|&first| (copies.len(), triangles[first as usize].instance));
    let mut removed = [copies, backs].concat();
    removed.sort_unstable();
    if !removed.is_empty() {
        let mut index = 0;
        triangles.retain(|_| {
            index += 1;
            removed.binary_search(&(index - 1)).is_err()
        });
    }
    let place = |i: u32| i as usize - removed.partition_point(|&other| other < i);
    Dropped { copies: copies_of, double_sided: with_back.into_iter().map(place).collect() }
}

/// A triangle without its orientation.
struct Face {
    /// The bits of the corners in ascending order, then the material.
    key: [u32; 10],
    /// The corners in this order.
    order: [usize; 3],
    /// Whether this order runs against the orientation of the triangle; `None` if corners coincide.
    is_turned: Option<bool>,
}

impl Face {
    fn new(t: &Triangle) -> Face {
        // Adding 0.0 turns -0.0 into 0.0, which is the same position with other bits.
        let bits = |p: [f32; 3]| p.map(|x| (x + 0.0).to_bits());
        let mut corners = [(bits(t.v0), 0), (bits(t.v1), 1), (bits(t.v2), 2)];
        corners.sort_unstable();
        let [(a, i), (b, j), (c, k)] = corners;
        let mut key = [t.material; 10];
        key[..3].copy_from_slice(&a);
        key[3..6].copy_from_slice(&b);
        key[6..9].copy_from_slice(&c);
        Face { key, order: [i, j, k], is_turned: (a != b && b != c).then_some((i + 1) % 3 != j) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::generate::{parts, shapes};
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
            let film = Material { alpha_mode, emission: [emission; 3], ..parts::diffuse("film", [0.5; 3]) };
            let film = Material { base_color: [0.5, 0.5, 0.5, alpha], ..film };
            let film = parts::material(&mut scene, film);
            for name in ["front", "back"] {
                parts::add(&mut scene, name, film, shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]));
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
        assert_eq!(drop_copies(&mut all, plain).copies, Some((4, 4)));
        assert_eq!(all, [&[one], &others[..]].concat());
        assert_eq!(drop_copies(&mut all, plain), Dropped::default());
        assert_eq!(drop_copies(&mut vec![], plain), Dropped::default());
    }

    /// Triangle 1 faces away from triangle 0 and has other normals. It becomes the back of triangle 0, unless the two differ in
    /// colour or are not allowed to.
    #[test]
    fn a_triangle_that_faces_the_other_way_becomes_a_back() {
        let [a, b, c] = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let triangle =
            |[v0, v1, v2]: [[f32; 3]; 3], instance| Triangle { v0, instance, v1, corner: 0, v2, material: 5 };
        let both = [triangle([b, c, a], 0), triangle([a, c, b], 1), triangle([a, b, c], 0), triangle([c, b, a], 1)];
        let drop = |colors: [u32; 3], may_get_back: bool| {
            let mut all = vec![triangle([a, b, [2.0; 3]], 0)];
            all.extend(both);
            let dropped = drop_copies(&mut all, |t| {
                // Values of the corners a, b and c.
                let at = |corner: [f32; 3]| [a, b, c].iter().position(|&other| other == corner).unwrap_or(0);
                let normals = [[1, 2, 3], [4, 5, 6]][t.instance as usize];
                let color = |k: usize| if t.instance == 0 { [7, 8, 9][k] } else { colors[k] };
                let corner = |p: [f32; 3]| [normals[at(p)], 0, 0, color(at(p)), 0, 0];
                let corners = [t.v0, t.v1, t.v2].map(corner);
                Some(ShadingAttributes { corners, may_get_back, ..ShadingAttributes::default() })
            });
            (all.len(), dropped.copies, dropped.double_sided)
        };
        assert_eq!(drop([7, 8, 9], true), (2, Some((2, 0)), vec![1]));
        assert_eq!(drop([7, 9, 8], true), (3, Some((2, 0)), vec![]));
        assert_eq!(drop([7, 8, 9], false), (3, Some((2, 0)), vec![]));
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
        assert_eq!(drop_copies(&mut all, attributes).copies, Some((1, 1)));
        assert_eq!(all, [triangle([a, b, c], 0), triangle([a, b, c], 2)]);
    }
}
