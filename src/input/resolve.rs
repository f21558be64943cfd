//! Resolves an experiment and a scene to [`Settings`]: fills in defaults from the scene, and checks names and the gate.

mod defaults;
mod outputs;

use std::collections::HashSet;

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::responses::chosen;
use crate::render::space::RenderSpace;
use crate::scene::{Camera, Scene};
use crate::settings::doppler::Doppler;
use crate::settings::table::{CameraTable, EmitterTable, GateTable, RenderTable, Tables};
use crate::settings::units::{Gate, GatePrecision};
use crate::settings::values::Resolution;
use crate::settings::*;

pub use outputs::{Outputs, check_shard, checkpoint, outputs};

/// The settings of a render, and warnings for the user.
#[derive(Debug, Clone)]
pub struct Resolved {
    pub settings: Settings,
    /// One sentence per warning.
    pub warnings: Vec<String>,
    /// The one of them about a gate that is near the resolution of 32-bit travel times.
    pub gate_warning: Option<String>,
}

/// Fills in all settings. `experiment` (flags and file, already merged) has priority over the scene, and the scene over the
/// defaults. [`super::scenery::apply`] has already added cameras and lights. Fails if a name is unknown, if a value is outside its
/// limits, or if the scene has no camera or no light.
pub fn resolve(experiment: &Experiment, scene: &Scene) -> Result<Resolved> {
    resolve_with(experiment, scene, chosen(&experiment.gate)?)
}

/// As [`resolve`], with these responses instead of those of the experiment.
pub fn resolve_with(experiment: &Experiment, scene: &Scene, responses: Responses) -> Result<Resolved> {
    let mut warnings = Vec::new();
    let Experiment { render, .. } = experiment;
    // The user can correct these mistakes only in the scene, so the message names the scene's file.
    let unfit = |message: &str| Error::Scene {
        path: experiment.scene.clone().unwrap_or_else(|| "the scene".into()),
        message: message.into(),
    };
    if scene.instances.is_empty() && scene.media.is_empty() {
        return Err(unfit("has no surfaces; export a scene with visible meshes (points and lines are not rendered)"));
    }
    if scene.cameras.is_empty() {
        return Err(unfit("has no camera; add one with --camera auto or --look-from X,Y,Z"));
    }
    if emitting_nodes(scene).is_empty() {
        return Err(unfit(
            "has nothing that emits light; add a light with --headlamp, --lamp X,Y,Z,INTENSITY or --sky RADIANCE",
        ));
    }
    let camera = camera(&experiment.camera, scene)?;
    let narrowest = responses.narrowest();
    let resolution = resolution(&experiment.camera, &scene.cameras[camera])?;
    let emitters = emitters(&experiment.emitter, scene, responses.are_steady(), &mut warnings)?;
    let unseen = || unseen(scene, &scene.cameras[camera], &emitters, &responses, narrowest.hi);
    let gate_warning = match narrowest.hi.is_finite() {
        true => gate_warning(&narrowest, unseen(), &experiment.gate)?,
        false => None,
    };
    warnings.extend(gate_warning.clone());
    let estimator = render.estimator.unwrap_or_else(|| {
        let gate = defaults::decisive(&responses, scene, experiment.scan.is_some());
        defaults::estimator(gate, responses.len() > 1, scene, &emitters)
    });
    let mut settings = Settings::builder()
        .table(render)
        .estimator(estimator)
        .responses(responses)
        .resolution(resolution)
        .crop(experiment.camera.crop)
        .camera(camera)
        .emitters(emitters);
    if experiment.output.strategy_images.is_some() && render.sampling.is_none() {
        // Images of strategies need the same number of samples per pixel.
        settings = settings.sampling(Sampling::Uniform);
    }
    let settings = settings.build()?;
    if experiment.scan.is_some() && settings.fireflies() == Fireflies::Damp {
        return Err(Error::advice(
            "--fireflies damp is only for images, because the points of a scan are not neighbours; ",
            "leave it out",
        )
        .about("fireflies"));
    }
    if settings.doppler() != Doppler::OFF && experiment.output.strategy_images.is_some() {
        let message = "--strategy-images shows the colours of light, and --doppler velocities: ";
        return Err(Error::advice(message, "leave out one of them").about("doppler"));
    }
    warnings.extend(render.without_effect(estimator));
    if settings.splat_paths() > 0 && settings.strategies() == Strategies::Paper {
        warnings.push("--splat-paths has no effect, because --strategies paper forms no path with t = 1".into());
    }
    warnings.extend(settings.missed_lights(scene).map(|light| {
        let beam = format!("the beam '{}'", light.node);
        estimator.beam_refusal(&beam)
    }));
    Ok(Resolved { settings, warnings, gate_warning })
}

