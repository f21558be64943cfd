//! The scene as triangles in world space, a bounding volume hierarchy over them, and rays. All numbers are f64.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3, Vec4};
use taugate::Scene;

/// A triangle in world space. Seen from the front, its corners are counter-clockwise, except in mirrored instances.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    corner: DVec3,
    edge1: DVec3,
    edge2: DVec3,
    /// Unit normal of the front side.
    pub normal: DVec3,
    /// Index into `Scene::instances`.
    pub instance: u32,
    /// Index into the triangles of the instance's mesh.
    pub index: u32,
}

impl Triangle {
    pub fn area(&self) -> f64 {
        self.edge1.cross(self.edge2).length() / 2.0
    }

    /// Minimum and maximum coordinates.
    fn bounds(&self) -> (DVec3, DVec3) {
        let (b, c) = (self.corner + self.edge1, self.corner + self.edge2);
        (self.corner.min(b).min(c), self.corner.max(b).max(c))
    }

    /// The point with barycentric weights (1 - u - v, u, v).
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        self.corner + self.edge1 * u + self.edge2 * v
    }

    /// Intersection from either side (Moeller-Trumbore): (t, u, v) with t_min < t < t_max.
    fn intersect(&self, ray: &Ray) -> Option<(f64, f64, f64)> {
        let p = ray.direction.cross(self.edge2);
        let determinant = self.edge1.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let s = ray.origin - self.corner;
        let u = s.dot(p) / determinant;
        let q = s.cross(self.edge1);
        let v = ray.direction.dot(q) / determinant;
        let t = self.edge2.dot(q) / determinant;
        // Triangles are enlarged by 1e-12, so that no ray passes between neighbours.
        let inside = u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12;
        (inside && t > ray.t_min && t < ray.t_max).then_some((t, u, v))
    }
}

/// The points origin + t direction with t_min < t < t_max. The direction is a unit vector.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
    pub t_min: f64,
    pub t_max: f64,
}

impl Ray {
    /// A ray without an end. The origin may lie on a surface: t_min excludes that surface.
    pub fn new(origin: DVec3, direction: DVec3) -> Ray {
        Ray { origin, direction, t_min: 1e-9 * (1.0 + origin.abs().max_element()), t_max: f64::INFINITY }
    }

    /// The open segment between two points, which may lie on surfaces.
    pub fn between(a: DVec3, b: DVec3) -> Ray {
        let ray = Ray::new(a, (b - a).normalize());
        Ray { t_max: (b - a).length() - ray.t_min, ..ray }
    }
}

/// Intersection of a ray with a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub t: f64,
    /// Index into [`Geometry::triangles`].
    pub triangle: u32,
    pub u: f64,
    pub v: f64,
}

/// A point of a surface, with everything that shading needs.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    pub position: DVec3,
    /// Unit geometric normal of the front side.
    pub geometric: DVec3,
    /// Unit shading normal on the front side: interpolated, or the geometric normal if the mesh has no normals.
    pub shading: DVec3,
    pub uv: DVec2,
    /// Linear vertex colour and alpha; white if the mesh has none.
    pub color: [f64; 4],
    /// Tangent and bitangent for the normal map, of any length; `None` if the mesh has no tangents.
    pub tangents: Option<[DVec3; 2]>,
    /// Index into `Scene::materials`.
    pub material: u32,
    pub instance: u32,
}

struct Node {
    min: DVec3,
    max: DVec3,
    /// Inner node (count 0): index of the first child; the second child follows it. Leaf: start of its slice of `order`.
    first: u32,
    count: u32,
}

/// From this depth on, nodes are split into equal halves, which bounds the depth of the tree.
const MEDIAN_SPLIT_DEPTH: usize = 32;
/// Maximum number of nodes on the traversal stack. The traversal adds at most one node per level.
const MAX_STACK: usize = 64;

