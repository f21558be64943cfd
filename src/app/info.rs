//! `taugate info`: the contents of a scene, the memory that a render needs, and the travel times of the light.

mod contents;
mod map;
mod media;
mod pixel;
mod plot;
mod poses;
mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use serde::Serialize;
use taugate::Error;
use taugate::internals::gpu::{BufferDesc, Device, DeviceInfo};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::resolve;
use taugate::internals::input::scenery;
use taugate::internals::job::{feasible, read};
use taugate::internals::render::sheets::Glass;
use taugate::internals::render::{
    BlackBacks, MemoryPlan, PreparedScene, TravelTimeBounds, TravelTimes, black_backs, formed_light,
    missing_light_at_any_time, probe, view_thickness,
};
use taugate::internals::scene::Scene;
use taugate::internals::settings::table::InputTable;
use taugate::internals::settings::units::METRES_PER_NS;
use taugate::internals::settings::{Crop, Settings};

pub use contents::emitters;
use map::Map;
use media::{Medium, Thickness};
use pixel::Shown;

use super::{compiling, render};
use crate::app::cli::InfoArgs;

/// Percentiles of the arriving light whose travel times the report lists.
const PERCENTILES: [f64; 7] = [1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0];
/// Number of buffers that the report lists, largest first.
const LARGEST: usize = 8;

/// Everything that the command prints. With --json, the keys are the names of these fields.
#[derive(Serialize)]
struct Report {
    triangles: usize,
    instances: usize,
    meshes: usize,
    mesh_triangles: usize,
    /// Lower corner, upper corner and length of the diagonal, in metres; none without triangles.
    bounds: Option<([f64; 3], [f64; 3], f64)>,
    cameras: Vec<Camera>,
    emitters: Vec<Emitter>,
    materials: Vec<String>,
    materials_in_file: usize,
    /// Used materials whose meshes contain a medium, with its mean free path and its coefficients.
    interiors: Vec<String>,
    /// Glass, thin or solid, and why.
    glass: Vec<Glass>,
    textures: usize,
    images: usize,
    texels: u64,
    media: Vec<Medium>,
    warnings: Vec<String>,
    render: Option<Render>,
    /// Choices that the program made for the user, and reasons why parts of the report are missing.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Camera {
    name: String,
    position: [f64; 3],
    /// Vertical field of view of a perspective camera.
    degrees_high: Option<f64>,
    /// Height of the view of an orthographic camera.
    metres_high: Option<f64>,
    /// What its lens does; `None` without a lens.
    lens: Option<String>,
    resolution: Option<[u32; 2]>,
}

#[derive(Serialize)]
struct Emitter {
    node: String,
    kind: String,
    /// Luminance-weighted power in W. None for a sun or a sky (`kind` has its irradiance), for an emitter that --emitters leaves out,
    /// and if the scene cannot be prepared.
    watts: Option<f64>,
}

/// The part of the report that depends on the settings.
#[derive(Serialize)]
struct Render {
    camera: String,
    resolution: [u32; 2],
    max_depth: u32,
    light_paths: u32,
    memory: Memory,
    /// None if all light comes from infinitely far away.
    possible: Option<TravelTimeBounds>,
    /// The part of the image whose light is measured, if it is not the whole image: x0,x1,y0,y1.
    crop: Option<String>,
    /// The gates of an experiment; none if all light counts.
    gate: Option<Gate>,
    light: Option<Light>,
    /// Which strategy forms which kind of light, one sentence each.
    formed: Vec<String>,
    /// Fraction of the visible surface that is the black back of a one-sided surface; none if it was not measured.
    black_backs: Option<f64>,
    /// None without media, or if it was not measured.
    optical_thickness: Option<Thickness>,
    /// The object that --pixel asked for.
    pixel: Option<Shown>,
    /// The files of --map.
    map: Option<Map>,
}

/// The gates of an experiment.
#[derive(Serialize)]
struct Gate {
    gates: String,
    /// The share of the light that arrives from the start of the first gate to the end of the last one, 0 to 1. None if no travel times
    /// were measured, and for gates without an end.
    share: Option<f64>,
}

impl Gate {
    fn new(settings: &Settings, times: Option<&TravelTimes>) -> Option<Gate> {
        let responses = settings.responses();
        let support = responses.support();
        let is_limited = !responses.is_repeated() && !support.is_open();
        let share = times.filter(|_| is_limited).and_then(|times| times.share(&support));
        (!responses.are_steady()).then(|| Gate { gates: responses.describe(), share })
    }
}

#[derive(Serialize)]
struct Memory {
    device: Option<String>,
    scene_bytes: u64,
    iteration_bytes: u64,
    /// Estimated size of the light-vertex pool and its trees.
    pool_bytes: u64,
    device_bytes: u64,
    /// Estimated peak of the program's memory on the host.
    host_bytes: u64,
    /// How many iterations host and device work on at a time.
    in_flight: u32,
    heap_bytes: Option<u64>,
    largest: Vec<Part>,
    /// The error if a buffer does not fit on the device, with the remedy.
    problem: Option<String>,
}

