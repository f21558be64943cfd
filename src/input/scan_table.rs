//! `[scan]` of an experiment file: a laser and a sensor that look at points of a wall, or in directions as a LiDAR does.

mod points;
mod trajectory;

use std::f64::consts::PI;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::Result;
use crate::render::split_mix;
use crate::scene::check::MAX_COORDINATE;
use crate::scene::{Aim, Camera, Light, LightKind, Projection};
use crate::settings::MAX_ROW;
use crate::settings::keys::Dashed;
use crate::settings::numbers::Numbers;
use crate::settings::values::Seconds;
pub use points::{Directions, Ends, Grid, Points, Spinning};
use trajectory::Trajectory;

/// Name of the camera of a scan.
pub const SENSOR: &str = "scan sensor";
/// Name of the light of a scan.
pub const LASER: &str = "scan laser";

/// Power of the laser in W, if the user gives none.
const DEFAULT_POWER: f64 = 1.0;
/// Maximum number of points of the laser: of beams, if the scan is confocal. Those of the sensor have a pixel each in an image of one
/// row, so [`MAX_ROW`] limits them.
const MAX_LASER_POINTS: u32 = 1 << 20;
/// Maximum divergence and field of view, in degrees.
const MAX_ANGLE: f64 = 90.0;

/// The keys of `[scan]` that no other table has. `[[light]]` has a power too.
pub const KEYS: [&str; 12] = [
    "laser",
    "sensor",
    "divergence",
    "pixel-fov",
    "account-first-and-last-bounces",
    "points",
    "laser-points",
    "sensor-points",
    "ends",
    "duration",
    "trajectory",
    "begin",
];

/// A scan as the user wrote it. Reading a file checks it, so [`ScanTable::scan`] cannot fail afterwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields, rename_all = "kebab-case")]
pub struct ScanTable {
    /// Where the laser stands, in metres.
    pub laser: Numbers<3>,
    /// Where the sensor stands, in metres; by default where the laser stands.
    pub sensor: Option<Numbers<3>>,
    /// Power of the laser in W.
    pub power: Option<f64>,
    /// Full angle in degrees of the cone of the laser. 0, the default: a beam without width.
    pub divergence: Option<f64>,
    /// Width and height in degrees of the field of view of a pixel. 0, the default: a point.
    pub pixel_fov: Option<f64>,
    /// Whether travel times contain the way from the laser to its point, and the way from the point of the sensor to the sensor.
    /// By default only for directions, which have no points.
    pub account_first_and_last_bounces: Option<bool>,
    /// The points of a confocal scan: laser and sensor look at the same point, one point after the other.
    pub points: Option<Points>,
    /// The points of an exhaustive scan: for each point of the laser, the sensor looks at all of its points.
    pub laser_points: Option<Points>,
    pub sensor_points: Option<Points>,
    /// Where the first and the last point of grids and directions are; by default [`Ends::Centres`].
    pub ends: Option<Ends>,
    /// Time from the first shot to the end of the scan. Shots are evenly spaced in time; all channels of a spinning LiDAR fire at once.
    pub duration: Option<Seconds>,
    /// A file with the poses of a LiDAR in world space. Place and directions of the LiDAR are then those in its own frame.
    pub trajectory: Option<PathBuf>,
    /// Time of the first shot in the trajectory; by default that of its first pose.
    pub begin: Option<Seconds>,
}

/// A scan. It consists of one render per point of the laser. Positions are in world space, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    pub laser: DVec3,
    pub sensor: DVec3,
    power: f64,
    /// Full angle of the laser's cone, and width and height of the field of view of a pixel, in radians.
    pub divergence: f64,
    pub pixel_fov: f64,
    pub accounts_first_and_last: bool,
    pub laser_points: Vec<DVec3>,
    /// `None` if each point of the laser is also the only point of the sensor.
    pub sensor_points: Option<Vec<DVec3>>,
    /// Time in seconds of each shot of the laser; `None` if the scan has no duration.
    pub times: Option<Vec<f64>>,
    /// Where laser and sensor are at each shot, if they move.
    pub places: Option<Vec<DVec3>>,
    /// Number of consecutive shots that the laser fires at once: the channels of a spinning LiDAR, else 1.
    pub at_once: usize,
}

