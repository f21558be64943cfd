//! `[scan]` of an experiment file: a laser and a sensor that look at points of a wall.

use std::sync::Arc;

use glam::DVec3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::{Error, Result};
use crate::scene::{Aim, Camera, Light, LightKind, Projection};
use crate::settings::keys::Dashed;
use crate::settings::numbers::Numbers;

/// Name of the camera of a scan.
pub const SENSOR: &str = "scan sensor";
/// Name of the light of a scan.
pub const LASER: &str = "scan laser";

/// Power of the laser in W, if the user gives none.
const DEFAULT_POWER: f64 = 1.0;
/// Maximum number of points of the laser, and of the sensor.
const MAX_POINTS: usize = 65_535;

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
    /// Whether travel times contain the way from the laser to its point, and the way from the point of the sensor to the sensor.
    pub account_first_and_last_bounces: Option<bool>,
    /// The points of a confocal scan: laser and sensor look at the same point, one point after the other.
    pub points: Option<Points>,
    /// The points of an exhaustive scan: for each point of the laser, the sensor looks at all of its points.
    pub laser_points: Option<Points>,
    pub sensor_points: Option<Points>,
}

/// Points in world space, in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected points, like [[0, 1, 2], [3, 4, 5]], or a grid {corner = [0, 0, 0], across = [1, 0, 0], down = [0, -1, 0], \
                 count = [16, 16]}"
)]
pub enum Points {
    List(Vec<[f64; 3]>),
    Grid(Grid),
}

/// The centres of the cells of a parallelogram, row by row: `count[0]` cells along `across`, then the next row along `down`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    pub corner: [f64; 3],
    pub across: [f64; 3],
    pub down: [f64; 3],
    pub count: [u32; 2],
}

impl Points {
    /// Columns and rows of a grid.
    pub fn grid(&self) -> Option<[u32; 2]> {
        match self {
            Points::List(_) => None,
            Points::Grid(grid) => Some(grid.count),
        }
    }

    /// Fails with one sentence if there are too few or too many points, or if a coordinate is not finite.
    fn positions(&self) -> Result<Vec<DVec3>, String> {
        let (count, numbers) = match self {
            Points::List(list) => (list.len() as u64, list.clone()),
            Points::Grid(grid) => {
                (u64::from(grid.count[0]) * u64::from(grid.count[1]), vec![grid.corner, grid.across, grid.down])
            }
        };
        if !(1..=MAX_POINTS as u64).contains(&count) {
            return Err(format!("these are {count} points; a scan has 1 to {MAX_POINTS}"));
        }
        if !numbers.iter().flatten().all(|x| x.is_finite()) {
            return Err("the coordinates of the points must be finite".into());
        }
        Ok(match self {
            Points::List(list) => list.iter().map(|&point| point.into()).collect(),
            Points::Grid(grid) => grid.centres(),
        })
    }
}

impl Grid {
    fn centres(&self) -> Vec<DVec3> {
        let [corner, across, down] = [self.corner, self.across, self.down].map(DVec3::from);
        let [columns, rows] = self.count;
        let part = |i: u32, of: u32| (f64::from(i) + 0.5) / f64::from(of);
        let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        cells.map(|(column, row)| corner + part(column, columns) * across + part(row, rows) * down).collect()
    }
}

/// A scan: the renders that it consists of. Each has one point of the laser.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    pub laser: DVec3,
    pub sensor: DVec3,
    power: f64,
    pub accounts_first_and_last: bool,
    pub laser_points: Vec<DVec3>,
    /// `None` if each point of the laser is also the only point of the sensor.
    pub sensor_points: Option<Vec<DVec3>>,
}

impl ScanTable {
    /// Fails with one sentence if keys exclude each other, or if a number is out of range.
    pub fn scan(&self) -> Result<Scan, String> {
        let laser = DVec3::from(self.laser.0);
        let sensor = self.sensor.map_or(laser, |sensor| sensor.0.into());
        let (laser_points, sensor_points) = match (&self.points, &self.laser_points, &self.sensor_points) {
            (Some(points), None, None) => (points.positions()?, None),
            (None, Some(laser), Some(sensor)) => (laser.positions()?, Some(sensor.positions()?)),
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
        let accounts_first_and_last = self.account_first_and_last_bounces.unwrap_or(false);
        let scan = Scan { laser, sensor, power, accounts_first_and_last, laser_points, sensor_points };
        scan.light(0).check()?;
        scan.camera(0).check().map_err(|e| e.to_string())?;
        Ok(scan)
    }
}

impl Scan {
    /// Number of points at which the sensor looks for each point of the laser.
    pub fn sensor_count(&self) -> usize {
        self.sensor_points.as_ref().map_or(1, Vec::len)
    }

    /// The laser while it looks at its point `index`: a beam without width.
    pub fn light(&self, index: usize) -> Light {
        Light {
            node: LASER.into(),
            position: self.laser,
            direction: (self.laser_points[index] - self.laser).normalize(),
            kind: LightKind::Beam { power: [self.power as f32; 3], radius: 0.0 },
        }
    }

    /// A camera at `place` that looks at `points`; all of their travel times count.
    pub fn camera_at(place: DVec3, points: &[DVec3]) -> Camera {
        aimed(place, points, |_| 0.0)
    }

