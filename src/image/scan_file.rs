//! Writes the result of a scan as a NumPy array, with a JSON file beside it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use crate::error::Result;
use crate::image::array_set::{ArraySet, Role};
use crate::image::exr_file::{Provenance, version};
use crate::image::film::Film;
use crate::image::npy_file::{Bins, Entry};
use crate::image::response_film::ResponseFilm;
use crate::image::scan_layers::ScanLayers;
use crate::input::scan_table::{Points, Scan, ScanTable};

/// Mean radiance in W / (m^2 sr) per response, point of the laser and point of the sensor: the mean of red, green and blue. Pairs that
/// were not measured are NaN.
pub struct ScanFilm {
    responses: usize,
    pairs: usize,
    /// Indexed by response, point of the laser and point of the sensor, the last one the fastest.
    means: Vec<f32>,
    /// Variances of the means, in the same order; empty if they are not wanted.
    variances: Vec<f32>,
}

/// The arrays of a [`ScanFilm`].
pub struct ScanArrays {
    pub shape: Vec<usize>,
    pub means: Vec<f32>,
    /// `None` if they are not wanted.
    pub variances: Option<Vec<f32>>,
}

impl ScanFilm {
    /// A film without measurements.
    pub fn new(scan: &Scan, responses: usize, has_variance: bool) -> ScanFilm {
        let pairs = scan.laser_points.len() * scan.sensor_count();
        let values = vec![f32::NAN; pairs * responses];
        let variances = if has_variance { values.clone() } else { vec![] };
        ScanFilm { responses, pairs, means: values, variances }
    }

    /// Bytes of host memory that a film takes.
    pub fn bytes(scan: &Scan, responses: usize, has_variance: bool) -> u64 {
        let values = scan.laser_points.len() as u64 * scan.sensor_count() as u64 * responses as u64;
        values * size_of::<f32>() as u64 * if has_variance { 2 } else { 1 }
    }

    /// Stores the first `points` pixels of the image of one response, or of the images of several. They are the measurements of the pairs
    /// of points from number `first` on, counted by point of the laser, then by point of the sensor.
    pub fn set(&mut self, first: usize, points: usize, film: &Film, responses: Option<&ResponseFilm>) {
        let store = |to: &mut [f32], rgb: &[f32], factor: f32| {
            for (k, rgb) in rgb.chunks_exact(3).enumerate() {
                to[k * self.pairs] = rgb.iter().sum::<f32>() * factor;
            }
        };
        let (means, variances) = (film.mean(), film.variance_of_mean());
        for point in 0..points {
            let of_film = |values: &[f32]| values[3 * point..3 * point + 3].to_vec();
            let mean = responses.map_or_else(|| of_film(&means), |all| all.means_of(point).collect());
            store(&mut self.means[first + point..], &mean, 1.0 / 3.0);
            if !self.variances.is_empty() {
                let variance = responses.map_or_else(|| of_film(&variances), |all| all.variances_of(point).collect());
                // The channels share their paths, so the standard errors add up.
                let of_sum: Vec<f32> = variance
                    .chunks_exact(3)
                    .flat_map(|rgb| [rgb.iter().map(|x| x.sqrt()).sum::<f32>().powi(2), 0.0, 0.0])
                    .collect();
                store(&mut self.variances[first + point..], &of_sum, 1.0 / 9.0);
            }
        }
    }

    /// Whether no light was measured.
    pub fn is_black(&self) -> bool {
        self.means.iter().all(|&mean| mean == 0.0)
    }

    /// Writes the means, their variances and layers if there are any, and the JSON file that describes them, as one [`ArraySet`]. The arrays have
    /// 32-bit floats of shape (response, point) for a confocal scan, and (response, point of the laser, point of the sensor) for an
    /// exhaustive one. `description`: see [`ScanFilm::description`].
    pub fn write(
        &self,
        path: &Path,
        scan: &Scan,
        layers: Option<&ScanLayers>,
        description: &impl Serialize,
    ) -> Result<()> {
        let mut set = ArraySet::new(path);
        let shape = self.shape(scan);
        set.add(Role::Array, &shape, self.means.iter().copied())?;
        if !self.variances.is_empty() {
            set.add(Role::Variance, &shape, self.variances.iter().copied())?;
        }
        if let Some(layers) = layers {
            set.add_with(Role::Layers, |writer| layers.write(writer))?;
        }
        set.publish(description)
    }

    fn shape(&self, scan: &Scan) -> Vec<usize> {
        let mut shape = vec![self.responses, scan.laser_points.len()];
        shape.extend(scan.sensor_points.as_ref().map(Vec::len));
        shape
    }

    /// The arrays, as [`ScanFilm::write`] writes them.
    pub fn into_arrays(self, scan: &Scan) -> ScanArrays {
        let shape = self.shape(scan);
        let variances = Some(self.variances).filter(|variances| !variances.is_empty());
        ScanArrays { shape, means: self.means, variances }
    }

