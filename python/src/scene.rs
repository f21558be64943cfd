//! A scene of Python: a file or arrays, the settings that belong to it, and the renderer of its last render.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::thread::{self, ThreadId};

use glam::{DAffine3, DMat4};
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use taugate::Error;
use taugate::internals::image::accumulation::{About, Accumulation};
use taugate::internals::image::fingerprint;
use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::{self, Resolved, emitting_nodes};
use taugate::internals::input::scenery;
use taugate::internals::input::sequence::Sequence;
use taugate::internals::render::{PreparedScene, Renderer, object_ids, probe};
use taugate::internals::scene::Scene;
use taugate::internals::scene::gltf::{self, Playback};
use taugate::internals::settings::Settings;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::table::InputTable;

use crate::arrays::{Mesh, Objects, transform};
use crate::camera::View;
use crate::engine::{self, Prepared, lock};
use crate::errors::{Failure, Result, settings, shown};
use crate::flags::{self, Words};
use crate::image::Image;
use crate::resume::SumFiles;
use crate::shared::ready::Ready;
use crate::shared::{feasible, memory};
use crate::sums;

/// A scene, see the class of the same name in Python.
#[pyclass(frozen, module = "taugate._native")]
pub struct NativeScene {
    state: Mutex<State>,
    /// The thread that renders.
    renders: Mutex<Option<ThreadId>>,
}

struct State {
    /// Settings of the file and of the scene itself; a render adds its own.
    base: Experiment,
    /// The scene of the file or the arrays, without the changes in `moved`.
    scene: Scene,
    /// How the file was read; `None` for arrays.
    input: Option<InputTable>,
    /// Names of the nodes of the file that may move.
    moves: Vec<String>,
    /// Transforms of the nodes that were moved.
    moved: BTreeMap<String, DAffine3>,
    ready: Option<Ready>,
}

/// A render with all settings resolved.
pub struct Job {
    pub experiment: Experiment,
    pub scene: Scene,
    pub resolved: Resolved,
    pub notes: Vec<String>,
    /// The experiment with all defaults, as TOML.
    pub printed: String,
}

