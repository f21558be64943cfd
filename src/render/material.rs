//! Materials on the device: the record that the kernels read, and the conversion from a material of the scene.

mod smooth;

use std::collections::HashMap;

use glam::DAffine2;

use super::albedo::AlbedoTable;
use super::media::interior_indices;
use super::null_boundary;
use crate::scene::{self, AlphaMode, Scene};
use crate::settings::Emitters;
use crate::wgsl::layout::constants::{TRIANGLE_ALPHA, TRIANGLE_MIRRORED, TRIANGLE_NULL, TRIANGLE_SHEET};
use crate::wgsl::layout::{NONE, host_twins, shared_constants};
pub use smooth::SmoothShares;

host_twins! {
    /// Twin of the struct in `shared/material.wgsl`, which documents the fields.
    Material {
        base_color: [f32; 3], opacity: f32,
        emission: [f32; 3], emission_density: f32,
        metallic: f32, alpha: f32, f0: f32, ior: f32,
        transmission: f32, diffuse_scale: f32, alpha_cutoff: f32, flags: u32,
        base_texture: u32, emission_texture: u32, f90: f32, surface_texture: u32,
        normal_texture: u32, normal_scale: f32, clearcoat: f32, clearcoat_alpha: f32,
        f0_color: [f32; 3], specular_color_texture: u32,
        specular_texture: u32, clearcoat_texture: u32, clearcoat_roughness_texture: u32, interior: u32,
        retroreflection: f32, retroreflector_alpha: f32, transmission_texture: u32, thickness: f32,
        absorption: [f32; 3], group_index: f32,
    }
}

shared_constants! {
    MATERIAL_DOUBLE_SIDED: u32 = 1,
    MATERIAL_MASK: u32 = 2,
    MATERIAL_BLEND: u32 = 4,
    MATERIAL_VARIES: u32 = 8,
    MATERIAL_THIN: u32 = 16,
    /// A lobe with a smaller GGX alpha is treated as perfectly smooth (a delta distribution).
    DELTA_ALPHA: f32 = 0.001,
    MIN_BELOW_COAT: f32 = 1e-4,
}

/// Features that the kernels need for this scene. The code of all other features is removed when a kernel is compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Features {
    pub textures: bool,
    /// Whether metalness, roughness, a coat or the transmission varies over a surface.
    pub surface_textures: bool,
    /// Whether the dielectric coat or the clear coat vary over a surface.
    pub coat_textures: bool,
    /// Whether any texture transforms the texture coordinates of its meshes.
    pub texture_transforms: bool,
    pub normal_maps: bool,
    pub vertex_colors: bool,
    pub alpha: bool,
    /// Whether any material is not purely Lambertian.
    pub glossy: bool,
    pub transmission: bool,
    pub transmission_textures: bool,
    pub group_indices: bool,
    pub specular_colors: bool,
    pub clearcoat: bool,
    pub retroreflectors: bool,
    /// Whether meshes bound media without bending light.
    pub null_boundaries: bool,
    /// Whether there is thin glass, whether some of it may be clear, and whether it delays light.
    pub sheets: bool,
    pub clear_sheets: bool,
    pub delays: bool,
}

impl Material {
    /// Indices of the textures that the material uses, and NONE for the others.
    pub fn textures(&self) -> [u32; 9] {
        let shading = [self.base_texture, self.emission_texture, self.normal_texture, self.surface_texture];
        let specular = [self.specular_texture, self.specular_color_texture];
        let clearcoat = [self.clearcoat_texture, self.clearcoat_roughness_texture];
        let mut all = [self.transmission_texture; 9];
        all[..4].copy_from_slice(&shading);
        all[4..6].copy_from_slice(&specular);
        all[6..8].copy_from_slice(&clearcoat);
        all
    }
}

