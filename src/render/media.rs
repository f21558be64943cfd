//! Participating media on the device.

use bytemuck::Zeroable;
use glam::{DVec3, Vec3};

use super::space::RenderSpace;
use super::{grid, phase};
use crate::error::{Error, Result};
use crate::scene::{self, Scene, surrounding_indices};
use crate::wgsl::layout::constants::{PHASE_DRAINE, PHASE_LOBES, PHASE_RAYLEIGH, PHASE_TABLE};
use crate::wgsl::layout::{Grid, Medium};

/// Stands for infinity in the corners of media without bounds.
pub(super) const FAR: f32 = 3e38;
/// Upper bound on the cells and blocks of all density grids together: 2 GiB. Common drivers take no larger texel buffers.
const MAX_TEXELS: u64 = 1 << 27;
/// Maximum number of media: a vertex has 12 bits for the code of its solid (`shared/solid.wgsl`).
const MAX_MEDIA: usize = 4000;

/// The media of the scene in render space.
pub struct Media {
    /// First the media outside of solids, in the order of the scene; then the media inside solids, in the order of the materials.
    /// Coefficients are per unit of length.
    pub list: Vec<Medium>,
    /// Number of media outside of solids.
    pub outside: usize,
    /// Nodes of the tables of their phase functions.
    pub phase_tables: Vec<phase::Node>,
    /// Index of refraction and group index outside of solids.
    pub surrounding: [f32; 2],
    /// One record per medium if a medium has a density grid; else empty.
    pub grids: Vec<Grid>,
    /// Cells and blocks of the grids.
    pub densities: Vec<grid::Texel>,
}

impl Media {
    /// Fails if the device cannot render a medium.
    pub fn new(scene: &Scene, space: &RenderSpace) -> Result<Media> {
        let outside = scene.media.len();
        let (mut list, mut phase_tables) = (vec![], vec![]);
        for medium in &scene.media {
            list.push(convert(medium, space, &mut phase_tables));
        }
        for material in &scene.materials {
            if let Some(interior) = &material.interior {
                if interior.grid.is_some() {
                    return Err(Error::settings(format!(
                        "the medium inside material '{}' has a density grid, which is not rendered yet; remove the grid",
                        material.name
                    )));
                }
                list.push(convert(interior, space, &mut phase_tables));
            }
        }
        if list.len() > MAX_MEDIA {
            return Err(Error::settings(format!(
                "the scene has {} media, more than {MAX_MEDIA}; give materials with the same medium one common material",
                list.len()
            )));
        }
        let (grids, densities) = density_grids(scene, space, list.len())?;
        Ok(Media { list, outside, phase_tables, surrounding: surrounding_indices(&scene.media), grids, densities })
    }

