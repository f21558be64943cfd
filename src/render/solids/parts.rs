//! The closed parts of a mesh: sets of triangles that share corners.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::solid_angle;
use crate::scene::Mesh;

/// Meshes with more parts are not searched for parts inside of parts.
const MAX_PARTS: usize = 64;

/// A part of a closed mesh, in the space of the mesh.
#[derive(Clone)]
pub struct Part {
    /// Indices of its triangles.
    pub triangles: Vec<u32>,
    /// Whether its triangles face inwards: its signed volume is negative.
    pub is_inward: bool,
    /// Corners of its box.
    pub bounds: [DVec3; 2],
    /// Index of the innermost part that contains this one.
    pub parent: Option<usize>,
    /// Number of parts that contain this one.
    pub depth: usize,
}

impl Part {
    /// A corner of the part.
    pub fn corner(&self, mesh: &Mesh) -> DVec3 {
        corners(mesh, self.triangles[0])[0]
    }
}

/// The parts of `mesh`, which must be closed. Triangles belong together if they share a corner; corners at the same position count as
/// one.
pub fn parts(mesh: &Mesh) -> Vec<Part> {
    let numbers = group(mesh);
    let count = numbers.iter().max().map_or(0, |&last| last as usize + 1);
    let mut lists = vec![vec![]; count];
    for (triangle, &part) in numbers.iter().enumerate() {
        lists[part as usize].push(triangle as u32);
    }
    let mut parts: Vec<Part> = lists.into_iter().map(|triangles| part(mesh, triangles)).collect();
    if parts.len() <= MAX_PARTS {
        nest(mesh, &mut parts);
    }
    parts
}

/// Whether the triangles of the closed surface `triangles` are around `point`, whichever way they face. A point on the surface is outside.
pub fn surrounds(mesh: &Mesh, triangles: &[u32], point: DVec3) -> bool {
    let angle = |&t: &u32| solid_angle(corners(mesh, t).map(|corner| corner - point));
    triangles.iter().map(angle).sum::<f64>().abs() > 3.0 * std::f64::consts::PI
}

/// Whether the box `inner` lies in the box `outer`.
pub fn is_in(inner: [DVec3; 2], outer: [DVec3; 2]) -> bool {
    inner[0].cmpge(outer[0]).all() && inner[1].cmple(outer[1]).all()
}

fn corners(mesh: &Mesh, triangle: u32) -> [DVec3; 3] {
    mesh.triangles[triangle as usize].map(|corner| Vec3::from(mesh.positions[corner as usize]).as_dvec3())
}

fn part(mesh: &Mesh, triangles: Vec<u32>) -> Part {
    // Far from the origin, volumes of tetrahedra with a corner there would lose digits.
    let first = corners(mesh, triangles[0])[0];
    let mut volume = 0.0;
    let mut bounds = [first, first];
    for &t in &triangles {
        let points = corners(mesh, t);
        bounds = points.iter().fold(bounds, |[lo, hi], &p| [lo.min(p), hi.max(p)]);
        let [a, b, c] = points.map(|p| p - first);
        volume += a.dot(b.cross(c));
    }
    Part { triangles, is_inward: volume < 0.0, bounds, parent: None, depth: 0 }
}

/// Sets parent and depth of all parts.
fn nest(mesh: &Mesh, parts: &mut [Part]) {
    for inner in 0..parts.len() {
        let point = parts[inner].corner(mesh);
        let contains = |outer: &usize| {
            let other = &parts[*outer];
            *outer != inner && is_in(parts[inner].bounds, other.bounds) && surrounds(mesh, &other.triangles, point)
        };
        let around: Vec<usize> = (0..parts.len()).filter(contains).collect();
        let size = |part: &usize| parts[*part].bounds[1].distance(parts[*part].bounds[0]);
        let parent = around.iter().copied().min_by(|a, b| size(a).total_cmp(&size(b)));
        (parts[inner].parent, parts[inner].depth) = (parent, around.len());
    }
}

/// The number of the part of each triangle, counted from 0 in the order of the triangles.
fn group(mesh: &Mesh) -> Vec<u32> {
    let mut places: HashMap<[u32; 3], u32> = HashMap::new();
    // Adding 0 turns -0 into 0.
    let place = |p: &[f32; 3]| p.map(|x| (x + 0.0).to_bits());
    let welded: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = places.len() as u32;
            *places.entry(place(p)).or_insert(next)
        })
        .collect();
    let mut above: Vec<u32> = (0..places.len() as u32).collect();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| root(&mut above, welded[corner as usize]));
        above[b as usize] = a;
        let c = root(&mut above, c);
        above[c as usize] = root(&mut above, a);
    }
    let mut numbers: HashMap<u32, u32> = HashMap::new();
    let of_triangle = |triangle: &[u32; 3]| {
        let root = root(&mut above, welded[triangle[0] as usize]);
        let next = numbers.len() as u32;
        *numbers.entry(root).or_insert(next)
    };
    mesh.triangles.iter().map(of_triangle).collect()
}

/// The representative of `place`. Shortens the way to it.
fn root(above: &mut [u32], mut place: u32) -> u32 {
    while above[place as usize] != place {
        let next = above[above[place as usize] as usize];
        above[place as usize] = next;
        place = next;
    }
    place
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::generate::shapes::{append, cuboid, icosphere, inside_out};

    #[test]
    fn parts_are_found_with_their_orientation_and_nesting() {
        let mut mesh = icosphere(1.0, 1);
        append(&mut mesh, &inside_out(icosphere(0.5, 1)), DAffine3::IDENTITY);
        append(&mut mesh, &icosphere(0.25, 1), DAffine3::IDENTITY);
        append(&mut mesh, &inside_out(cuboid(DVec3::splat(2.0), DVec3::splat(3.0))), DAffine3::IDENTITY);
        let parts = parts(&mesh);
        let found: Vec<_> = parts.iter().map(|p| (p.triangles.len(), p.is_inward, p.parent, p.depth)).collect();
        assert_eq!(found, [(80, false, None, 0), (80, true, Some(0), 1), (80, false, Some(1), 2), (12, true, None, 0)]);
        assert_eq!(parts[3].bounds, [DVec3::splat(2.0), DVec3::splat(3.0)]);
    }
}
