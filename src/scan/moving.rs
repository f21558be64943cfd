//! Objects that move while a LiDAR scans: the scene at the time of each shot.

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scan_table::Scan;
use crate::input::scenery;
use crate::job::read;
use crate::scene::Scene;
use crate::settings::moment::Moment;

/// The animations of a scan's scene. They play while the shots are fired.
pub struct Moving {
    /// Without its scan.
    experiment: Experiment,
    /// Time in the animations minus time of a shot, in seconds.
    offset: f64,
}

/// The last shot may be later than the animations by this fraction, because the times of their keys are rounded to f32.
const ROUNDING: f64 = 1e-6;

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
        if seen > end * (1.0 + ROUNDING) {
            return Err(Error::advice(
                format!("the last shot is fired at {seen} s of the animations, which end at {end} s; "),
                "choose an earlier time with --at, or a shorter duration of the scan",
            ));
        }
        let experiment = Experiment { scan: None, ..experiment.clone() };
        Ok(Some(Moving { experiment, offset: at - first }))
    }

    /// The scene at a time of the scan. `before`: the scene at another time, with the laser and the sensor of the scan. They stay.
    pub fn scene_at(&self, time: f64, before: &Scene) -> Result<Scene> {
        let mut experiment = self.experiment.clone();
        experiment.input.at = Some(Moment(time + self.offset));
        let mut scene = read::scene(&experiment)?;
        scenery::apply_to_surfaces(&experiment, &mut scene);
        if experiment.medium != Default::default() {
            scene.media = before.media.clone();
        }
        Ok(Scene { cameras: before.cameras.clone(), lights: before.lights.clone(), sky: before.sky.clone(), ..scene })
    }
}
