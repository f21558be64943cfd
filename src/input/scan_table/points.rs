//! The points at which a scan looks: a list, a grid or directions.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::settings::MAX_ROW;

/// Maximum number of points of the laser, and of the sensor, which have a pixel each in an image of one row.
const MAX_POINTS: usize = MAX_ROW as usize;

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

    pub(super) fn are_directions(&self) -> bool {
        matches!(self, Points::Directions(_))
    }

    /// The points. A direction gives the point at 1 m from `place`. Fails with one sentence if there are too few or too many
    /// points, or if a number is not finite or out of range.
    pub(super) fn positions(&self, place: DVec3) -> Result<Vec<DVec3>, String> {
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