/// All triangles of all instances, without degenerate ones, and the tree over them.
pub struct Geometry<'a> {
    pub scene: &'a Scene,
    pub triangles: Vec<Triangle>,
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl<'a> Geometry<'a> {
    pub fn new(scene: &'a Scene) -> Geometry<'a> {
        let mut triangles = Vec::new();
        for (number, instance) in scene.instances.iter().enumerate() {
            let mesh = &scene.meshes[instance.mesh as usize];
            let side = instance.transform.matrix3.determinant().signum();
            for (index, corners) in mesh.triangles.iter().enumerate() {
                let [a, b, c] = corners
                    .map(|i| instance.transform.transform_point3(Vec3::from(mesh.positions[i as usize]).as_dvec3()));
                let cross = (b - a).cross(c - a);
                if cross.length() == 0.0 {
                    continue;
                }
                triangles.push(Triangle {
                    corner: a,
                    edge1: b - a,
                    edge2: c - a,
                    normal: cross.normalize() * side,
                    instance: number as u32,
                    index: index as u32,
                });
            }
        }
        let mut geometry = Geometry { scene, order: (0..triangles.len() as u32).collect(), triangles, nodes: vec![] };
        let centres: Vec<DVec3> = geometry.triangles.iter().map(|t| t.point(1.0 / 3.0, 1.0 / 3.0)).collect();
        geometry.nodes.push(Node { min: DVec3::ZERO, max: DVec3::ZERO, first: 0, count: 0 });
        geometry.split(0, 0, geometry.order.len(), &centres, 0);
        geometry
    }

    /// Builds the subtree for `order[start..end]` in node `node` at depth `depth`. A leaf has at most 2 triangles; other nodes
    /// are split where the surface-area cost is lowest.
    fn split(&mut self, node: usize, start: usize, end: usize, centres: &[DVec3], depth: usize) {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &i in &self.order[start..end] {
            let (low, high) = self.triangles[i as usize].bounds();
            (min, max) = (min.min(low), max.max(high));
        }
        // Enlarge the box, because rounding of corners could put an edge outside.
        let slack = (max.abs().max(min.abs()) + 1.0) * 1e-12;
        (min, max) = (min - slack, max + slack);
        if end - start <= 2 {
            self.nodes[node] = Node { min, max, first: start as u32, count: (end - start) as u32 };
            return;
        }
        let (axis, place) = self.cheapest_split(start, end, centres);
        self.sort(start, end, axis, centres);
        let middle = if depth < MEDIAN_SPLIT_DEPTH { start + place } else { (start + end) / 2 };
        let first = self.nodes.len();
        for _ in 0..2 {
            self.nodes.push(Node { min, max, first: 0, count: 0 });
        }
        self.nodes[node] = Node { min, max, first: first as u32, count: 0 };
        self.split(first, start, middle, centres, depth + 1);
        self.split(first + 1, middle, end, centres, depth + 1);
    }

    fn sort(&mut self, start: usize, end: usize, axis: usize, centres: &[DVec3]) {
        self.order[start..end]
            .sort_unstable_by(|&a, &b| centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b)));
    }

    /// The split of lowest cost: the axis to sort by, and the number of triangles in the first child. The cost is the sum over
    /// both children of the surface area of the box times the number of triangles.
    fn cheapest_split(&mut self, start: usize, end: usize, centres: &[DVec3]) -> (usize, usize) {
        let n = end - start;
        let mut best = (f64::INFINITY, 0, n / 2);
        for axis in 0..3 {
            self.sort(start, end, axis, centres);
            let boxes: Vec<_> = self.order[start..end].iter().map(|&i| self.triangles[i as usize].bounds()).collect();
            let grow = |sum: &mut (DVec3, DVec3), b: &(DVec3, DVec3)| {
                *sum = (sum.0.min(b.0), sum.1.max(b.1));
                let d = sum.1 - sum.0;
                Some(d.x * d.y + d.y * d.z + d.z * d.x)
            };
            let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let upto: Vec<f64> = boxes.iter().scan(nothing, grow).collect();
            let from: Vec<f64> = boxes.iter().rev().scan(nothing, grow).collect();
            for k in 1..n {
                let cost = upto[k - 1] * k as f64 + from[n - k - 1] * (n - k) as f64;
                if cost < best.0 {
                    best = (cost, axis, k);
                }
            }
        }
        (best.1, best.2)
    }

    /// The nearest hit, if any.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.closest_but(ray, &[])
    }

    /// The nearest hit with a triangle that is not one of `passed`.
    pub fn closest_but(&self, ray: &Ray, passed: &[u32]) -> Option<Hit> {
        self.walk(ray, false, passed)
    }

    /// Whether anything is hit.
    pub fn any(&self, ray: &Ray) -> bool {
        self.walk(ray, true, &[]).is_some()
    }

    /// The nearest hit, found without the tree, for tests of the tree.
    pub fn closest_by_exhaustion(&self, ray: &Ray) -> Option<Hit> {
        let all = (0..self.triangles.len() as u32).filter_map(|i| self.hit(i, ray));
        all.min_by(|a, b| a.t.total_cmp(&b.t))
    }

    fn hit(&self, triangle: u32, ray: &Ray) -> Option<Hit> {
        self.triangles[triangle as usize].intersect(ray).map(|(t, u, v)| Hit { t, triangle, u, v })
    }

    fn walk(&self, ray: &Ray, any: bool, passed: &[u32]) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let inverse = ray.direction.recip();
        let mut ray = *ray;
        let mut best = None;
        // Stack of nodes to visit, each with the distance at which the ray enters it. The nearest node is last.
        let mut open = [(0u32, f64::NEG_INFINITY); MAX_STACK];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (node, near) = open[count];
            if near > ray.t_max {
                continue;
            }
            let node = &self.nodes[node as usize];
            if node.count > 0 {
                for &i in &self.order[node.first as usize..(node.first + node.count) as usize] {
                    if let Some(hit) = self.hit(i, &ray).filter(|_| !passed.contains(&i)) {
                        if any {
                            return Some(hit);
                        }
                        ray.t_max = hit.t;
                        best = Some(hit);
                    }
                }
                continue;
            }
            let child = |i: u32| (i, entry(&self.nodes[i as usize], &ray, inverse));
            let mut children = [child(node.first), child(node.first + 1)];
            if children[0].1 < children[1].1 {
                children.swap(0, 1);
            }
            for (child, near) in children {
                if let Some(near) = near {
                    open[count] = (child, near);
                    count += 1;
                }
            }
        }
        best
    }

    /// The surface point of a hit.
    pub fn surface(&self, hit: &Hit) -> Surface {
        let triangle = &self.triangles[hit.triangle as usize];
        let instance = &self.scene.instances[triangle.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let corners = mesh.triangles[triangle.index as usize].map(|i| i as usize);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut shading = triangle.normal;
        let mut flip = 1.0;
        if !mesh.normals.is_empty() {
            let to_world: DMat3 = instance.transform.matrix3.inverse().transpose();
            let blend: DVec3 =
                corners.iter().zip(weights).map(|(&i, w)| Vec3::from(mesh.normals[i]).as_dvec3() * w).sum();
            shading = (to_world * blend).try_normalize().unwrap_or(shading);
            flip = if shading.dot(triangle.normal) < 0.0 { -1.0 } else { 1.0 };
        }
        let mut uv = DVec2::ZERO;
        if !mesh.uvs.is_empty() {
            uv = corners.iter().zip(weights).map(|(&i, w)| Vec2::from(mesh.uvs[i]).as_dvec2() * w).sum();
        }
        let mut color = [1.0; 4];
        if !mesh.colors.is_empty() {
            color = [0, 1, 2, 3].map(|k| (0..3).map(|c| f64::from(mesh.colors[corners[c]][k]) * weights[c]).sum());
        }
        let tangents = (!mesh.tangents.is_empty()).then(|| {
            // The bitangent is made in the space of the mesh, then transformed as a direction, not as a normal.
            let matrix = instance.transform.matrix3;
            let normal = matrix.transpose() * shading;
            let of = |i: usize| Vec4::from(mesh.tangents[i]).truncate().as_dvec3();
            let tangent: DVec3 = corners.iter().zip(weights).map(|(&i, w)| of(i) * w).sum();
            let bitangent = normal.cross(tangent) * f64::from(mesh.tangents[corners[0]][3]);
            // A normal map turns the normal of the mesh. Where this normal is flipped, the turn must be flipped too.
            [matrix * tangent * flip, matrix * bitangent * flip]
        });
        Surface {
            position: triangle.point(hit.u, hit.v),
            geometric: triangle.normal,
            shading: shading * flip,
            uv,
            color,
            tangents,
            material: mesh.material,
            instance: triangle.instance,
        }
    }
}