#[derive(Serialize)]
struct Part {
    name: &'static str,
    bytes: u64,
    /// The device's limit for a buffer of this kind, in bytes.
    allowed: Option<u64>,
    fits: Option<bool>,
}

/// Travel times of the light that reaches the sensor, measured by a probe. Emitters in view are left out.
#[derive(Serialize)]
struct Light {
    first: Arrival,
    last: Arrival,
    percentiles: Vec<Arrival>,
    suggested_gate: Option<String>,
}

#[derive(Serialize)]
pub struct Arrival {
    percent: f64,
    metres: f64,
    nanoseconds: f64,
    /// Half of `metres`: the one-way range if the sensor is beside the emitter.
    depth_metres: f64,
}

pub fn run(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    map::check(&args.map)?;
    args.plot.as_deref().map_or(Ok(()), plot::check)?;
    let mut experiment = read::experiment(args.input.clone(), args.flags.0.clone())?;
    if let Some(wanted) = &args.poses {
        poses::write(&experiment, wanted)?;
        return Ok(ExitCode::SUCCESS);
    }
    let notes = reduce(&mut experiment);
    let files: Vec<PathBuf> = args.map.iter().chain(&args.plot).cloned().collect();
    render::check_inputs(&files, experiment.scene.as_ref().expect("the experiment names a scene"), &experiment)?;
    compiling::announce()?;
    let mut scene = read::scene(&experiment)?;
    let choices = scenery::apply(&mut experiment, &mut scene)?;
    let mut report = contents::report(&scene);
    report.notes = [notes, choices].concat();
    match resolve(&experiment, &scene) {
        Ok(resolved) => {
            report.warnings.extend(resolved.warnings);
            add_render(&mut report, &scene, &resolved.settings, args, experiment.render.device.as_deref())?;
            // A scan wants waveforms, and the first light of a LiDAR may be fog before its lens.
            if let Some(light) =
                report.render.as_mut().filter(|_| experiment.scan.is_some()).and_then(|r| r.light.as_mut())
            {
                light.suggested_gate = None;
            }
        }
        // The user must change the scene to remove this error. The report still lists the contents.
        Err(Error::Scene { message, .. }) if !needs_render(args) => {
            report.notes.push(format!("cannot be rendered: {message}"))
        }
        Err(error) => return Err(error.into()),
    }
    super::print(&if args.json {
        format!("{}\n", serde_json::to_string_pretty(&report)?)
    } else {
        text::text(&report)
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Removes the settings of an experiment that the report leaves out. Returns notes for the user.
fn reduce(experiment: &mut Experiment) -> Vec<String> {
    experiment.output = Default::default();
    let keys = experiment.gate.gate_keys.take();
    let of_keys = keys.map(|_| "the gates of gate-keys differ between frames, so the report has no gate".into());
    let of_scan = experiment.scan.as_ref().map(|_| "travel times are those of the first point of the laser".into());
    let InputTable { shutter, rolling, .. } = &mut experiment.input;
    let of_shutter = shutter.map(|_| "the report shows the middle of the exposure".into());
    *rolling = None;
    of_keys.into_iter().chain(of_scan).chain(of_shutter).collect()
}

/// Whether the user wants a part of the report that needs a device and a scene that can be rendered.
fn needs_render(args: &InfoArgs) -> bool {
    args.pixel.is_some() || !args.map.is_empty() || args.plot.is_some()
}

/// Adds the part that depends on the settings. A device that the user named but that cannot be opened is an error. If no
/// device at all can be opened, the report gets a note instead of travel times, unless --pixel, --map or --plot needs the device.
fn add_render(
    report: &mut Report,
    scene: &Scene,
    settings: &Settings,
    args: &InfoArgs,
    device: Option<&str>,
) -> anyhow::Result<()> {
    let part = match args.pixel {
        Some(pixel) => &pixel::crop_to(settings, pixel)?,
        None => settings,
    };
    let prepared = match PreparedScene::new(scene, settings) {
        Ok(prepared) => prepared,
        Err(error) if needs_render(args) => return Err(error.into()),
        Err(error) => {
            report.notes.push(format!("cannot be rendered: {error}"));
            return Ok(());
        }
    };
    for emitter in &mut report.emitters {
        emitter.watts = prepared.powers().get(&emitter.node).copied();
    }
    report.warnings.extend(prepared.warnings(scene, part));
    let opened = match Device::open(device) {
        Err(error) if device.is_some() || needs_render(args) => return Err(error.into()),
        opened => opened,
    };
    let info = opened.as_ref().ok().map(Device::info);
    let plan = MemoryPlan::new(scene, settings, &prepared, info)?;
    // The light of suns and of the sky has no travel time, so the probe uses the other lights only.
    let others = if prepared.has_distant() { PreparedScene::without_distant(scene, part) } else { None };
    let timed = match &others {
        Some((part, prepared)) => Some((part, prepared)),
        None => (!prepared.has_distant()).then_some((part, &prepared)),
    };
    let times = match (timed, &opened) {
        (None, _) => None,
        (Some(_), Err(error)) => Some(Err(error.to_string())),
        (Some((part, prepared)), Ok(device)) => match probe(device, scene, part, prepared) {
            // The plot needs the travel times.
            Err(error) if args.plot.is_some() => return Err(error.into()),
            times => Some(times.map_err(|e| e.to_string())),
        },
    };
    let light = match &times {
        Some(Ok(times)) => light(times, scene, settings),
        _ => None,
    };
    let missing = match &times {
        Some(Ok(_)) if light.is_none() => missing_light_at_any_time(scene, part, &prepared),
        _ => None,
    };
    let missing = missing.map(|missing| missing.describe());
    let gate = Gate::new(settings, times.as_ref().and_then(|times| times.as_ref().ok()));
    if let Some(plot) = &args.plot {
        plot::write(plot, times.as_ref().and_then(|times| times.as_ref().ok()), missing.as_deref())?;
    }
    match times {
        None => report.notes.push("all light comes from infinitely far away, so it has no travel time to gate".into()),
        Some(Err(error)) => report.notes.push(format!("travel times were not measured: {error}")),
        Some(Ok(_)) if light.is_none() => {
            let place = if args.pixel.is_some() { "this pixel" } else { "the sensor" };
            match missing {
                None => report.notes.push(format!("no light reaches {place}")),
                Some(missing) => {
                    report.notes.push(format!(
                        "travel times are unknown, because a render misses the light at {place}: see the warning"
                    ));
                    if !report.warnings.contains(&missing) {
                        report.warnings.push(missing);
                    }
                }
            }
        }
        Some(Ok(_)) => {}
    }
    let (mut backs, mut thickness, mut shown, mut written) = (None, None, None, None);
    if let Ok(device) = &opened {
        let measured = black_backs(device, scene, part, &prepared).ok();
        report.notes.extend(measured.iter().filter_map(BlackBacks::describe));
        backs = measured.map(|backs| backs.fraction);
        if !scene.media.is_empty() {
            thickness = view_thickness(device, scene, part, &prepared).ok().map(|along| Thickness::new(along, scene));
        }
        if args.pixel.is_some() {
            shown = Some(pixel::shown(device, scene, part, &prepared)?);
        }
        if !args.map.is_empty() {
            written = Some(map::write(&args.map, device, scene, part, &prepared)?);
        }
    }
    let [width, height] = settings.resolution();
    let whole = Crop { x0: 0, x1: width, y0: 0, y1: height };
    report.render = Some(Render {
        camera: scene.cameras[settings.camera()].name.clone(),
        resolution: settings.resolution(),
        max_depth: settings.max_depth(),
        light_paths: settings.light_paths(),
        memory: memory(&plan, info),
        possible: timed.map(|(part, prepared)| prepared.travel_time_bounds(part.max_depth())),
        crop: (part.crop() != whole).then(|| part.crop().to_string()),
        gate,
        formed: formed_light(scene, part, &prepared),
        light,
        black_backs: backs,
        optical_thickness: thickness,
        pixel: shown,
        map: written,
    });
    Ok(())
}

fn memory(plan: &MemoryPlan, device: Option<&DeviceInfo>) -> Memory {
    let sum = |buffer_descs: &[BufferDesc]| buffer_descs.iter().map(|desc| desc.bytes).sum();
    let part = |desc: &BufferDesc| Part {
        name: desc.name,
        bytes: desc.bytes,
        allowed: device.map(|device| desc.limit(device)),
        fits: device.map(|device| desc.check(device).is_ok()),
    };
    Memory {
        device: device.map(|device| device.name.clone()),
        scene_bytes: sum(&plan.scene),
        iteration_bytes: sum(&plan.iteration),
        pool_bytes: sum(&plan.pool),
        device_bytes: plan.device_bytes(),
        host_bytes: plan.host_bytes,
        in_flight: plan.in_flight,
        heap_bytes: device.map(|device| device.heap_bytes),
        largest: plan.largest().iter().take(LARGEST).map(part).collect(),
        problem: device.and_then(|device| plan.check(device).err()).map(|error| error.to_string()),
    }
}

fn light(times: &TravelTimes, scene: &Scene, settings: &Settings) -> Option<Light> {
    let (first, last) = times.range()?;
    let percentiles = PERCENTILES.iter().filter_map(|&p| Some(arrival(p, times.percentile(p)?)));
    Some(Light {
        first: arrival(0.0, first),
        last: arrival(100.0, last),
        percentiles: percentiles.collect(),
        suggested_gate: feasible::suggestion(times, scene, settings, feasible::MEDIAN).map(|gate| gate.to_string()),
    })
}

pub fn arrival(percent: f64, metres: f64) -> Arrival {
    Arrival { percent, metres, nanoseconds: metres / METRES_PER_NS, depth_metres: metres / 2.0 }
}
