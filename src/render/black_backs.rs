//! How much of the view is black because surfaces that are not double-sided show their backs.

use std::collections::BTreeMap;

use super::first_surface::first_surfaces;
use super::prepared_scene::PreparedScene;
use super::probe::small;
use crate::error::Result;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::Settings;

/// Smaller fractions of the visible surface are not reported.
const MIN_FRACTION: f64 = 0.01;

/// Black backs of surfaces in view.
#[derive(Debug, Clone, PartialEq)]
pub struct BlackBacks {
    /// Of the camera rays that hit a surface, the fraction that hits a black back first, 0 to 1; 0 if no ray hits a surface.
    pub fraction: f64,
    /// Name of the node whose black backs are hit by most rays; empty if there is none.
    pub node: String,
}

impl BlackBacks {
    /// One sentence with the remedy; `None` if the fraction is below 1 %.
    pub fn describe(&self) -> Option<String> {
        (self.fraction >= MIN_FRACTION).then(|| {
            format!(
                "{:.0} % of the surface in view is black because it is seen from behind (most of it in node '{}'); --double-sided makes \
                 both sides reflect and emit",
                100.0 * self.fraction,
                self.node
            )
        })
    }
}

/// Traces one ray per pixel of a small image of the same crop as `settings`. Fails if the scene does not fit the device.
pub fn black_backs(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<BlackBacks> {
    let mut surfaces = 0u64;
    let mut backs: BTreeMap<&str, u64> = BTreeMap::new();
    first_surfaces(device, scene, &small(settings), prepared, &mut |_, surface| {
        surfaces += 1;
        if surface.black_back {
            *backs.entry(scene.instances[surface.instance as usize].node.as_str()).or_default() += 1;
        }
    })?;
    let total: u64 = backs.values().sum();
    let node = backs.into_iter().max_by_key(|(_, count)| *count).map_or("", |(node, _)| node);
    Ok(BlackBacks { fraction: total as f64 / surfaces.max(1) as f64, node: node.into() })
}
