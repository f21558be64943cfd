//! `taugate info`: the contents of a scene, the memory that a render needs, and the travel times of the light.

mod text;

use std::process::ExitCode;

use serde::Serialize;
use taugate::Error;
use taugate::internals::gpu::{BufferDesc, Device, DeviceInfo};
use taugate::internals::input::resolve::{emitting_nodes, resolve};
use taugate::internals::render::{MemoryPlan, PreparedScene, TravelTimeBounds, TravelTimes, probe};
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;
use taugate::internals::settings::units::METRES_PER_NS;

use super::feasible;
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
    textures: usize,
    images: usize,
    texels: u64,
    warnings: Vec<String>,
    render: Option<Render>,
    /// Reasons why parts of the report are missing.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Camera {
    name: String,
    position: [f64; 3],
    degrees_high: f64,
    resolution: Option<[u32; 2]>,
}

#[derive(Serialize)]
struct Emitter {
    node: String,
    kind: String,
    /// Luminance-weighted power in W. None for a directional light, for an emitter that --emitters leaves out, and if the
    /// scene cannot be prepared.
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
    possible: TravelTimeBounds,
    light: Option<Light>,
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
struct Arrival {
    percent: f64,
    metres: f64,
    nanoseconds: f64,
    /// Half of `metres`: the one-way range if the sensor is beside the emitter.
    depth_metres: f64,
}

pub fn run(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    let scene = taugate::internals::scene::gltf::load(&args.scene)?;
    let mut report = contents(&scene);
    let experiment = args.experiment();
    match resolve(&experiment, &scene) {
        Ok(resolved) => {
            report.warnings.extend(resolved.warnings);
            add_render(&mut report, &scene, &resolved.settings, experiment.render.device.as_deref())?;
        }
        // Only a change of the scene can remove these errors. The report still lists the contents.
        Err(Error::Scene { message, .. }) => report.notes.push(format!("cannot be rendered: {message}")),
        Err(error) => return Err(error.into()),
    }
    super::print(&if args.json {
        format!("{}\n", serde_json::to_string_pretty(&report)?)
    } else {
        text::text(&report)
    })?;
    Ok(ExitCode::SUCCESS)
}

/// The part of the report that depends on the scene file alone.
fn contents(scene: &Scene) -> Report {
    let mut used = vec![false; scene.materials.len()];
    scene.instances.iter().for_each(|i| used[scene.meshes[i.mesh as usize].material as usize] = true);
    let materials = scene.materials.iter().zip(used).filter(|(_, used)| *used).map(|(m, _)| m.name.clone());
    let emitters = emitting_nodes(scene).into_iter().map(|node| {
        let light = scene.lights.iter().find(|light| light.node == node);
        Emitter {
            node: node.into(),
            kind: light.map_or("emissive mesh".into(), |light| light.kind.describe()),
            watts: None,
        }
    });
    let cameras = scene.cameras.iter().map(|camera| Camera {
        name: camera.name.clone(),
        position: camera.transform.translation.to_array(),
        degrees_high: camera.yfov.to_degrees(),
        resolution: camera.resolution,
    });
    Report {
        triangles: scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum(),
        instances: scene.instances.len(),
        meshes: scene.meshes.len(),
        mesh_triangles: scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum(),
        bounds: feasible::bounds(scene).map(|(low, high)| (low.to_array(), high.to_array(), (high - low).length())),
        cameras: cameras.collect(),
        emitters: emitters.collect(),
        materials: materials.collect(),
        materials_in_file: scene.materials.len(),
        textures: scene.textures.len(),
        images: scene.images.len(),
        texels: scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum(),
        warnings: scene.warnings.clone(),
        render: None,
        notes: vec![],
    }
}

/// Adds the part that depends on the settings. A device that the user named but that cannot be opened is an error. If no
/// device at all can be opened, the report gets a note instead of travel times.
fn add_render(report: &mut Report, scene: &Scene, settings: &Settings, device: Option<&str>) -> anyhow::Result<()> {
    let prepared = match PreparedScene::new(scene, settings) {
        Ok(prepared) => prepared,
        Err(error) => {
            report.notes.push(format!("cannot be rendered: {error}"));
            return Ok(());
        }
    };
    for emitter in &mut report.emitters {
        emitter.watts = prepared.powers().get(&emitter.node).copied();
    }
    report.warnings.extend(prepared.warnings(scene));
    let opened = match Device::open(device) {
        Err(error) if device.is_some() => return Err(error.into()),
        opened => opened,
    };
    let info = opened.as_ref().ok().map(Device::info);
    let plan = MemoryPlan::new(scene, settings, &prepared, info)?;
    let times = opened
        .as_ref()
        .map_err(|e| e.to_string())
        .and_then(|device| probe(device, scene, settings, &prepared).map_err(|e| e.to_string()));
    let light = match &times {
        Ok(times) => light(times, scene),
        Err(_) => None,
    };
    match times {
        Err(error) => report.notes.push(format!("travel times were not measured: {error}")),
        Ok(_) if light.is_none() => report.notes.push("no light reaches the sensor".into()),
        Ok(_) => {}
    }
    report.render = Some(Render {
        camera: scene.cameras[settings.camera()].name.clone(),
        resolution: settings.resolution(),
        max_depth: settings.max_depth(),
        light_paths: settings.light_paths(),
        memory: memory(&plan, info),
        possible: TravelTimeBounds::new(&prepared, settings),
        light,
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
        heap_bytes: device.map(|device| device.heap_bytes),
        largest: plan.largest().iter().take(LARGEST).map(part).collect(),
        problem: device.and_then(|device| plan.check(device).err()).map(|error| error.to_string()),
    }
}

fn light(times: &TravelTimes, scene: &Scene) -> Option<Light> {
    let (first, last) = times.range()?;
    let percentiles = PERCENTILES.iter().filter_map(|&p| Some(arrival(p, times.percentile(p)?)));
    Some(Light {
        first: arrival(0.0, first),
        last: arrival(100.0, last),
        percentiles: percentiles.collect(),
        suggested_gate: feasible::suggestion(times, scene).map(|gate| gate.to_string()),
    })
}

fn arrival(percent: f64, metres: f64) -> Arrival {
    Arrival { percent, metres, nanoseconds: metres / METRES_PER_NS, depth_metres: metres / 2.0 }
}
