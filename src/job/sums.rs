//! The sums of a render: where they come from, and files that keep them.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::files::{Lock, is_same};
use crate::image::accumulation::file::{self, Parts};
use crate::image::accumulation::{self, About, Accumulation};
use crate::image::fingerprint;
use crate::image::layers::Layers;
use crate::input::experiment::Experiment;
use crate::render::Renderer;
use crate::render::schedule::Lengths;
use crate::scene::gltf;
use crate::settings::shard::Shard;
use crate::settings::{Budget, Settings};

/// A write of the sums takes at most this fraction of the time of a render.
const MAX_SHARE: f64 = 0.01;

/// Describes the render that sums belong to, without the number of samples.
pub struct Identity(About);

impl Identity {
    /// `experiment` is the resolved experiment. It names the file of the scene.
    pub fn new(experiment: Experiment, settings: &Settings, shard: Shard) -> Result<Identity> {
        let without_outputs = Experiment { output: Default::default(), ..experiment };
        let experiment = without_outputs.with_absolute_paths()?;
        let scene = experiment.scene.as_ref().expect("the experiment names a scene");
        let files = experiment.input_files();
        let read = [gltf::paths(scene, &experiment.input.allowed()), files.clone()].concat();
        let scene = fingerprint::of_files(&read)?;
        Ok(Identity(About::new(settings, experiment.to_toml(), &files, scene, shard)))
    }

    /// The fingerprint of the contents of the scene, and of the files that the settings name.
    pub fn inputs(&self) -> &str {
        &self.0.scene
    }

    /// Fails if the sums in the file belong to another render.
    pub fn check_file(&self, path: &Path) -> Result<()> {
        let about = file::read_about(path)?;
        about.check_same_render(&path.display().to_string(), &self.0, "this command")
    }

    /// How the settings of an image, as TOML, differ from those of this render in a way that affects the image; `None` if they do not.
    pub fn difference_to(&self, settings: &str) -> Option<String> {
        let other = Experiment::parse(settings).ok().and_then(|other| other.with_absolute_paths().ok());
        let Some(other) = other.filter(|other| other.scene.is_some()) else {
            return Some("its settings are not known".into());
        };
        // The image may record paths relative to a folder that is not the current one. The fingerprint compares the contents.
        let files: Vec<String> = other.input_paths().iter().map(|path| path.to_string_lossy().into()).collect();
        let own = ("this command", (&*self.0.settings, &*self.0.files));
        accumulation::difference_of_images(own, ("the file", (&other.to_toml(), &files)))
    }

    /// Whether the sums in the file have the same --spp or --time.
    pub fn has_budget_of(&self, path: &Path) -> Result<bool> {
        let budget = |settings: &str| Experiment::parse(settings).ok().map(|e| (e.render.spp, e.render.time));
        Ok(budget(&file::read_about(path)?.settings) == budget(&self.0.settings))
    }

    /// Writes the sums after `seconds` of rendering, with the auxiliary layers of the image.
    pub fn write(&self, path: &Path, renderer: &Renderer, layers: &Layers, seconds: f64) -> Result<()> {
        let about = renderer.about(&self.0, seconds);
        let adaptive = renderer.adaptive_state();
        let (film, responses) = (renderer.film(), renderer.responses()?);
        file::write(path, Parts { about: &about, film, responses, adaptive: adaptive.as_ref(), layers })
    }
}

/// The experiment of a command without a scene: that of the sums which --resume names. The flags `typed` take precedence.
pub fn read_experiment(typed: Experiment) -> Result<Experiment> {
    let path = typed.output.resume.clone().expect("a command without a scene has --resume");
    let text = file::read_about(&path)?.settings;
    let earlier = Experiment::parse(&text).map_err(|e| Error::File {
        path: path.clone(),
        message: format!("its settings cannot be read ({e}); name the scene and the settings in the command"),
    })?;
    match earlier.scene {
        Some(_) => Ok(typed.over(earlier)),
        None => Err(Error::File { path, message: "its settings name no scene; name the scene in the command".into() }),
    }
}

/// The sums that a render continues.
pub struct Earlier {
    path: PathBuf,
    pub sums: Accumulation,
}

impl Earlier {
    /// Reads the file of --resume, or the file of --checkpoint if it exists. Fails if these are two different files.
    pub fn read(resume: Option<&Path>, checkpoint: Option<&(PathBuf, f64)>) -> Result<Option<Earlier>> {
        let checkpoint = checkpoint.map(|(path, _)| path.as_path()).filter(|path| path.exists());
        let path = match (resume, checkpoint) {
            (Some(resume), Some(checkpoint)) if !is_same(resume, checkpoint) => {
                return Err(Error::advice(
                    format!(
                        "--resume would go on from {}, and --checkpoint from {}, which exists: ",
                        resume.display(),
                        checkpoint.display()
                    ),
                    "keep one, or choose another name",
                ));
            }
            (Some(path), _) | (None, Some(path)) => path,
            (None, None) => return Ok(None),
        };
        Ok(Some(Earlier { path: path.into(), sums: file::read(path)? }))
    }

