//! The points at which a scan looks: a list, a grid or directions.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::input::rows;

/// Which positions the points of a grid have, and the directions of a LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ends {
    /// The range is divided into cells, and the points are their centres.
    #[default]
    Centres,
    /// The first and the last point lie at the ends of the range. A full turn has its first end only, because the last one is the same
    /// direction. A single point lies in the middle.
    Included,
}

/// A full turn in degrees.
const TURN: f64 = 360.0;

/// Points in world space, in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected points, like [[0, 1, 2], [3, 4, 5]], or a grid {corner = [0, 0, 0], across = [1, 0, 0], down = [0, -1, 0], \
                 count = [16, 16]}, or directions {forward = [0, 0, -1], azimuth = [-30, 30], elevation = [-10, 5], count = [60, 15]}, \
                 {channels = 'channels.csv', forward = [0, 0, -1], azimuth = [0, 360], steps = 1800}, \
                 {shots = 'shots.csv', forward = [0, 0, -1]} or {wedges = [12, 12], index = 1.5, turns = [20, -13], forward = [0, 0, -1], \
                 shots = 10000}"
)]
pub enum Points {
    List(Vec<[f64; 3]>),
    Grid(Grid),
    Directions(Directions),
    Spinning(Spinning),
    Shots(Shots),
    Risley(Risley),
}

/// Directions of a LiDAR, row by row from the top. Angles are in degrees: azimuth to the right of `forward`, elevation above it.
/// See [`Ends`] for the first and the last one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Directions {
    pub forward: [f64; 3],
    pub azimuth: [f64; 2],
    pub elevation: [f64; 2],
    pub count: [u32; 2],
}

/// Directions of a LiDAR that spins: at each step of the azimuth, all channels fire at once. Angles as in [`Directions`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spinning {
    /// A CSV file with a channel per row: its elevation, and how far its azimuth is ahead of the step, both in degrees.
    pub channels: PathBuf,
    pub forward: [f64; 3],
    pub azimuth: [f64; 2],
    pub steps: u32,
}

/// Directions of a LiDAR from a file. Angles as in [`Directions`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shots {
    /// A CSV file with a shot per row: its time in seconds, azimuth and elevation in degrees. Times do not fall.
    pub shots: PathBuf,
    pub forward: [f64; 3],
}

/// Directions of a LiDAR whose beam passes two rotating prisms (Risley). At first, both prisms turn the beam to the right.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Risley {
    /// Angle in degrees between the faces of each prism. The beam enters through the face that is perpendicular to `forward`.
    pub wedges: [f64; 2],
    /// Index of refraction of the prisms.
    pub index: f64,
    /// How many times each prism turns during the scan, counterclockwise as the LiDAR looks; negative for the other way.
    pub turns: [f64; 2],
    pub forward: [f64; 3],
    pub shots: u32,
}

/// Points of a parallelogram, row by row: `count[0]` points along `across`, then the next row along `down`. By default they are the
/// centres of cells, see [`Ends`].
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
            Points::List(_) | Points::Spinning(_) | Points::Shots(_) | Points::Risley(_) => None,
            Points::Grid(grid) => Some(grid.count),
            Points::Directions(directions) => Some(directions.count),
        }
    }

    pub(super) fn are_directions(&self) -> bool {
        !matches!(self, Points::List(_) | Points::Grid(_))
    }

    /// Whether the places of points within a range are chosen by [`Ends`].
    pub(super) fn have_ends(&self) -> bool {
        !matches!(self, Points::List(_) | Points::Shots(_) | Points::Risley(_))
    }

    /// The file that the points name.
    pub(super) fn path(&mut self) -> Option<&mut PathBuf> {
        match self {
            Points::Spinning(spinning) => Some(&mut spinning.channels),
            Points::Shots(list) => Some(&mut list.shots),
            _ => None,
        }
    }

    /// The time of each shot in seconds, if the points say it. Fails as [`Points::positions`].
    pub(super) fn times(&self) -> Result<Option<Vec<f64>>, String> {
        match self {
            Points::Shots(list) => Ok(Some(list.read()?.into_iter().map(|[time, ..]| time).collect())),
            _ => Ok(None),
        }
    }

    /// The points. A direction gives the point at 1 m from `place`. Fails with one sentence if there are none or more than `max`
    /// points, if a number is not finite or out of range, or if the file of channels cannot be read.
    pub(super) fn positions(&self, place: DVec3, ends: Ends, max: u32) -> Result<Vec<DVec3>, String> {
        let (mut channels, mut shots) = (vec![], vec![]);
        match self {
            Points::Spinning(spinning) => channels = read_channels(&spinning.channels)?,
            Points::Shots(list) => shots = list.read()?,
            _ => {}
        }
        let product = |[columns, rows]: [u32; 2]| u64::from(columns) * u64::from(rows);
        let (count, numbers) = match self {
            Points::List(list) => (list.len() as u64, list.clone()),
            Points::Grid(grid) => (product(grid.count), vec![grid.corner, grid.across, grid.down]),
            Points::Directions(directions) => (product(directions.count), directions.numbers()?),
            Points::Spinning(spinning) => {
                check_azimuth(spinning.azimuth)?;
                check_forward(spinning.forward)?;
                (u64::from(spinning.steps) * channels.len() as u64, vec![spinning.forward])
            }
            Points::Shots(list) => {
                check_forward(list.forward)?;
                (shots.len() as u64, vec![list.forward])
            }
            Points::Risley(risley) => {
                risley.check()?;
                (risley.shots.into(), vec![risley.forward])
            }
        };
        if !(1..=u64::from(max)).contains(&count) {
            return Err(format!("these are {count} points; here a scan has 1 to {max}"));
        }
        if !numbers.iter().flatten().all(|x| x.is_finite()) {
            return Err("the coordinates of the points must be finite".into());
        }
        Ok(match self {
            Points::List(list) => list.iter().map(|&point| point.into()).collect(),
            Points::Grid(grid) => grid.points(ends),
            Points::Directions(directions) => directions.around(place, ends),
            Points::Spinning(spinning) => spinning.around(place, ends, &channels),
            Points::Shots(list) => {
                let axes = Axes::new(list.forward);
                shots.iter().map(|&[_, azimuth, elevation]| place + axes.direction(azimuth, elevation)).collect()
            }
            Points::Risley(risley) => risley.around(place),
        })
    }
}

