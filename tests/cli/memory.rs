//! The memory that a render needs: what does not fit is refused, and what may not fit is warned about. Needs a device.

use taugate::internals::generate::{Kind, build};
use taugate::internals::gpu::{Device, DeviceInfo};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::render::{MemoryPlan, PreparedScene};
use taugate::internals::settings::Estimator;
use taugate::internals::settings::values::Resolution;

use super::info::{info, refused, scene};

#[test]
fn a_render_that_does_not_fit_is_refused_before_it_starts() {
    let here = scene("cornell-box");
    // The number of light vertices is known only after tracing. The estimate is 7 GiB, more than one buffer may have.
    let json = info(here.path(), &["--resolution", "32x32", "--light-paths", "16777216"]);
    let largest = &json["render"]["memory"]["largest"][0];
    assert_eq!(
        (largest["name"].as_str(), largest["fits"].as_bool()),
        (Some("light vertices"), Some(false)),
        "{largest}"
    );
    // The film needs 1 GiB. lavapipe allows no buffer of this size.
    let film = ["--resolution", "8192x8192"];
    let device = Device::open(None).unwrap();
    let part = match device.info() {
        device if device.largest_buffer() < 1 << 30 => "the film pixels need 1024 MiB",
        device if device.heap_bytes <= 1 << 30 => "the largest part are the film pixels with 1024 MiB",
        _ => return, // The device has enough memory.
    };
    refused(here.path(), &film, 4, &[part, "--resolution"]);
    let json = info(here.path(), &film);
    let problem = json["render"]["memory"]["problem"].as_str().unwrap();
    assert!(problem.contains(part), "{problem}");
}

/// The default number of light paths fits a device with the smallest buffers that Vulkan allows.
#[test]
fn default_light_paths_fit_the_smallest_device() {
    let scene = build(Kind::CornellBox);
    let device = DeviceInfo { max_texels: 1 << 16, max_storage_buffer_range: 128 << 20, ..DeviceInfo::unlimited() };
    for estimator in Estimator::ALL {
        let mut experiment = Experiment::default();
        experiment.render.estimator = Some(estimator);
        experiment.camera.resolution = Some(Resolution([1920, 1080]));
        let settings = resolve(&experiment, &scene).unwrap().settings;
        let prepared = PreparedScene::new(&scene, &settings).unwrap();
        let plan = MemoryPlan::new(&scene, &settings, &prepared, Some(&device)).unwrap();
        plan.check(&device).unwrap_or_else(|e| panic!("{estimator:?}: {e}"));
        assert_eq!(plan.warning(&device), None, "{estimator:?}");
    }
}

/// The program estimates the memory of the light vertices before it traces them, and warns if it is likely too much.
#[test]
fn a_pool_that_is_likely_too_large_is_warned_about() {
    let scene = build(Kind::CornellBox);
    let mut experiment = Experiment::default();
    experiment.render.light_paths = Some(1 << 20);
    let settings = resolve(&experiment, &scene).unwrap().settings;
    let prepared = PreparedScene::new(&scene, &settings).unwrap();
    let warning = |max_texels: u64| {
        // The same limit in bytes for texel buffers (16 bytes per texel) and storage buffers.
        let device = DeviceInfo { max_texels, max_storage_buffer_range: max_texels * 16, ..DeviceInfo::unlimited() };
        let plan = MemoryPlan::new(&scene, &settings, &prepared, Some(&device)).unwrap();
        (plan.warning(&device), plan.check(&device).is_ok())
    };
    // A vertex takes seven texels. Every path leaves at least one vertex, the estimate is four, plus a reserve of an eighth.
    assert_eq!(warning(40 << 20), (None, true));
    let (message, fits) = warning(20 << 20);
    let message = message.expect("a warning");
    assert!(fits && message.contains("light vertices need 504 MiB") && message.contains("--light-paths"), "{message}");
    assert_eq!(warning(7 << 20), (None, false), "the plan must refuse what does not fit for certain");
}
