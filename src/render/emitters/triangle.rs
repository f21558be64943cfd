//! Emissive triangles and their entries in the emitter table.

use glam::Vec3;

use super::{EmitterKind, luminance};
use crate::render::geometry::Geometry;
use crate::render::material::MATERIAL_DOUBLE_SIDED;
use crate::scene::Scene;
use crate::wgsl::layout::Emitter;
use crate::wgsl::layout::constants::*;

/// A triangle that emits light.
pub struct EmissiveTriangle {
    /// Entry of the device's emitter table.
    pub entry: Emitter,
    /// Luminance-weighted power in render space, which decides how often the triangle is chosen. It counts the mean of the whole
    /// texture.
    pub flux: f64,
    /// In render space.
    pub area: f64,
    pub corners: [Vec3; 3],
    pub instance: u32,
}

/// Luminance-weighted radiant exitance (flux per area) of each material in `geometry.materials`, over both sides of a
/// double-sided material. 0 for a material that does not emit.
pub fn exitances(scene: &Scene, geometry: &Geometry) -> Vec<f64> {
    let materials = geometry.materials.iter();
    materials
        .map(|m| {
            let sides = if m.flags & MATERIAL_DOUBLE_SIDED != 0 { 2.0 } else { 1.0 };
            sides * std::f64::consts::PI * luminance(m.emission) * mean_texel(scene, m.emission_texture)
        })
        .collect()
}

/// The emissive triangles with an area, in the order of the scene file. The order decides which emitter each random number
/// selects. The order in the BVH would depend on rounding.
pub fn emissive_triangles(geometry: &Geometry, exitances: &[f64]) -> Vec<EmissiveTriangle> {
    let exitance_of = |i: usize| exitances[(geometry.triangles[i].material & TRIANGLE_MATERIAL) as usize];
    let mut numbers: Vec<usize> = (0..geometry.triangles.len()).filter(|&i| exitance_of(i) > 0.0).collect();
    numbers.sort_unstable_by_key(|&i| geometry.bvh.order[i]);
    numbers
        .into_iter()
        .filter_map(|i| {
            let t = &geometry.triangles[i];
            let corners = [t.v0, t.v1, t.v2].map(Vec3::from);
            let [a, b, c] = corners.map(|p| p.as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            let entry =
                Emitter { kind: EmitterKind::Triangle as u32, triangle: i as u32, ..bytemuck::Zeroable::zeroed() };
            let flux = exitance_of(i) * area;
            (area > 0.0).then_some(EmissiveTriangle { entry, flux, area, corners, instance: t.instance })
        })
        .collect()
}

/// Mean luminance of the texels of `texture`; 1 if there is no texture.
fn mean_texel(scene: &Scene, texture: u32) -> f64 {
    let Some(texture) = scene.textures.get(texture as usize) else { return 1.0 };
    let image = &scene.images[texture.image as usize];
    let sum: f64 = image.rgba.iter().map(|c| luminance([linear(c[0]), linear(c[1]), linear(c[2])])).sum();
    sum / image.rgba.len().max(1) as f64
}

/// Decodes an sRGB byte to a linear value in [0, 1].
pub fn linear(byte: u8) -> f32 {
    let x = f32::from(byte) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}
