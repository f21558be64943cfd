//! What the program, the viewer and the Python module do with a scene. Nothing here prints.

pub mod feasible;
pub mod iterations;
pub mod memory;
pub mod preparation;
pub mod read;
pub mod ready;
pub mod sums;

use crate::error::Result;
use crate::input::experiment::Experiment;
use crate::input::resolve::{self, Resolved};
use crate::input::scenery;
use crate::scene::Scene;

/// A render with all settings resolved.
pub struct Job {
    /// With the choices that depend on the scene, such as the place of an automatic camera.
    pub experiment: Experiment,
    /// With the cameras and lights of the experiment.
    pub scene: Scene,
    pub resolved: Resolved,
    /// Notes about the choices, one sentence each.
    pub notes: Vec<String>,
}

impl Job {
    /// Adds the cameras and lights of `experiment` to `scene`, and fills in all settings. Fails if they contradict each other or the
    /// scene.
    pub fn new(mut experiment: Experiment, mut scene: Scene) -> Result<Job> {
        let notes = scenery::apply(&mut experiment, &mut scene)?;
        let resolved = resolve::resolve(&experiment, &scene)?;
        Ok(Job { experiment, scene, resolved, notes })
    }

    /// The experiment with all defaults, but without outputs. It renders the same image later.
    pub fn config(&self) -> Experiment {
        let config = resolve::as_experiment(&self.experiment, &self.resolved.settings, &self.scene);
        Experiment { output: Default::default(), ..config }
    }

    /// Warnings about the scene and the settings, one sentence each.
    pub fn warnings(&self) -> Vec<String> {
        [&self.scene.warnings[..], &self.resolved.warnings].concat()
    }

    /// Whether a black image is accepted: the user wants it, or there is no gate that could miss the light.
    pub fn may_be_dark(&self) -> bool {
        self.experiment.gate.force.unwrap_or(false) || self.resolved.settings.responses().are_steady()
    }
}
