//! Describes scene and settings for the page.

use std::path::Path;

use taugate::Estimator;
use taugate::internals::gpu::Device;
use taugate::internals::image::exr_file;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::named;
use taugate::internals::input::resolve::emitting_nodes;
use taugate::internals::scene::Scene;
use taugate::internals::settings::Settings;

use super::super::info;
use super::message::{Camera, Emitter, Medium, Response, State, Welcome};
use super::viewed_scene::ViewedScene;

/// Minimum distance of the point at which a camera looks, relative to the diagonal of the scene.
const LEAST_DISTANCE: f64 = 0.05;

pub fn welcome(viewed: &ViewedScene, device: &Device, folder: &Path) -> Welcome {
    let scene = viewed.scene();
    let path = viewed.start().scene.as_ref().expect("the experiment names a scene");
    Welcome {
        version: exr_file::version().trim_start_matches("taugate ").into(),
        scene: path.file_name().unwrap_or_default().to_string_lossy().into(),
        device: device.info().name.clone(),
        cameras: viewed.cameras().map(String::from).collect(),
        emitters: info::emitters(scene).map(|(node, kind)| Emitter { node, kind }).collect(),
        estimators: Estimator::ALL.map(Estimator::name).to_vec(),
        bounds: scene.bounds().map(|corners| corners.map(|corner| corner.to_array())),
        folder: folder.display().to_string(),
    }
}

/// The present settings. `warnings` come from the preparation of the scene. `input` is the file that the user named, and whether
/// the viewer uses all its settings.
pub fn state(viewed: &ViewedScene, revision: u32, paused: bool, warnings: &[String], input: (&Path, bool)) -> State {
    let (scene, view) = (viewed.scene(), viewed.view());
    let settings = &view.settings;
    let responses = settings.responses().iter().map(|response| {
        let gate = response.gate();
        Response { name: response.name().into(), lo: gate.lo, hi: gate.hi.is_finite().then_some(gate.hi) }
    });
    let emitters = emitting_nodes(scene).into_iter().filter(|node| settings.emitters().include(node));
    let texts = named::as_texts(&view.experiment);
    State {
        revision,
        settings: texts.into_iter().map(|(name, text)| (name.to_string(), text)).collect(),
        camera: camera(scene, settings),
        responses: responses.collect(),
        emitters: emitters.map(String::from).collect(),
        estimator: settings.estimator().name(),
        resolution: settings.resolution(),
        max_depth: settings.max_depth(),
        sampling: settings.sampling().name(),
        medium: scene.media.last().map(|medium| Medium { sigma_s: medium.sigma_s, sigma_a: medium.sigma_a }),
        paused,
        notes: view.notes.clone(),
        warnings: [&view.warnings[..], warnings].concat(),
        command: command(viewed, input),
    }
}

fn camera(scene: &Scene, settings: &Settings) -> Camera {
    let camera = &scene.cameras[settings.camera()];
    let from = camera.transform.translation;
    let axis = |v: glam::DVec3| camera.transform.transform_vector3(v).normalize();
    let forward = axis(glam::DVec3::NEG_Z);
    let centre = scene.bounds().map_or(from + forward, |[lo, hi]| 0.5 * (lo + hi));
    // The page flies at a speed in proportion to this distance.
    let distance = match from.distance(centre).max(LEAST_DISTANCE * scene.diagonal()) {
        distance if distance > 0.0 => distance,
        _ => 1.0,
    };
    Camera {
        name: camera.name.clone(),
        look_from: from.to_array(),
        look_at: (from + distance * forward).to_array(),
        up: axis(glam::DVec3::Y).to_array(),
        fov: camera.projection.yfov().map(f64::to_degrees),
        ortho: camera.projection.view_height(),
    }
}

/// The command line that renders the same image. `None` if flags cannot give these settings.
fn command(viewed: &ViewedScene, (input, is_whole): (&Path, bool)) -> Option<String> {
    let (start, experiment) = (viewed.start(), &viewed.view().experiment);
    let is_scene = start.scene.as_deref() == Some(input);
    // Flags cannot express every setting of an experiment file. Then the command names this file, with flags for the settings that
    // the page changed.
    let words = if is_scene || !named::has_tables(start) {
        let scene = start.scene.as_ref().expect("the experiment names a scene");
        let mut words = vec![scene.to_str()?.to_string()];
        words.extend(named::as_words(&without_budget(experiment)));
        words
    } else {
        let (before, after) = (named::as_texts(start), named::as_texts(experiment));
        if !is_whole || before.keys().any(|name| !after.contains_key(name)) {
            return None;
        }
        let mut changed = experiment.clone();
        for name in before.iter().filter(|(name, text)| after.get(*name) == Some(text)).map(|(name, _)| *name) {
            named::set(&mut changed, name, None).ok()?;
        }
        let mut words = vec![input.to_str()?.to_string()];
        words.extend(named::as_words(&without_budget(&changed)));
        words
    };
    let line = ["taugate", "render"].into_iter().chain(words.iter().map(String::as_str));
    shlex::try_join(line).ok()
}

/// Removes the budget and the output. The page adds its own number of samples and output to the command.
fn without_budget(experiment: &Experiment) -> Experiment {
    let mut experiment = experiment.clone();
    (experiment.render.spp, experiment.render.time) = (None, None);
    experiment.output = Default::default();
    experiment
}
