//! What the program, the viewer and the Python module do with a scene. Nothing here prints. [`Job`] is also part of the API.

pub mod exposure;
pub mod feasible;
pub mod frames;
pub mod iterations;
pub mod memory;
pub mod preparation;
pub mod read;
pub mod ready;
pub mod ready_job;
pub mod ready_scan;
pub mod sum_files;
pub mod sums;

use std::path::Path;
use std::time::Duration;

use crate::error::{Error, Result};
use crate::gpu::Device;
use crate::image::layers::Layers;
use crate::input::experiment::Experiment;
use crate::input::resolve::{self, Resolved};
use crate::input::sequence::Sequence;
use crate::input::{named, scenery};
use crate::render::velocities;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::aov::Aov;
use crate::settings::shard::Shard;

use exposure::Exposure;
use preparation::Preparation;
use ready::{Ready, Wanted};
use ready_job::ReadyJob;
use ready_scan::ReadyScan;
use sum_files::SumFiles;

/// A render, or a scan, with all settings resolved: those of an experiment file, of a scene file, or of a program.
///
/// A job renders the same image as `taugate render` with the same settings, bit for bit, and makes the same checks before it. It writes no
/// file by itself: outputs that an experiment file names are ignored.
#[warn(missing_docs)]
pub struct Job {
    /// With the choices that depend on the scene, such as the place of an automatic camera.
    #[doc(hidden)]
    pub experiment: Experiment,
    /// With the cameras and lights of the experiment.
    #[doc(hidden)]
    pub scene: Scene,
    #[doc(hidden)]
    pub resolved: Resolved,
    /// See [`Job::notes`].
    #[doc(hidden)]
    pub notes: Vec<String>,
    /// Whether the job is one of [`Job::frames`].
    #[doc(hidden)]
    pub is_frame: bool,
}

/// A frame of a sequence: see [`Job::frames`].
#[warn(missing_docs)]
pub struct Frame {
    /// The number of the frame.
    pub number: u32,
    experiment: Experiment,
}

impl Frame {
    /// Reads the scene in its pose at the time of the frame. A black image is accepted, because light may come in at another frame.
    /// Fails as [`Job::open`], and if the scene cannot be rendered at this time.
    pub fn open(self) -> Result<Job> {
        let scene = read::scene(&self.experiment)?;
        Ok(Job { is_frame: true, ..Job::new(self.experiment, scene)? })
    }
}

#[warn(missing_docs)]
impl Job {
    /// Opens an experiment (`.toml`), or a scene (`.glb`, `.gltf`) with default settings, and reads the scene. Fails if a file cannot
    /// be read or is not valid, if settings contradict each other or the scene, or if the experiment is a sequence of frames
    /// ([`Job::frames`]).
    pub fn open(path: impl AsRef<Path>) -> Result<Job> {
        Job::open_with(path, [])
    }

    /// As [`Job::open`], with further settings, such as `("gate", "6.2m..6.3m")` or `("spp", "16")`. Their names are those of the
    /// flags of `taugate render`, and their values are written as on the command line; `true` switches a flag on. They replace the
    /// settings in the file. A later setting replaces an earlier one that excludes it. Also fails if there is no such setting, or if a
    /// value is not valid; nothing is read then.
    pub fn open_with<'a>(
        path: impl AsRef<Path>,
        settings: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Job> {
        let experiment = read_with(path.as_ref(), settings)?;
        if Sequence::new(&experiment, || Ok(Some(0.0)))?.is_some() {
            return Err(Error::advice(
                "this experiment is a sequence of frames; ",
                "remove frames and choose one of them with at, or open all of them with Job::frames",
            ));
        }
        let scene = read::scene(&experiment)?;
        Job::new(experiment, scene)
    }

    /// The frames of a sequence: an experiment, or a scene and further settings as for [`Job::open_with`], with the setting `frames`.
    /// With `shard`, only those of this shard. [`Job::prepare_after`] is the fast way from one frame to the next. Fails if the
    /// experiment is no sequence, if its settings do not suit one, or if a file cannot be read.
    pub fn frames<'a>(
        path: impl AsRef<Path>,
        settings: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<impl Iterator<Item = Frame>> {
        let experiment = read_with(path.as_ref(), settings)?;
        let Some(sequence) = Sequence::new(&experiment, || read::end_of_animations(&experiment))? else {
            return Err(Error::advice("this experiment is no sequence: ", "add frames, such as 0..24"));
        };
        let numbers: Vec<u32> = sequence.own_frames().collect();
        Ok(numbers.into_iter().map(move |number| Frame { number, experiment: sequence.frame(number) }))
    }

