//! The scene as rays see it: path vertices with their BSDFs, and coverage by alpha.

use glam::DVec3;
use taugate::internals::generate::numbers::Pcg;
use taugate::{AlphaMode, Emitters, Material, Scene};

use super::bsdf::{Bsdf, PreparedMaterial, Sample, Texels};
use super::geometry::{Geometry, Ray, Surface};
use super::media::Media;
use super::{rgb, texture};

/// Geometry, materials, and the emitters that are switched on.
pub struct World<'a> {
    pub scene: &'a Scene,
    pub geometry: Geometry<'a>,
    pub media: Media<'a>,
    /// With indices of refraction relative to the surrounding medium.
    prepared: Vec<PreparedMaterial>,
    emitters: &'a Emitters,
}

/// A surface point seen from one side, with its BSDF.
pub struct Vertex<'a> {
    pub position: DVec3,
    /// Unit geometric normal on the viewer's side.
    pub normal: DVec3,
    /// Unit vector to the viewer.
    pub wo: DVec3,
    /// Whether the viewer is behind the surface.
    pub inside: bool,
    pub surface: Surface,
    /// Axes x, y and z of the shading frame; z is the shading normal.
    frame: [DVec3; 3],
    /// Whether this is the back of a one-sided material, which is black but opaque.
    black: bool,
    bsdf: Bsdf<'a>,
}

impl<'a> World<'a> {
    pub fn new(scene: &'a Scene, emitters: &'a Emitters) -> World<'a> {
        let media = Media::new(scene);
        let relative = |m: &Material| Material { ior: (f64::from(m.ior) / media.ior()) as f32, ..m.clone() };
        let prepared = scene.materials.iter().map(|m| PreparedMaterial::new(&relative(m))).collect();
        World { scene, geometry: Geometry::new(scene), media, prepared, emitters }
    }

    /// Whether the emitters on this node are switched on.
    pub fn shines(&self, node: &str) -> bool {
        match self.emitters {
            Emitters::Scene => true,
            Emitters::Nodes(nodes) => nodes.iter().any(|n| n == node),
        }
    }

    /// The next vertex along a ray. A surface with alpha is present for this ray with a probability equal to its coverage.
    pub fn trace(&self, ray: Ray, pcg: &mut Pcg) -> Option<Vertex<'_>> {
        let surface = self.first_there(&ray, pcg)?;
        Some(self.vertex(surface, -ray.direction))
    }

    /// Whether no surface is between two points. Surfaces with alpha are present at random, as in [`World::trace`].
    pub fn visible(&self, a: DVec3, b: DVec3, pcg: &mut Pcg) -> bool {
        let ray = Ray::between(a, b);
        let all_opaque = self.scene.materials.iter().all(|m| m.alpha_mode == AlphaMode::Opaque);
        if all_opaque {
            return !self.geometry.any(&ray);
        }
        self.first_there(&ray, pcg).is_none()
    }

    /// The nearest surface that is present for this ray. The search continues without the triangles that the ray has passed, not
    /// from a larger distance, because another triangle may lie at the same distance. A ray can cross a triangle only once.
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

    /// Coverage of the surface at this point: 1 or 0, or alpha for blended materials.
    pub fn coverage(&self, surface: &Surface) -> f64 {
        let material = &self.scene.materials[surface.material as usize];
        let alpha = || {
            let texel = texture::sample(self.scene, material.base_color_texture, surface.uv)[3];
            texel * f64::from(material.base_color[3]) * surface.color[3]
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
        let base = rgb(|k| texel[k] * f64::from(material.base_color[k]) * surface.color[k]);
        let inside = surface.geometric.dot(wo) < 0.0;
        let side = if inside { -1.0 } else { 1.0 };
        let bumped = surface.bumped(self.scene) * side;
        // A surface that a normal map turns away from the viewer scatters as if it were flat.
        let turned_away = bumped != surface.shading * side && bumped.dot(wo) <= 0.0;
        let z = if turned_away { surface.geometric * side } else { bumped };
        let x = z.any_orthonormal_vector();
        let bsdf = self.prepared[surface.material as usize].at_point(base, &self.texels(&surface));
        Vertex {
            position: surface.position,
            normal: surface.geometric * side,
            wo,
            inside,
            surface,
            frame: [x, z.cross(x), z],
            // The back of glass is the inside of a solid, so it is never black, even if the material is single-sided.
            black: inside && !material.double_sided && !material.transmits(),
            bsdf,
        }
    }

    /// The texels of the textures that multiply factors of the material.
    fn texels(&self, surface: &Surface) -> Texels {
        let m = &self.scene.materials[surface.material as usize];
        let data = |texture| texture::sample_data(self.scene, texture, surface.uv);
        let [red, green, blue, _] = texture::sample(self.scene, m.specular_color_texture, surface.uv);
        let [_, roughness, metallic, _] = data(m.surface_texture);
        Texels {
            roughness,
            metallic,
            specular: data(m.specular_texture)[3],
            specular_color: [red, green, blue],
            clearcoat: data(m.clearcoat_texture)[0],
            clearcoat_roughness: data(m.clearcoat_roughness_texture)[1],
            transmission: data(m.transmission_texture)[0],
        }
    }

    /// Index of refraction and group index of a material.
    pub fn indices_of(&self, material: u32) -> [f64; 2] {
        let material = &self.scene.materials[material as usize];
        [material.ior, material.group_index()].map(f64::from)
    }

    /// Radiance that a surface emits in direction `to`, a vector of any length that points away from the surface.
    pub fn emitted(&self, surface: &Surface, to: DVec3) -> [f64; 3] {
        let material = &self.scene.materials[surface.material as usize];
        let front = surface.geometric.dot(to) > 0.0;
        let node = &self.scene.instances[surface.instance as usize].node;
        if material.emission == [0.0; 3] || !(front || material.double_sided) || !self.shines(node) {
            return [0.0; 3];
        }
        let texel = texture::sample(self.scene, material.emission_texture, surface.uv);
        rgb(|k| texel[k] * f64::from(material.emission[k]))
    }
}