impl ScanTable {
    /// The files that the table names.
    pub fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let all = [&mut self.points, &mut self.laser_points, &mut self.sensor_points];
        all.into_iter().flatten().filter_map(Points::path).chain(&mut self.trajectory)
    }

    /// Fails with one sentence if keys exclude each other, or if a number is out of range.
    pub fn scan(&self) -> Result<Scan, String> {
        let laser = DVec3::from(self.laser.0);
        let sensor = self.sensor.map_or(laser, |sensor| sensor.0.into());
        let given = [&self.points, &self.laser_points, &self.sensor_points];
        if self.ends.is_some() && given.into_iter().flatten().all(|points| !points.have_ends()) {
            return Err("ends is for grids and directions, and the points are a list: remove it".into());
        }
        let ends = self.ends.unwrap_or_default();
        let lit_at = |points: &Points| points.positions(laser, ends, MAX_LASER_POINTS);
        let (laser_points, sensor_points) = match (&self.points, &self.laser_points, &self.sensor_points) {
            (Some(points), None, None) => (lit_at(points)?, None),
            (None, Some(lit), Some(seen)) => (lit_at(lit)?, Some(seen.positions(sensor, ends, MAX_ROW)?)),
            _ => {
                return Err("a scan needs points, at which laser and sensor look together, or both laser-points and sensor-points"
                    .into());
            }
        };
        if laser_points.contains(&laser) || sensor_points.as_ref().unwrap_or(&laser_points).contains(&sensor) {
            return Err("the laser or the sensor stands at one of its points; place it in front of the wall".into());
        }
        let power = self.power.unwrap_or(DEFAULT_POWER);
        if !(power > 0.0 && (power as f32).is_finite()) {
            return Err(format!("the power of the laser is {power} W; it must be above 0"));
        }
        let has_directions = given.into_iter().flatten().any(Points::are_directions);
        if has_directions && self.points.is_some() && laser != sensor {
            return Err("if points are directions, laser and sensor must stand in one place: remove the sensor".into());
        }
        let accounts_first_and_last = self.account_first_and_last_bounces.unwrap_or(has_directions);
        if has_directions && !accounts_first_and_last {
            return Err("directions give no distances, so travel times include the ways to the wall: remove account-first-and-last-bounces"
                .into());
        }
        let angle = |key: &str, degrees: Option<f64>| match degrees.unwrap_or(0.0) {
            degrees if (0.0..=MAX_ANGLE).contains(&degrees) => Ok(degrees.to_radians()),
            degrees => Err(format!("{key} is {degrees} degrees; it must be from 0 to {MAX_ANGLE}")),
        };
        let divergence = angle("divergence", self.divergence)?;
        let pixel_fov = angle("pixel-fov", self.pixel_fov)?;
        let shots = laser_points.len();
        let at_once = match self.points {
            Some(Points::Spinning(Spinning { steps, .. })) => shots / steps as usize,
            _ => 1,
        };
        let mut scan = Scan {
            laser,
            sensor,
            power,
            divergence,
            pixel_fov,
            accounts_first_and_last,
            laser_points,
            sensor_points,
            times: None,
            places: None,
            at_once,
        };
        self.set_times(&mut scan)?;
        scan.check()?;
        Ok(scan)
    }

    /// Sets the times of the shots, and moves a LiDAR along its trajectory.
    fn set_times(&self, scan: &mut Scan) -> Result<(), String> {
        let of_shots = self.points.as_ref().map_or(Ok(None), Points::times)?;
        if of_shots.is_some() && self.duration.is_some() {
            return Err("the file of shots has a time for each of them: remove duration".into());
        }
        let duration = match (self.duration, &of_shots) {
            (Some(Seconds(duration)), _) => duration,
            (None, Some(_)) => 0.0,
            (None, None) if self.trajectory.is_some() || self.begin.is_some() => {
                return Err("a trajectory needs the time of each shot: add duration, such as '100ms' for a turn".into());
            }
            (None, None) => return Ok(()),
        };
        let trajectory = self.trajectory.as_deref().map(Trajectory::read).transpose()?;
        let begin = match (&self.begin, &trajectory) {
            (Some(Seconds(begin)), Some(_)) => *begin,
            (Some(_), None) => return Err("begin is a time of a trajectory: add trajectory, or remove begin".into()),
            (None, trajectory) => trajectory.as_ref().map_or(0.0, |trajectory| trajectory.range()[0]),
        };
        let shots = scan.laser_points.len();
        let steps = (shots / scan.at_once) as f64;
        let evenly = |shot: usize| duration * ((shot / scan.at_once) as f64 / steps);
        let since_begin = of_shots.unwrap_or_else(|| (0..shots).map(evenly).collect());
        let times: Vec<f64> = since_begin.into_iter().map(|time| begin + time).collect();
        if let Some(trajectory) = trajectory {
            let is_lidar = self.points.as_ref().is_some_and(Points::are_directions);
            if !is_lidar {
                return Err("a trajectory moves a LiDAR, whose points are directions: remove trajectory".into());
            }
            let ([first, last], [start, end]) = (trajectory.range(), [times[0], times[shots - 1]]);
            if start < first || end > last {
                return Err(format!(
                    "the shots are from {start} s to {end} s, and the trajectory only from {first} s to {last} s; add poses, or change begin \
                     or duration"
                ));
            }
            let mut places = vec![];
            for (point, &time) in scan.laser_points.iter_mut().zip(&times) {
                let (position, rotation) = trajectory.at(time);
                *point = position + rotation * *point;
                places.push(position + rotation * scan.laser);
            }
            scan.places = Some(places);
        }
        scan.times = Some(times);
        Ok(())
    }
}