/// Elevation and azimuth offset in degrees of each channel of a LiDAR.
fn read_channels(path: &Path) -> Result<Vec<[f64; 2]>, String> {
    let row = "the elevation and the azimuth offset of a channel in degrees";
    let channels = rows::read(path, ["elevation", "azimuth"], row, "-15,1.4")?;
    let wrong =
        |[elevation, offset]: &[f64; 2]| !((-90.0..=90.0).contains(elevation) && (-TURN..=TURN).contains(offset));
    match channels.iter().position(wrong) {
        None => Ok(channels),
        Some(k) => Err(format!(
            "{}: channel {} has the elevation {} and the azimuth offset {}; elevations are from -90 to 90 degrees, offsets from -360 to 360",
            path.display(),
            k + 1,
            channels[k][0],
            channels[k][1]
        )),
    }
}

fn check_azimuth([a0, a1]: [f64; 2]) -> Result<(), String> {
    match (-360.0..=360.0).contains(&a0) && (a0..=360.0f64.min(a0 + TURN)).contains(&a1) {
        true => Ok(()),
        false => Err(format!(
            "the azimuth goes from {a0} to {a1}; it must rise by a full turn at most, between -360 and 360 degrees"
        )),
    }
}

fn check_forward(forward: [f64; 3]) -> Result<(), String> {
    let forward = DVec3::from(forward);
    match forward.is_finite() && forward.cross(DVec3::Y).length() > 1e-6 * forward.length() {
        true => Ok(()),
        false => Err("forward must be a direction that is not vertical, like [0, 0, -1]".into()),
    }
}

/// The axes of a LiDAR that faces `forward`.
struct Axes {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
}

impl Axes {
    fn new(forward: [f64; 3]) -> Axes {
        let forward = DVec3::from(forward).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        Axes { forward, right, up: right.cross(forward) }
    }

    /// The unit direction with these angles in degrees.
    fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        let level = azimuth.cos() * self.forward + azimuth.sin() * self.right;
        elevation.cos() * level + elevation.sin() * self.up
    }
}

impl Grid {
    fn points(&self, ends: Ends) -> Vec<DVec3> {
        let [corner, across, down] = [self.corner, self.across, self.down].map(DVec3::from);
        let [columns, rows] = self.count.map(|count| ends.parts(count));
        row_by_row(&columns, &rows).map(|[x, y]| corner + x * across + y * down).collect()
    }
}

impl Directions {
    /// The numbers that must be finite: those of `forward`. Fails if an angle is out of range or if `forward` is zero or vertical.
    fn numbers(&self) -> Result<Vec<[f64; 3]>, String> {
        check_azimuth(self.azimuth)?;
        let [e0, e1] = self.elevation;
        if !(-90.0..=90.0).contains(&e0) || !(e0..=90.0).contains(&e1) {
            return Err(format!("the elevation goes from {e0} to {e1}; it must rise, from -90 to 90 degrees at most"));
        }
        check_forward(self.forward)?;
        Ok(vec![self.forward])
    }

    /// The points in these directions at 1 m from `place`.
    fn around(&self, place: DVec3, ends: Ends) -> Vec<DVec3> {
        let axes = Axes::new(self.forward);
        let between = |[low, high]: [f64; 2], part: f64| low + part * (high - low);
        let columns = ends.steps(self.azimuth, self.count[0]);
        let point =
            |[x, y]: [f64; 2]| place + axes.direction(between(self.azimuth, x), between(self.elevation, 1.0 - y));
        row_by_row(&columns, &ends.parts(self.count[1])).map(point).collect()
    }
}

