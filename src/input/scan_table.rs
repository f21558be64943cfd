//! `[scan]` of an experiment file: a laser and a sensor that look at points of a wall, or in directions as a LiDAR does.

mod points;

use std::ops::Range;
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
pub use points::{Directions, Ends, Grid, Points};

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
pub const KEYS: [&str; 9] = [
    "laser",
    "sensor",
    "divergence",
    "pixel-fov",
    "account-first-and-last-bounces",
    "points",
    "laser-points",
    "sensor-points",
    "ends",
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
        let given = [&self.points, &self.laser_points, &self.sensor_points];
        if self.ends.is_some() && given.into_iter().flatten().all(|points| points.grid().is_none()) {
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
        let scan =
            Scan { laser, sensor, power, divergence, pixel_fov, accounts_first_and_last, laser_points, sensor_points };
        scan.check()?;
        Ok(scan)
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
        (aimed(self.sensor, &points, self.pixel_fov, |_| 0.0), seeds)
    }

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
        let uncounted = |point: DVec3| match self.accounts_first_and_last {
            true => 0.0,
            false => self.laser.distance(lit) + self.sensor.distance(point),
        };
        aimed(self.sensor, points, self.pixel_fov, uncounted)
    }
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
    fn scans_with_other_seeds_share_no_render() {
        assert_eq!([Scan::seed(7, 0), Scan::seed(8, 0)], [7, 8]);
        let mut seeds: Vec<u32> = (0..20).flat_map(|seed| (0..500).map(move |index| Scan::seed(seed, index))).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 20 * 500);
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
        assert_eq!(aims[0].uncounted, 25.25f64.sqrt() + 16.25f64.sqrt());
    }

    #[test]
    fn all_points_of_the_sensor_belong_to_each_point_of_the_laser() {
        let keys = "laser = [0, 0, 5]\npower = 2\naccount_first_and_last_bounces = true\n\
                    laser_points = [[0, 0, 0], [0, 3, 0]]\nsensor-points = [[1, 0, 0], [2, 0, 0], [3, 0, 0]]";
        let scan = parse(keys).unwrap();
        assert_eq!((scan.laser_points.len(), scan.sensor_count(), scan.sensor), (2, 3, DVec3::new(0.0, 0.0, 5.0)));
        let (camera, light) = (scan.camera(1), scan.light(0));
        assert!(camera.projection.aims().unwrap().iter().all(|aim| aim.uncounted == 0.0));
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

    /// The 16 rows of a LiDAR whose data sheet says "-15 to 15 degrees, every 2 degrees", and its turn that begins straight ahead.
    #[test]
    fn ends_are_included_or_rows_are_the_centres_of_cells() {
        let angles = |keys: &str| {
            let points = "points = {forward = [0, 0, -1], azimuth = [0, 360], elevation = [-15, 15], count = [4, 16]}";
            let scan = parse(&format!("laser = [0, 0, 0]\n{keys}\n{points}")).unwrap();
            let of = |p: &DVec3| [p.x.atan2(-p.z).rem_euclid(2.0 * PI), p.y.asin()].map(f64::to_degrees);
            scan.laser_points.iter().map(of).collect::<Vec<_>>()
        };
        let close = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        let included = angles("ends = 'included'");
        for (row, elevation) in (0..16).zip((0..16).map(|row| 15.0 - 2.0 * f64::from(row))) {
            for (column, azimuth) in [0.0, 90.0, 180.0, 270.0].into_iter().enumerate() {
                let [a, e] = included[row * 4 + column];
                close(a, azimuth);
                close(e, elevation);
            }
        }
        for keys in ["", "ends = 'centres'"] {
            let centres = angles(keys);
            close(centres[0][1], 14.0625);
            close(centres[0][0], 45.0);
            close(centres[63][1], -14.0625);
        }
        // A part of a turn has both ends, and the points of a wall have its corners. A single row is in the middle.
        let keys = |points: &str| format!("laser = [0, 0, 5]\nends = 'included'\npoints = {points}");
        let half = "{forward = [0, 0, -1], azimuth = [0, 90], elevation = [-10, 10], count = [2, 1]}";
        let scan = parse(&keys(half)).unwrap();
        assert!(scan.laser_points[0].distance(DVec3::new(0.0, 0.0, 4.0)) < 1e-12);
        assert!(scan.laser_points[1].distance(DVec3::new(1.0, 0.0, 5.0)) < 1e-12);
        let wall = "{corner = [-1, 1, 0], across = [2, 0, 0], down = [0, -2, 0], count = [3, 2]}";
        let scan = parse(&keys(wall)).unwrap();
        assert_eq!(scan.laser_points[0], DVec3::new(-1.0, 1.0, 0.0));
        assert_eq!(scan.laser_points[5], DVec3::new(1.0, -1.0, 0.0));
        let message = parse(&keys("[[0, 0, 0]]")).unwrap_err();
        assert!(message.contains("ends is for grids and directions"), "{message}");
        assert!(parse(&keys(half).replace("included", "middle")).is_err());
    }

    #[test]
    fn a_scan_has_a_million_beams() {
        let turn = |rows: u32| {
            format!(
                "laser = [0, 0, 5]\npoints = {{forward = [0, 0, -1], azimuth = [0, 360], elevation = [-9, 9], count = [8192, {rows}]}}"
            )
        };
        assert_eq!(parse(&turn(128)).unwrap().laser_points.len(), 1 << 20);
        let message = parse(&turn(129)).unwrap_err();
        assert!(message.contains("a scan has 1 to 1048576"), "{message}");
        // The sensor of an exhaustive scan has an image of one row.
        let many = turn(8).replace("\npoints", "\nlaser-points = [[0, 0, 0]]\nsensor-points");
        let message = parse(&many).unwrap_err();
        assert!(message.contains("a scan has 1 to 65535"), "{message}");
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
            (
                "points = [[0, 0, 0], [0, 1e16, 0]]".into(),
                "the point 0e0, 1e16, 0e0 is farther than 1e15 m from the origin",
            ),
            ("points = [[0, 0, 0], [0, 9e14, 0]]".into(), "camera 'scan sensor' aims"),
            (
                "laser-points = [[0, 0, 0], [0, 9e14, 0]]\nsensor-points = [[0, 0, 1], [0, 8e14, 0]]".into(),
                "scan sensor",
            ),
            ("point = [[0, 0, 0]]".into(), "no key point"),
            ("points = [[0, 0, 0]]\ndivergence = 100".into(), "from 0 to 90"),
            ("points = [[0, 0, 0]]\npixel_fov = -1".into(), "from 0 to 90"),
            (directions("[0, 0, -1]", "[30, -30]"), "must rise"),
            (directions("[0, 0, -1]", "[-180, 181]"), "by a full turn at most"),
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
