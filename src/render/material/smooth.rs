//! Where materials are perfectly smooth. A texture of the roughness may make them so in places.

use rayon::prelude::*;

use super::{DELTA_ALPHA, Material};
use crate::scene::{self, Scene};

/// The device packs properties that vary over a surface into few bits. It may round an alpha down by less than this factor.
const ROUNDING: f32 = 1.2;

/// Shares of the points of a material at which a lobe has no width, from 0 to 1. Without a texture of the roughness, each is 0 or 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SmoothShares {
    /// Reflection and refraction; for thin glass also the light that passes straight on.
    pub base: f64,
    pub clearcoat: f64,
    pub is_thin: bool,
}

impl SmoothShares {
    /// The shares of the device material `m`, made from `source`. Factors of metalness, transmission and coats count without textures.
    pub fn new(scene: &Scene, source: &scene::Material, m: &Material, is_thin: bool, varies: bool) -> SmoothShares {
        let limit = if varies { ROUNDING * DELTA_ALPHA } else { DELTA_ALPHA };
        let share = |has_lobe: bool, alpha: f32, texture: Option<u32>| match texture {
            _ if !has_lobe => 0.0,
            // Only light of lamps without a surface needs the share. Counting takes time in scenes with many textures.
            Some(_) if alpha >= limit && scene.lights.is_empty() => 0.0,
            Some(texture) if alpha >= limit => smooth_texels(scene, texture, limit / alpha),
            _ => f64::from(u8::from(alpha < limit)),
        };
        let has_base = m.metallic > 0.0 || m.transmission > 0.0 || m.f90 > 0.0;
        SmoothShares {
            base: share(has_base, m.alpha, source.surface_texture),
            clearcoat: share(m.clearcoat > 0.0, m.clearcoat_alpha, source.clearcoat_roughness_texture),
            is_thin,
        }
    }

    /// Whether any point has a lobe without width. Thin glass does not count: what it reflects twice on a path is dim.
    pub fn is_smooth(&self) -> bool {
        !self.is_thin && (self.base > 0.0 || self.clearcoat > 0.0)
    }

    /// Whether the material is thin glass that lets light pass straight on, at any point.
    pub fn is_smooth_sheet(&self) -> bool {
        self.is_thin && self.base > 0.0
    }
}

/// The share of the texels whose green channel, squared, is below `limit`.
fn smooth_texels(scene: &Scene, texture: u32, limit: f32) -> f64 {
    let texels = &scene.images[scene.textures[texture as usize].image as usize].rgba;
    // The squares rise with the bytes.
    let first_rough = (0..=255u8).find(|&byte| (f32::from(byte) / 255.0).powi(2) >= limit);
    let Some(first_rough) = first_rough else { return 1.0 };
    let count = texels.par_iter().with_min_len(1 << 16).filter(|texel| texel[1] < first_rough).count();
    count as f64 / texels.len().max(1) as f64
}
