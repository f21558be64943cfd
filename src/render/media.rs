//! Participating media on the device.

use glam::{DVec3, Vec3};

use super::space::RenderSpace;
use crate::error::{Error, Result};
use crate::scene::{self, PhaseFunction, Scene};
use crate::wgsl::layout::Medium;
use crate::wgsl::layout::constants::{PHASE_LOBES, PHASE_RAYLEIGH};

/// Stands for infinity in the corners of media without bounds.
const FAR: f32 = 3e38;

/// The media of the scene in render space, in the same order. Coefficients are per unit of length. Fails if the device cannot
/// render a medium.
pub fn media(scene: &Scene, space: &RenderSpace) -> Result<Vec<Medium>> {
    let number = |(i, medium)| convert(medium, space).map_err(|what| refusal(i, scene.media.len(), what));
    scene.media.iter().enumerate().map(number).collect()
}

fn refusal(index: usize, count: usize, what: &str) -> Error {
    let name = if count == 1 { "the medium".into() } else { format!("medium {index}") };
    Error::Settings(format!("{name} has {what}, which is not rendered yet; change it, or render with --no-medium"))
}

/// The record of a medium, or the property that kernels do not know.
fn convert(medium: &scene::Medium, space: &RenderSpace) -> Result<Medium, &'static str> {
    if medium.grid.is_some() {
        return Err("a density grid");
    }
    if medium.ior != 1.0 || medium.group_ior != 1.0 {
        return Err("an index of refraction");
    }
    let (phase, [g, g2], share) = match medium.phase {
        PhaseFunction::Isotropic => (PHASE_LOBES, [0.0; 2], 0.0),
        PhaseFunction::HenyeyGreenstein { g } => (PHASE_LOBES, [g, g], 0.0),
        PhaseFunction::DoubleHenyeyGreenstein { g, weight } => (PHASE_LOBES, g, 1.0 - weight),
        PhaseFunction::Rayleigh => (PHASE_RAYLEIGH, [0.0; 2], 0.0),
        PhaseFunction::HenyeyGreensteinDraine { .. } => return Err("a phase function of Draine"),
        PhaseFunction::Table { .. } => return Err("a table as phase function"),
    };
    let [lo, hi] = medium.bounds.map_or([Vec3::splat(-FAR), Vec3::splat(FAR)], |bounds| bounds.map(|p| space.point(p)));
    let per_unit = |sigma: [f64; 3]| (DVec3::from(sigma) * space.unit).as_vec3().to_array();
    Ok(Medium {
        lo: lo.to_array(),
        phase,
        hi: hi.to_array(),
        share: share as f32,
        sigma_s: per_unit(medium.sigma_s),
        g: g as f32,
        sigma_a: per_unit(medium.sigma_a),
        g2: g2 as f32,
    })
}
