//! How a LiDAR moves while it scans: a table of poses.

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::input::rows;

/// The columns of the file, what a row is, and an example.
const COLUMNS: [&str; 8] = ["time", "x", "y", "z", "qx", "qy", "qz", "qw"];
const ROW: &str = "a time in seconds, a position in metres and a unit quaternion (time,x,y,z,qx,qy,qz,qw)";
const EXAMPLE: &str = "0.05,0,1.6,-0.5,0,0,0,1";
/// Maximum difference to 1 of the length of a quaternion. Files with four digits have it.
const MAX_LENGTH_ERROR: f64 = 1e-3;

/// Poses of the sensor in world space, by time.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// In ascending order of time; at least one.
    poses: Vec<Pose>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Pose {
    /// In seconds.
    time: f64,
    /// Origin of the sensor's frame in metres.
    position: DVec3,
    /// From the sensor's frame to world space.
    rotation: DQuat,
}

impl Trajectory {
    /// Reads a CSV file with a pose per row. Fails with one sentence if it cannot be read, if a number is not finite, if times do not rise,
    /// or if a quaternion is not a unit quaternion.
    pub fn read(path: &Path) -> Result<Trajectory, String> {
        let rows = rows::read(path, COLUMNS, ROW, EXAMPLE)?;
        Trajectory::of_rows(&rows).map_err(|message| format!("{}: {message}", path.display()))
    }

    fn of_rows(rows: &[[f64; 8]]) -> Result<Trajectory, String> {
        let mut poses: Vec<Pose> = vec![];
        for (number, &[time, x, y, z, qx, qy, qz, qw]) in rows.iter().enumerate() {
            let pose = number + 1;
            if !rows[number].iter().all(|x| x.is_finite()) {
                return Err(format!("pose {pose} has a number that is not finite; remove it"));
            }
            if let Some(before) = poses.last().filter(|before| before.time >= time) {
                return Err(format!(
                    "pose {pose} is at {time} s, and the one before at {} s; sort the poses by time, and give each time once",
                    before.time
                ));
            }
            let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
            if (rotation.length() - 1.0).abs() > MAX_LENGTH_ERROR {
                return Err(format!(
                    "the quaternion of pose {pose} has the length {:.4}; divide it by its length (the order is x, y, z, w)",
                    rotation.length()
                ));
            }
            poses.push(Pose { time, position: DVec3::new(x, y, z), rotation: rotation.normalize() });
        }
        Ok(Trajectory { poses })
    }

    /// The times of the first and the last pose, in seconds.
    pub fn range(&self) -> [f64; 2] {
        [self.poses[0].time, self.poses[self.poses.len() - 1].time]
    }

    /// Position and rotation at a time inside of [`Trajectory::range`]. Between two poses, the position moves on a straight line, and the
    /// rotation turns about a fixed axis.
    pub fn at(&self, time: f64) -> (DVec3, DQuat) {
        let next = self.poses.partition_point(|pose| pose.time <= time);
        let before = self.poses[next.saturating_sub(1)];
        let Some(after) = self.poses.get(next).filter(|_| next > 0) else { return (before.position, before.rotation) };
        let part = (time - before.time) / (after.time - before.time);
        (before.position.lerp(after.position, part), before.rotation.slerp(after.rotation, part))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    const FIRST: [f64; 8] = [1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0];

    #[test]
    fn poses_are_interpolated() {
        let quarter = DQuat::from_rotation_y(FRAC_PI_2).to_array();
        // A quaternion and its negative are one rotation, and the shorter turn counts.
        for sign in [1.0, -1.0] {
            let [x, y, z, w] = quarter.map(|x| sign * x);
            let trajectory = Trajectory::of_rows(&[FIRST, [3.0, 4.0, 2.0, -2.0, x, y, z, w]]).unwrap();
            assert_eq!(trajectory.range(), [1.0, 3.0]);
            let (position, rotation) = trajectory.at(1.5);
            assert!(position.distance(DVec3::new(1.0, 2.0, -0.5)) < 1e-12, "{position}");
            let turned = rotation * DVec3::NEG_Z;
            let wanted = DQuat::from_rotation_y(0.25 * FRAC_PI_2) * DVec3::NEG_Z;
            assert!(turned.distance(wanted) < 1e-12, "{turned} {wanted}");
            assert_eq!(trajectory.at(3.0).0, DVec3::new(4.0, 2.0, -2.0));
            assert_eq!(trajectory.at(1.0).0, DVec3::new(0.0, 2.0, 0.0));
        }
    }

    #[test]
    fn wrong_poses_are_named() {
        let with = |change: &dyn Fn(&mut [f64; 8])| {
            let mut second = FIRST;
            second[0] = 2.0;
            change(&mut second);
            Trajectory::of_rows(&[FIRST, second]).unwrap_err()
        };
        for (message, part) in [
            (with(&|pose| pose[0] = 1.0), "sort the poses by time"),
            (with(&|pose| pose[0] = 0.5), "pose 2 is at 0.5 s, and the one before at 1 s"),
            (with(&|pose| pose[7] = 0.9), "has the length 0.9000"),
            (with(&|pose| pose[2] = f64::NAN), "not finite"),
        ] {
            assert!(message.contains(part), "{message}");
        }
    }
}