/// The experiment that resolves to exactly `settings`, with all defaults filled in. It keeps the gate keys of a sequence.
pub fn as_experiment(experiment: &Experiment, settings: &Settings, scene: &Scene) -> Experiment {
    let Tables { camera, emitter, gate, render } = settings.to_tables();
    let mut full = experiment.clone();
    full.camera = CameraTable {
        camera: Some(scene.cameras[settings.camera()].name.clone()),
        resolution: camera.resolution,
        crop: camera.crop,
        ..full.camera
    };
    full.emitter = EmitterTable { emitters: emitter.emitters, ..full.emitter };
    if experiment.scan.is_some() {
        // The scan places its own sensor and laser.
        (full.camera, full.emitter) = Default::default();
    }
    full.gate = match &experiment.gate {
        // The gate of a single frame says less than the keys.
        moving if moving.gate_keys.is_some() => GateTable { gate: None, ..moving.clone() },
        fixed => GateTable { force: fixed.force, ..gate },
    };
    full.render = RenderTable { device: experiment.render.device.clone(), strict: experiment.render.strict, ..render };
    full
}

/// Travel time of the latest light that matters to the gates of a pulsed laser, in diagonals of the scene.
const LATEST_LIGHT: f64 = 4.0;

/// Maximum length in metres that the travel times to `camera` omit.
fn uncounted(camera: &Camera) -> f64 {
    camera.projection.aims().unwrap_or_default().iter().map(|aim| aim.uncounted).fold(0.0, f64::max)
}

/// The sum of lengths in metres that make the rounding errors of travel times to `camera` larger, for a gate that ends at `end`: see
/// [`Gate::precision`].
fn unseen(scene: &Scene, camera: &Camera, emitters: &Emitters, responses: &Responses, end: f64) -> f64 {
    let from_origin = RenderSpace::distance_of_camera(scene, camera, emitters);
    let latest = if responses.is_repeated() { LATEST_LIGHT * scene.diagonal() } else { 0.0 };
    uncounted(camera) + from_origin + (latest - end).max(0.0)
}

/// Whether a render with this gate instead of that of `settings` gives no warning about 32-bit travel times.
pub fn is_fine(gate: &Gate, scene: &Scene, settings: &Settings) -> bool {
    let camera = &scene.cameras[settings.camera()];
    gate.precision(unseen(scene, camera, settings.emitters(), settings.responses(), gate.hi)) == GatePrecision::Fine
}

/// A warning if the width of `gate` is near the resolution of 32-bit travel times, else `None`. Fails if the gate is too narrow for them,
/// unless the user gave `--force`. Travel times are rounded as if they were longer by `unseen` metres: see [`Gate::precision`].
fn gate_warning(gate: &Gate, unseen: f64, table: &GateTable) -> Result<Option<String>> {
    match gate.precision(unseen) {
        GatePrecision::Fine => Ok(None),
        GatePrecision::TooThin { ulps } if !table.force.unwrap_or(false) => Err(Error::advice(
            format!(
                "the {} is only {ulps:.1} steps of 32-bit travel times wide, so its brightness may be wrong by more than 6 %; ",
                gate.describe()
            ),
            "make the gate wider, or add --force",
        )),
        GatePrecision::Coarse { ulps } | GatePrecision::TooThin { ulps } => Ok(Some(format!(
            "the {} is only {ulps:.0} steps of 32-bit travel times wide; its brightness may be wrong by {:.1} %",
            gate.describe(),
            100.0 / ulps.max(1.0)
        ))),
    }
}

fn camera(table: &CameraTable, scene: &Scene) -> Result<usize> {
    table.camera.as_ref().map_or(Ok(0), |name| find_camera(name, scene))
}

/// Index of the camera `name`. A camera that the user added comes last, and has priority over a camera of the file with the same
/// name.
pub(super) fn find_camera(name: &str, scene: &Scene) -> Result<usize> {
    scene.cameras.iter().rposition(|camera| camera.name == name).ok_or_else(|| {
        if let Some(unusable) = scene.unusable_cameras.iter().find(|camera| camera.name == name) {
            return Error::settings(&unusable.why);
        }
        let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).chain(["auto"]).collect();
        Error::advice(format!("no camera is called '{name}'; "), format!("choose one of {}", list(&names)))
            .about("camera")
    })
}

fn resolution(table: &CameraTable, camera: &Camera) -> Result<[u32; 2]> {
    let (resolution, source) = match (table.resolution, camera.resolution) {
        (Some(Resolution(typed)), _) => (typed, "--resolution".to_string()),
        (None, Some(from_file)) => (from_file, format!("the resolution in camera '{}'", camera.name)),
        (None, None) => {
            let height = f64::from(DEFAULT_WIDTH) / camera.aspect.unwrap_or(1.0);
            let height = height.round().clamp(1.0, f64::from(u32::MAX)) as u32;
            ([DEFAULT_WIDTH, height], format!("the resolution from the aspect ratio of camera '{}'", camera.name))
        }
    };
    check_resolution(&source, resolution)?;
    Ok(resolution)
}