    /// A job for a scene that a program has built or loaded. It has the seed, the estimator and all else of `settings`. A gated render
    /// leaves out suns and skies, with a warning. Fails if the scene has no camera or light, if the settings do not suit it, or if a
    /// gate is too narrow for 32-bit travel times.
    pub fn of_scene(scene: Scene, settings: &Settings) -> Result<Job> {
        let camera = settings.camera();
        if camera >= scene.cameras.len() {
            return Err(Error::advice(
                format!("the settings choose camera {camera}, but the scene has {}; ", scene.cameras.len()),
                "add a camera to the scene",
            ));
        }
        let mut experiment = resolve::as_experiment(&Experiment::default(), settings, &scene);
        let (mut scene, responses) = (scene, settings.responses().clone());
        let notes = scenery::apply(&mut experiment, &mut scene)?;
        // An experiment cannot hold the rows of a table.
        let mut resolved = resolve::resolve_with(&experiment, &scene, responses)?;
        // Two cameras may have the same name.
        resolved.settings = resolved.settings.change().camera(camera).build()?;
        Ok(Job { experiment, scene, resolved, notes, is_frame: false })
    }

    /// Adds the cameras and lights of `experiment` to `scene`, and fills in all settings. Fails if they contradict each other or the
    /// scene.
    #[doc(hidden)]
    pub fn new(mut experiment: Experiment, mut scene: Scene) -> Result<Job> {
        let notes = scenery::apply(&mut experiment, &mut scene)?;
        let resolved = resolve::resolve(&experiment, &scene)?;
        let has_layer = experiment.scan.is_some() && experiment.output.aov.is_some_and(|aov| aov.velocity);
        if velocities::are_needed(&resolved.settings) || has_layer {
            scene.velocities = read::velocities(&experiment, &scene)?;
        }
        Ok(Job { experiment, scene, resolved, notes, is_frame: false })
    }

    /// The scene, with the cameras and lights that the settings add.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The settings, with all defaults.
    pub fn settings(&self) -> &Settings {
        &self.resolved.settings
    }

    /// The choices that were made for the scene, such as the place of a camera, one sentence each without a full stop.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Warnings about the scene and the settings, one sentence each without a full stop.
    pub fn warnings(&self) -> Vec<String> {
        [&self.scene.warnings[..], &self.resolved.warnings].concat()
    }

    /// The settings as an experiment file (TOML), with all defaults. The file renders the same image later, if the scene and the tables
    /// of responses are from files.
    pub fn to_toml(&self) -> String {
        self.config().to_toml()
    }

    /// The experiment with all defaults, but without outputs. It renders the same image later.
    #[doc(hidden)]
    pub fn config(&self) -> Experiment {
        let config = resolve::as_experiment(&self.experiment, &self.resolved.settings, &self.scene);
        Experiment { output: Default::default(), ..config }
    }

    /// Whether a black image is accepted: the user wants it, there is no gate that could miss the light, or other frames have light.
    #[doc(hidden)]
    pub fn may_be_dark(&self) -> bool {
        self.is_frame || self.experiment.gate.force.unwrap_or(false) || self.resolved.settings.responses().are_steady()
    }

    /// Opens the device that the setting `device` names, or else the best one. Fails if there is none.
    pub fn open_device(&self) -> Result<Device> {
        Device::open(self.experiment.render.device.as_deref())
    }

    /// Whether the job is a scan, which [`Job::prepare_scan`] prepares. An experiment file with a table `[scan]` is one.
    pub fn is_scan(&self) -> bool {
        self.experiment.scan.is_some()
    }

    /// Prepares the scene on a device: builds the BVH, compiles kernels, and renders auxiliary layers if the setting `aov` wants them.
    ///
    /// Fails if the gate can meet no light, unless the settings have `force`; the error says when light arrives. Fails if the memory
    /// of the host or of the device does not suffice, if the scene or the settings do not allow a render, if the device is lost, or if
    /// the job is a scan.
    pub fn prepare(self, device: &Device) -> Result<ReadyJob> {
        let mut job = self.prepare_after(None, device)?;
        job.no_job_follows();
        Ok(job)
    }

