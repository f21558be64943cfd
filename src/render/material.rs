//! Materials on the device: the record that the kernels read, and the conversion from a material of the scene.

use std::collections::HashMap;

use super::albedo::AlbedoTable;
use crate::scene::{self, AlphaMode, Scene};
use crate::settings::Emitters;
use crate::wgsl::layout::constants::TRIANGLE_ALPHA;
use crate::wgsl::layout::{NONE, host_twins, shared_constants};

host_twins! {
    /// Twin of the struct in `shared/material.wgsl`, which documents the fields.
    Material {
        base_color: [f32; 3], opacity: f32,
        emission: [f32; 3], emission_density: f32,
        metallic: f32, alpha: f32, f0: f32, ior: f32,
        transmission: f32, diffuse_scale: f32, alpha_cutoff: f32, flags: u32,
        base_texture: u32, emission_texture: u32, f90: f32, pad0: u32,
    }
}

shared_constants! {
    MATERIAL_DOUBLE_SIDED: u32 = 1,
    MATERIAL_MASK: u32 = 2,
    MATERIAL_BLEND: u32 = 4,
    /// A lobe with a smaller GGX alpha is treated as perfectly smooth (a delta distribution).
    DELTA_ALPHA: f32 = 0.001,
}

/// Features that the kernels need for this scene. The code of all other features is removed when a kernel is compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Features {
    pub textures: bool,
    pub alpha: bool,
    /// Whether any material is not purely Lambertian.
    pub glossy: bool,
    pub transmission: bool,
}

impl Features {
    /// Values of the WGSL `override` constants that switch each feature on (1) or off (0).
    pub fn constants(&self) -> [(&'static str, f64); 4] {
        [
            ("HAS_TEXTURES", self.textures),
            ("HAS_ALPHA", self.alpha),
            ("HAS_GLOSSY", self.glossy),
            ("HAS_TRANSMISSION", self.transmission),
        ]
        .map(|(name, on)| (name, if on { 1.0 } else { 0.0 }))
    }
}

/// The device materials that the scene uses. A material on a node that is not a selected emitter has no emission.
pub struct MaterialSet<'a> {
    scene: &'a Scene,
    emitters: &'a Emitters,
    albedo: &'a AlbedoTable,
    /// One device material per pair (material, whether its node is a selected emitter) in use.
    pub list: Vec<Material>,
    numbers: HashMap<(u32, bool), u32>,
    pub features: Features,
    /// Maximum refractive index of the transmissive materials, at least 1.
    pub max_ior: f32,
}

impl<'a> MaterialSet<'a> {
    pub fn new(scene: &'a Scene, emitters: &'a Emitters, albedo: &'a AlbedoTable) -> Self {
        let (list, numbers) = (vec![], Default::default());
        MaterialSet { scene, emitters, albedo, list, numbers, features: Features::default(), max_ior: 1.0 }
    }

    /// Index in `list` of `material` on `node`, with the bit [`TRIANGLE_ALPHA`] if rays may pass through the surface.
    pub fn number(&mut self, material: u32, node: &str) -> u32 {
        let source = &self.scene.materials[material as usize];
        let is_emitter = self.emitters.include(node);
        let number = match self.numbers.get(&(material, is_emitter)) {
            Some(&n) => n,
            None => {
                let n = self.list.len() as u32;
                let converted = self.convert(source, is_emitter);
                self.list.push(converted);
                self.numbers.insert((material, is_emitter), n);
                n
            }
        };
        let alpha = if is_partial(source) { TRIANGLE_ALPHA } else { 0 };
        self.features.alpha |= alpha != 0;
        number | alpha
    }

    fn convert(&mut self, m: &scene::Material, is_emitter: bool) -> Material {
        let f0 = ((m.ior - 1.0) / (m.ior + 1.0)).powi(2) * m.specular;
        // With ior = 1 or specular = 0 there is no coat.
        let f90 = if f0 > 0.0 { m.specular } else { 0.0 };
        let mut alpha = m.roughness * m.roughness;
        if alpha < DELTA_ALPHA || (m.transmission > 0.0 && (m.ior - 1.0).abs() < 1e-5) {
            alpha = 0.0;
        }
        let emission = if is_emitter { m.emission } else { [0.0; 3] };
        let emission_texture = if emission == [0.0; 3] { None } else { m.emission_texture };
        self.features.textures |= m.base_color_texture.is_some() || emission_texture.is_some();
        self.features.glossy |= m.metallic > 0.0 || f0 > 0.0 || m.transmission > 0.0;
        self.features.transmission |= m.transmission > 0.0 && m.metallic < 1.0;
        if m.transmission > 0.0 && m.metallic < 1.0 {
            self.max_ior = self.max_ior.max(m.ior);
        }
        let (mode, cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask(cutoff) => (MATERIAL_MASK, cutoff),
            AlphaMode::Blend => (MATERIAL_BLEND, 0.0),
        };
        Material {
            base_color: [m.base_color[0], m.base_color[1], m.base_color[2]],
            opacity: m.base_color[3],
            emission,
            emission_density: 0.0,
            metallic: m.metallic,
            alpha,
            f0,
            ior: m.ior,
            transmission: m.transmission,
            diffuse_scale: (1.0
                / (std::f64::consts::PI * (1.0 - self.albedo.mean(alpha.into(), f0.into(), f90.into()))))
                as f32,
            alpha_cutoff: cutoff,
            flags: mode | if m.double_sided { MATERIAL_DOUBLE_SIDED } else { 0 },
            base_texture: m.base_color_texture.unwrap_or(NONE),
            emission_texture: emission_texture.unwrap_or(NONE),
            f90,
            pad0: 0,
        }
    }
}

/// Whether the alpha of the material may let light through the surface.
fn is_partial(m: &scene::Material) -> bool {
    let opaque = match m.alpha_mode {
        AlphaMode::Opaque => f32::NEG_INFINITY,
        AlphaMode::Mask(cutoff) => cutoff,
        AlphaMode::Blend => 1.0,
    };
    let varies = m.alpha_mode != AlphaMode::Opaque && m.base_color_texture.is_some();
    varies || m.base_color[3] < opaque
}