    /// The sensor while the laser looks at its point `index`.
    pub fn camera(&self, index: usize) -> Camera {
        let lit = self.laser_points[index];
        let points = self.sensor_points.as_deref().unwrap_or(std::slice::from_ref(&lit));
        let omitted = |point: DVec3| match self.accounts_first_and_last {
            true => 0.0,
            false => self.laser.distance(lit) + self.sensor.distance(point),
        };
        aimed(self.sensor, points, omitted)
    }
}

/// A camera at `place` that looks at `points`, of whose travel times `omitted` metres do not count.
fn aimed(place: DVec3, points: &[DVec3], omitted: impl Fn(DVec3) -> f64) -> Camera {
    let aims: Arc<[Aim]> = points.iter().map(|&point| Aim { point, omitted: omitted(point) }).collect();
    Camera {
        projection: Projection::Aimed(aims),
        ..Camera::looking_at(SENSOR, place, points[0], 1.0, [points.len() as u32, 1])
    }
}

impl ScanTable {
    /// Fails if the experiment has settings of other renders: a camera, lights, or files that a scan does not write.
    pub fn check_experiment(experiment: &super::experiment::Experiment) -> Result<()> {
        let output = &experiment.output;
        let has_lights = !experiment.light.is_empty() || experiment.emitter != Default::default();
        let given = [
            ("a camera", experiment.camera != Default::default(), "the sensor of [scan] is the camera"),
            ("lights", has_lights, "the laser of [scan] is the only light"),
            ("--frames", output.frames.is_some(), "render the scans of a sequence one by one, with --at"),
            ("--gate-keys", experiment.gate.gate_keys.is_some(), "give it gates with --gates"),
            ("--aov", output.aov.is_some(), "a scan has no image"),
            ("--png", output.png.is_some(), "a scan has no image"),
            ("--stats", output.stats.is_some(), "a scan has no statistics"),
            ("--strategy-images", output.strategy_images.is_some(), "a scan has no image"),
        ];
        match given.iter().find(|(_, is_given, _)| *is_given) {
            Some((what, _, why)) => Err(Error::Settings(format!("a scan cannot have {what}: {why}"))),
            None => Ok(()),
        }
    }
}

impl Serialize for ScanTable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        ScanTable::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for ScanTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<ScanTable, D::Error> {
        let table = ScanTable::deserialize(Dashed(deserializer))?;
        table.scan().map_err(D::Error::custom)?;
        Ok(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    fn parse(keys: &str) -> Result<Scan, String> {
        let experiment = Experiment::parse(&format!("[scan]\n{keys}")).map_err(|e| e.to_string())?;
        assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
        experiment.scan.unwrap().scan()
    }

    #[test]
    fn a_grid_has_its_points_row_by_row() {
        let scan = parse(
            "laser = [0, 0, 5]\nsensor = '0,0,4'\npoints = {corner = [-1, 1, 0], across = [2, 0, 0], down = [0, -2, 0], count = [2, 1]}",
        )
        .unwrap();
        assert_eq!(scan.laser_points, [DVec3::new(-0.5, 0.0, 0.0), DVec3::new(0.5, 0.0, 0.0)]);
        assert_eq!((scan.sensor_points.clone(), scan.sensor_count()), (None, 1));
        let camera = scan.camera(1);
        let aims = camera.projection.aims().unwrap();
        assert_eq!((aims.len(), aims[0].point), (1, DVec3::new(0.5, 0.0, 0.0)));
        assert_eq!(aims[0].omitted, 25.25f64.sqrt() + 16.25f64.sqrt());
    }

    #[test]
    fn all_points_of_the_sensor_belong_to_each_point_of_the_laser() {
        let keys = "laser = [0, 0, 5]\npower = 2\naccount_first_and_last_bounces = true\n\
                    laser_points = [[0, 0, 0], [0, 3, 0]]\nsensor-points = [[1, 0, 0], [2, 0, 0], [3, 0, 0]]";
        let scan = parse(keys).unwrap();
        assert_eq!((scan.laser_points.len(), scan.sensor_count(), scan.sensor), (2, 3, DVec3::new(0.0, 0.0, 5.0)));
        let (camera, light) = (scan.camera(1), scan.light(0));
        assert!(camera.projection.aims().unwrap().iter().all(|aim| aim.omitted == 0.0));
        assert_eq!((light.direction, light.kind), (DVec3::NEG_Z, LightKind::Beam { power: [2.0; 3], radius: 0.0 }));
    }

    #[test]
    fn mistakes_name_the_remedy() {
        let grid = |count: &str| {
            format!("points = {{corner = [0, 0, 0], across = [1, 0, 0], down = [0, 1, 0], count = {count}}}")
        };
        let table = [
            (String::new(), "needs points"),
            ("laser_points = [[0, 0, 0]]".into(), "needs points"),
            ("points = []".into(), "0 points"),
            ("points = [[0, 0]]".into(), "points must be points, like"),
            ("points = [[0, 0, nan]]".into(), "finite"),
            ("points = [[0, 0, 5]]".into(), "in front of the wall"),
            (grid("[0, 4]"), "0 points"),
            (grid("[4000, 4000]"), "16000000 points"),
            (grid("[4]"), "points must be points, like"),
            ("points = [[0, 0, 0]]\npower = -1".into(), "above 0"),
            ("points = [[0, 0, 1e99]]".into(), "from the origin"),
            ("point = [[0, 0, 0]]".into(), "no key point"),
        ];
        for (keys, part) in table {
            let message = parse(&format!("laser = [0, 0, 5]\n{keys}")).expect_err(&keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
