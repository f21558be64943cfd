//! Refuses gates that no light can meet, and suggests gates that show light.

use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::input::resolve;
use crate::render::{
    MissingLight, PreparedScene, TravelTimes, black_backs, missing_light, missing_light_at_any_time, probe,
};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::gates::Gates;
use crate::settings::units::{Gate, METRES_PER_NS};

/// Minimum width of a suggested gate, as a fraction of the diagonal of [`bounds`]. Without triangles: of the time from the 5th to the
/// 95th percentile of the light.
pub const SUGGESTED_PART: f64 = 0.02;

/// Fails if the travel-time bounds show that no path can meet the gate. `open` opens the device for a probe that adds advice.
pub fn check_gate(
    scene: &Scene,
    settings: &Settings,
    prepared: &PreparedScene,
    open: impl FnOnce() -> Result<Device>,
) -> Result<()> {
    let bounds = prepared.travel_time_bounds(settings.max_depth());
    if bounds.overlaps(&settings.responses().support()) {
        return Ok(());
    }
    let bound = bounds.explain_miss(&settings.responses().support(), travel);
    // The probe only adds advice to the message. If the probe fails, the user must still read about the gate.
    let probed = open().and_then(|device| Probed::new(&device, scene, settings, prepared));
    Err(refuse(settings, scene, &bound, probed.ok().as_ref()))
}

/// The error for a render in which no sample fell inside the gate.
pub fn nothing_inside(device: &Device, scene: &Scene, settings: &Settings) -> Error {
    let probed =
        PreparedScene::new(scene, settings).and_then(|prepared| Probed::new(device, scene, settings, &prepared));
    let found = "no sample fell inside, so the image would be black";
    refuse(settings, scene, found, probed.ok().as_ref())
}

/// Result of the probe. `backs`: a note, if no light arrives and black backs of surfaces may be the reason. `missing`: light that no
/// strategy forms, inside the gate; if no light arrives, at any time.
struct Probed {
    times: TravelTimes,
    backs: Option<String>,
    missing: Option<MissingLight>,
}

impl Probed {
    fn new(device: &Device, scene: &Scene, settings: &Settings, prepared: &PreparedScene) -> Result<Probed> {
        let times = probe(device, scene, settings, prepared)?;
        let (backs, missing) = match times.range() {
            Some(_) => (None, missing_light(scene, settings, prepared)),
            None => (
                black_backs(device, scene, settings, prepared)?.describe(),
                missing_light_at_any_time(scene, settings, prepared),
            ),
        };
        Ok(Probed { times, backs, missing })
    }
}

fn refuse(settings: &Settings, scene: &Scene, found: &str, probed: Option<&Probed>) -> Error {
    if settings.responses().chirp().is_some() {
        return Error::settings(format!(
            "the {} meets no beat: {found}; gates of an FMCW sensor are lengths of paths at rest, and motion shifts the beats: widen the gates, \
             or render with --doppler to see the velocities (--force renders anyway)",
            settings.responses().describe()
        ))
        .about("gate");
    }
    let times = probed.map(|probed| &probed.times);
    let meet = if settings.responses().len() > 1 { "meet" } else { "meets" };
    let mut message = format!("the {} {meet} no light: {found}", settings.responses().describe());
    if let Some((first, last)) = times.and_then(TravelTimes::range) {
        let at = |p| travel(times.and_then(|t| t.percentile(p)).unwrap_or(first));
        message += &format!(
            "; the feasible range, found by a probe, is {} to {}; 5 % of the light has arrived by {}, half by {}, 95 % by {}",
            travel(first),
            travel(last),
            at(5.0),
            at(50.0),
            at(95.0)
        );
    } else if probed.is_some_and(|probed| probed.missing.is_none()) {
        message += "; a probe found no light at any time; see taugate info";
    }
    if let Some(missing) = probed.and_then(|probed| probed.missing.as_ref()) {
        message += &format!("; {}", missing.describe());
    }
    if let Some(backs) = probed.and_then(|probed| probed.backs.as_ref()) {
        message += &format!("; {backs}");
    }
    if let Some(remedy) = times.and_then(|t| remedy(t, scene, settings)) {
        message += &format!("; try {remedy}");
    }
    Error::settings(format!("{message} (--force renders anyway)")).about("gate")
}

/// A flag with a gate that shows light. For a histogram, it has as many gates as in `settings`, and most of the light.
fn remedy(times: &TravelTimes, scene: &Scene, settings: &Settings) -> Option<String> {
    match settings.responses().uniform() {
        Some(gates) => {
            let gates = Gates::new(times.whole_gate()?, gates.count()).ok()?;
            resolve::is_fine(&gates.gate(gates.count() - 1), scene, settings).then(|| format!("--gates {gates}"))
        }
        None => suggestion(times, scene, settings, MEDIAN).map(|gate| format!("--gate {gate}")),
    }
}

/// The percentile of the suggested gate.
pub const MEDIAN: f64 = 50.0;

/// A gate around the time at which `percent` of the light has arrived. It is [`SUGGESTED_PART`] wide, or wider if 32-bit travel times
/// need it. `percent`: 0 to 100. `None` if no light arrived, or if the 5th and the 95th percentile are equal in a scene without
/// triangles.
pub fn suggestion(times: &TravelTimes, scene: &Scene, settings: &Settings, percent: f64) -> Option<Gate> {
    let whole = match bounds(scene) {
        Some((low, high)) => (high - low).length(),
        None => times.percentile(95.0)? - times.percentile(5.0)?,
    };
    let mut width = SUGGESTED_PART * whole;
    while width > 0.0 {
        let gate = times.gate_at(percent, width)?;
        if resolve::is_fine(&gate, scene, settings) {
            return Some(gate);
        }
        width *= 2.0;
    }
    None
}

/// World-space bounds of all instances, in metres; `None` without triangles.
pub fn bounds(scene: &Scene) -> Option<(glam::DVec3, glam::DVec3)> {
    let corners = scene.instances.iter().flat_map(|instance| {
        let positions = &scene.meshes[instance.mesh as usize].positions;
        positions.iter().map(|p| instance.transform.transform_point3(p.map(f64::from).into()))
    });
    corners.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
}

/// `12.346 m (41.182 ns)`
fn travel(tau: f64) -> String {
    format!("{} m ({} ns)", short(tau), short(tau / METRES_PER_NS))
}

/// With 1 to 7 decimals: four to six digits from 0.1 to 100,000. With an exponent from 1e9 on.
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
