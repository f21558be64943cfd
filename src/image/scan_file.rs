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
use crate::settings::Settings;
use crate::settings::doppler::Doppler;

/// Mean radiance in W / (m^2 sr) per response, point of the laser and point of the sensor: the mean of red, green and blue. Pairs that
/// were not measured are NaN.
pub struct ScanFilm {
    responses: usize,
    pairs: usize,
    /// Indexed by response, point of the laser and point of the sensor, the last one the fastest.
    means: Vec<f32>,
    /// Variances of the means, in the same order; empty if they are not wanted.
    variances: Vec<f32>,
    /// See [`ScanArrays::velocities`]; empty if the colours are those of light.
    velocities: Vec<f32>,
    doppler: Doppler,
}

/// The arrays of a [`ScanFilm`].
pub struct ScanArrays {
    pub shape: Vec<usize>,
    pub means: Vec<f32>,
    /// `None` if they are not wanted.
    pub variances: Option<Vec<f32>>,
    /// The mean radial velocity of the light and its standard deviation in m/s, with an axis for the two behind those of `shape`. NaN
    /// without light. `None` if the scan records no velocities.
    pub velocities: Option<Vec<f32>>,
}

impl ScanFilm {
    /// A film without measurements.
    pub fn new(scan: &Scan, settings: &Settings, has_variance: bool) -> ScanFilm {
        let (responses, doppler) = (settings.responses().len(), settings.doppler());
        let pairs = scan.laser_points.len() * scan.sensor_count();
        let values =
            |each: usize, is_wanted: bool| if is_wanted { vec![f32::NAN; each * pairs * responses] } else { vec![] };
        let [means, variances, velocities] =
            [values(1, true), values(1, has_variance), values(2, doppler != Doppler::OFF)];
        ScanFilm { responses, pairs, means, variances, velocities, doppler }
    }

    /// Bytes of host memory that a film takes.
    pub fn bytes(scan: &Scan, settings: &Settings, has_variance: bool) -> u64 {
        let pairs = scan.laser_points.len() as u64 * scan.sensor_count() as u64;
        let numbers = 1 + u64::from(has_variance) + if settings.doppler() == Doppler::OFF { 0 } else { 2 };
        pairs * settings.responses().len() as u64 * numbers * size_of::<f32>() as u64
    }

    /// Stores the first `points` pixels of the image of one response, or of the images of several. They are the measurements of the pairs
    /// of points from number `first` on, counted by point of the laser, then by point of the sensor.
    pub fn set(&mut self, first: usize, points: usize, film: &Film, responses: Option<&ResponseFilm>) {
        // How much each channel counts in the light, and the sum of these weights.
        let (weights, whole) = match self.doppler {
            Doppler::OFF => ([1.0f32; 3], 3.0f32),
            _ => ([1.0, 2.0, 1.0], 4.0),
        };
        let weighted = |rgb: [f32; 3]| rgb.iter().zip(weights).map(|(x, weight)| x * weight).sum::<f32>();
        let (means, variances) = (film.mean(), film.variance_of_mean());
        for point in 0..points {
            let of_film = |values: &[f32]| values[3 * point..3 * point + 3].to_vec();
            let mean = responses.map_or_else(|| of_film(&means), |all| all.means_of(point).collect());
            for (k, rgb) in mean.as_chunks().0.iter().enumerate() {
                let at = first + point + k * self.pairs;
                self.means[at] = weighted(*rgb) * (1.0 / whole);
                if let Some(speed) = self.doppler.speed() {
                    let velocity = Doppler::decode(speed, rgb.map(f64::from));
                    self.velocities[2 * at..2 * at + 2].copy_from_slice(&velocity.map(|x| x as f32));
                }
            }
            if !self.variances.is_empty() {
                let variance = responses.map_or_else(|| of_film(&variances), |all| all.variances_of(point).collect());
                // The channels share their paths, so the standard errors add up.
                for (k, rgb) in variance.as_chunks().0.iter().enumerate() {
                    self.variances[first + point + k * self.pairs] =
                        weighted(rgb.map(f32::sqrt)).powi(2) * (1.0 / (whole * whole));
                }
            }
        }
    }

    /// Whether no light was measured.
    pub fn is_black(&self) -> bool {
        self.means.iter().all(|&mean| mean == 0.0)
    }

    /// Writes the means, their variances, velocities and layers if there are any, and the JSON file that describes them, as one [`ArraySet`]. The arrays have
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
        if !self.velocities.is_empty() {
            set.add(Role::Velocity, &[&shape[..], &[2]].concat(), self.velocities.iter().copied())?;
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
        let wanted = |values: Vec<f32>| Some(values).filter(|values| !values.is_empty());
        ScanArrays { shape, means: self.means, variances: wanted(self.variances), velocities: wanted(self.velocities) }
    }

    /// JSON that describes the arrays. `measured`: number of points of the laser that were measured, and samples per pair of points. `group_index`: that of the medium around
    /// the sensor. `layers`: what lies beside them.
    pub fn description<'a>(
        &self,
        table: &ScanTable,
        scan: &'a Scan,
        (measured, samples): (usize, u64),
        group_index: f32,
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
            group_index: Some(group_index).filter(|index| *index != 1.0),
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
    /// Travel time per length in the medium around the sensor, if it is not 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    group_index: Option<f32>,
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
    use crate::settings::gates::Gates;

    #[test]
    fn measurements_are_stored_by_response_laser_and_sensor() {
        let keys = "[scan]\nlaser = [0, 0, 5]\nlaser-points = [[0, 0, 0], [1, 0, 0]]\nsensor-points = [[2, 0, 0], [3, 0, 0], [4, 0, 0]]";
        let scan = Experiment::parse(keys).unwrap().scan.unwrap().scan().unwrap();
        let settings = Settings::builder().responses("0..2m/2".parse::<Gates>().unwrap()).build().unwrap();
        let mut film = ScanFilm::new(&scan, &settings, true);
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

    /// The colours of light 3 at the velocity 0.4, in units of the speed.
    #[test]
    fn colours_of_velocities_become_light_and_velocities() {
        let keys = "[scan]\nlaser = [0, 0, 5]\npoints = [[0, 0, 0], [1, 0, 0]]";
        let scan = Experiment::parse(keys).unwrap().scan.unwrap().scan().unwrap();
        let settings = Settings::builder().doppler("20".parse::<Doppler>().unwrap()).build().unwrap();
        let mut film = ScanFilm::new(&scan, &settings, true);
        let mut seen = Film::new(1, 1);
        let [u, light] = [0.4f32, 3.0];
        let colours = [(1.0 + u) * (1.0 + u), 1.0 - u * u, (1.0 - u) * (1.0 - u)].map(|x| x * light);
        seen.add(&colours, 2);
        seen.add(&colours, 2);
        film.set(1, 1, &seen, None);
        assert!((film.means[1] - light).abs() < 1e-5 && film.means[0].is_nan());
        let [mean, deviation] = [film.velocities[2], film.velocities[3]];
        assert!((mean - 8.0).abs() < 1e-4 && deviation < 0.01 && film.velocities[0].is_nan(), "{mean} {deviation}");
        assert!(film.variances[1] < 1e-9);
    }
}