    /// Values of the WGSL `override` constants that depend on the media. `has_glass`: whether a surface transmits light. The media
    /// around glass do not enter it.
    pub fn constants(&self, has_glass: bool) -> [(&'static str, f64); 10] {
        let switch = |on: bool| if on { 1.0 } else { 0.0 };
        let any = |holds: fn(&Medium) -> bool| switch(self.list.iter().any(holds));
        let [ior, group_index] = self.surrounding.map(f64::from);
        [
            ("HAS_MEDIA", switch(!self.list.is_empty())),
            ("HAS_INTERIORS", switch(self.list.len() > self.outside || (has_glass && !self.list.is_empty()))),
            ("HAS_GRIDS", switch(!self.grids.is_empty())),
            ("HAS_SCATTERING", any(|medium| medium.sigma_s != [0.0; 3])),
            ("HAS_TWO_LOBES", any(|medium| medium.phase == PHASE_LOBES && medium.share > 0.0)),
            ("HAS_RAYLEIGH", any(|medium| medium.phase == PHASE_RAYLEIGH)),
            ("HAS_DRAINE", any(|medium| medium.phase == PHASE_DRAINE)),
            ("HAS_PHASE_TABLES", any(|medium| medium.phase == PHASE_TABLE)),
            ("SURROUNDING_IOR", ior),
            ("SURROUNDING_GROUP_INDEX", group_index),
        ]
    }
}

/// By material: index in [`Media::list`] of the medium inside solids with this material.
pub fn interior_indices(scene: &Scene) -> Vec<Option<u32>> {
    let mut indices = scene.media.len() as u32..;
    scene.materials.iter().map(|m| m.interior.as_ref().and_then(|_| indices.next())).collect()
}

/// One record per medium if a medium has a density grid, else none; and the cells and blocks of the grids.
fn density_grids(scene: &Scene, space: &RenderSpace, media: usize) -> Result<(Vec<Grid>, Vec<grid::Texel>)> {
    let texels: u64 = scene.media.iter().filter_map(|medium| medium.grid.as_ref()).map(grid::texel_count).sum();
    if texels > MAX_TEXELS {
        return Err(Error::advice(
            format!("the density grids need {texels} texels on the device, more than {MAX_TEXELS}; "),
            "use grids with fewer voxels",
        ));
    }
    let (mut grids, mut densities) = (vec![], vec![]);
    if texels > 0 {
        grids = vec![Grid::zeroed(); media];
        for (record, medium) in grids.iter_mut().zip(&scene.media) {
            if let Some(grid) = &medium.grid {
                *record = grid::convert(grid, space, &mut densities);
            }
        }
    }
    Ok((grids, densities))
}

/// The record of a medium. The nodes of a table are appended to `phase_tables`.
fn convert(medium: &scene::Medium, space: &RenderSpace, phase_tables: &mut Vec<phase::Node>) -> Medium {
    let [lo, hi] =
        medium.extent().map_or([Vec3::splat(-FAR), Vec3::splat(FAR)], |bounds| bounds.map(|p| space.point(p)));
    let per_unit = |sigma: [f64; 3]| (DVec3::from(sigma) * space.unit).as_vec3().to_array();
    let mut record = Medium {
        lo: lo.to_array(),
        hi: hi.to_array(),
        sigma_s: per_unit(medium.sigma_s),
        sigma_a: per_unit(medium.sigma_a),
        ..Zeroable::zeroed()
    };
    phase::set(&medium.phase, &mut record, phase_tables);
    record
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{DensityGrid, GridFilter, Material, PhaseFunction};
    use glam::DAffine3;

    /// A grid of 512 x 512 x 512 voxels has 2^27 cells, and its blocks come on top of them. No density is read before the refusal.
    #[test]
    fn the_blocks_of_grids_count() {
        let refused = |resolution: [u32; 3]| {
            let (bounds, transform) = ([DVec3::ZERO, DVec3::ONE], DAffine3::IDENTITY);
            let grid = DensityGrid { resolution, density: vec![], bounds, transform, filter: GridFilter::Nearest };
            let media = vec![scene::Medium { grid: Some(grid), ..scene::Medium::default() }];
            density_grids(&Scene { media, ..Scene::default() }, &RenderSpace::metres(DVec3::ZERO), 1).err()
        };
        let message = refused([512; 3]).expect("an error").to_string();
        assert!(message.contains("need 134479872 texels on the device, more than 134217728"), "{message}");
    }

    /// Kernels contain the phase functions that the media have.
    #[test]
    fn each_phase_function_switches_on_its_constant() {
        let of = |phase: PhaseFunction| {
            let fog = scene::Medium { sigma_s: [0.1; 3], phase, ..scene::Medium::default() };
            let scene = Scene { media: vec![fog], ..Scene::default() };
            let constants = Media::new(&scene, &RenderSpace::metres(DVec3::ZERO)).unwrap().constants(false);
            let phases = ["HAS_TWO_LOBES", "HAS_RAYLEIGH", "HAS_DRAINE", "HAS_PHASE_TABLES"];
            let on = |name: &str| constants.iter().any(|(constant, value)| *constant == name && *value == 1.0);
            assert!(on("HAS_MEDIA") && on("HAS_SCATTERING") && !on("HAS_GRIDS") && !on("HAS_INTERIORS"));
            phases.into_iter().filter(|name| on(name)).collect::<Vec<_>>()
        };
        assert!(of(PhaseFunction::HenyeyGreenstein { g: 0.5 }).is_empty());
        assert_eq!(of(PhaseFunction::DoubleHenyeyGreenstein { g: [0.5, -0.2], weight: 0.8 }), ["HAS_TWO_LOBES"]);
        assert_eq!(of(PhaseFunction::Rayleigh), ["HAS_RAYLEIGH"]);
        let droplets = PhaseFunction::HenyeyGreensteinDraine { g: 0.5, g_draine: 0.9, alpha: 8.0, weight_draine: 0.4 };
        assert_eq!(of(droplets), ["HAS_DRAINE"]);
        let table = PhaseFunction::Table { cosines: vec![-1.0, 1.0], values: vec![1.0, 2.0] };
        assert_eq!(of(table), ["HAS_PHASE_TABLES"]);
    }

    #[test]
    fn media_inside_of_materials_follow_the_media_outside() {
        let with = |interior| Material { interior, ..Material::glass("glass") };
        let fog = scene::Medium::default();
        let materials = [Some(fog.clone()), None, Some(fog.clone())].map(with).to_vec();
        let scene = Scene { media: vec![fog], materials, ..Scene::default() };
        assert_eq!(interior_indices(&scene), [Some(1), None, Some(2)]);
    }
}