impl Features {
    /// Values of the WGSL `override` constants that switch each feature on (1) or off (0).
    pub fn constants(&self) -> [(&'static str, f64); 18] {
        [
            ("HAS_TEXTURES", self.textures),
            ("HAS_SURFACE_TEXTURES", self.surface_textures),
            ("HAS_COAT_TEXTURES", self.coat_textures),
            ("HAS_TEXTURE_TRANSFORMS", self.texture_transforms),
            ("HAS_NORMAL_MAPS", self.normal_maps),
            ("HAS_VERTEX_COLORS", self.vertex_colors),
            ("HAS_ALPHA", self.alpha),
            ("HAS_GLOSSY", self.glossy),
            ("HAS_TRANSMISSION", self.transmission),
            ("HAS_TRANSMISSION_TEXTURES", self.transmission_textures),
            ("HAS_GROUP_INDICES", self.group_indices),
            ("HAS_SPECULAR_COLORS", self.specular_colors),
            ("HAS_CLEARCOAT", self.clearcoat),
            ("HAS_RETROREFLECTORS", self.retroreflectors),
            ("HAS_NULL_BOUNDARIES", self.null_boundaries),
            ("HAS_SHEETS", self.sheets),
            ("SPLITS_AT_SHEETS", self.clear_sheets),
            ("HAS_DELAYS", self.delays),
        ]
        .map(|(name, on)| (name, if on { 1.0 } else { 0.0 }))
    }
}

/// What the device material of an instance depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Use {
    /// Index into [`Scene::materials`].
    material: u32,
    /// Whether the node is a selected emitter.
    is_emitter: bool,
    /// Whether the mesh has tangents.
    has_tangents: bool,
    /// Thin glass: the bits of its thickness in metres.
    sheet: Option<u32>,
}

/// The device materials that the scene uses. A material on a node that is not a selected emitter has no emission.
pub struct MaterialSet<'a> {
    scene: &'a Scene,
    emitters: &'a Emitters,
    albedo: &'a AlbedoTable,
    /// See [`interior_indices`].
    interiors: Vec<Option<u32>>,
    /// One device material per [`Use`] of a material.
    pub list: Vec<Material>,
    /// Of each material of `list`.
    pub smooth: Vec<SmoothShares>,
    numbers: HashMap<Use, u32>,
    /// Whether each mesh is thin glass, once this is known.
    sheets: HashMap<u32, bool>,
    /// Unit of length of render space, in metres.
    unit: f64,
    pub features: Features,
    /// Maximum travel time per length: the group index outside of solids, or the index of a transmissive material.
    pub max_ior: f32,
    /// Index of refraction outside of solids.
    surrounding_ior: f32,
}

impl<'a> MaterialSet<'a> {
    /// `unit`: unit of length of render space, in metres.
    pub fn new(scene: &'a Scene, emitters: &'a Emitters, albedo: &'a AlbedoTable, unit: f64) -> Self {
        let [surrounding_ior, max_ior] = scene::surrounding_indices(&scene.media);
        MaterialSet {
            scene,
            emitters,
            albedo,
            interiors: interior_indices(scene),
            list: vec![],
            smooth: vec![],
            numbers: HashMap::new(),
            sheets: HashMap::new(),
            unit,
            features: Features::default(),
            max_ior,
            surrounding_ior,
        }
    }

    /// Index in `list` of the material of the instance. The bit [`TRIANGLE_ALPHA`] says that rays may pass through the surface,
    /// the bit [`TRIANGLE_NULL`] that they always do, and the bit [`TRIANGLE_SHEET`] that the surface is thin glass. A null boundary
    /// that is inside out gets the bit [`TRIANGLE_MIRRORED`], which turns its triangles around.
    pub fn number(&mut self, instance: &scene::Instance) -> u32 {
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let material = mesh.material;
        let source = &self.scene.materials[material as usize];
        let is_sheet = *self.sheets.entry(instance.mesh).or_insert_with(|| source.is_sheet(mesh));
        let key = Use {
            material,
            is_emitter: self.emitters.include(&instance.node),
            has_tangents: !mesh.tangents.is_empty(),
            sheet: is_sheet.then(|| source.thickness_in(&instance.transform, mesh).to_bits()),
        };
        let number = match self.numbers.get(&key) {
            Some(&n) => n,
            None => {
                let n = self.list.len() as u32;
                let converted = self.convert(source, &key);
                let interior = self.interiors[material as usize].filter(|_| !is_sheet).unwrap_or(NONE);
                self.list.push(Material { interior, ..converted });
                let varies = converted.flags & MATERIAL_VARIES != 0;
                self.smooth.push(SmoothShares::new(self.scene, source, &converted, is_sheet, varies));
                self.numbers.insert(key, n);
                n
            }
        };
        let alpha = if is_partial(source, mesh) { TRIANGLE_ALPHA } else { 0 };
        self.features.alpha |= alpha != 0;
        self.features.vertex_colors |= !mesh.colors.is_empty();
        let is_null = source.is_null_boundary(mesh, self.surrounding_ior);
        self.features.null_boundaries |= is_null;
        let null = if is_null { TRIANGLE_NULL } else { 0 };
        let sheet = if is_sheet { TRIANGLE_SHEET } else { 0 };
        let turned = if is_null && null_boundary::is_inside_out(mesh) { TRIANGLE_MIRRORED } else { 0 };
        number | alpha | null | sheet | turned
    }