impl Vertex<'_> {
    /// Whether every connection to this vertex contributes 0.
    pub fn only_delta(&self) -> bool {
        self.black || self.bsdf.only_delta()
    }

    /// f(wi, wo) without the cosine; 0 if `wi` is not on the viewer's side of the surface.
    pub fn eval(&self, wi: DVec3) -> [f64; 3] {
        if self.black || self.normal.dot(wi) <= 0.0 {
            return [0.0; 3];
        }
        self.bsdf.eval(self.local(wi), self.local(self.wo))
    }

    /// Cosine between a direction and the shading normal, clamped to at least 0.
    pub fn cos(&self, w: DVec3) -> f64 {
        self.frame[2].dot(w).max(0.0)
    }

    /// Density per steradian of [`Vertex::sample`], without mirrors and glass.
    pub fn pdf(&self, wi: DVec3) -> f64 {
        if self.black { 0.0 } else { self.bsdf.pdf(self.local(wi), self.local(self.wo)) }
    }

    /// Samples a direction of incident light, in world space. `None`: the path ends.
    pub fn sample(&self, pcg: &mut Pcg) -> Option<Sample> {
        if self.black {
            return None;
        }
        let u = [pcg.uniform(), pcg.uniform(), pcg.uniform()];
        let sample = self.bsdf.sample(self.local(self.wo), self.inside, u)?;
        let wi = self.frame[0] * sample.wi.x + self.frame[1] * sample.wi.y + self.frame[2] * sample.wi.z;
        // A shading normal must not turn reflection into transmission, so such a sample ends the path.
        let through = self.normal.dot(wi) < 0.0;
        (through == sample.refracted).then_some(Sample { wi, ..sample })
    }

    fn local(&self, w: DVec3) -> DVec3 {
        DVec3::new(self.frame[0].dot(w), self.frame[1].dot(w), self.frame[2].dot(w))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use taugate::internals::generate::{parts, shapes};

    /// The default metalness of glTF is 1. It leaves no light for a transmission, so the back of such a material is black.
    #[test]
    fn a_metal_has_a_black_back_whatever_its_transmission() {
        for (metallic, black) in [(1.0, true), (0.5, false)] {
            let mut scene = Scene::default();
            let kind = Material { transmission: 1.0, metallic, double_sided: false, ..parts::glass("sheet") };
            let sheet = parts::material(&mut scene, kind);
            parts::add(&mut scene, "sheet", sheet, shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Y, [1.0; 2]));
            let world = World::new(&scene, &Emitters::Scene);
            let ray = Ray::new(DVec3::new(0.3, 0.3, -1.0), DVec3::Z);
            let back = world.trace(ray, &mut Pcg::new(1)).unwrap();
            assert_eq!((back.inside, back.black), (true, black), "metalness {metallic}");
        }
    }
}
