//! How long a render takes, from a few of its samples.

use std::time::Instant;

use super::Renderer;
use super::prepared_scene::PreparedScene;
use crate::error::Result;
use crate::scene::Scene;
use crate::settings::{Crop, Sampling, Settings};

/// Sides of the small images. The first is quick in any scene; the next one fills the device better.
const SIDES: [u32; 3] = [4, 16, 64];
/// An image that takes more than this many seconds suffices; larger ones are not rendered.
const LONG_ENOUGH: f64 = 0.2;

/// Seconds that one sample in every pixel of the crop takes. Renders small images of the camera's whole view, with few light
/// subpaths, because the time for these does not depend on the resolution. Each image is rendered twice, because the first time
/// includes compiling kernels. `renderer` renders `scene` and lends the arrays of the scene on its device.
pub fn seconds_per_sample(
    renderer: &Renderer,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
) -> Result<f64> {
    let pixels = f64::from(settings.crop().width()) * f64::from(settings.crop().height());
    let mut seconds = 0.0;
    for side in SIDES {
        let crop = Crop { x0: 0, y0: 0, x1: side, y1: side };
        let small = settings.change().resolution([side, side]).crop(crop).light_paths(256).splat_paths(0);
        let settings = small.sampling(Sampling::Uniform).build()?;
        let mut renderer = renderer.sibling(scene, &settings, prepared)?;
        renderer.iterate(1)?;
        let begin = Instant::now();
        renderer.iterate(1)?;
        let elapsed = begin.elapsed().as_secs_f64();
        seconds = elapsed * pixels / f64::from(side * side);
        if elapsed > LONG_ENOUGH {
            break;
        }
    }
    Ok(seconds)
}
