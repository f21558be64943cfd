//! Objects that move while a LiDAR scans: the scene at the time of each shot.

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scan_table::Scan;
use crate::input::scenery;
use crate::job::read;
use crate::scene::{Scene, Velocities, gltf};
use crate::settings::moment::Moment;

/// The animations of a scan's scene. They play while the shots are fired.
pub struct Moving {
    /// Without its scan.
    experiment: Experiment,
    /// Time in the animations minus time of a shot, in seconds.
    offset: f64,
    /// End of the animations in seconds.
    end: f64,
}

impl Moving {
    /// `None` if the objects stand still: the user chose no time of the animations, or the shots have no times. The first shot sees the
    /// scene at the time of `--at`. Fails if the animations end before the last shot.
    pub fn new(experiment: &Experiment, scan: &Scan) -> Result<Option<Moving>> {
        let (Some(Moment(at)), Some(times)) = (experiment.input.at, &scan.times) else { return Ok(None) };
        if experiment.scene.is_none() {
            return Ok(None);
        }
        let Some(end) = read::end_of_animations(experiment)? else { return Ok(None) };
        let (first, last) = (times[0], times[times.len() - 1]);
        let seen = at + last - first;
        if seen > end * (1.0 + gltf::ROUNDING) {
            return Err(Error::advice(
                format!("the last shot is fired at {seen} s of the animations, which end at {end} s; "),
                "choose an earlier time with --at, or a shorter duration of the scan",
            ));
        }
        let experiment = Experiment { scan: None, ..experiment.clone() };
        Ok(Some(Moving { experiment, offset: at - first, end }))
    }

    /// The scene at a time of the scan. `before`: the scene at another time, with the laser and the sensor of the scan. They stay.
    pub fn scene_at(&self, time: f64, before: &Scene) -> Result<Scene> {
        let experiment = &self.experiment;
        let mut scene = self.pose(time + self.offset)?;
        scenery::apply_to_surfaces(experiment, &mut scene);
        if experiment.medium != Default::default() {
            scene.media = before.media.clone();
        }
        Ok(Scene { cameras: before.cameras.clone(), lights: before.lights.clone(), sky: before.sky.clone(), ..scene })
    }

    /// The scene of the file at a time of the animations.
    fn pose(&self, at: f64) -> Result<Scene> {
        let mut experiment = self.experiment.clone();
        experiment.input.at = Some(Moment(at));
        read::scene(&experiment)
    }

    /// How the surfaces of `scene` move, which is the scene at a time of the scan.
    pub fn velocities(&self, time: f64, scene: &Scene) -> Result<Velocities> {
        let [from, to] = Velocities::times_around(time + self.offset, self.end);
        let (before, after) = (self.pose(from)?, self.pose(to)?);
        Ok(Velocities::between(&before, scene, &after, to - from))
    }
}