impl Scan {
    /// Fails if a camera or a laser of the scan is not valid, so that no scan fails after its first points.
    fn check(&self) -> Result<(), String> {
        let mut points = self.laser_points.iter().chain(self.sensor_points.iter().flatten());
        if let Some(far) = points.find(|point| point.abs().max_element() > MAX_COORDINATE) {
            let [x, y, z] = far.to_array();
            return Err(format!(
                "the point {x:e}, {y:e}, {z:e} is farther than {MAX_COORDINATE:e} m from the origin; check its unit"
            ));
        }
        let all = 0..self.laser_points.len();
        all.clone().try_for_each(|index| self.light(index).check())?;
        let check = |index: usize| self.camera(index).check().map_err(|e| e.to_string());
        if self.sensor_points.is_none() {
            return all.into_iter().try_for_each(check);
        }
        // The sensor looks at the same points for each point of the laser. It omits most for the farthest.
        let distance = |index: usize| self.laser.distance(self.laser_points[index]);
        all.max_by(|&a, &b| distance(a).total_cmp(&distance(b))).map_or(Ok(()), check)
    }

    /// Seed of the render of point `index` of the laser: `seed` at the first point, then a hash of both. Scans with other seeds
    /// therefore share no render with this one.
    pub fn seed(seed: u32, index: usize) -> u32 {
        if index == 0 {
            return seed;
        }
        split_mix::mix((u64::from(seed) << 32 | index as u64).wrapping_add(split_mix::STEP)) as u32
    }

    /// Whether each point of the laser is one beam of a LiDAR: a cone of light, and a sensor in the same place that looks along its axis
    /// and omits no length.
    pub fn lights_what_it_sees(&self) -> bool {
        let is_confocal = self.sensor_points.is_none() && self.laser == self.sensor;
        is_confocal && self.divergence > 0.0 && self.accounts_first_and_last
    }

    /// A camera with one pixel for each of the beams `numbers`, and the seeds of their renders. Beyond the last beam, the last one counts
    /// again.
    pub fn beams(&self, numbers: Range<usize>, seed: u32) -> (Camera, Vec<u32>) {
        let last = self.laser_points.len() - 1;
        let numbers = || numbers.clone().map(|number| number.min(last));
        let points: Vec<DVec3> = numbers().map(|number| self.laser_points[number]).collect();
        let seeds = numbers().map(|number| Scan::seed(seed, number)).collect();
        (aimed(self.sensor_at(numbers().next().unwrap_or(last)), &points, self.pixel_fov, |_| 0.0), seeds)
    }

    /// Radiance in W/(m^2 sr) of a white diffuse target at 1 m that faces a LiDAR, averaged over a pixel, in a gate that contains its
    /// light. It calibrates intensities: another target has its albedo times the cosine of the angle of incidence over the square of the
    /// distance in metres of this radiance. `None` if the laser does not light what the sensor sees.
    pub fn white_target_at_1m(&self) -> Option<f64> {
        if !self.lights_what_it_sees() {
            return None;
        }
        let solid_angle = 4.0 * PI * (0.25 * self.divergence).sin().powi(2);
        let [spot, pixel] = [self.divergence, self.pixel_fov].map(|angle| (0.5 * angle).tan());
        Some(self.power / (PI * solid_angle) * share_in_disc(spot, pixel))
    }

