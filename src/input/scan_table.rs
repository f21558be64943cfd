//! `[scan]` of an experiment file: a laser and a sensor that look at points of a wall, or in directions as a LiDAR does.

use std::sync::Arc;

use glam::DVec3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::Result;
use crate::scene::{Aim, Camera, Light, LightKind, Projection};
use crate::settings::MAX_ROW;
use crate::settings::keys::Dashed;
use crate::settings::numbers::Numbers;

/// Name of the camera of a scan.
pub const SENSOR: &str = "scan sensor";
/// Name of the light of a scan.
pub const LASER: &str = "scan laser";

/// Power of the laser in W, if the user gives none.
const DEFAULT_POWER: f64 = 1.0;
/// Maximum divergence and field of view, in degrees.
const MAX_ANGLE: f64 = 90.0;
/// Maximum number of points of the laser, and of the sensor, which have a pixel each in an image of one row.
const MAX_POINTS: usize = MAX_ROW as usize;

/// The keys of `[scan]` that no other table has. `[[light]]` has a power too.
pub const KEYS: [&str; 8] = [
    "laser",
    "sensor",
    "divergence",
    "pixel-fov",
    "account-first-and-last-bounces",
    "points",
    "laser-points",
    "sensor-points",
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
}

/// Points in world space, in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected points, like [[0, 1, 2], [3, 4, 5]], or a grid {corner = [0, 0, 0], across = [1, 0, 0], down = [0, -1, 0], \
                 count = [16, 16]}, or directions {forward = [0, 0, -1], azimuth = [-30, 30], elevation = [-10, 5], count = [60, 15]}"
)]
pub enum Points {
    List(Vec<[f64; 3]>),
    Grid(Grid),
    Directions(Directions),
}

/// Directions of a LiDAR, row by row from the top. Angles are in degrees: azimuth to the right of `forward`, elevation above it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Directions {
    pub forward: [f64; 3],
    pub azimuth: [f64; 2],
    pub elevation: [f64; 2],
    pub count: [u32; 2],
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
            Points::Directions(directions) => Some(directions.count),
        }
    }

    fn are_directions(&self) -> bool {
        matches!(self, Points::Directions(_))
    }

    /// The points. A direction gives the point at 1 m from `place`. Fails with one sentence if there are too few or too many
    /// points, or if a number is not finite or out of range.
    fn positions(&self, place: DVec3) -> Result<Vec<DVec3>, String> {
        let (list, numbers) = match self {
            Points::List(list) => (list.len() as u64, list.clone()),
            Points::Grid(grid) => (1, vec![grid.corner, grid.across, grid.down]),
            Points::Directions(directions) => (1, directions.numbers()?),
        };
        let count = self.grid().map_or(list, |[columns, rows]| u64::from(columns) * u64::from(rows));
        if !(1..=MAX_POINTS as u64).contains(&count) {
            return Err(format!("these are {count} points; a scan has 1 to {MAX_POINTS}"));
        }
        if !numbers.iter().flatten().all(|x| x.is_finite()) {
            return Err("the coordinates of the points must be finite".into());
        }
        Ok(match self {
            Points::List(list) => list.iter().map(|&point| point.into()).collect(),
            Points::Grid(grid) => grid.centres(),
            Points::Directions(directions) => directions.around(place),
        })
    }
}

impl Grid {
    fn centres(&self) -> Vec<DVec3> {
        let [corner, across, down] = [self.corner, self.across, self.down].map(DVec3::from);
        centres(self.count).map(|[x, y]| corner + x * across + y * down).collect()
    }
}

impl Directions {
    /// The numbers that must be finite: those of `forward`. Fails if an angle is out of range or if `forward` is zero or vertical.
    fn numbers(&self) -> Result<Vec<[f64; 3]>, String> {
        let [a0, a1] = self.azimuth;
        let [e0, e1] = self.elevation;
        if !(-180.0..=180.0).contains(&a0) || !(a0..=180.0).contains(&a1) {
            return Err(format!("the azimuth goes from {a0} to {a1}; it must rise, from -180 to 180 degrees at most"));
        }
        if !(-90.0..=90.0).contains(&e0) || !(e0..=90.0).contains(&e1) {
            return Err(format!("the elevation goes from {e0} to {e1}; it must rise, from -90 to 90 degrees at most"));
        }
        let forward = DVec3::from(self.forward);
        if !(forward.is_finite() && forward.cross(DVec3::Y).length() > 1e-6 * forward.length()) {
            return Err("forward must be a direction that is not vertical, like [0, 0, -1]".into());
        }
        Ok(vec![self.forward])
    }

    /// The points in these directions at 1 m from `place`.
    fn around(&self, place: DVec3) -> Vec<DVec3> {
        let forward = DVec3::from(self.forward).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let between = |[low, high]: [f64; 2], part: f64| (low + part * (high - low)).to_radians();
        let direction = |[x, y]: [f64; 2]| {
            let (azimuth, elevation) = (between(self.azimuth, x), between(self.elevation, 1.0 - y));
            let level = azimuth.cos() * forward + azimuth.sin() * right;
            elevation.cos() * level + elevation.sin() * up
        };
        centres(self.count).map(|cell| place + direction(cell)).collect()
    }
}

