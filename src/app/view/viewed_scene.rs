//! The scene of the viewer and its present settings, which the page changes by the names of their flags.

use std::collections::BTreeMap;
use std::mem::discriminant;

use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::{named, resolve, scenery};
use taugate::internals::job::{memory, read};
use taugate::internals::scene::{Camera, Light, Material, Medium, Scene, SkyImage};
use taugate::internals::settings::Settings;
use taugate::internals::settings::setting::Taker;
use taugate::internals::settings::table::{excluding, find};
use taugate::{Error, Result};

use super::message::Change;

/// Bytes per pixel of the films, the sample statistics, and the pictures for the pages.
const PIXEL_BYTES: u64 = 256;
/// Bytes per pixel and gate of two pictures and the sums of the film.
const GATE_BYTES: u64 = 48;

/// The parts of a scene that settings change.
struct Changeable {
    cameras: Vec<Camera>,
    lights: Vec<Light>,
    materials: Vec<Material>,
    media: Vec<Medium>,
    sky: Option<SkyImage>,
}

impl Changeable {
    fn of(scene: &Scene) -> Changeable {
        Changeable {
            cameras: scene.cameras.clone(),
            lights: scene.lights.clone(),
            materials: scene.materials.clone(),
            media: scene.media.clone(),
            sky: scene.sky.clone(),
        }
    }

    fn restore(&self, scene: &mut Scene) {
        scene.cameras.clone_from(&self.cameras);
        scene.lights.clone_from(&self.lights);
        scene.materials.clone_from(&self.materials);
        scene.media.clone_from(&self.media);
        scene.sky.clone_from(&self.sky);
    }
}

/// The settings that were applied to the scene.
pub struct View {
    /// The settings that the user gave.
    pub experiment: Experiment,
    /// As `experiment`, with the choices that the program made for the scene, such as the place of an automatic camera.
    pub placed: Experiment,
    pub settings: Settings,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

/// How much of a render a change invalidates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// The image stays the same.
    Nothing,
    /// Only the seed or the responses changed.
    Restart,
    /// The camera moved, turned or has another projection.
    Camera,
    /// Lights without a surface moved or have another strength: a headlamp moves with the camera. The camera may have changed too.
    CameraAndLights,
    /// Other settings changed, but not the scene, the emitters or the camera.
    Settings,
    /// The scene must be prepared again.
    All,
}

impl Effect {
    /// The effect of two changes, one after the other.
    pub fn and(self, other: Effect) -> Effect {
        use Effect::{All, Camera, CameraAndLights, Nothing, Restart, Settings};
        match (self, other) {
            (Nothing, effect) | (effect, Nothing) => effect,
            (Restart, effect) | (effect, Restart) => effect,
            (Settings, Settings) => Settings,
            (Camera, Camera) => Camera,
            (Camera | CameraAndLights, Camera | CameraAndLights) => CameraAndLights,
            (All | Settings, _) | (_, All | Settings) => All,
        }
    }
}

/// The loaded scene, with the present settings applied to it.
pub struct ViewedScene {
    start: Experiment,
    /// The settings that a page changed: text as on the command line, or `None` for a flag that is not given.
    changes: BTreeMap<String, Option<String>>,
    scene: Scene,
    original: Changeable,
    view: View,
    /// Free memory before the first render. The images of a render take the place of those before a change.
    free: Option<u64>,
}

impl ViewedScene {
    /// Loads the scene of an experiment.
    pub fn new(start: Experiment) -> anyhow::Result<ViewedScene> {
        let mut scene = read::scene(&start)?;
        let original = Changeable::of(&scene);
        let free = memory::free();
        let view = apply(start.clone(), &mut scene, free)?;
        Ok(ViewedScene { start, changes: BTreeMap::new(), scene, original, view, free })
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    pub fn view(&self) -> &View {
        &self.view
    }

    /// The experiment that the viewer started with.
    pub fn start(&self) -> &Experiment {
        &self.start
    }

    /// Names of the cameras in the file.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        self.original.cameras.iter().map(|camera| camera.name.as_str())
    }

    /// Applies all changes, or none of them if one fails. Returns how much of the render must be done again.
    pub fn change(&mut self, changes: &BTreeMap<String, Change>) -> Result<Effect> {
        let merged = self.merged(changes)?;
        let mut experiment = self.start.clone();
        // Remove settings first, so that a removal cannot undo a value set below.
        for (name, _) in merged.iter().filter(|(_, text)| text.is_none()) {
            named::set(&mut experiment, name, None)?;
        }
        if merged.get("gate").is_some_and(Option::is_none) {
            (experiment.gate.response, experiment.gate.repeat) = (None, None);
        }
        let texts = || merged.iter().filter_map(|(name, text)| Some((name, text.as_deref()?)));
        let mut changed = Experiment::default();
        for (name, text) in texts() {
            named::set(&mut changed, name, Some(text))?;
        }
        experiment.gate.leave_responses_to(&changed.gate);
        for (name, text) in texts() {
            named::set(&mut experiment, name, Some(text))?;
        }
        let before = Changeable::of(&self.scene);
        self.original.restore(&mut self.scene);
        match apply(experiment, &mut self.scene, self.free) {
            Ok(view) => {
                let effect = effect((&before, &self.view.settings), (&self.scene, &view.settings));
                (self.changes, self.view) = (merged, view);
                effect
            }
            Err(error) => {
                before.restore(&mut self.scene);
                Err(error)
            }
        }
    }