    /// The shard to render: the shard of the flag, else the shard of the sums. Fails if the two differ.
    pub fn shard(&self, typed: Option<Shard>) -> Result<Shard> {
        let of_sums = self.sums.about.shard();
        match (typed, of_sums) {
            (None, shard) => Ok(shard.unwrap_or(Shard::ALL)),
            (Some(typed), Some(shard)) if typed == shard => Ok(typed),
            (Some(typed), _) => Err(Error::advice(
                format!(
                    "{} holds {}, and not shard {typed}; ",
                    self.path.display(),
                    of_sums.map_or("merged shards".into(), |shard| match shard.is_all() {
                        true => "a whole render".into(),
                        false => format!("shard {shard}"),
                    })
                ),
                "choose another file",
            )),
        }
    }

    /// Fails if the sums belong to another render, or if they lack variances that this render must write.
    pub fn check(&self, identity: &Identity, has_variance: bool) -> Result<()> {
        let name = self.path.display().to_string();
        self.sums.about.check_same_render(&name, &identity.0, "this command")?;
        let lacks = self.sums.responses.as_ref().is_some_and(|film| !film.has_variance());
        match has_variance && lacks {
            true => Err(Error::advice(
                format!("{name} has no variances of the gates, which the outputs need; "),
                "leave out --variance and .exr, or render anew with --variance",
            )),
            false => Ok(()),
        }
    }

    /// A line that says after how many samples and iterations the render goes on.
    pub fn describe(&self) -> String {
        let About { samples_per_pixel, iterations, .. } = &self.sums.about;
        let shard = self.sums.about.shard().filter(|shard| !shard.is_all());
        let part = shard.map_or(String::new(), |shard| format!("shard {shard}, "));
        format!(
            "{}: {part}going on after {samples_per_pixel} samples per pixel in {} iterations",
            self.path.display(),
            iterations.len()
        )
    }

    /// A note if the image will differ from that of a render that was never interrupted. `lengths`: those of the iterations.
    pub fn note(&self, shard: Shard, is_adaptive: bool, lengths: Lengths) -> Option<String> {
        let About { samples_per_pixel, iterations, shards, .. } = &self.sums.about;
        let is_complete =
            iterations.iter().map(|i| u64::from(lengths.samples_in(i))).sum::<u64>() == *samples_per_pixel;
        let has_gap = shard.is_all() && iterations.gap().is_some();
        let reason = match (is_complete, has_gap || shards.len() > 1) {
            _ if is_adaptive && self.sums.adaptive.is_none() => "it lacks the state of adaptive sampling",
            (true, false) => return None,
            (_, true) => "its iterations are not those of a single render",
            (false, false) => "its last iteration was shortened to end with the wanted number of samples",
        };
        Some(format!(
            "{}: {reason}; the image will be as accurate as that of a render that never stopped, but its noise will differ",
            self.path.display()
        ))
    }
}

/// A note if a render with this budget, and with iterations of these lengths, has no iteration for the shard.
pub fn empty_shard(shard: Shard, budget: &Budget, lengths: Lengths) -> Option<String> {
    let Budget::Spp(spp) = *budget else { return None };
    let iterations = lengths.iterations_of(spp);
    (shard.index() >= iterations).then(|| {
        format!(
            "shard {shard} has no iteration of a render of {spp} samples per pixel; use at most {iterations} shards"
        )
    })
}

/// The file of --checkpoint while a render runs.
pub struct Checkpoint {
    path: PathBuf,
    every: Duration,
    /// When the last write ended, and how long it took.
    last: Instant,
    took: Duration,
    _lock: Lock,
}

impl Checkpoint {
    /// The checkpoint with this file and these seconds between two writes; `None` without one. Fails if another render writes the same
    /// file.
    pub fn new(wanted: Option<&(PathBuf, f64)>) -> Result<Option<Checkpoint>> {
        let Some((path, seconds)) = wanted else { return Ok(None) };
        let every = Duration::try_from_secs_f64(*seconds).unwrap_or(Duration::MAX);
        let lock = Lock::new(path)?;
        Ok(Some(Checkpoint { path: path.clone(), every, last: Instant::now(), took: Duration::ZERO, _lock: lock }))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the sums if it is time. If they cannot be written, a call after the same pause tries again.
    pub fn update(&mut self, identity: &Identity, renderer: &Renderer, layers: &Layers, seconds: f64) -> Result<()> {
        let pause = self.every.max(self.took.div_f64(MAX_SHARE));
        if self.last.elapsed() < pause {
            return Ok(());
        }
        let start = Instant::now();
        let written = identity.write(&self.path, renderer, layers, seconds);
        (self.last, self.took) = (Instant::now(), start.elapsed());
        written
    }
}
