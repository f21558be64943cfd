//! Gates that no light can meet: refused with what the scene offers instead.

use taugate::Error;
use taugate::internals::error::Result;
use taugate::internals::gpu::Device;
use taugate::internals::render::{PreparedScene, TravelTimeBounds, TravelTimes, probe};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;
use taugate::internals::settings::units::{Gate, METRES_PER_NS};

/// Width of a suggested gate as a part of the scene's diagonal.
pub const SUGGESTED_PART: f64 = 0.02;

/// Fails if bounds alone show that no path meets the gate.
pub fn check_gate(scene: &Scene, settings: &Settings, prepared: &PreparedScene, device: Option<&str>) -> Result<()> {
    let bounds = TravelTimeBounds::new(prepared, settings);
    if bounds.overlaps(&settings.responses().support()) {
        return Ok(());
    }
    let bound = bounds.explain_miss(&settings.responses().support(), travel);
    // What the probe finds is help; that there is none must not hide the mistake.
    let times = Device::open(device).and_then(|device| probe(&device, scene, settings, prepared));
    Err(refuse(settings, scene, &bound, times.ok().as_ref()))
}

/// The error for a render in which nothing fell inside the gate.
pub fn nothing_inside(device: &Device, scene: &Scene, settings: &Settings) -> Error {
    let times = PreparedScene::new(scene, settings).and_then(|prepared| probe(device, scene, settings, &prepared));
    let found = "no sample fell inside, so the image would be black";
    refuse(settings, scene, found, times.ok().as_ref())
}

fn refuse(settings: &Settings, scene: &Scene, found: &str, times: Option<&TravelTimes>) -> Error {
    let mut message = format!("the {} meets no light: {found}", settings.responses().describe());
    if let Some((first, last)) = times.and_then(TravelTimes::range) {
        let at = |p| travel(times.and_then(|t| t.percentile(p)).unwrap_or(first));
        message += &format!(
            "; the feasible range, as probed, is {} to {}, 5 % of the light arrive by {}, half by {}, 95 % by {}",
            travel(first),
            travel(last),
            at(5.0),
            at(50.0),
            at(95.0)
        );
    } else if times.is_some() {
        message += "; a probe found no light at any time: see taugate info";
    }
    if let Some(gate) = times.and_then(|t| suggestion(t, scene)) {
        message += &format!(": try --gate {gate}");
    }
    Error::Settings(format!("{message} (--force renders it all the same)"))
}

/// A gate around the median that is worth a try.
pub fn suggestion(times: &TravelTimes, scene: &Scene) -> Option<Gate> {
    let (low, high) = bounds(scene)?;
    times.suggestion(SUGGESTED_PART * (high - low).length())
}

/// World bounds of all placed triangles.
pub fn bounds(scene: &Scene) -> Option<(glam::DVec3, glam::DVec3)> {
    let corners = scene.instances.iter().flat_map(|instance| {
        let positions = &scene.meshes[instance.mesh as usize].positions;
        positions.iter().map(|p| instance.transform.transform_point3(p.map(f64::from).into()))
    });
    corners.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
}

/// `12.346 m (41.18 ns)`
fn travel(tau: f64) -> String {
    format!("{} m ({} ns)", short(tau), short(tau / METRES_PER_NS))
}

/// About five digits; with an exponent where the number is astronomical.
pub fn short(x: f64) -> String {
    if x.abs() >= 1e9 {
        return format!("{x:.4e}");
    }
    let decimals = match x.abs() {
        a if a >= 1000.0 => 1,
        a if a >= 10.0 => 3,
        a if a >= 0.1 => 4,
        _ => 7,
    };
    format!("{x:.decimals$}")
}
