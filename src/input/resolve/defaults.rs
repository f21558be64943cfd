//! Choice of the default estimator.

use crate::estimators::{Conditions, Fog, GateWidth};
use crate::scene::{DensityGrid, Light, Material, Medium, Scene};
use crate::settings::units::Gate;
use crate::settings::*;

/// A gate is wide if its width is larger than this fraction of the scene's [`size`].
const WIDE_GATE: f64 = 0.4;

/// The gate that decides the default estimator. It is the widest of the gates, because `lcs` suits each of them, however long they
/// are together. But if light is focused, `lcs` has rare samples that are far too bright in the first gates of a long histogram
/// (docs/notebook/long-histograms.md). Then the interval of all gates together decides, except in a scan.
pub(super) fn decisive(responses: &Responses, scene: &Scene, is_scan: bool) -> Gate {
    if is_scan || !focuses_light(scene) { responses.widest() } else { responses.support() }
}

/// The default estimator for this gate, this scene and these emitters. `has_several`: whether there are several responses.
pub(super) fn estimator(gate: Gate, has_several: bool, scene: &Scene, emitters: &Emitters) -> Estimator {
    let any = |is: &dyn Fn(&Light) -> bool| scene.lights.iter().any(|light| is(light) && emitters.include(&light.node));
    let width = if gate != Gate::OPEN && gate.hi - gate.lo <= WIDE_GATE * size(scene, gate) {
        GateWidth::Narrow
    } else if gate == Gate::OPEN {
        GateWidth::Open
    } else {
        GateWidth::Wide
    };
    Estimator::default_for(&Conditions {
        gate: width,
        has_several,
        focuses_light: focuses_light(scene),
        has_beam: any(&|light| light.kind.needs_light_subpaths()),
        has_distant: any(&|light| light.kind.is_distant()),
        fog: fog(scene, size(scene, gate)),
    })
}

/// Length in metres that gates and fog are compared with: the diagonal of the scene. Fog that fills all space, without surfaces, has no
/// diagonal. Light in the gate goes no further than the end of the gate.
fn size(scene: &Scene, gate: Gate) -> f64 {
    if scene.bounds().is_some() { scene.diagonal() } else { gate.hi }
}

/// Fog is thick from this mean number of scattering events on (docs/notebook/no-gate.md). They count along the diagonal of the fog, or
/// along the scene's [`size`] if that is shorter.
const THICK: f64 = 3.0;

/// How much the media of the scene scatter. Media inside of meshes count as thin, because their size is not known here.
fn fog(scene: &Scene, size: f64) -> Fog {
    let scatters = |medium: &Medium| medium.sigma_s.iter().any(|&sigma| sigma > 0.0);
    let length = |medium: &Medium| {
        let diagonal = medium.extent().map_or(f64::INFINITY, |[lo, hi]| lo.distance(hi));
        diagonal.min(size)
    };
    let events = |medium: &Medium| {
        let sigma = medium.sigma_s.into_iter().fold(0.0, f64::max);
        sigma * medium.grid.as_ref().map_or(1.0, mean_density) * length(medium)
    };
    let of_meshes = || scene.materials.iter().filter_map(|material| material.interior.as_ref());
    if scene.media.iter().map(events).any(|events| events >= THICK) {
        Fog::Thick
    } else if scene.media.iter().chain(of_meshes()).any(scatters) {
        Fog::Thin
    } else {
        Fog::None
    }
}

/// Roughness below which a glossy surface focuses light so sharply that `pt` seldom finds the light.
const SHARP: f32 = 0.3;

/// Whether the scene has a material that can focus light: glass, or metal, gloss or a clear coat of low roughness.
fn focuses_light(scene: &Scene) -> bool {
    let focuses = |m: &Material| {
        m.transmits()
            || ((m.metallic > 0.0 || m.specular > 0.0) && is_sharp(scene, m.roughness, m.surface_texture))
            || (m.clearcoat > 0.0 && is_sharp(scene, m.clearcoat_roughness, m.clearcoat_roughness_texture))
    };
    scene.materials.iter().any(focuses)
}

/// Whether the mean roughness over a surface is below [`SHARP`]: the factor times the mean green channel of the texture.
fn is_sharp(scene: &Scene, factor: f32, texture: Option<u32>) -> bool {
    factor < SHARP || texture.is_some_and(|texture| f64::from(factor) * mean_green(scene, texture) < SHARP.into())
}

/// About how many texels of a texture or voxels of a grid are read at most.
const MAX_READ: usize = 1 << 16;

/// Mean over the voxels of a grid. For a large grid, it is the mean over evenly spaced voxels.
fn mean_density(grid: &DensityGrid) -> f64 {
    let step = (grid.density.len() / MAX_READ) | 1;
    let read = || grid.density.iter().step_by(step);
    read().map(|&density| f64::from(density)).sum::<f64>() / read().count().max(1) as f64
}

/// Mean of the green channel of a texture, in [0, 1]. For a large texture, it is the mean over evenly spaced texels.
fn mean_green(scene: &Scene, texture: u32) -> f64 {
    let texels = &scene.images[scene.textures[texture as usize].image as usize].rgba;
    // An odd step does not stay in one column of an image whose width is a power of two.
    let step = (texels.len() / MAX_READ) | 1;
    let (sum, count) =
        texels.iter().step_by(step).fold((0u64, 0u64), |(sum, n), texel| (sum + u64::from(texel[1]), n + 1));
    sum as f64 / (255 * count.max(1)) as f64
}
