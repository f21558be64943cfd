//! Reads experiments and scenes.

use std::path::{Path, PathBuf};

use super::exposure;
use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scenery;
use crate::scene::gltf::{self, Playback};
use crate::scene::{Scene, Velocities};
use crate::settings::moment::Moment;

/// The experiment to render, from the file `input` and the flags `typed`. If the input is an experiment file, flags take precedence
/// over its keys. `scene` is always set.
pub fn experiment(input: PathBuf, mut typed: Experiment) -> Result<Experiment> {
    let extension = input.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "toml" {
        let experiment = typed.over(Experiment::read(&input)?);
        if experiment.scene.is_none() {
            let message = "names no scene; add a first line like scene = \"room.glb\"".into();
            return Err(Error::File { path: input, message });
        }
        return Ok(experiment);
    }
    if extension != "glb" && extension != "gltf" {
        let message = "is neither a scene (.glb, .gltf) nor an experiment (.toml)".into();
        return Err(Error::File { path: input, message });
    }
    typed.scene = Some(input);
    Ok(typed)
}

/// Loads the scene of an experiment, in the pose that the experiment selects. With a shutter: in the middle of the exposure of the first
/// row.
///
/// # Panics
/// If the experiment names no scene. So do the functions below.
pub fn scene(experiment: &Experiment) -> Result<Scene> {
    exposure::check(experiment, 0..1)?;
    let (path, allowed, playback) = source(experiment);
    gltf::load_with(path, &allowed, playback)
}

/// Fails if the scene has no pose at the time that the experiment selects.
pub fn check_pose(experiment: &Experiment) -> Result<()> {
    exposure::check(experiment, 0..1)?;
    let (path, allowed, playback) = source(experiment);
    gltf::check_pose(path, &allowed, playback)
}

/// When the animations of the scene end, in seconds; `None` if nothing moves.
pub fn end_of_animations(experiment: &Experiment) -> Result<Option<f64>> {
    let (path, allowed, playback) = source(experiment);
    gltf::end_of_animations(path, &allowed, playback.animation)
}

/// Where a node of the scene is, see [`gltf::poses`].
pub fn poses(experiment: &Experiment, node: &str, steps: impl Fn(f64) -> u32) -> Result<Vec<gltf::Pose>> {
    let (path, allowed, playback) = source(experiment);
    gltf::poses(path, &allowed, playback.animation, node, steps)
}

/// How the parts of `scene` move, which is that of the experiment, with its cameras and lights. All choices have been made, so that an
/// automatic camera stands still. `None` if nothing moves, or if the user chose
/// no time.
pub fn velocities(experiment: &Experiment, scene: &Scene) -> Result<Option<Velocities>> {
    let Some(at) = experiment.input.moment().filter(|_| experiment.scene.is_some()) else { return Ok(None) };
    let Some(end) = end_of_animations(experiment)? else { return Ok(None) };
    let times = Velocities::times_around(at, end);
    let pose = |at: f64| {
        let mut experiment = experiment.clone();
        (experiment.input.at, experiment.input.shutter, experiment.input.rolling) = (Some(Moment(at)), None, None);
        experiment.gate.heterodyne = None;
        let mut scene = self::scene(&experiment)?;
        // Laser and sensor of a scan follow its trajectory.
        if experiment.scan.is_none() {
            scenery::apply(&mut experiment, &mut scene)?;
        }
        Ok::<_, Error>(scene)
    };
    let [before, after] = [pose(times[0])?, pose(times[1])?];
    Ok(Some(Velocities::between(&before, scene, &after, times[1] - times[0])))
}

/// The file of the scene, the folders that it may refer to, and the pose (time and animation).
fn source(experiment: &Experiment) -> (&Path, Vec<PathBuf>, Playback<'_>) {
    let path = experiment.scene.as_ref().expect("the experiment names a scene");
    let input = &experiment.input;
    (path, input.allowed(), Playback { at: input.moment(), animation: input.animation.as_deref() })
}
