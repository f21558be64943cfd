//! A note before a render that will take long.

use taugate::internals::error::Result;
use taugate::internals::estimators::Ellipsoids;
use taugate::internals::gpu::Device;
use taugate::internals::render::{PreparedScene, seconds_per_sample};
use taugate::internals::scene::Scene;
use taugate::internals::settings::{Budget, Settings};

use super::progress::duration;

/// For an estimator that searches all triangles, the pace is measured if the scene has at least this many.
const MANY_TRIANGLES: usize = 10_000;

/// Says how long one sample per pixel takes, and the whole image. `None` unless the estimator searches all triangles and the scene has many.
pub fn note(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Option<String>> {
    let triangles = prepared.triangles();
    if settings.estimator().record().ellipsoids != Ellipsoids::Enumerated || triangles < MANY_TRIANGLES {
        return Ok(None);
    }
    let seconds = seconds_per_sample(device, scene, settings, prepared)?;
    let image = match settings.budget() {
        Budget::Spp(spp) => format!(", and the whole image {}", duration(seconds * f64::from(spp))),
        Budget::Seconds(_) => String::new(),
    };
    Ok(Some(format!(
        "note: each connection of {} searches the {triangles} triangles, so one sample per pixel takes about {}{image}; the time of \
         lcs hardly depends on triangles",
        settings.estimator(),
        duration(seconds)
    )))
}