/// Names of all nodes that emit, without repetition, in the order of the scene: first lights, then emissive meshes.
pub fn emitting_nodes(scene: &Scene) -> Vec<&str> {
    let emissive = |mesh: u32| {
        let material = scene.meshes[mesh as usize].material as usize;
        scene.materials[material].emission.iter().any(|&e| e > 0.0)
    };
    let lights = scene.lights.iter().map(|light| light.node.as_str());
    let meshes = scene.instances.iter().filter(|i| emissive(i.mesh)).map(|i| i.node.as_str());
    let mut seen = HashSet::new();
    lights.chain(meshes).filter(|node| seen.insert(*node)).collect()
}

/// The nodes that emit. A gated render leaves out suns and the sky, with a warning, because their light has no travel time.
fn emitters(table: &EmitterTable, scene: &Scene, is_steady: bool, warnings: &mut Vec<String>) -> Result<Emitters> {
    let candidates = emitting_nodes(scene);
    let emitters = table.emitters.clone().unwrap_or(Emitters::Scene);
    let emitters = match emitters {
        Emitters::Scene => Emitters::Scene,
        // A list with the one word `scene` means the same as the word alone, unless a node has this name.
        Emitters::Nodes(names) if names == ["scene"] && !candidates.contains(&"scene") => Emitters::Scene,
        Emitters::Nodes(names) if names.is_empty() => {
            return Err(Error::advice("no emitter is selected; ", format!("choose from {}", list(&candidates))).about("emitters"));
        }
        Emitters::Nodes(names) => Emitters::Nodes(whole_names(&names, &candidates).map_err(|unknown| {
            let candidates = list(&candidates);
            Error::settings(format!(
                "no node '{unknown}' emits light; --emitters may name {candidates} (--headlamp, --lamp and --sky add lights)"
            ))
        })?),
    };

    let distant: HashSet<&str> =
        scene.lights.iter().filter(|light| light.kind.is_distant()).map(|light| light.node.as_str()).collect();
    let is_distant = |node: &&str| distant.contains(*node);
    let (distant, others): (Vec<&str>, Vec<&str>) =
        candidates.iter().filter(|node| emitters.include(node)).partition(|n| is_distant(n));
    let (false, Some(first)) = (is_steady, distant.first()) else { return Ok(emitters) };
    if !others.is_empty() {
        warnings.push(format!(
            "suns and the sky are infinitely far away and have no travel time, so this gated render leaves out {}",
            list(&distant)
        ));
        return Ok(Emitters::Nodes(others.into_iter().map(String::from).collect()));
    }
    let positioned: Vec<&str> = candidates.iter().copied().filter(|node| !is_distant(node)).collect();
    let remedy = match positioned[..] {
        [] => "add a light that has a position (--headlamp, --lamp)".to_string(),
        _ => format!("choose other lights with --emitters from {}", list(&positioned)),
    };
    Err(Error::advice(
        format!("the light '{first}' is infinitely far away, so its light has no travel time to gate; "),
        format!("render without a gate, or {remedy}"),
    ))
}

/// The candidates that `typed` names, in order. `typed` was split at its commas. A node's name may contain commas, so several
/// consecutive parts may spell one name. A name without commas has priority. The error is the first part that is in no name.
fn whole_names(typed: &[String], candidates: &[&str]) -> Result<Vec<String>, String> {
    let spells = |name: &str, parts: &[String]| match parts {
        [whole] if whole == name => true,
        _ => name.split(',').map(str::trim).eq(parts.iter().map(String::as_str)),
    };
    // For each position, filled from last to first: the end of the name that begins there, and the name. `None` unless all parts
    // from there on spell names.
    let mut ends = vec![None; typed.len() + 1];
    ends[typed.len()] = Some((typed.len(), ""));
    for from in (0..typed.len()).rev() {
        ends[from] = (from + 1..=typed.len()).filter(|&to| ends[to].is_some()).find_map(|to| {
            let name = candidates.iter().find(|name| spells(name, &typed[from..to]))?;
            Some((to, *name))
        });
    }
    let (mut at, mut names) = (0, vec![]);
    while at < typed.len() {
        let Some((end, name)) = ends[at] else {
            let unknown =
                typed.iter().find(|part| !candidates.iter().any(|name| name.split(',').any(|p| p.trim() == *part)));
            return Err(unknown.unwrap_or(&typed[at]).clone());
        };
        names.push(name.to_string());
        at = end;
    }
    Ok(names)
}

/// Names as text for a message: the first 12, and how many more there are.
fn list(names: &[&str]) -> String {
    let shown: Vec<&str> = names.iter().take(12).copied().collect();
    match names.len().saturating_sub(shown.len()) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests;
