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
/// Maximum number of media: a vertex has 12 bits for the code of its solid (`shared/solid.wgsl`).
const MAX_MEDIA: usize = 4000;

/// The media of the scene in render space.
pub struct Media {
    /// First the media outside of solids, in the order of the scene. Then those inside of solids, by material. Coefficients are
    /// per unit of length.
    pub list: Vec<Medium>,
    /// Number of media outside of solids.
    pub outside: usize,
    /// Nodes of the tables of their phase functions.
    pub phase_tables: Vec<phase::Node>,
    /// Index of refraction and group index outside of solids.
    pub surrounding: [f32; 2],
}

impl Media {
    /// Fails if the device cannot render a medium.
    pub fn new(scene: &Scene, space: &RenderSpace) -> Result<Media> {
        let outside = scene.media.len();
        let (mut list, mut phase_tables) = (vec![], vec![]);
        for (i, medium) in scene.media.iter().enumerate() {
            let name = || if outside == 1 { "the medium".into() } else { format!("medium {i}") };
            let refuse = |what: &str| refusal(&name(), what, "change it, or render with --no-medium");
            list.push(convert(medium, space, &mut phase_tables).map_err(refuse)?);
        }
        for material in &scene.materials {
            if let Some(interior) = &material.interior {
                let refuse =
                    |what: &str| refusal(&format!("the medium inside material '{}'", material.name), what, "change it");
                list.push(convert(interior, space, &mut phase_tables).map_err(refuse)?);
            }
        }
        if list.len() > MAX_MEDIA {
            return Err(Error::Settings(format!(
                "the scene has {} media, more than {MAX_MEDIA}; give materials with the same medium one common material",
                list.len()
            )));
        }
        Ok(Media { list, outside, phase_tables, surrounding: surrounding_indices(&scene.media) })
    }

    /// Values of the WGSL `override` constants that depend on the media.
    pub fn constants(&self) -> [(&'static str, f64); 6] {
        let switch = |on: bool| if on { 1.0 } else { 0.0 };
        let has = |phase| switch(self.list.iter().any(|medium| medium.phase == phase));
        let [ior, group_index] = self.surrounding.map(f64::from);
        [
            ("HAS_MEDIA", switch(!self.list.is_empty())),
            ("HAS_INTERIORS", switch(self.list.len() > self.outside)),
            ("HAS_DRAINE", has(PHASE_DRAINE)),
            ("HAS_PHASE_TABLES", has(PHASE_TABLE)),
            ("SURROUNDING_IOR", ior),
            ("SURROUNDING_GROUP_INDEX", group_index),
        ]
    }
}

/// Index in [`Media::list`] of the medium inside of solids of a material.
pub fn interior_index(scene: &Scene, material: u32) -> Option<u32> {
    let (before, rest) = scene.materials.split_at(material as usize);
    let number = before.iter().filter(|m| m.interior.is_some()).count();
    rest[0].interior.is_some().then_some((scene.media.len() + number) as u32)
}

fn refusal(name: &str, what: &str, remedy: &str) -> Error {
    Error::Settings(format!("{name} has {what}, which is not rendered yet; {remedy}"))
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