#[pymethods]
impl NativeScene {
    /// Reads a scene (.glb, .gltf) or an experiment (.toml).
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, flags: Vec<Words>, moves: Vec<String>) -> PyResult<NativeScene> {
        let state = py.detach(|| State::load(path, &flags, moves))?;
        Ok(NativeScene::new(state))
    }

    /// A scene of meshes and materials without any instance, light or camera. `materials` and `textures` are JSON.
    #[staticmethod]
    fn from_arrays(
        materials: &str,
        textures: &str,
        images: Vec<PyReadonlyArray3<'_, u8>>,
        meshes: Vec<Mesh>,
        flags: Vec<Words>,
    ) -> PyResult<NativeScene> {
        let scene = crate::arrays::scene(materials, textures, images, meshes)?;
        let base = flags::experiment(&flags)?;
        let state = State { base, scene, input: None, moves: vec![], moved: BTreeMap::new(), ready: None };
        Ok(NativeScene::new(state))
    }

    /// Replaces all instances and lights of a scene of arrays.
    fn place(&self, py: Python<'_>, objects: Objects) -> PyResult<()> {
        py.detach(|| {
            let mut state = self.state()?;
            state.moved.clear();
            objects.place(&mut state.scene)
        })?;
        Ok(())
    }

    /// Moves the node `name`. `matrix` maps the space of its first mesh to world space, row by row.
    fn set_transform(&self, py: Python<'_>, name: &str, matrix: [[f64; 4]; 4]) -> PyResult<()> {
        py.detach(|| {
            let mut state = self.state()?;
            if !state.scene.instances.iter().any(|instance| instance.node == name) {
                return Err(settings(format!("the scene has no node '{name}' with a mesh; check the name")));
            }
            state.moved.insert(name.into(), transform(matrix));
            Ok(())
        })?;
        Ok(())
    }

    /// The matrix of the first mesh of the node `name` from mesh space to world space, row by row.
    fn transform(&self, py: Python<'_>, name: &str) -> PyResult<[[f64; 4]; 4]> {
        let found = py.detach(|| {
            let state = self.state()?;
            let moved = state.moved.get(name).copied();
            let instance = state.scene.instances.iter().find(|instance| instance.node == name);
            Result::Ok(moved.or(instance.map(|instance| instance.transform)))
        })?;
        let found =
            found.ok_or_else(|| settings(format!("the scene has no node '{name}' with a mesh; check the name")))?;
        Ok(DMat4::from(found).transpose().to_cols_array_2d())
    }

    /// What the scene contains. With `arrival` also when its light arrives.
    fn info<'py>(&self, py: Python<'py>, flags: Vec<Words>, arrival: bool) -> PyResult<Bound<'py, PyDict>> {
        let (job, times) = py.detach(|| {
            let job = self.state()?.job(&flags)?;
            let times = if arrival { Some(arrivals(&job)) } else { None };
            engine::forget_lost();
            Result::Ok((job, times.transpose()?))
        })?;
        let scene = &job.scene;
        let dict = PyDict::new(py);
        let cameras: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
        let triangles: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh as usize].triangles.len()).sum();
        let bounds = scene.bounds().map(|corners| corners.map(|corner| corner.to_array()));
        let objects = PyDict::new(py);
        for (id, instance) in object_ids(scene).into_iter().zip(&scene.instances) {
            objects.set_item(id, &instance.node)?;
        }
        dict.set_item("cameras", cameras)?;
        dict.set_item("emitters", emitting_nodes(scene))?;
        dict.set_item("objects", objects)?;
        dict.set_item("triangles", triangles)?;
        dict.set_item("bounds", bounds)?;
        dict.set_item("diagonal", scene.diagonal())?;
        dict.set_item("media", scene.media.len())?;
        dict.set_item("resolution", job.resolved.settings.resolution())?;
        dict.set_item("notes", shown(&job.notes))?;
        dict.set_item("warnings", shown(&[&scene.warnings[..], &job.resolved.warnings].concat()))?;
        if let Some((percentiles, gate)) = times {
            dict.set_item("arrival", percentiles.map(|all| all.to_vec()))?;
            dict.set_item("suggested_gate", gate)?;
        }
        Ok(dict)
    }

    /// The settings of a render as TOML, with all defaults.
    fn settings(&self, py: Python<'_>, flags: Vec<Words>) -> PyResult<String> {
        Ok(py.detach(|| self.state()?.job(&flags).map(|job| job.printed))?)
    }

    /// The camera of a render.
    fn view(&self, py: Python<'_>, flags: Vec<Words>) -> PyResult<View> {
        let job = py.detach(|| self.state()?.job(&flags))?;
        View::of(&job.scene, &job.resolved.settings)
    }

    /// Renders. `single`: fail if there are several responses. Returns the image, and the exception that ended it early, if any.
    #[pyo3(signature = (flags, single, progress=None))]
    fn render(
        &self,
        py: Python<'_>,
        flags: Vec<Words>,
        single: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Image, Option<PyErr>)> {
        Ok(py.detach(|| {
            let mut state = self.state()?;
            *lock(&self.renders) = Some(thread::current().id());
            let result = state.render(&flags, single, progress.as_ref());
            *lock(&self.renders) = None;
            engine::forget_lost();
            result
        })?)
    }

    /// Fails in a progress function of a render of this scene.
    fn check_idle(&self) -> PyResult<()> {
        Ok(self.refuse_own_render()?)
    }

    /// Frees the renderer of the last render, unless another thread uses the scene.
    fn release(&self, py: Python<'_>) {
        py.detach(|| {
            if let Ok(mut state) = self.state.try_lock() {
                state.ready = None;
            }
        });
    }

    /// Number of images that a render makes: one per gate or other response.
    fn responses(&self, py: Python<'_>, flags: Vec<Words>) -> PyResult<usize> {
        Ok(py.detach(|| Result::Ok(self.job(&flags)?.resolved.settings.responses().len()))?)
    }

    /// Fingerprint of the files of a render: those of the scene, and those that its settings name. `None` if there are none.
    fn files(&self, py: Python<'_>, flags: Vec<Words>) -> PyResult<Option<String>> {
        let found = py.detach(|| {
            let base = self.state()?.base.clone();
            match files(&flags::experiment(&flags)?.over(base)) {
                none if none.is_empty() => Ok(None),
                files => Ok(Some(fingerprint::of_files(&files)?)),
            }
        });
        found.map_err(|failure: Failure| failure.into())
    }
}

impl NativeScene {
    fn new(state: State) -> NativeScene {
        NativeScene { state: Mutex::new(state), renders: Mutex::new(None) }
    }

