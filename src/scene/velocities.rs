//! How the parts of a scene move at its moment of an animation.

use glam::{DAffine3, DVec3};

use super::Scene;

/// Velocities in world space, in m/s.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Velocities {
    /// Of each of [`Scene::cameras`].
    pub cameras: Vec<DVec3>,
    /// Of each of [`Scene::lights`].
    pub lights: Vec<DVec3>,
    /// For each of [`Scene::instances`], the map from a point of it to the velocity of the point. `None` if it is not known, because the
    /// mesh changes its shape, or because the object appears or disappears.
    pub instances: Vec<Option<DAffine3>>,
}

/// Velocities come from the places of objects this time before and after a moment, in seconds. It is long enough for places with 32 bits.
const STEP: f64 = 1e-3;

impl Velocities {
    /// The times in seconds of the scenes that [`Velocities::between`] needs for the moment `at` of animations that end at `end`.
    pub fn times_around(at: f64, end: f64) -> [f64; 2] {
        [(at - STEP).max(0.0), (at + STEP).min(end)]
    }

    /// The velocities in `now`, from the scene before and after it. `seconds` lie between `before` and `after`.
    pub fn between(before: &Scene, now: &Scene, after: &Scene, seconds: f64) -> Velocities {
        let of_instance = |index: usize| {
            let instance = &now.instances[index];
            if !now.is_moving(instance) {
                return Some(DAffine3::ZERO);
            }
            // A node that is scaled to nothing at one of the times has no instance then.
            let transform_in = |other: &Scene| {
                let same = other.instances.get(index).filter(|same| same.node == instance.node)?;
                let is_rigid = other.meshes[same.mesh as usize] == now.meshes[instance.mesh as usize];
                is_rigid.then_some(same.transform)
            };
            Some(rate_of(transform_in(before)?, instance.transform, transform_in(after)?, seconds))
        };
        let of_cameras = before.cameras.iter().zip(&after.cameras);
        let of_lights = before.lights.iter().zip(&after.lights);
        Velocities {
            cameras: of_cameras.map(|(a, b)| (b.transform.translation - a.transform.translation) / seconds).collect(),
            lights: of_lights.map(|(a, b)| (b.position - a.position) / seconds).collect(),
            instances: (0..now.instances.len()).map(of_instance).collect(),
        }
    }

    /// Velocity of a point of an instance. NaN if it is not known.
    pub fn of(&self, instance: usize, point: DVec3) -> DVec3 {
        self.instances[instance].map_or(DVec3::NAN, |rate| rate.transform_point3(point))
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
