//! Vignetting: lenses send less light to the border of the image than to its centre.

#![warn(missing_docs)]

use std::f64::consts::PI;
use std::sync::Arc;

use super::check::Checked;
use super::lens::Distortion;

/// The share of the light that reaches the sensor. It depends on the angle to the view at which the light passes the centre of the lens. A
/// pixel measures this share of the radiance; layers such as depth stay as they are.
#[derive(Debug, Clone, PartialEq)]
pub enum Vignetting {
    /// All light, at all angles: pixels measure radiance.
    None,
    /// The fourth power of the cosine of the angle: the irradiance behind a thin lens in front of a flat sensor.
    Cos4,
    /// Angles in radians, ascending from 0, and shares in [0, 1]; between two rows the share is linear in the angle. 2 to
    /// [`Vignetting::MAX_ROWS`] rows. The last angle is not less than the largest one in the image.
    Table(Arc<[[f64; 2]]>),
}

/// Smallest difference in radians of two angles of a table, so that they differ on the device too.
const LEAST_STEP: f64 = 1e-6;

impl Vignetting {
    /// The largest number of rows of a table, as in `shared/frame.wgsl`.
    pub const MAX_ROWS: usize = 32;

    /// Whether a lens with this distortion can have it. The error is a clause that follows the name of the camera.
    pub(super) fn check(&self, distortion: &Distortion) -> Checked {
        match self {
            Vignetting::None => Ok(()),
            Vignetting::Cos4 if matches!(distortion, Distortion::Fisheye(_)) => {
                Err("has a fisheye lens, for which cos4 does not hold; give its vignetting as a table".into())
            }
            Vignetting::Cos4 => Ok(()),
            Vignetting::Table(rows) => {
                let count = rows.len();
                if !(2..=Vignetting::MAX_ROWS).contains(&count) {
                    return Err(format!("has a vignetting of {count} rows; give 2 to {} rows", Vignetting::MAX_ROWS));
                }
                if rows[0][0] != 0.0 {
                    return Err(
                        "has a vignetting that does not begin at the centre of the image; give the angle 0 first"
                            .into(),
                    );
                }
                if let Some(pair) = rows.windows(2).find(|pair| (pair[1][0] - pair[0][0]).max(0.0) < LEAST_STEP) {
                    let [before, after] = [pair[0][0], pair[1][0]].map(f64::to_degrees);
                    return Err(format!(
                        "has a vignetting with the angle {after} after {before} degrees; sort the rows by angle, each angle once"
                    ));
                }
                match rows.iter().find(|[angle, share]| !(*angle <= PI && (0.0..=1.0).contains(share))) {
                    Some([angle, share]) => Err(format!(
                        "has a vignetting of {share} at {} degrees; give shares of the light from 0 to 1 at angles up to 180 degrees",
                        angle.to_degrees()
                    )),
                    None => Ok(()),
                }
            }
        }
    }

    /// Whether it covers all angles up to `reach` in radians. The error is a clause that follows the name of the camera.
    pub(super) fn check_reach(&self, reach: f64) -> Checked {
        let Vignetting::Table(rows) = self else { return Ok(()) };
        let last = rows.last().map_or(0.0, |row| row[0]);
        match last >= reach - LEAST_STEP {
            true => Ok(()),
            false => Err(format!(
                "has a vignetting that ends at {:.2} degrees, but its image reaches {:.2} degrees from the axis; add rows",
                last.to_degrees(),
                reach.to_degrees()
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: &[[f64; 2]]) -> Vignetting {
        Vignetting::Table(rows.iter().map(|&[degrees, share]| [degrees.to_radians(), share]).collect())
    }

    #[test]
    fn tables_that_are_none_are_refused() {
        for (rows, part) in [
            (&[[0.0, 1.0]][..], "1 rows"),
            (&[[5.0, 1.0], [9.0, 0.5]], "give the angle 0 first"),
            (&[[0.0, 1.0], [20.0, 0.6], [10.0, 0.8]], "the angle 10 after 20 degrees"),
            (&[[0.0, 1.0], [20.0, 0.6], [20.0, 0.5]], "each angle once"),
            (&[[0.0, 1.0], [f64::NAN, 0.6]], "sort the rows"),
            (&[[0.0, 100.0], [20.0, 60.0]], "from 0 to 1"),
            (&[[0.0, 1.0], [20.0, f64::NAN]], "from 0 to 1"),
            (&[[0.0, 1.0], [200.0, 0.5]], "up to 180 degrees"),
        ] {
            let message = table(rows).check(&Distortion::None).unwrap_err();
            assert!(message.contains(part), "{message}");
        }
        assert!(Vignetting::Cos4.check(&Distortion::Fisheye([0.0; 4])).unwrap_err().contains("as a table"));
        assert!(table(&[[0.0, 1.0], [20.0, 0.0]]).check(&Distortion::None).is_ok());
    }

    #[test]
    fn tables_cover_the_image() {
        let table = table(&[[0.0, 1.0], [20.0, 0.5]]);
        assert!(table.check_reach(20f64.to_radians()).is_ok() && Vignetting::Cos4.check_reach(1.0).is_ok());
        assert!(
            table
                .check_reach(27f64.to_radians())
                .unwrap_err()
                .contains("ends at 20.00 degrees, but its image reaches 27.00")
        );
    }
}
