//! The surface that the centre of each pixel shows: for auxiliary layers of an image, and to name the object in a pixel.

use bytemuck::Zeroable;

use super::device_scene::{DeviceScene, frame_buffer};
use super::plan::{Iteration, Plan};
use super::prepared_scene::PreparedScene;
use super::stats::computes_wrongly;
use crate::error::Result;
use crate::gpu::{Buffer, Device, Kernel, Recorder};
use crate::scene::Scene;
use crate::settings::{Estimator, Settings};
use crate::wgsl::layout::{Dispatch, NONE};

/// Pixels per submit.
const BATCH: u32 = 1 << 16;
/// The bit that marks a black back in the last word of a surface, as in `first_surface.wgsl`.
const BLACK_BACK: u32 = 1 << 31;
const REMEDY: &str = "choose another --device";

/// The surface that the ray through the centre of a pixel hits first. Glass counts as a surface. A surface with alpha counts
/// where its coverage is at least 0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstSurface {
    /// Length of the camera ray, from the pinhole or the sensor plane to the surface, in metres.
    pub distance: f32,
    /// Unit shading normal in world space, on the side of the surface that the camera sees.
    pub normal: [f32; 3],
    /// Base colour, linear. It is the colour of diffuse reflection, and the reflectance of a metal at normal incidence. Black
    /// for the back of a surface that is not double-sided.
    pub albedo: [f32; 3],
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Whether the camera sees the back of a surface that is neither double-sided nor glass.
    pub black_back: bool,
}

/// Traces one ray through the centre of each pixel of the crop. If the ray hits a surface, calls `visit` with the row-major index
/// of the pixel in the crop, and with the surface. `prepared` must be prepared for the same camera or for one nearby. Fails if
/// the scene does not fit the device.
pub fn first_surfaces(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
    visit: &mut impl FnMut(usize, FirstSurface),
) -> Result<()> {
    // The estimator does not matter here, but some estimators refuse scenes that this one accepts.
    let settings = settings.change().estimator(Estimator::UNGATED).build()?;
    let plan = Plan::new(scene, &settings, prepared, device.info().quirks)?;
    let on_device = DeviceScene::new(device, scene, prepared, plan.hardware_rays)?;
    let mut frame = frame_buffer(device)?;
    frame.write(0, &[plan.frame(&Iteration { number: 0, first_sample: 0, samples: 1 }, None)])?;
    let mut constants = plan.constants();
    constants.push(("AT_HALF_COVERAGE", 1.0));
    let kernel = Kernel::new(device, "first_surface", "first_surface", &constants)?;
    let surfaces = Buffer::new::<[u32; 8]>(device, "first surfaces", BATCH as usize, REMEDY)?;
    let mut buffers = on_device.bindings(&frame);
    buffers.push(("surfaces", &surfaces));
    let bindings = kernel.bind(&buffers)?;
    let mut recorder = Recorder::new(device)?;
    let pixels = u32::try_from(plan.crop_pixels).expect("an image has at most MAX_PIXELS pixels");
    for first in (0..pixels).step_by(BATCH as usize) {
        let count = BATCH.min(pixels - first);
        let constants = Dispatch { first, count, ..Dispatch::zeroed() };
        recorder.dispatch("first_surface", &kernel, &bindings, &constants, kernel.groups(count as usize))?;
        recorder.submit()?;
        let are_right = surfaces.with::<[u32; 8], _>(count as usize, |surfaces| {
            let seen = surfaces.iter().enumerate().filter(|(_, words)| words[7] != NONE);
            let mut seen = seen.map(|(i, words)| (first as usize + i, unpack(words, prepared.space.unit)));
            seen.all(|(pixel, surface)| {
                let exists = (surface.instance as usize) < scene.instances.len();
                if exists {
                    visit(pixel, surface);
                }
                exists
            })
        })?;
        if !are_right {
            return Err(computes_wrongly("it saw an object that does not exist"));
        }
    }
    Ok(())
}

/// The surface in the words that `first_surface.wgsl` writes; `unit` is the unit of render space in metres.
fn unpack(words: &[u32; 8], unit: f64) -> FirstSurface {
    let [distance, x, y, z, r, g, b] = [0, 1, 2, 3, 4, 5, 6].map(|i| f32::from_bits(words[i]));
    FirstSurface {
        distance: (f64::from(distance) * unit) as f32,
        normal: [x, y, z],
        albedo: [r, g, b],
        instance: words[7] & !BLACK_BACK,
        black_back: words[7] & BLACK_BACK != 0,
    }
}
