//! The first arrival of light in each pixel.

use super::emitters::luminance;
use super::prepared_scene::PreparedScene;
use super::probe::{observer, without_gate};
use crate::error::Result;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::wgsl::layout::NONE;

/// Samples per pixel and iteration, and number of iterations.
const SAMPLES: u32 = 4;
const ITERATIONS: u32 = 4;

/// The travel time (metres of optical path) at which the first light arrives in each pixel of the crop, row by row; 0 where no
/// light was found. Light from suns, from the sky, or straight from an emitter in view does not count. The result is the
/// minimum over 16 samples per pixel and all strategies except t = 1, for which the device does not report the pixel. So it is an
/// upper bound. In scenes without fog, it is exact where a point light or the spot of a beam lights the first surface. Elsewhere it
/// may be late by the size of the lamp, or by more where only scattered light arrives.
pub fn first_arrivals(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<Vec<f32>> {
    if prepared.has_distant() {
        let pixels = settings.crop().width() as usize * settings.crop().height() as usize;
        return match PreparedScene::without_distant(scene, settings) {
            Some((settings, prepared)) => first_arrivals(device, scene, &settings, &prepared),
            None => Ok(vec![0.0; pixels]),
        };
    }
    let settings = without_gate(settings).build()?;
    let mut renderer = observer(device, scene, &settings, prepared)?;
    let mut first = vec![f32::INFINITY; settings.crop().width() as usize * settings.crop().height() as usize];
    for _ in 0..ITERATIONS {
        renderer.observe(SAMPLES, &mut |seen| {
            let weight = luminance(seen.rgb);
            if seen.pixel != NONE && weight > 0.0 && weight.is_finite() {
                let pixel = &mut first[seen.pixel as usize];
                *pixel = pixel.min(seen.tau);
            }
        })?;
    }
    let metres = |tau: f32| if tau.is_finite() { (f64::from(tau) * prepared.space.unit) as f32 } else { 0.0 };
    Ok(first.into_iter().map(metres).collect())
}