    /// Waits until no other thread uses the scene. Fails if this thread renders the scene, as in a progress function: the thread would
    /// wait for itself.
    fn state(&self) -> Result<MutexGuard<'_, State>> {
        self.refuse_own_render()?;
        Ok(lock(&self.state))
    }

    fn refuse_own_render(&self) -> Result<()> {
        if *lock(&self.renders) == Some(thread::current().id()) {
            return Err(settings(
                "this scene is being rendered, so a progress function cannot use it; use it after the render",
            ));
        }
        Ok(())
    }

    /// Calls `work` with a renderer without iterations, its settings, and the experiment as TOML.
    pub fn with_renderer<T>(
        &self,
        flags: &[Words],
        work: impl FnOnce(&mut Renderer, &Settings, &str) -> Result<T>,
    ) -> Result<T> {
        let mut state = self.state()?;
        let Job { experiment, scene, resolved, printed, .. } = state.job(flags)?;
        let settings = &resolved.settings;
        let has_variance = settings.responses().len() > 1 && experiment.output.variance.unwrap_or(false);
        memory::check(settings, memory::Made { variance: has_variance, exr: false }, memory::free())?;
        let before = state.ready.take();
        let result = engine::prepare(before, scene, &experiment, settings, has_variance).and_then(
            |Prepared { mut ready, .. }| {
                let result = work(&mut ready.renderer, settings, &printed)?;
                state.ready = Some(ready);
                Ok(result)
            },
        );
        engine::forget_lost();
        result
    }

    /// The fingerprint that the program gives to the files of an experiment; `None` if the scene is from arrays, or nodes were moved.
    pub fn fingerprint(&self, experiment: &Experiment) -> Result<Option<String>> {
        let was_moved = !self.state()?.moved.is_empty();
        if experiment.scene.is_none() || was_moved {
            return Ok(None);
        }
        Ok(Some(fingerprint::of_files(&files(experiment))?))
    }

    /// The render with these flags, with all settings resolved.
    pub fn job(&self, flags: &[Words]) -> Result<Job> {
        self.state()?.job(flags)
    }
}

/// The files of the scene, and those that the settings name.
fn files(experiment: &Experiment) -> Vec<PathBuf> {
    let of_scene = experiment.scene.as_ref().map(|scene| gltf::paths(scene, &experiment.input.allowed()));
    [of_scene.unwrap_or_default(), experiment.input_files()].concat()
}

impl State {
    fn load(path: PathBuf, flags: &[Words], moves: Vec<String>) -> Result<State> {
        engine::check_process()?;
        let typed = flags::experiment(flags)?;
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let base = if extension == "toml" {
            typed.over(Experiment::read(&path)?)
        } else if extension == "glb" || extension == "gltf" {
            Experiment { scene: Some(path.clone()), ..typed }
        } else {
            let message = "is neither a scene (.glb, .gltf) nor an experiment (.toml)".into();
            return Err(Error::File { path, message }.into());
        };
        if base.scene.is_none() {
            let message = "names no scene; add a first line like scene = \"room.glb\"".into();
            return Err(Error::File { path: path.clone(), message }.into());
        }
        base.check_paths()?;
        let mut state =
            State { base, scene: Scene::default(), input: None, moves, moved: BTreeMap::new(), ready: None };
        let input = state.base.input.clone();
        state.read(&input)?;
        Ok(state)
    }

    /// Reads the file, unless it was read in the same way before.
    fn read(&mut self, input: &InputTable) -> Result<()> {
        let Some(path) = self.base.scene.clone() else { return Ok(()) };
        if self.input.as_ref() == Some(input) {
            return Ok(());
        }
        let playback = Playback { at: input.at.map(|at| at.0), animation: input.animation.as_deref() };
        let mut scene = gltf::load_with(&path, &input.allowed(), playback)?;
        if let Some(unknown) = self.moves.iter().find(|name| !scene.instances.iter().any(|i| i.node == **name)) {
            return Err(settings(format!("the scene has no node '{unknown}', so it cannot move; check the name")));
        }
        if !self.moves.is_empty() {
            scene.moving.get_or_insert_default().extend(self.moves.iter().cloned());
        }
        self.scene = scene;
        self.input = Some(input.clone());
        Ok(())
    }

    fn job(&mut self, flags: &[Words]) -> Result<Job> {
        engine::check_process()?;
        let mut experiment = flags::experiment(flags)?.over(self.base.clone());
        experiment.check_paths()?;
        if Sequence::new(&experiment, || Ok(Some(0.0)))?.is_some() {
            return Err(settings(
                "this experiment is a sequence of frames; render one of them at a time, with at=SECONDS",
            ));
        }
        self.read(&experiment.input.clone())?;
        let mut scene = self.scene.clone();
        move_nodes(&mut scene, &self.moved);
        let notes = scenery::apply(&mut experiment, &mut scene)?;
        let resolved = resolve::resolve(&experiment, &scene)?;
        let config = resolve::as_experiment(&experiment, &resolved.settings, &scene);
        let printed = Experiment { output: Default::default(), ..config }.to_toml();
        Ok(Job { experiment, scene, resolved, notes, printed })
    }

