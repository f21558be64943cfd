//! Compiles all kernels of a renderer at the same time.

use rayon::prelude::*;

use super::compaction::Compaction;
use super::light::LightTracer;
use super::photons::PhotonTracer;
use super::plan::Plan;
use super::responses::on_device;
use super::sensor::SensorTracer;
use crate::error::Result;
use crate::gpu::{Device, Kernel};

/// Compiles the kernels that a render of `plan` needs, on all cores. The device keeps them, so the phases find them compiled. Does
/// nothing if kernels check their indices, because the device does not keep such kernels.
pub fn compile_all(device: &Device, plan: &Plan) -> Result<()> {
    if !device.keeps_kernels() {
        return Ok(());
    }
    let constants = plan.constants();
    let photons: &[&'static str] = if plan.merging.is_some() { &[PhotonTracer::FILE] } else { &[] };
    let files = [&SensorTracer::files(plan)[..], &LightTracer::files(device.info(), plan), photons].concat();
    let mut entries: Vec<(&'static str, &str)> = files.into_iter().map(|file| (file, file)).collect();
    entries.extend(Compaction::ENTRIES.map(|entry| (Compaction::FILE, entry)));
    if on_device::is_suited(device.info(), plan) {
        entries.extend(on_device::ENTRIES);
    }
    let compile = |(file, entry)| Kernel::new(device, file, entry, &constants).map(drop);
    entries.into_par_iter().with_max_len(1).try_for_each(compile)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::Estimator;
    use crate::generate::{Kind, build};
    use crate::gpu::Drive;
    use crate::render::{PreparedScene, Renderer};
    use crate::settings::Settings;

    #[test]
    fn a_render_needs_no_other_kernels() {
        let scene = build(Kind::CornellBox);
        let cases = Estimator::ALL.into_iter().zip([Drive::CPU, Drive::CARD].into_iter().cycle());
        for (estimator, drive) in cases {
            let settings = Settings::builder().estimator(estimator).light_paths(16).resolution([4, 4]).build().unwrap();
            let prepared = PreparedScene::new(&scene, &settings).unwrap();
            let device = Device::open_with_drive(None, Some(drive)).expect("this test needs a Vulkan device");
            if !device.keeps_kernels() {
                return;
            }
            let plan = Plan::new(&scene, &settings, &prepared, device.info().quirks).unwrap();
            compile_all(&device, &plan).unwrap();
            let compiled = device.kernels_kept();
            let mut renderer = Renderer::from_prepared(&device, &scene, &settings, &prepared).unwrap();
            renderer.iterate(1).unwrap();
            assert!(compiled > 10 && device.kernels_kept() == compiled, "{estimator}: {compiled} kernels");
        }
    }
}