    fn convert(&mut self, m: &scene::Material, usage: &Use) -> Material {
        let &Use { is_emitter, has_tangents, .. } = usage;
        let normal_texture = m.normal_texture.filter(|_| has_tangents);
        let ior = m.ior / self.surrounding_ior;
        let uncolored = ((ior - 1.0) / (ior + 1.0)).powi(2);
        // Textures of a coat that does not reflect have no effect.
        let has_coat = m.specular > 0.0 && uncolored > 0.0 && (m.metallic < 1.0 || m.surface_texture.is_some());
        let of_coat = |texture: Option<u32>| texture.filter(|_| has_coat);
        let of_clearcoat = |texture: Option<u32>| texture.filter(|_| m.clearcoat > 0.0);
        let (specular_texture, specular_color_texture) =
            (of_coat(m.specular_texture), of_coat(m.specular_color_texture));
        let (clearcoat_texture, clearcoat_roughness_texture) =
            (of_clearcoat(m.clearcoat_texture), of_clearcoat(m.clearcoat_roughness_texture));
        // The limit of 1 applies after the texture.
        let limit = if specular_color_texture.is_some() { f32::MAX } else { 1.0 };
        let f0_color = m.specular_color.map(|color| (uncolored * color).min(limit) * m.specular);
        let f0 = f0_color.into_iter().fold(0.0, f32::max);
        // With a relative index of 1, or specular = 0, there is no coat.
        let f90 = if uncolored > 0.0 { m.specular } else { 0.0 };
        let smoothed = |roughness: f32| Some(roughness * roughness).filter(|a| *a >= DELTA_ALPHA).unwrap_or(0.0);
        let mut alpha = smoothed(m.roughness);
        let transmits = m.transmits();
        if transmits && (ior - 1.0).abs() < 1e-5 {
            alpha = 0.0;
        }
        let emission = if is_emitter { m.emission } else { [0.0; 3] };
        let emission_texture = if emission == [0.0; 3] { None } else { m.emission_texture };
        let coats = [specular_texture, specular_color_texture, clearcoat_texture, clearcoat_roughness_texture];
        let coat_varies = coats.iter().any(|texture| texture.is_some());
        let transmission_texture = m.transmission_texture.filter(|_| transmits);
        let varies = coat_varies || m.surface_texture.is_some() || transmission_texture.is_some();
        self.features.surface_textures |= varies;
        self.features.coat_textures |= coat_varies;
        self.features.normal_maps |= normal_texture.is_some();
        let retroreflector = m.retroreflector.filter(|retroreflector| retroreflector.share > 0.0);
        self.features.retroreflectors |= retroreflector.is_some();
        let has_lobes = m.metallic > 0.0 || f90 > 0.0 || transmits || m.clearcoat > 0.0;
        self.features.glossy |= has_lobes || retroreflector.is_some();
        self.features.specular_colors |= f0_color != [f0; 3] || specular_color_texture.is_some();
        self.features.clearcoat |= m.clearcoat > 0.0;
        self.features.transmission_textures |= transmission_texture.is_some();
        if transmits {
            self.features.transmission = true;
        }
        let thickness = usage.sheet.map(f32::from_bits);
        match thickness {
            Some(thickness) => {
                self.features.sheets = true;
                self.features.clear_sheets |= alpha == 0.0 || varies;
                self.features.delays |= thickness > 0.0;
            }
            None if transmits => {
                self.max_ior = self.max_ior.max(m.group_index());
                self.features.group_indices |= m.group_index() != m.ior;
            }
            None => {}
        }
        let thickness = f64::from(thickness.unwrap_or(0.0));
        let absorbed = m.interior.as_ref().map_or([0.0; 3], |medium| medium.sigma_a);
        // Fraction of the light that the coat lets in on average. The lower bound avoids 0 / 0 for a perfect reflector.
        let below = (1.0 - self.albedo.mean(alpha.into(), f0.into(), f90.into())).max(MIN_BELOW_COAT.into());
        let (mode, cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask(cutoff) => (MATERIAL_MASK, cutoff),
            AlphaMode::Blend => (MATERIAL_BLEND, 0.0),
        };
        let varying = if varies { MATERIAL_VARIES } else { 0 };
        let thin = if usage.sheet.is_some() { MATERIAL_THIN } else { 0 };
        let material = Material {
            base_color: [m.base_color[0], m.base_color[1], m.base_color[2]],
            opacity: m.base_color[3],
            emission,
            emission_density: 0.0,
            metallic: m.metallic,
            alpha,
            f0,
            ior,
            transmission: if transmits { m.transmission } else { 0.0 },
            diffuse_scale: (1.0 / (std::f64::consts::PI * below)) as f32,
            alpha_cutoff: cutoff,
            flags: mode | varying | thin | if m.double_sided { MATERIAL_DOUBLE_SIDED } else { 0 },
            base_texture: m.base_color_texture.unwrap_or(NONE),
            emission_texture: emission_texture.unwrap_or(NONE),
            f90,
            surface_texture: m.surface_texture.unwrap_or(NONE),
            normal_texture: normal_texture.unwrap_or(NONE),
            normal_scale: m.normal_scale,
            clearcoat: m.clearcoat,
            clearcoat_alpha: smoothed(m.clearcoat_roughness),
            f0_color,
            specular_color_texture: specular_color_texture.unwrap_or(NONE),
            specular_texture: specular_texture.unwrap_or(NONE),
            clearcoat_texture: clearcoat_texture.unwrap_or(NONE),
            clearcoat_roughness_texture: clearcoat_roughness_texture.unwrap_or(NONE),
            interior: NONE,
            retroreflection: retroreflector.map_or(0.0, |retroreflector| retroreflector.share),
            retroreflector_alpha: retroreflector.map_or(0.0, |retroreflector| retroreflector.alpha() as f32),
            transmission_texture: transmission_texture.unwrap_or(NONE),
            thickness: (thickness / self.unit) as f32,
            absorption: absorbed.map(|sigma| (sigma * thickness) as f32),
            group_index: m.group_ior.unwrap_or(ior * self.surrounding_ior),
        };
        let used = || material.textures().into_iter().filter(|&texture| texture != NONE);
        self.features.textures |= used().next().is_some();
        self.features.texture_transforms |=
            used().any(|texture| self.scene.textures[texture as usize].transform != DAffine2::IDENTITY);
        material
    }
}

/// Whether the alpha of the material, or the alpha of the vertex colours, may let light through the surface.
fn is_partial(m: &scene::Material, mesh: &scene::Mesh) -> bool {
    let opaque = match m.alpha_mode {
        AlphaMode::Opaque => f32::NEG_INFINITY,
        AlphaMode::Mask(cutoff) => cutoff,
        AlphaMode::Blend => 1.0,
    };
    let translucent = || mesh.colors.iter().any(|color| color[3] < 1.0);
    let varies = m.alpha_mode != AlphaMode::Opaque && (m.base_color_texture.is_some() || translucent());
    varies || m.base_color[3] < opaque
}

#[cfg(test)]
mod tests;