    /// Where the laser is while it looks at its point `index`.
    pub fn laser_at(&self, index: usize) -> DVec3 {
        self.places.as_ref().map_or(self.laser, |places| places[index])
    }

    /// Velocity in m/s of the LiDAR at shot `index`; zero if it stands still.
    pub fn velocity_at(&self, index: usize) -> DVec3 {
        let (Some(places), Some(times)) = (&self.places, &self.times) else { return DVec3::ZERO };
        let last = times.len() - 1;
        let differs = |other: &usize| times[*other] != times[index];
        let (from, to) = match (index..=last).find(differs) {
            Some(later) => (index, later),
            None => ((0..index).rev().find(differs).unwrap_or(index), index),
        };
        let seconds = times[to] - times[from];
        if seconds > 0.0 { (places[to] - places[from]) / seconds } else { DVec3::ZERO }
    }

    /// Where the sensor is while the laser looks at its point `index`.
    fn sensor_at(&self, index: usize) -> DVec3 {
        self.places.as_ref().map_or(self.sensor, |places| places[index])
    }

    /// Number of points at which the sensor looks for each point of the laser.
    pub fn sensor_count(&self) -> usize {
        self.sensor_points.as_ref().map_or(1, Vec::len)
    }

    /// The laser while it looks at its point `index`: a beam without width, or a spot light with its power in the cone.
    pub fn light(&self, index: usize) -> Light {
        Light {
            node: LASER.into(),
            position: self.laser_at(index),
            direction: (self.laser_points[index] - self.laser_at(index)).normalize(),
            kind: match self.divergence > 0.0 {
                false => LightKind::Beam { power: [self.power as f32; 3], radius: 0.0 },
                true => LightKind::cone(self.power, 0.5 * self.divergence),
            },
        }
    }

    /// A camera at `place` that looks at `points`. Nothing is subtracted from the travel times.
    pub fn camera_at(place: DVec3, points: &[DVec3]) -> Camera {
        aimed(place, points, 0.0, |_| 0.0)
    }

    /// The sensor while the laser looks at its point `index`.
    pub fn camera(&self, index: usize) -> Camera {
        let lit = self.laser_points[index];
        let points = self.sensor_points.as_deref().unwrap_or(std::slice::from_ref(&lit));
        let uncounted = |point: DVec3| match self.accounts_first_and_last {
            true => 0.0,
            false => self.laser.distance(lit) + self.sensor.distance(point),
        };
        aimed(self.sensor_at(index), points, self.pixel_fov, uncounted)
    }
}

/// The share of a square with sides of 2 `half` that lies in a disc of this radius with the same centre.
fn share_in_disc(radius: f64, half: f64) -> f64 {
    if half <= radius * std::f64::consts::FRAC_1_SQRT_2 {
        return 1.0;
    }
    // The disc reaches beyond the square in four caps.
    let cap = match half < radius {
        true => radius.powi(2) * (half / radius).acos() - half * (radius.powi(2) - half.powi(2)).sqrt(),
        false => 0.0,
    };
    (PI * radius.powi(2) - 4.0 * cap) / (4.0 * half.powi(2))
}

/// A camera at `place` that looks at `points`. For each point, `uncounted` metres are subtracted from the travel times.
fn aimed(place: DVec3, points: &[DVec3], pixel_fov: f64, uncounted: impl Fn(DVec3) -> f64) -> Camera {
    let aims: Arc<[Aim]> = points.iter().map(|&point| Aim { point, uncounted: uncounted(point) }).collect();
    Camera {
        projection: Projection::Aimed { aims, pixel_fov },
        ..Camera::looking_at(SENSOR, place, points[0], 1.0, [points.len() as u32, 1])
    }
}

// `remote = "Self"` derives inherent functions of these names; the traits add checks and dashes.
impl Serialize for ScanTable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        ScanTable::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for ScanTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<ScanTable, D::Error> {
        let table = ScanTable::deserialize(Dashed(deserializer, |key| key))?;
        // The paths of files are relative to the experiment file until it is read as a whole.
        if table.clone().paths().next().is_none() {
            table.scan().map_err(D::Error::custom)?;
        }
        Ok(table)
    }
}

#[cfg(test)]
mod tests;
