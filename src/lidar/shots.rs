//! Where, when and in which direction the shots of a LiDAR were fired: from the description of a finished scan.

use glam::DVec3;
use serde_json::Value;

/// The shots of a LiDAR, in the order of the array of the scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Shots {
    /// The place of each shot in world space, in metres.
    pub places: Vec<DVec3>,
    /// The unit direction of each shot in world space.
    pub directions: Vec<DVec3>,
    /// The time of each shot in seconds; 0 if the scan has no duration.
    pub times: Vec<f64>,
    /// The number of the laser that fires each shot. If all shots come from one laser, it is the number of their row.
    pub channels: Vec<u16>,
    /// Radiance of a white diffuse target at 1 m that faces the LiDAR, see [`crate::input::scan_table::Scan::white_target_at_1m`].
    pub white: f64,
}

impl Shots {
    /// The shots of a scan with this description. `None` if it describes no LiDAR, or is damaged.
    pub fn of(about: &Value) -> Option<Shots> {
        let vectors = |key: &str| {
            let list: Vec<[f64; 3]> = serde_json::from_value(about[key].clone()).ok()?;
            Some(list.into_iter().map(DVec3::from).collect::<Vec<_>>())
        };
        let points = vectors("laser_points")?;
        let laser = || serde_json::from_value::<[f64; 3]>(about["laser"].clone()).ok().map(DVec3::from);
        let places = match about["laser_places"].is_null() {
            true => vec![laser()?; points.len()],
            false => vectors("laser_places")?,
        };
        let times = match about["shot_times_s"].is_null() {
            true => vec![0.0; points.len()],
            false => serde_json::from_value(about["shot_times_s"].clone()).ok()?,
        };
        let directions: Vec<DVec3> =
            points.iter().zip(&places).map(|(point, place)| (*point - *place).normalize()).collect();
        let white = about["white_target_at_1m"].as_f64().filter(|white| *white > 0.0)?;
        let columns = about["laser_grid"][0].as_u64().unwrap_or(u64::MAX).max(1);
        let channel = |number: usize| match about["channels"].as_u64().filter(|&channels| channels > 0) {
            Some(channels) => number as u64 % channels,
            None => number as u64 / columns,
        };
        let channels = (0..points.len()).map(|number| channel(number).min(u16::MAX.into()) as u16).collect();
        let fits = [places.len(), times.len()] == [points.len(); 2];
        let is_finite =
            directions.iter().chain(&places).all(|v| v.is_finite()) && times.iter().all(|t: &f64| t.is_finite());
        (fits && is_finite).then_some(Shots { places, directions, times, channels, white })
    }

    /// Number of shots.
    pub fn count(&self) -> usize {
        self.places.len()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn shots_are_those_of_the_description() {
        let still = json!({
            "laser": [1, 2, 3], "laser_points": [[1, 2, 1], [3, 2, 3], [1, 4, 3], [1, 2, 4]], "laser_grid": [2, 2],
            "white_target_at_1m": 7.5,
        });
        let shots = Shots::of(&still).unwrap();
        assert_eq!((shots.count(), shots.white, shots.places[3]), (4, 7.5, DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!(shots.directions, [DVec3::NEG_Z, DVec3::X, DVec3::Y, DVec3::Z]);
        assert_eq!((shots.times, shots.channels), (vec![0.0; 4], vec![0, 0, 1, 1]));

        let mut moving = still.clone();
        moving["channels"] = 2.into();
        moving["shot_times_s"] = json!([0.0, 0.0, 0.5, 0.5]);
        moving["laser_places"] = json!([[1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 0, 4]]);
        let shots = Shots::of(&moving).unwrap();
        assert_eq!((shots.channels, shots.times), (vec![0, 1, 0, 1], vec![0.0, 0.0, 0.5, 0.5]));
        assert_eq!(shots.directions[3], DVec3::Y);

        for (key, wrong) in [
            ("white_target_at_1m", json!(null)),
            ("laser_points", json!([[1, 2]])),
            ("laser_places", json!([[1, 2, 3]])),
            ("shot_times_s", json!([0, 1])),
            ("laser_points", json!([[1, 2, 3], [3, 2, 3], [1, 4, 3], [1, 2, 4]])),
        ] {
            let mut broken = moving.clone();
            broken[key] = wrong;
            assert_eq!(Shots::of(&broken), None, "{key}");
        }
    }
}
