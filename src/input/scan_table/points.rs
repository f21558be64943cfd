//! The points at which a scan looks: a list, a grid or directions.

use glam::DVec3;
use serde::{Deserialize, Serialize};

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
                 count = [16, 16]}, or directions {forward = [0, 0, -1], azimuth = [-30, 30], elevation = [-10, 5], count = [60, 15]}"
)]
pub enum Points {
    List(Vec<[f64; 3]>),
    Grid(Grid),
    Directions(Directions),
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
            Points::List(_) => None,
            Points::Grid(grid) => Some(grid.count),
            Points::Directions(directions) => Some(directions.count),
        }
    }

    pub(super) fn are_directions(&self) -> bool {
        matches!(self, Points::Directions(_))
    }

    /// The points. A direction gives the point at 1 m from `place`. Fails with one sentence if there are none or more than `max`
    /// points, or if a number is not finite or out of range.
    pub(super) fn positions(&self, place: DVec3, ends: Ends, max: u32) -> Result<Vec<DVec3>, String> {
        let (list, numbers) = match self {
            Points::List(list) => (list.len() as u64, list.clone()),
            Points::Grid(grid) => (1, vec![grid.corner, grid.across, grid.down]),
            Points::Directions(directions) => (1, directions.numbers()?),
        };
        let count = self.grid().map_or(list, |[columns, rows]| u64::from(columns) * u64::from(rows));
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
        })
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
        let [a0, a1] = self.azimuth;
        let [e0, e1] = self.elevation;
        if !(-360.0..=360.0).contains(&a0) || !(a0..=360.0f64.min(a0 + TURN)).contains(&a1) {
            return Err(format!(
                "the azimuth goes from {a0} to {a1}; it must rise by a full turn at most, between -360 and 360 degrees"
            ));
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
    fn around(&self, place: DVec3, ends: Ends) -> Vec<DVec3> {
        let forward = DVec3::from(self.forward).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let between = |[low, high]: [f64; 2], part: f64| (low + part * (high - low)).to_radians();
        let direction = |[x, y]: [f64; 2]| {
            let (azimuth, elevation) = (between(self.azimuth, x), between(self.elevation, 1.0 - y));
            let level = azimuth.cos() * forward + azimuth.sin() * right;
            elevation.cos() * level + elevation.sin() * up
        };
        let is_turn = self.azimuth[1] - self.azimuth[0] == TURN;
        let columns = match ends {
            // The last end of a turn is its first one again.
            Ends::Included if is_turn => (0..self.count[0]).map(|i| f64::from(i) / f64::from(self.count[0])).collect(),
            _ => ends.parts(self.count[0]),
        };
        row_by_row(&columns, &ends.parts(self.count[1])).map(|part| place + direction(part)).collect()
    }
}

impl Ends {
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
