//! Participating media on the device.

use glam::{DVec3, Vec3};

use super::phase;
use super::space::RenderSpace;
use crate::error::{Error, Result};
use crate::scene::{self, Scene, surrounding_indices};
use crate::wgsl::layout::Medium;
use crate::wgsl::layout::constants::{PHASE_DRAINE, PHASE_TABLE};

/// Stands for infinity in the corners of media without bounds.
const FAR: f32 = 3e38;

/// The media of the scene in render space.
pub struct Media {
    /// In the order of the scene. Coefficients are per unit of length.
    pub list: Vec<Medium>,
    /// Nodes of the tables of their phase functions.
    pub phase_tables: Vec<phase::Node>,
    /// Index of refraction and group index outside of solids.
    pub surrounding: [f32; 2],
}

impl Media {
    /// Fails if the device cannot render a medium.
    pub fn new(scene: &Scene, space: &RenderSpace) -> Result<Media> {
        let mut phase_tables = vec![];
        let mut number =
            |(i, medium)| convert(medium, space, &mut phase_tables).map_err(|what| refusal(i, scene.media.len(), what));
        let list = scene.media.iter().enumerate().map(&mut number).collect::<Result<Vec<_>>>()?;
        Ok(Media { list, phase_tables, surrounding: surrounding_indices(&scene.media) })
    }

    /// Values of the WGSL `override` constants that depend on the media.
    pub fn constants(&self) -> [(&'static str, f64); 5] {
        let has = |phase| if self.list.iter().any(|medium| medium.phase == phase) { 1.0 } else { 0.0 };
        let [ior, group_index] = self.surrounding.map(f64::from);
        [
            ("HAS_MEDIA", if self.list.is_empty() { 0.0 } else { 1.0 }),
            ("HAS_DRAINE", has(PHASE_DRAINE)),
            ("HAS_PHASE_TABLES", has(PHASE_TABLE)),
            ("SURROUNDING_IOR", ior),
            ("SURROUNDING_GROUP_INDEX", group_index),
        ]
    }
}

fn refusal(index: usize, count: usize, what: &str) -> Error {
    let name = if count == 1 { "the medium".into() } else { format!("medium {index}") };
    Error::Settings(format!("{name} has {what}, which is not rendered yet; change it, or render with --no-medium"))
}

/// The record of a medium, or the property that kernels do not know. The nodes of a table are appended to `phase_tables`.
fn convert(
    medium: &scene::Medium,
    space: &RenderSpace,
    phase_tables: &mut Vec<phase::Node>,
) -> Result<Medium, &'static str> {
    if medium.grid.is_some() {
        return Err("a density grid");
    }
    let [lo, hi] = medium.bounds.map_or([Vec3::splat(-FAR), Vec3::splat(FAR)], |bounds| bounds.map(|p| space.point(p)));
    let per_unit = |sigma: [f64; 3]| (DVec3::from(sigma) * space.unit).as_vec3().to_array();
    let mut record = Medium {
        lo: lo.to_array(),
        hi: hi.to_array(),
        sigma_s: per_unit(medium.sigma_s),
        sigma_a: per_unit(medium.sigma_a),
        ..bytemuck::Zeroable::zeroed()
    };
    phase::set(&medium.phase, &mut record, phase_tables);
    Ok(record)
}