/// Distance at which the ray enters the node's box; `None` if the ray misses the box.
fn entry(node: &Node, ray: &Ray, inverse: DVec3) -> Option<f64> {
    let (mut near, mut far) = (ray.t_min, ray.t_max);
    for axis in 0..3 {
        let a = (node.min[axis] - ray.origin[axis]) * inverse[axis];
        let b = (node.max[axis] - ray.origin[axis]) * inverse[axis];
        // A ray in the plane of a face gives 0 * infinity = NaN, which min and max ignore.
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then_some(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use taugate::internals::generate::numbers::Pcg;
    use taugate::internals::generate::{Kind, build};

    #[test]
    fn tree_and_exhaustion_agree() {
        let scene = build(Kind::ClutteredRoom { triangles: 5_000 });
        let geometry = Geometry::new(&scene);
        let mut pcg = Pcg::new(3);
        for _ in 0..1000 {
            let origin = DVec3::new(pcg.range(-2.9, 2.9), pcg.range(0.1, 2.9), pcg.range(-2.4, 2.4));
            let to = DVec3::new(pcg.range(-2.9, 2.9), pcg.range(0.1, 2.9), pcg.range(-2.4, 2.4));
            let ray = Ray::new(origin, (to - origin).normalize());
            let hit = geometry.closest(&ray);
            assert_eq!(hit, geometry.closest_by_exhaustion(&ray));
            // The room is closed, so every ray hits something.
            let hit = hit.expect("a hit");
            assert!(geometry.any(&Ray { t_max: hit.t + 1e-6, ..ray }));
            assert!(!geometry.any(&Ray { t_max: hit.t, ..ray }));
        }
    }

    #[test]
    fn a_closed_sphere_does_not_leak() {
        let scene = build(Kind::GatedSphere { radius: 1.0, subdivisions: 4, albedo: 0.5 });
        let geometry = Geometry::new(&scene);
        let mesh = &scene.meshes[0];
        for triangle in mesh.triangles.iter().take(2000) {
            let [a, b, c] = triangle.map(|i| Vec3::from(mesh.positions[i as usize]).as_dvec3());
            for aim in [a + b, a + b + c, a + 1e-9 * b] {
                assert!(geometry.closest(&Ray::new(DVec3::ZERO, aim.normalize())).is_some());
            }
        }
    }
}