    fn render(
        &mut self,
        flags: &[Words],
        single: bool,
        progress: Option<&Py<PyAny>>,
    ) -> Result<(Image, Option<PyErr>)> {
        let Job { experiment, scene, resolved, mut notes, printed } = self.job(flags)?;
        let settings = &resolved.settings;
        let count = settings.responses().len();
        if experiment.scan.is_some() {
            return Err(crate::errors::settings("this experiment is a scan; measure it with taugate.scan"));
        }
        if single && count > 1 {
            return Err(crate::errors::settings(format!(
                "these are {count} gates, so the result is no single image; use taugate.histogram"
            )));
        }
        if !single && count == 1 && settings.responses().are_steady() {
            return Err(crate::errors::settings("a histogram needs gates, such as gates='5m..15m/100'"));
        }
        let has_variance = count > 1 && experiment.output.variance.unwrap_or(false);
        engine::check_memory(self.ready.as_ref(), settings, has_variance)?;
        // The files of sums are those of the call: an experiment file names outputs of the program.
        let wanted = flags::experiment(flags)?.output;
        let is_in_files = experiment.scene.is_some() && self.moved.is_empty();
        let in_files = if is_in_files { Some(sums::parsed(&printed)?) } else { None };
        let mut sum_files = SumFiles::new(&wanted, in_files, settings, has_variance)?;
        let mut warnings = [&scene.warnings[..], &resolved.warnings].concat();
        let prepared = engine::prepare(self.ready.take(), scene, &experiment, settings, has_variance);
        let Prepared { mut ready, mut layers } = prepared.map_err(|failure| self.of_file(failure))?;
        warnings.extend(ready.warnings.iter().cloned());
        notes.extend(sum_files.resume(&mut ready.renderer, &mut layers, settings)?);
        let strict = experiment.render.strict.unwrap_or(false);
        let before = sum_files.before;
        let (seconds, interrupt) =
            engine::iterate(&mut ready.renderer, settings, strict, before, progress, |renderer, seconds| {
                sum_files.update(renderer, &layers, seconds);
            })?;
        warnings.extend(sum_files.finish(&ready.renderer, &layers, seconds));
        if ready.renderer.is_black() && interrupt.is_none() && !engine::may_be_dark(&experiment, settings) {
            let device = engine::device(experiment.render.device.as_deref())?;
            return Err(feasible::nothing_inside(&device, &ready.scene, settings).into());
        }
        let renderer = &ready.renderer;
        let about = About::new(settings, printed, &[], String::new(), Shard::ALL);
        let sums = Accumulation {
            about: renderer.about(&about, seconds),
            film: renderer.film().clone(),
            responses: renderer.responses().cloned(),
            adaptive: None,
            layers: Layers::default(),
        };
        let (view, dropped) = (View::of(&ready.scene, settings)?, renderer.dropped());
        let image = Image { sums, responses: settings.responses().clone(), layers, view, notes, warnings, dropped };
        self.ready = Some(ready).filter(|ready| !ready.renderer.device().is_lost());
        Ok((image, interrupt))
    }

    /// Adds the scene's file to an error of the settings, because the scene may be the cause.
    fn of_file(&self, failure: Failure) -> Failure {
        use Failure::Library;
        match (failure, &self.base.scene) {
            (Library(Error::Settings(message)), Some(path)) if !message.contains("--force") => {
                Library(Error::Scene { path: path.clone(), message })
            }
            (other, _) => other,
        }
    }
}

/// Gives the first instance of each of these nodes a new transform. The others, such as copies of its mesh, keep their places relative to
/// the first.
fn move_nodes(scene: &mut Scene, moved: &BTreeMap<String, DAffine3>) {
    let mut firsts = BTreeMap::new();
    for instance in &mut scene.instances {
        let Some(&matrix) = moved.get(&instance.node) else { continue };
        let before = instance.transform;
        let first = *firsts.entry(instance.node.clone()).or_insert(before);
        instance.transform = if before == first { matrix } else { matrix * first.inverse() * before };
    }
}

/// Percentiles of the travel times of all light in metres (first, 5, 50, 95 and last), and a gate around the median that shows light.
/// The light of suns and of the sky has no travel time, so it does not count.
fn arrivals(job: &Job) -> Result<(Option<[f64; 5]>, Option<String>)> {
    let settings = &job.resolved.settings;
    let prepared = PreparedScene::new(&job.scene, settings)?;
    let device = engine::device(job.experiment.render.device.as_deref())?;
    let times = if !prepared.has_distant() {
        probe(&device, &job.scene, settings, &prepared)?
    } else if let Some((settings, prepared)) = PreparedScene::without_distant(&job.scene, settings) {
        probe(&device, &job.scene, &settings, &prepared)?
    } else {
        return Ok((None, None));
    };
    let percentile = |percent| times.percentile(percent).unwrap_or(f64::NAN);
    let found = times.range().map(|(first, last)| [first, percentile(5.0), percentile(50.0), percentile(95.0), last]);
    Ok((found, feasible::suggestion(&times, &job.scene, settings, feasible::MEDIAN).map(|gate| gate.to_string())))
}
