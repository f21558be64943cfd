//! The scene as f64 triangles in world space, a median-split tree over them, and rays.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};

use crate::scene::Scene;

/// A triangle in world space; counter-clockwise about `normal`, mirrored instances included.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    corner: DVec3,
    edge1: DVec3,
    edge2: DVec3,
    /// Unit normal of the front.
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

    /// The point with barycentric weights (1 - u - v, u, v).
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        self.corner + self.edge1 * u + self.edge2 * v
    }

    /// Moeller-Trumbore, both sides: (t, u, v) with t_min < t < t_max.
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
        // Neighbours overlap by a hair, so that no ray passes between them.
        let inside = u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12;
        (inside && t > ray.t_min && t < ray.t_max).then_some((t, u, v))
    }
}

/// Points origin + t direction, t_min < t < t_max; the direction is a unit vector.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
    pub t_min: f64,
    pub t_max: f64,
}

impl Ray {
    /// A ray that starts on a surface (or anywhere) and has no end.
    pub fn new(origin: DVec3, direction: DVec3) -> Ray {
        Ray { origin, direction, t_min: 1e-9 * (1.0 + origin.abs().max_element()), t_max: f64::INFINITY }
    }

    /// The open segment between two points; both may lie on surfaces.
    pub fn between(a: DVec3, b: DVec3) -> Ray {
        let ray = Ray::new(a, (b - a).normalize());
        Ray { t_max: (b - a).length() - ray.t_min, ..ray }
    }
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub t: f64,
    /// Index into [`Geometry::triangles`].
    pub triangle: u32,
    pub u: f64,
    pub v: f64,
}

/// A point of a surface with all that shading needs.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    pub position: DVec3,
    /// Unit normal of the triangle's front.
    pub geometric: DVec3,
    /// Interpolated unit normal, the geometric one for flat meshes; front side.
    pub shading: DVec3,
    pub uv: DVec2,
    /// Index into `Scene::materials`.
    pub material: u32,
    pub instance: u32,
}

struct Node {
    min: DVec3,
    max: DVec3,
    /// Inner node (count 0): its children are `first` and the next. Leaf: its slice of `order`.
    first: u32,
    count: u32,
}

/// All triangles of all instances.
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
        geometry.split(0, 0, geometry.order.len(), &centres);
        geometry
    }

    /// Fills node `node` for `order[start..end]`: halves at the median of the centres' widest axis, leaves of up to 4.
    fn split(&mut self, node: usize, start: usize, end: usize, centres: &[DVec3]) {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut low, mut high) = (min, max);
        for &i in &self.order[start..end] {
            let t = &self.triangles[i as usize];
            for p in [t.corner, t.corner + t.edge1, t.corner + t.edge2] {
                min = min.min(p);
                max = max.max(p);
            }
            low = low.min(centres[i as usize]);
            high = high.max(centres[i as usize]);
        }
        // Corners are rounded; a box must not lose an edge to that.
        let slack = (max.abs().max(min.abs()) + 1.0) * 1e-12;
        (min, max) = (min - slack, max + slack);
        if end - start <= 4 {
            self.nodes[node] = Node { min, max, first: start as u32, count: (end - start) as u32 };
            return;
        }
        let axis = (high - low).max_position();
        let half = (end - start) / 2;
        self.order[start..end]
            .select_nth_unstable_by(half, |&a, &b| centres[a as usize][axis].total_cmp(&centres[b as usize][axis]));
        let first = self.nodes.len();
        for _ in 0..2 {
            self.nodes.push(Node { min, max, first: 0, count: 0 });
        }
        self.nodes[node] = Node { min, max, first: first as u32, count: 0 };
        self.split(first, start, start + half, centres);
        self.split(first + 1, start + half, end, centres);
    }

    /// The nearest hit.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.walk(ray, false)
    }

    /// Whether anything is hit.
    pub fn any(&self, ray: &Ray) -> bool {
        self.walk(ray, true).is_some()
    }

    /// The nearest hit without the tree, to test the tree.
    pub fn closest_by_exhaustion(&self, ray: &Ray) -> Option<Hit> {
        let all = (0..self.triangles.len() as u32).filter_map(|i| self.hit(i, ray));
        all.min_by(|a, b| a.t.total_cmp(&b.t))
    }

    fn hit(&self, triangle: u32, ray: &Ray) -> Option<Hit> {
        self.triangles[triangle as usize].intersect(ray).map(|(t, u, v)| Hit { t, triangle, u, v })
    }

    fn walk(&self, ray: &Ray, any: bool) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let inverse = ray.direction.recip();
        let mut ray = *ray;
        let mut best = None;
        let mut stack = vec![0u32];
        while let Some(node) = stack.pop() {
            let node = &self.nodes[node as usize];
            if entry(node, &ray, inverse).is_none() {
                continue;
            }
            if node.count > 0 {
                for &i in &self.order[node.first as usize..(node.first + node.count) as usize] {
                    if let Some(hit) = self.hit(i, &ray) {
                        if any {
                            return Some(hit);
                        }
                        ray.t_max = hit.t;
                        best = Some(hit);
                    }
                }
                continue;
            }
            // The nearer child is looked at first.
            let near = |i: u32| entry(&self.nodes[i as usize], &ray, inverse).unwrap_or(f64::INFINITY);
            let (a, b) = (node.first, node.first + 1);
            stack.extend(if near(a) < near(b) { [b, a] } else { [a, b] });
        }
        best
    }

    /// What a ray has hit.
    pub fn surface(&self, hit: &Hit) -> Surface {
        let triangle = &self.triangles[hit.triangle as usize];
        let instance = &self.scene.instances[triangle.instance as usize];
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let corners = mesh.triangles[triangle.index as usize].map(|i| i as usize);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut shading = triangle.normal;
        if !mesh.normals.is_empty() {
            let to_world: DMat3 = instance.transform.matrix3.inverse().transpose();
            let blend: DVec3 =
                corners.iter().zip(weights).map(|(&i, w)| Vec3::from(mesh.normals[i]).as_dvec3() * w).sum();
            shading = (to_world * blend).try_normalize().unwrap_or(shading);
        }
        let mut uv = DVec2::ZERO;
        if !mesh.uvs.is_empty() {
            uv = corners.iter().zip(weights).map(|(&i, w)| Vec2::from(mesh.uvs[i]).as_dvec2() * w).sum();
        }
        Surface {
            position: triangle.point(hit.u, hit.v),
            geometric: triangle.normal,
            shading,
            uv,
            material: mesh.material,
            instance: triangle.instance,
        }
    }
}

/// Where the ray enters a node's box, if it does.
fn entry(node: &Node, ray: &Ray, inverse: DVec3) -> Option<f64> {
    let (mut near, mut far) = (ray.t_min, ray.t_max);
    for axis in 0..3 {
        let a = (node.min[axis] - ray.origin[axis]) * inverse[axis];
        let b = (node.max[axis] - ray.origin[axis]) * inverse[axis];
        // 0 * infinity, on the plane of a face: min and max ignore the NaN.
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then_some(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::numbers::Pcg;
    use crate::generate::{Kind, build};

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
            // The room is closed.
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