/// Centres of the cells of the unit square, row by row.
fn centres([columns, rows]: [u32; 2]) -> impl Iterator<Item = [f64; 2]> {
    let part = |i: u32, of: u32| (f64::from(i) + 0.5) / f64::from(of);
    (0..rows).flat_map(move |row| (0..columns).map(move |column| [part(column, columns), part(row, rows)]))
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
}

impl ScanTable {
    /// Fails with one sentence if keys exclude each other, or if a number is out of range.
    pub fn scan(&self) -> Result<Scan, String> {
        let laser = DVec3::from(self.laser.0);
        let sensor = self.sensor.map_or(laser, |sensor| sensor.0.into());
        let (laser_points, sensor_points) = match (&self.points, &self.laser_points, &self.sensor_points) {
            (Some(points), None, None) => (points.positions(laser)?, None),
            (None, Some(lit), Some(seen)) => (lit.positions(laser)?, Some(seen.positions(sensor)?)),
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
        let given = [&self.points, &self.laser_points, &self.sensor_points];
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
        let scan =
            Scan { laser, sensor, power, divergence, pixel_fov, accounts_first_and_last, laser_points, sensor_points };
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

    /// The laser while it looks at its point `index`: a beam without width, or a spot light with its power in the cone.
    pub fn light(&self, index: usize) -> Light {
        Light {
            node: LASER.into(),
            position: self.laser,
            direction: (self.laser_points[index] - self.laser).normalize(),
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
        let omitted = |point: DVec3| match self.accounts_first_and_last {
            true => 0.0,
            false => self.laser.distance(lit) + self.sensor.distance(point),
        };
        aimed(self.sensor, points, self.pixel_fov, omitted)
    }
}

/// A camera at `place` that looks at `points`. For each point, `omitted` metres are subtracted from the travel times.
fn aimed(place: DVec3, points: &[DVec3], pixel_fov: f64, omitted: impl Fn(DVec3) -> f64) -> Camera {
    let aims: Arc<[Aim]> = points.iter().map(|&point| Aim { point, omitted: omitted(point) }).collect();
    Camera {
        projection: Projection::Aimed { aims, pixel_fov },
        ..Camera::looking_at(SENSOR, place, points[0], 1.0, [points.len() as u32, 1])
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
    use std::f64::consts::PI;

    use super::*;
    use crate::input::experiment::Experiment;

    fn parse(keys: &str) -> Result<Scan, String> {
        let experiment = Experiment::parse(&format!("[scan]\n{keys}")).map_err(|e| e.to_string())?;
        assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
        experiment.scan.unwrap().scan()
    }

    /// The message about an unknown key lists all keys of the table.
    #[test]
    fn keys_are_those_of_the_table_without_the_power() {
        let message = parse("no-such-key = 1").unwrap_err();
        let (_, keys) = message.split_once("choose one of ").unwrap();
        assert_eq!(keys.split(", ").filter(|key| *key != "power").collect::<Vec<_>>(), KEYS);
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

    fn directions(forward: &str, azimuth: &str) -> String {
        format!("points = {{forward = {forward}, azimuth = {azimuth}, elevation = [-10, 20], count = [2, 3]}}")
    }

    #[test]
    fn directions_run_from_the_left_and_from_the_top() {
        let keys = directions("[0, 0, -2]", "[-20, 60]");
        let scan = parse(&format!("laser = [1, 2, 3]\ndivergence = 0.2\npixel-fov = 0.1\n{keys}")).unwrap();
        assert!(scan.accounts_first_and_last && scan.laser_points.len() == 6);
        let direction = |index: usize| scan.laser_points[index] - DVec3::new(1.0, 2.0, 3.0);
        let wanted = |azimuth: f64, elevation: f64| {
            let [a, e] = [azimuth, elevation].map(f64::to_radians);
            DVec3::new(a.sin() * e.cos(), e.sin(), -a.cos() * e.cos())
        };
        for (index, azimuth, elevation) in [(0, 0.0, 15.0), (1, 40.0, 15.0), (2, 0.0, 5.0), (5, 40.0, -5.0)] {
            assert!(direction(index).distance(wanted(azimuth, elevation)) < 1e-12, "{index}");
        }
        // All of the power, 1 W, is in the cone.
        let LightKind::Spot { intensity, inner, outer } = scan.light(0).kind else { panic!("a cone is a spot light") };
        let cap = |half: f32| 4.0 * PI * (0.5 * f64::from(half)).sin().powi(2);
        // The integral of the falloff, the square of a ramp, is a third of the solid angle between the cones.
        let power = f64::from(intensity[0]) * (cap(inner) + (cap(outer) - cap(inner)) / 3.0);
        assert!((power - 1.0).abs() < 1e-6, "{power}");
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
            ("points = [[0, 0, 0]]\ndivergence = 100".into(), "from 0 to 90"),
            ("points = [[0, 0, 0]]\npixel_fov = -1".into(), "from 0 to 90"),
            (directions("[0, 0, -1]", "[30, -30]"), "must rise"),
            (directions("[0, 1, 0]", "[-30, 30]"), "not vertical"),
            (format!("sensor = [0, 0, 4]\n{}", directions("[0, 0, -1]", "[-30, 30]")), "in one place"),
            (
                format!("account-first-and-last-bounces = false\n{}", directions("[0, 0, -1]", "[-30, 30]")),
                "directions give no distances",
            ),
        ];
        for (keys, part) in table {
            let message = parse(&format!("laser = [0, 0, 5]\n{keys}")).expect_err(&keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