impl Spinning {
    /// The points in these directions at 1 m from `place`: all channels of a step, then those of the next one.
    fn around(&self, place: DVec3, ends: Ends, channels: &[[f64; 2]]) -> Vec<DVec3> {
        let axes = Axes::new(self.forward);
        let [a0, a1] = self.azimuth;
        let steps = ends.steps(self.azimuth, self.steps).into_iter().map(|part| a0 + part * (a1 - a0));
        let channel = |azimuth: f64| {
            let axes = &axes;
            channels.iter().map(move |[elevation, offset]| place + axes.direction(azimuth + offset, *elevation))
        };
        steps.flat_map(channel).collect()
    }
}

impl Shots {
    /// The rows of the file: time, azimuth and elevation.
    fn read(&self) -> Result<Vec<[f64; 3]>, String> {
        let rows = rows::read(
            &self.shots,
            ["time", "azimuth", "elevation"],
            "the time in seconds, azimuth and elevation in degrees of a shot",
            "0.00001,30,-5",
        )?;
        let fail = |k: usize, what: &str| Err(format!("{}: shot {} {what}", self.shots.display(), k + 1));
        for (k, &[time, azimuth, elevation]) in rows.iter().enumerate() {
            if !(time.is_finite() && azimuth.is_finite() && (-90.0..=90.0).contains(&elevation)) {
                return fail(
                    k,
                    "has an elevation outside of -90 to 90 degrees, or a number that is not finite; correct the row",
                );
            }
            if k > 0 && rows[k - 1][0] > time {
                return fail(k, "is earlier than the one before; sort the shots by time");
            }
        }
        Ok(rows)
    }
}

impl Risley {
    /// Fails if the prisms are not prisms, or if the beam does not pass them.
    fn check(&self) -> Result<(), String> {
        check_forward(self.forward)?;
        if !(1.0..=4.0).contains(&self.index) || !self.wedges.iter().all(|wedge| (-45.0..=45.0).contains(wedge)) {
            return Err("the wedges of prisms are from -45 to 45 degrees, and their index from 1 to 4".into());
        }
        if !self.turns.iter().all(|turns| turns.is_finite()) {
            return Err("the turns of the prisms must be finite".into());
        }
        // The beam is turned most while both prisms turn it to the same side, or to opposite ones.
        match [0.0, PI].iter().all(|&other| self.through([0.0, other]).is_some()) {
            true => Ok(()),
            false => Err("the prisms reflect the beam totally; choose smaller wedges".into()),
        }
    }

    /// The direction of the beam behind the prisms, which are turned by these angles. Its components point to the right, up and forward.
    fn through(&self, turned: [f64; 2]) -> Option<DVec3> {
        let mut beam = DVec3::Z;
        for (wedge, angle) in self.wedges.into_iter().zip(turned) {
            beam = refract(beam, DVec3::Z, 1.0 / self.index)?;
            // The exit face of a prism with its base at the right.
            let tilt = wedge.to_radians();
            let normal = DVec3::new(-tilt.sin() * angle.cos(), -tilt.sin() * angle.sin(), tilt.cos());
            beam = refract(beam, normal, self.index)?;
        }
        Some(beam)
    }

    fn around(&self, place: DVec3) -> Vec<DVec3> {
        let axes = Axes::new(self.forward);
        let shot = |k: u32| {
            let turned = self.turns.map(|turns| 2.0 * PI * (turns * f64::from(k) / f64::from(self.shots)).fract());
            let beam = self.through(turned).expect("the beam passes at the greatest deviation");
            place + beam.x * axes.right + beam.y * axes.up + beam.z * axes.forward
        };
        (0..self.shots).map(shot).collect()
    }
}

/// The unit direction of a ray behind a face, by Snell's law. `normal`: that of the face, along the ray. `ratio`: the index before the face over
/// that behind it. `None` if all light is reflected.
fn refract(direction: DVec3, normal: DVec3, ratio: f64) -> Option<DVec3> {
    let cosine = direction.dot(normal);
    let behind = 1.0 - ratio.powi(2) * (1.0 - cosine.powi(2));
    (behind > 0.0).then(|| ratio * direction + (behind.sqrt() - ratio * cosine) * normal)
}

impl Ends {
    /// The positions of the steps of an azimuth, as parts of its range. The last end of a turn is its first one again.
    fn steps(self, [begin, end]: [f64; 2], count: u32) -> Vec<f64> {
        match self {
            Ends::Included if end - begin == TURN => (0..count).map(|i| f64::from(i) / f64::from(count)).collect(),
            _ => self.parts(count),
        }
    }

    /// The positions of `count` points in a range, as parts of its length.
    fn parts(self, count: u32) -> Vec<f64> {
        let part = |i: u32| match self {
            Ends::Included if count > 1 => f64::from(i) / f64::from(count - 1),
            _ => (f64::from(i) + 0.5) / f64::from(count),
        };
        (0..count).map(part).collect()
    }
}

/// All pairs of a column and a row, row by row.
fn row_by_row(columns: &[f64], rows: &[f64]) -> impl Iterator<Item = [f64; 2]> {
    rows.iter().flat_map(|&row| columns.iter().map(move |&column| [column, row]))
}
