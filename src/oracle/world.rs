//! What rays meet: vertices of paths with their scattering, and coverage by alpha.

use glam::DVec3;

use super::bsdf::{Bsdf, PreparedMaterial, Sample};
use super::geometry::{Geometry, Ray, Surface};
use super::texture;
use crate::generate::numbers::Pcg;
use crate::scene::{AlphaMode, Scene};
use crate::settings::Emitters;

/// Geometry, materials, and who may shine.
pub struct World<'a> {
    pub scene: &'a Scene,
    pub geometry: Geometry<'a>,
    prepared: Vec<PreparedMaterial>,
    emitters: &'a Emitters,
}

/// A surface point seen from some side, ready to scatter.
pub struct Vertex<'a> {
    pub position: DVec3,
    /// Unit geometric normal on the viewer's side.
    pub normal: DVec3,
    /// Unit vector to the viewer.
    pub wo: DVec3,
    /// The viewer is behind the surface.
    pub inside: bool,
    pub surface: Surface,
    /// Axes of the shading frame, z being the shading normal.
    frame: [DVec3; 3],
    /// Seen from the back of a one-sided material: black, yet opaque.
    black: bool,
    bsdf: Bsdf<'a>,
}

impl<'a> World<'a> {
    pub fn new(scene: &'a Scene, emitters: &'a Emitters) -> World<'a> {
        let prepared = scene.materials.iter().map(PreparedMaterial::new).collect();
        World { scene, geometry: Geometry::new(scene), prepared, emitters }
    }

    /// Whether what stands on that node may shine.
    pub fn shines(&self, node: &str) -> bool {
        match self.emitters {
            Emitters::Scene => true,
            Emitters::Nodes(nodes) => nodes.iter().any(|n| n == node),
        }
    }

    /// The next vertex along a ray; surfaces with alpha are there with their coverage for probability.
    pub fn trace(&self, ray: Ray, pcg: &mut Pcg) -> Option<Vertex<'_>> {
        let surface = self.first_there(&ray, pcg)?;
        Some(self.vertex(surface, -ray.direction))
    }

    /// Whether nothing stands between two points.
    pub fn visible(&self, a: DVec3, b: DVec3, pcg: &mut Pcg) -> bool {
        let ray = Ray::between(a, b);
        let all_opaque = self.scene.materials.iter().all(|m| m.alpha_mode == AlphaMode::Opaque);
        if all_opaque {
            return !self.geometry.any(&ray);
        }
        self.first_there(&ray, pcg).is_none()
    }

    /// The nearest surface that is there for this ray. A ray passes a triangle once, so it goes on by leaving out those that it has
    /// passed: another may lie at the same distance.
    fn first_there(&self, ray: &Ray, pcg: &mut Pcg) -> Option<Surface> {
        let mut passed = vec![];
        loop {
            let hit = self.geometry.closest_but(ray, &passed)?;
            let surface = self.geometry.surface(&hit);
            if self.is_there(&surface, pcg) {
                return Some(surface);
            }
            passed.push(hit.triangle);
        }
    }

    /// Part of the surface that is there: 1, 0 or, for blended materials, alpha.
    pub fn coverage(&self, surface: &Surface) -> f64 {
        let material = &self.scene.materials[surface.material as usize];
        let alpha = || {
            let texel = texture::sample(self.scene, material.base_color_texture, surface.uv)[3];
            texel * f64::from(material.base_color[3])
        };
        match material.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f64::from(u8::from(alpha() >= f64::from(cutoff))),
            AlphaMode::Blend => alpha(),
        }
    }

    fn is_there(&self, surface: &Surface, pcg: &mut Pcg) -> bool {
        let coverage = self.coverage(surface);
        coverage >= 1.0 || (coverage > 0.0 && pcg.uniform() < coverage)
    }

    fn vertex(&self, surface: Surface, wo: DVec3) -> Vertex<'_> {
        let material = &self.scene.materials[surface.material as usize];
        let texel = texture::sample(self.scene, material.base_color_texture, surface.uv);
        let base = [0, 1, 2].map(|k| texel[k] * f64::from(material.base_color[k]));
        let inside = surface.geometric.dot(wo) < 0.0;
        let side = if inside { -1.0 } else { 1.0 };
        let z = surface.shading * side;
        let x = z.any_orthonormal_vector();
        Vertex {
            position: surface.position,
            normal: surface.geometric * side,
            wo,
            inside,
            surface,
            frame: [x, z.cross(x), z],
            // Glass has an inside, whatever the file says about its sides.
            black: inside && !material.double_sided && material.transmission == 0.0,
            bsdf: self.prepared[surface.material as usize].at(base),
        }
    }

    pub fn ior(&self, vertex: &Vertex) -> f64 {
        self.prepared[vertex.surface.material as usize].ior()
    }

    /// Radiance that a surface emits towards `to` (a vector from it, any length).
    pub fn emitted(&self, surface: &Surface, to: DVec3) -> [f64; 3] {
        let material = &self.scene.materials[surface.material as usize];
        let front = surface.geometric.dot(to) > 0.0;
        let node = &self.scene.instances[surface.instance as usize].node;
        if material.emission == [0.0; 3] || !(front || material.double_sided) || !self.shines(node) {
            return [0.0; 3];
        }
        let texel = texture::sample(self.scene, material.emission_texture, surface.uv);
        [0, 1, 2].map(|k| texel[k] * f64::from(material.emission[k]))
    }
}

impl Vertex<'_> {
    /// Nothing can be connected to this vertex.
    pub fn only_delta(&self) -> bool {
        self.black || self.bsdf.only_delta()
    }

    /// f(wi, wo) without cosine; 0 unless `wi` is on the viewer's side of the surface.
    pub fn eval(&self, wi: DVec3) -> [f64; 3] {
        if self.black || self.normal.dot(wi) <= 0.0 {
            return [0.0; 3];
        }
        self.bsdf.eval(self.local(wi), self.local(self.wo))
    }

    /// Cosine of a direction to the shading normal, at least 0.
    pub fn cos(&self, w: DVec3) -> f64 {
        self.frame[2].dot(w).max(0.0)
    }

    /// Density per steradian of [`Vertex::sample`], mirrors and glass left out.
    pub fn pdf(&self, wi: DVec3) -> f64 {
        if self.black { 0.0 } else { self.bsdf.pdf(self.local(wi), self.local(self.wo)) }
    }

    /// Draws the direction from which the viewer is lit, in world space.
    pub fn sample(&self, pcg: &mut Pcg) -> Option<Sample> {
        if self.black {
            return None;
        }
        let u = [pcg.uniform(), pcg.uniform(), pcg.uniform()];
        let sample = self.bsdf.sample(self.local(self.wo), self.inside, u)?;
        let wi = self.frame[0] * sample.wi.x + self.frame[1] * sample.wi.y + self.frame[2] * sample.wi.z;
        // The shading normal must not turn reflection into transmission.
        let through = self.normal.dot(wi) < 0.0;
        (through == sample.refracted).then_some(Sample { wi, ..sample })
    }

    fn local(&self, w: DVec3) -> DVec3 {
        DVec3::new(self.frame[0].dot(w), self.frame[1].dot(w), self.frame[2].dot(w))
    }
}
