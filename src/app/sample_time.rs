//! A note before a render that will take long.

use taugate::Result;
use taugate::internals::job::ready::Ready;
use taugate::internals::render::seconds_per_sample;
use taugate::internals::settings::Budget;

use super::progress::duration;

/// For an estimator that searches all triangles, seconds per sample are measured if the scene has at least this many.
const MANY_TRIANGLES: usize = 10_000;

/// Says how long one sample per pixel takes, and the whole image. `None` unless the estimator searches all triangles and the scene has many.
pub fn note(ready: &Ready) -> Result<Option<String>> {
    let Ready { renderer, scene, settings, prepared: Some(prepared), .. } = ready else { return Ok(None) };
    let triangles = prepared.triangles();
    if !settings.estimator().searches_all_triangles() || triangles < MANY_TRIANGLES {
        return Ok(None);
    }
    let seconds = seconds_per_sample(renderer, scene, settings, prepared)?;
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