    /// JSON that describes the arrays. `measured`: number of points of the laser that were measured. `layers`: what lies beside them.
    pub fn description<'a>(
        &self,
        table: &ScanTable,
        scan: &'a Scan,
        measured: usize,
        samples: u64,
        layers: Option<&'a ScanLayers>,
        provenance: &'a Provenance,
    ) -> Description<'a> {
        let positions = |points: &[glam::DVec3]| points.iter().map(|p| p.to_array()).collect::<Vec<_>>();
        let laser_points = table.points.as_ref().or(table.laser_points.as_ref());
        let sensor_points = table.points.as_ref().or(table.sensor_points.as_ref());
        let steps =
            (scan.at_once > 1).then(|| [scan.at_once, scan.laser_points.len() / scan.at_once].map(|n| n as u32));
        Description {
            bins: Bins::of(&provenance.responses),
            responses: provenance.responses.iter().map(Entry::of).collect(),
            axes: match scan.sensor_points {
                None => "response, point",
                Some(_) => "response, laser point, sensor point",
            },
            shape: self.shape(scan),
            unit: "W/(m^2 sr)",
            laser: scan.laser.to_array(),
            sensor: scan.sensor.to_array(),
            divergence_degrees: scan.divergence.to_degrees(),
            pixel_fov_degrees: scan.pixel_fov.to_degrees(),
            account_first_and_last_bounces: scan.accounts_first_and_last,
            laser_grid: laser_points.and_then(Points::grid).or(steps),
            sensor_grid: sensor_points.and_then(Points::grid).or(steps),
            white_target_at_1m: scan.white_target_at_1m(),
            channels: (scan.at_once > 1).then_some(scan.at_once),
            shot_times_s: scan.times.as_deref(),
            laser_places: scan.places.as_deref().map(positions),
            laser_points: positions(&scan.laser_points),
            sensor_points: positions(scan.sensor_points.as_ref().unwrap_or(&scan.laser_points)),
            measured_laser_points: measured,
            samples,
            aov: layers.map(ScanLayers::fields),
            objects: layers.filter(|layers| layers.chosen.object).map(|layers| &layers.objects),
            seconds: provenance.seconds,
            seed: provenance.seed,
            version: version(),
            settings: &provenance.settings,
        }
    }
}

/// The file beside the array of a scan. Positions are in metres in world space.
#[derive(Serialize)]
pub struct Description<'a> {
    #[serde(flatten)]
    bins: Option<Bins>,
    /// The responses along the first axis of the array, in order.
    responses: Vec<Entry<'a>>,
    axes: &'static str,
    shape: Vec<usize>,
    unit: &'static str,
    laser: [f64; 3],
    sensor: [f64; 3],
    /// Full angle of the laser's cone, and width of the sensor's square field of view.
    divergence_degrees: f64,
    pixel_fov_degrees: f64,
    account_first_and_last_bounces: bool,
    /// Columns and rows of the points; null if they are a list.
    laser_grid: Option<[u32; 2]>,
    sensor_grid: Option<[u32; 2]>,
    /// Radiance of a white diffuse target at 1 m that faces a LiDAR, in the unit of the array.
    #[serde(skip_serializing_if = "Option::is_none")]
    white_target_at_1m: Option<f64>,
    /// Number of consecutive shots that are fired at once, if it is not 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    channels: Option<usize>,
    /// Time of each shot in seconds, if the scan has a duration.
    #[serde(skip_serializing_if = "Option::is_none")]
    shot_times_s: Option<&'a [f64]>,
    /// Where laser and sensor are at each shot, if they move.
    #[serde(skip_serializing_if = "Option::is_none")]
    laser_places: Option<Vec<[f64; 3]>>,
    /// For directions: the points at 1 m from the laser.
    laser_points: Vec<[f64; 3]>,
    sensor_points: Vec<[f64; 3]>,
    /// Less than the number of points of the laser if the scan was interrupted; the rest of the array is NaN.
    measured_laser_points: usize,
    /// Samples per pair of points.
    samples: u64,
    /// Fields of the auxiliary layers, and the names of their objects by number.
    #[serde(skip_serializing_if = "Option::is_none")]
    aov: Option<Vec<&'static str>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<&'a BTreeMap<u32, String>>,
    seconds: f64,
    seed: u32,
    version: String,
    /// The experiment file that measures the array again.
    settings: &'a str,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    #[test]
    fn measurements_are_stored_by_response_laser_and_sensor() {
        let keys = "[scan]\nlaser = [0, 0, 5]\nlaser-points = [[0, 0, 0], [1, 0, 0]]\nsensor-points = [[2, 0, 0], [3, 0, 0], [4, 0, 0]]";
        let scan = Experiment::parse(keys).unwrap().scan.unwrap().scan().unwrap();
        let mut film = ScanFilm::new(&scan, 2, true);
        let mut seen = ResponseFilm::new(3, 2, true);
        for x in [1.0, 3.0] {
            seen.row_mut(2).add(1, [x, x, 4.0 * x], 1);
            seen.end_iteration(1);
        }
        let mut total = Film::new(3, 1);
        total.add(&[0.0; 9], 2);
        film.set(3, 3, &total, Some(&seen));
        assert_eq!(film.shape(&scan), [2, 2, 3]);
        assert!(film.means[..3].iter().chain(&film.means[6..9]).all(|x| x.is_nan()));
        assert_eq!((&film.means[3..6], &film.means[9..]), (&[0.0; 3][..], &[0.0, 0.0, 4.0][..]));
        // The variances of the channels are 1, 1 and 16: the mean of three dependent channels has (1 + 1 + 4)^2 / 9.
        assert!((film.variances[11] - 4.0).abs() < 1e-6 && film.variances[9] == 0.0, "{:?}", film.variances);
    }
}
