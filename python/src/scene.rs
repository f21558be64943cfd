//! The class of a scene in Python. One thread at a time uses its state.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::thread::{self, ThreadId};

use glam::DMat4;
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use taugate::internals::image::fingerprint;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::resolve::emitting_nodes;
use taugate::internals::job::preparation::Preparation;
use taugate::internals::job::ready_job::ReadyJob;
use taugate::internals::job::{Job, memory};
use taugate::internals::render::{Renderer, object_ids};
use taugate::internals::scene::gltf;
use taugate::internals::settings::Settings;

use crate::arrays::{MediumSpec, Mesh, Objects, parsed, transform};
use crate::camera::View;
use crate::engine::{self, lock};
use crate::errors::{Failure, Result, settings, shown};
use crate::flags::{self, Words};
use crate::image::Image;
use crate::state::{State, arrivals};

/// A scene, see the class of the same name in Python.
#[pyclass(frozen, module = "taugate._native")]
pub struct NativeScene {
    state: Mutex<State>,
    /// The thread that renders.
    renders: Mutex<Option<ThreadId>>,
}

#[pymethods]
impl NativeScene {
    /// Reads a scene (.glb, .gltf) or an experiment (.toml).
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, flags: Vec<Words>, moves: Vec<String>) -> PyResult<NativeScene> {
        let state = py.detach(|| State::load(path, &flags, moves))?;
        Ok(NativeScene::new(state))
    }

    /// A scene of meshes, materials and media without any instance, light or camera. `materials` and `textures` are JSON, and so is
    /// `scan`, a table `[scan]`.
    #[staticmethod]
    fn from_arrays(
        materials: &str,
        textures: &str,
        images: Vec<PyReadonlyArray3<'_, u8>>,
        meshes: Vec<Mesh>,
        media: Vec<MediumSpec<'_>>,
        scan: Option<&str>,
        flags: Vec<Words>,
    ) -> PyResult<NativeScene> {
        let scene = crate::arrays::scene(materials, textures, images, meshes, media)?;
        let mut base = flags::experiment(&flags)?;
        base.scan = scan.map(|json| parsed("the scan", json)).transpose()?;
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
        dict.set_item("warnings", shown(&job.warnings()))?;
        if let Some((percentiles, gate)) = times {
            dict.set_item("arrival", percentiles.map(|all| all.to_vec()))?;
            dict.set_item("suggested_gate", gate)?;
        }
        Ok(dict)
    }

    /// The settings of a render as TOML, with all defaults.
    fn settings(&self, py: Python<'_>, flags: Vec<Words>) -> PyResult<String> {
        Ok(py.detach(|| self.state()?.job(&flags).map(|job| job.config().to_toml()))?)
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

    /// Calls `work` with a renderer without iterations, its settings, and the experiment with all defaults. The renderer shows a single
    /// moment, see `check_parts`.
    pub fn with_renderer<T>(
        &self,
        flags: &[Words],
        work: impl FnOnce(&mut Renderer, &Settings, Experiment) -> Result<T>,
    ) -> Result<T> {
        let mut state = self.state()?;
        let job = state.job(flags)?;
        let (device, settings) = (job.experiment.render.device.clone(), &job.resolved.settings.clone());
        let has_variance = settings.responses().len() > 1 && job.experiment.output.variance.unwrap_or(false);
        memory::check(settings, memory::ImageParts { variance: has_variance, exr: false }, memory::free())?;
        let (before, open) = (state.ready.take(), || engine::device(device.as_deref()));
        let ready = job.ready(before, has_variance, open, &mut Preparation::start(), &mut |_| {});
        let result = ready.map_err(Failure::from).and_then(|ReadyJob { mut ready, config, .. }| {
            let result = work(&mut ready.renderer, settings, config)?;
            state.ready = Some(ready);
            Ok(result)
        });
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

    /// As [`NativeScene::job`], for a scan. Fails if its objects follow the animations of the file and were moved, too.
    pub fn scan_job(&self, flags: &[Words]) -> Result<Job> {
        let (job, was_moved) = (self.job(flags)?, !self.state()?.moved.is_empty());
        let Experiment { input, scan, .. } = &job.experiment;
        let has_times = scan.as_ref().is_some_and(|scan| scan.scan().is_ok_and(|scan| scan.times.is_some()));
        match was_moved && input.at.is_some() && has_times {
            true => Err(settings(
                "during this scan, nodes follow the animations of the file; leave out at or duration, or do not move nodes",
            )),
            false => Ok(job),
        }
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
