//! The state of a scene of Python: what its file or arrays hold, the nodes that were moved, and the renderer of its last render.

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::DAffine3;
use pyo3::prelude::*;
use taugate::internals::image::accumulation::{About, Accumulation};
use taugate::internals::image::layers::Layers;
use taugate::internals::input::experiment::Experiment;
use taugate::internals::input::sequence::Sequence;
use taugate::internals::job::preparation::Preparation;
use taugate::internals::job::ready::Ready;
use taugate::internals::job::ready_job::ReadyJob;
use taugate::internals::job::{Job, feasible, read};
use taugate::internals::render::{PreparedScene, probe};
use taugate::internals::scene::Scene;
use taugate::internals::settings::shard::Shard;
use taugate::internals::settings::table::InputTable;

use crate::camera::View;
use crate::engine;
use crate::errors::{Result, settings};
use crate::flags::{self, Words};
use crate::image::Image;
use crate::resume::sum_files;

/// What a scene of Python holds.
pub struct State {
    /// Settings of the file and of the scene itself; a render adds its own.
    pub base: Experiment,
    /// The scene of the file or the arrays, without the changes in `moved`.
    pub scene: Scene,
    /// How the file was read; `None` for arrays.
    pub input: Option<InputTable>,
    /// Names of the nodes of the file that may move.
    pub moves: Vec<String>,
    /// Transforms of the nodes that were moved.
    pub moved: BTreeMap<String, DAffine3>,
    pub ready: Option<Ready>,
}

impl State {
    /// Reads a scene (.glb, .gltf) or an experiment (.toml). `moves`: names of the nodes that may move.
    pub fn load(path: PathBuf, flags: &[Words], moves: Vec<String>) -> Result<State> {
        engine::check_process()?;
        let base = read::experiment(path, flags::experiment(flags)?)?;
        base.check_paths()?;
        let mut state =
            State { base, scene: Scene::default(), input: None, moves, moved: BTreeMap::new(), ready: None };
        state.read(&state.base.clone())?;
        Ok(state)
    }

    /// Reads the scene of `experiment`, if it has a file that was not read in the same way before.
    fn read(&mut self, experiment: &Experiment) -> Result<()> {
        if experiment.scene.is_none() || self.input.as_ref() == Some(&experiment.input) {
            return Ok(());
        }
        let mut scene = read::scene(experiment)?;
        if let Some(unknown) = self.moves.iter().find(|name| !scene.instances.iter().any(|i| i.node == **name)) {
            return Err(settings(format!("the scene has no node '{unknown}', so it cannot move; check the name")));
        }
        if !self.moves.is_empty() {
            scene.moving.get_or_insert_default().extend(self.moves.iter().cloned());
        }
        self.scene = scene;
        self.input = Some(experiment.input.clone());
        Ok(())
    }

    /// The render with these flags, with all settings resolved.
    pub fn job(&mut self, flags: &[Words]) -> Result<Job> {
        engine::check_process()?;
        let experiment = flags::experiment(flags)?.over(self.base.clone());
        experiment.check_paths()?;
        if Sequence::new(&experiment, || Ok(Some(0.0)))?.is_some() {
            return Err(settings(
                "this experiment is a sequence of frames; render one of them at a time, with at=SECONDS",
            ));
        }
        self.read(&experiment)?;
        let mut scene = self.scene.clone();
        move_nodes(&mut scene, &self.moved);
        Ok(Job::new(experiment, scene)?)
    }

    /// Renders an image, or with `single` unset a histogram. Returns the exception that ended it early if the image so far is kept.
    pub fn render(
        &mut self,
        flags: &[Words],
        single: bool,
        progress: Option<&Py<PyAny>>,
    ) -> Result<(Image, Option<PyErr>)> {
        let job = self.job(flags)?;
        let (config, mut notes) = (job.config(), job.notes.clone());
        let (experiment, settings) = (job.experiment.clone(), &job.resolved.settings.clone());
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
        if experiment.input.shutter.is_some() && !self.moved.is_empty() {
            return Err(crate::errors::settings(
                "while the shutter is open, nodes follow the animations of the file; leave out shutter, or do not move nodes",
            ));
        }
        if job.scene.velocities.is_some() && !self.moved.is_empty() {
            return Err(crate::errors::settings(
                "velocities are those of the animations of the file; leave out doppler and fmcw, or do not move nodes",
            ));
        }
        let has_variance = count > 1 && experiment.output.variance.unwrap_or(false);
        engine::check_memory(self.ready.as_ref(), settings, has_variance)?;
        // The files of sums are those of the call: an experiment file names outputs of the program.
        let wanted = flags::experiment(flags)?.output;
        let is_in_files = experiment.scene.is_some() && self.moved.is_empty();
        let in_files = is_in_files.then(|| config.clone());
        let sums = sum_files(&wanted, in_files, settings, has_variance)?;
        let open = || engine::device(experiment.render.device.as_deref());
        let before = self.ready.take();
        let mut job = job.ready(before, has_variance, open, &mut Preparation::start(), &mut |_| {})?;
        if let Some((line, note)) = job.continue_sums(sums, Shard::ALL)? {
            notes.extend([line].into_iter().chain(note));
        }
        // Of an exposure, the camera in the middle.
        let view = View::of(&job.ready.scene, settings)?;
        let interrupt = engine::iterate(&mut job, progress)?;
        job.warn_of_moments();
        let mut warnings: Vec<String> = job.warnings().map(String::from).collect();
        // The image must not be lost with the file.
        if let Err(error) = job.write_checkpoint() {
            warnings.push(format!("{error}; the checkpoint does not have this image"));
        }
        if interrupt.is_none() {
            job.check_light()?;
        }
        let (seconds, ReadyJob { ready, layers, .. }) = (job.seconds(), job);
        let renderer = &ready.renderer;
        let about = About::new(settings, config.to_toml(), &[], String::new(), Shard::ALL);
        let sums = Accumulation {
            about: renderer.about(&about, seconds),
            film: renderer.film().clone(),
            responses: renderer.responses()?.cloned(),
            adaptive: None,
            layers: Layers::default(),
        };
        let dropped = renderer.dropped();
        let image = Image { sums, responses: settings.responses().clone(), layers, view, notes, warnings, dropped };
        self.ready = Some(ready).filter(|ready| !ready.renderer.device().is_lost());
        Ok((image, interrupt))
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
pub fn arrivals(job: &Job) -> Result<(Option<[f64; 5]>, Option<String>)> {
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
