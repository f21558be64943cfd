//! Objects that move while a LiDAR scans: the scene at the time of each shot.

use glam::{DAffine3, DVec3};

use crate::error::{Error, Result};
use crate::input::experiment::Experiment;
use crate::input::scan_table::Scan;
use crate::input::scenery;
use crate::job::read;
use crate::scene::{Scene, gltf};
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

/// Velocities come from the places of surfaces this time before and after a shot, in seconds. It is long enough for places with 32 bits.
const STEP: f64 = 1e-3;

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
        let at = time + self.offset;
        let [from, to] = [(at - STEP).max(0.0), (at + STEP).min(self.end)];
        let (before, after) = (self.pose(from)?, self.pose(to)?);
        let rate = |index: usize| {
            let now = &scene.instances[index];
            if !scene.is_moving(now) {
                return Some(DAffine3::ZERO);
            }
            // A node that is scaled to nothing at one of the times has no instance then.
            let transform_in = |other: &Scene| {
                let same = other.instances.get(index).filter(|instance| instance.node == now.node)?;
                let is_rigid = other.meshes[same.mesh as usize] == scene.meshes[now.mesh as usize];
                is_rigid.then_some(same.transform)
            };
            Some(rate_of(transform_in(&before)?, now.transform, transform_in(&after)?, to - from))
        };
        Ok(Velocities((0..scene.instances.len()).map(rate).collect()))
    }
}

/// For each instance of a scene, the map from a point of it to the point's velocity; `None` if its mesh changes its shape.
pub struct Velocities(Vec<Option<DAffine3>>);

impl Velocities {
    /// Velocity in m/s of a point of an instance, in world space. NaN if its mesh changes its shape.
    pub fn of(&self, instance: usize, point: DVec3) -> DVec3 {
        self.0[instance].map_or(DVec3::NAN, |rate| rate.transform_point3(point))
    }
}

/// The map from a point in world space to its velocity, if it belongs to an object with these transforms, `seconds` between the first and
/// the last.
fn rate_of(before: DAffine3, now: DAffine3, after: DAffine3, seconds: f64) -> DAffine3 {
    let matrix3 = (after.matrix3 - before.matrix3) * seconds.recip();
    let rate = DAffine3 { matrix3, translation: (after.translation - before.translation) / seconds };
    rate * now.inverse()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_a_turning_object_moves_about_its_axis() {
        let (omega, drift) = (DVec3::new(1.0, -2.0, 0.5), DVec3::new(3.0, 0.0, -1.0));
        let at = |time: f64| {
            let turn = DAffine3::from_axis_angle(omega.normalize(), omega.length() * time);
            DAffine3::from_translation(DVec3::X + drift * time) * turn * DAffine3::from_scale(DVec3::new(2.0, 1.0, 0.5))
        };
        let rate = rate_of(at(0.299), at(0.3), at(0.301), 0.002);
        let point = at(0.3).transform_point3(DVec3::new(0.2, -0.7, 1.0));
        let centre = at(0.3).translation;
        let expected = drift + omega.cross(point - centre);
        assert!((rate.transform_point3(point) - expected).length() < 1e-4);
        assert_eq!(DAffine3::ZERO.transform_point3(point), DVec3::ZERO);
    }
}