    fn merged(&self, changes: &BTreeMap<String, Change>) -> Result<BTreeMap<String, Option<String>>> {
        let mut merged = self.changes.clone();
        for name in changes.keys() {
            if !is_changeable(name) {
                return Err(Error::settings(format!(
                    "a page cannot change --{name}; restart taugate view with this flag"
                )));
            }
            for other in excluding(name) {
                merged.remove(other);
            }
            merged.remove(name);
        }
        // After all others, because removing one of two settings that exclude each other would bring back the other one of the start.
        if let Some(change) = changes.get("camera") {
            let places = find("camera").map_or(&[][..], |camera| camera.resets);
            merged.retain(|name, _| !places.contains(&name.as_str()));
            if matches!(change, Change::Text(_)) {
                merged.extend(places.iter().map(|place| (place.to_string(), None)));
            }
        }
        for (name, change) in changes {
            match change {
                Change::AsAtStart => drop(merged.remove(name)),
                Change::LeaveOut => {
                    merged.insert(name.clone(), None);
                    if name == "gate" {
                        // The user wants a steady image, so remove gates of every kind.
                        merged.extend(excluding(name).map(|other| (other.to_string(), None)));
                        merged.remove("repeat");
                    }
                }
                Change::Text(text) => drop(merged.insert(name.clone(), Some(text.clone()))),
            }
        }
        Ok(merged)
    }
}

/// Whether a page may change the setting with this name.
fn is_changeable(name: &str) -> bool {
    find(name).is_some_and(|setting| setting.name == name && setting.is_for(Taker::Page))
}

/// The error of the first value that its flag does not accept, whatever the scene and the other settings are.
pub fn typing_error(changes: &BTreeMap<String, Change>) -> Option<Error> {
    let texts = changes.iter().filter_map(|(name, change)| match change {
        Change::Text(text) if is_changeable(name) => Some((name, text)),
        _ => None,
    });
    texts.into_iter().find_map(|(name, text)| named::set(&mut Experiment::default(), name, Some(text)).err())
}

/// Applies an experiment to a freshly loaded scene. Fails if the images need more memory than was `free` before any of them.
fn apply(experiment: Experiment, scene: &mut Scene, free: Option<u64>) -> Result<View> {
    let mut placed = experiment.clone();
    let notes = scenery::apply(&mut placed, scene)?;
    let resolved = resolve::resolve(&placed, scene)?;
    memory::check(&resolved.settings, memory::ImageParts { variance: false, exr: false }, free)?;
    let [width, height] = resolved.settings.resolution().map(u64::from);
    let gates = resolved.settings.responses().len() as u64;
    let bytes = width * height * (PIXEL_BYTES + GATE_BYTES * gates);
    memory::check_bytes(bytes, free, "the image", "use a smaller --resolution or fewer gates")?;
    let warnings = scene.warnings.iter().cloned().chain(resolved.warnings).collect();
    Ok(View { experiment, placed, settings: resolved.settings, notes, warnings })
}

fn effect((before, old): (&Changeable, &Settings), (scene, new): (&Scene, &Settings)) -> Result<Effect> {
    let is_like = |(a, b): (&Light, &Light)| a.node == b.node && discriminant(&a.kind) == discriminant(&b.kind);
    let has_same_lights = before.lights == scene.lights;
    let has_same_objects = before.lights.len() == scene.lights.len()
        && before.lights.iter().zip(&scene.lights).all(is_like)
        && before.materials == scene.materials
        && before.media == scene.media
        && before.sky == scene.sky
        && old.emitters() == new.emitters();
    if !has_same_objects {
        return Ok(Effect::All);
    }
    let camera = &scene.cameras[new.camera()];
    let is_same_camera = before.cameras[old.camera()] == *camera && old.camera() == new.camera();
    let with_new = old.change().seed(new.seed()).responses(new.responses().clone()).camera(new.camera()).build()?;
    let is_same_render = with_new == *new && old.responses().is_single_box() == new.responses().is_single_box();
    if !has_same_lights {
        return Ok(if is_same_render { Effect::CameraAndLights } else { Effect::All });
    }
    Ok(match (is_same_camera, is_same_render) {
        (true, true) if old == new => Effect::Nothing,
        (true, true) => Effect::Restart,
        (false, true) => Effect::Camera,
        // The sensor of an orthographic camera depends on the aspect ratio of the image, so the scene must be prepared again.
        (true, false) if !camera.projection.is_orthographic() => Effect::Settings,
        _ => Effect::All,
    })
}

#[cfg(test)]
mod tests;