    /// As [`Job::prepare`], for one job of a series. `before`: the job that this function has prepared last. Its renderer is taken over
    /// if only cameras, lights, positions of moving surfaces, gates or the seed differ. The image has the same bits in both cases. The scene stays in the memory of the host for the next job.
    pub fn prepare_after(self, before: Option<ReadyJob>, device: &Device) -> Result<ReadyJob> {
        let free = memory::free_without(before.as_ref().map_or(0, |before| before.ready.renderer.response_bytes()));
        // As for an image file, which has variances.
        memory::check(self.settings(), memory::ImageParts { variance: true, exr: true }, free)?;
        let before = before.map(|job| job.ready);
        self.ready(before, true, || Ok(device.clone()), &mut Preparation::start(), &mut |_| {})
    }

    /// Prepares a scan on a device. Fails if the job is no scan, or if its scene or settings do not allow one. Also fails if the host or
    /// the device has too little memory, or if the device is lost.
    pub fn prepare_scan(self, device: &Device) -> Result<ReadyScan> {
        ReadyScan::new(self, || Ok(device.clone()), &mut |_| {})
    }

    /// Makes a renderer, or takes over the renderer of the previous render. `has_variance`: whether several responses have variances.
    /// `open` opens the device. `say` gets each warning about the scene and the memory as soon as it is known.
    #[doc(hidden)]
    pub fn ready(
        self,
        before: Option<Ready>,
        has_variance: bool,
        mut open: impl FnMut() -> Result<Device>,
        preparation: &mut Preparation,
        say: &mut dyn FnMut(&str),
    ) -> Result<ReadyJob> {
        if self.is_scan() {
            return Err(Error::advice("this experiment is a scan: ", "measure its points instead of an image"));
        }
        let (config, mut warnings, may_be_dark) = (self.config(), self.warnings(), self.may_be_dark());
        let exposure = Exposure::new(&config, self.settings(), &self.scene)?;
        if let Some(warning) = exposure.as_ref().and_then(|exposure| exposure.warning(self.settings().budget())) {
            say(&warning);
            warnings.push(warning);
        }
        let Job { experiment, scene, resolved: Resolved { settings, .. }, .. } = self;
        let aov = experiment.output.aov.unwrap_or_default();
        if aov.velocity {
            return Err(Error::advice("the velocity is a layer of scans: ", "leave it out of --aov"));
        }
        // A renderer that this render cannot take over is dropped here, so that two copies of the scene are never on the device.
        let has_variances = has_variance && !settings.responses().is_single_box();
        let can_follow =
            |ready: &Ready| aov == Aov::default() && ready.renderer.has_response_variance() == has_variances;
        let was_missing = before.as_ref().is_some_and(|ready| ready.missing.is_some());
        let followed = match before.filter(can_follow) {
            Some(before) => {
                // The renderer `before` needs its device, so this device is usually open.
                let device = open()?;
                preparation.timed("follow what moved", || before.follow(&device, scene.clone(), &settings))?
            }
            None => None,
        };
        // Light may come in at another moment of the exposure.
        let may_begin_dark = may_be_dark || exposure.is_some();
        let wanted = Wanted { path: experiment.scene.as_deref(), may_be_dark: may_begin_dark, has_variance, aov };
        let (ready, layers) = match followed {
            Some(ready) => {
                // Its share of the pixels may differ from frame to frame, so it is told once.
                ready.missing.iter().filter(|_| !was_missing).for_each(|warning| say(warning));
                (ready, Layers::default())
            }
            None => Ready::new(scene, &settings, &wanted, open, preparation, say)?,
        };
        Ok(ReadyJob {
            ready,
            exposure,
            layers,
            sums: SumFiles::default(),
            shard: Shard::ALL,
            config,
            may_be_dark,
            strict: experiment.render.strict.unwrap_or(false),
            warnings,
            elapsed: Duration::ZERO,
        })
    }
}

/// The experiment in the file `path`, or of the scene in this file, with further settings.
fn read_with<'a>(path: &Path, settings: impl IntoIterator<Item = (&'a str, &'a str)>) -> Result<Experiment> {
    let mut typed = Experiment::default();
    settings.into_iter().try_for_each(|(name, text)| named::set(&mut typed, name, Some(text)))?;
    let experiment = read::experiment(path.into(), typed)?;
    experiment.check_paths()?;
    Ok(experiment)
}
