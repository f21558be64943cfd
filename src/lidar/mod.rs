//! Point clouds from the waveforms of a LiDAR scan: `taugate lidar`.

#![warn(missing_docs)]

pub mod cloud_file;
pub mod echoes;
mod las;
pub mod shots;
pub mod sweeps;

use glam::DVec3;
use rayon::prelude::*;

use echoes::Finder;
use shots::Shots;

use crate::image::scan_layers::Surface;

/// An echo as a point of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Number of the shot, from 0.
    pub shot: usize,
    /// Position in world space, in metres.
    pub position: DVec3,
    /// Distance from the sensor in metres.
    pub range: f64,
    /// Ranges between which the light of the echo lies, with one bin more on each side.
    pub extent: [f64; 2],
    /// Light of the echo; 1 is that of a white diffuse target that faces the sensor at 1 m.
    pub intensity: f64,
    /// Number of the echo in its shot, from 1.
    pub echo: u8,
    /// Number of echoes of the shot.
    pub echoes: u8,
    /// Time of the shot in seconds.
    pub time: f64,
    /// Number of the laser, from 0; see [`Shots::channels`].
    pub channel: u16,
    /// Number of the object on the axis of the shot, if the echo comes from there; else 0.
    pub object: u32,
    /// Radial velocity in m/s, receding positive: the mean of the light of the echo if the scan recorded it, otherwise that of the object. NaN if it
    /// is not known.
    pub velocity: f32,
    /// Standard deviation of the radial velocity in m/s, weighted by light; NaN if the scan did not record it.
    pub deviation: f32,
}

/// The waveforms of the shots of a LiDAR.
pub struct Waveforms<'a> {
    /// The shots.
    pub shots: &'a Shots,
    /// Mean radiance per bin and shot, the shot the fastest. Shots that were not measured are NaN.
    pub values: &'a [f32],
    /// Begin of the first bin, and width of the bins, in metres of the way there and back.
    pub begin: f64,
    /// See `begin`.
    pub width: f64,
    /// Light that is no echo, on average in each bin: daylight and dark counts.
    pub background: f64,
    /// The first surface on the axis of each shot (range 0: none); `None` if they are not known.
    pub surfaces: Option<&'a [Surface]>,
    /// Mean radial velocity of the light of each value and its standard deviation in m/s; NaN without light. `None` if they are not known.
    pub velocities: Option<&'a [f32]>,
}

impl Waveforms<'_> {
    /// The points of all shots in order, and within a shot the earliest echo first. The finder's lengths are in bins, and its floor is an
    /// intensity. An echo has the range of the first surface on the axis of the shot, if that surface is in its bins or at most
    /// one bin away. Otherwise its range is its position in the waveform.
    pub fn cloud(&self, finder: &Finder) -> Vec<Point> {
        let (shots, white) = (self.shots.count(), self.shots.white);
        let shot = |number: usize| {
            let light = self.values.iter().skip(number).step_by(shots);
            let waveform: Vec<f64> = light.map(|&x| f64::from(x).max(0.0) / white).collect();
            self.points_of(number, &waveform, finder)
        };
        (0..shots).into_par_iter().flat_map_iter(shot).collect()
    }

    fn points_of(&self, number: usize, waveform: &[f64], finder: &Finder) -> Vec<Point> {
        let found = finder.echoes(waveform);
        let (place, direction) = (self.shots.places[number], self.shots.directions[number]);
        let surface = self.surfaces.map(|surfaces| surfaces[number]).filter(|surface| surface.range > 0.0);
        let range_at = |position: f64| 0.5 * (self.begin + position * self.width);
        let point = |(k, echo): (usize, &echoes::Echo)| {
            let [near, far] = [range_at(echo.begin as f64 - 1.0), range_at(echo.end as f64 + 1.0)];
            let hit = surface.filter(|surface| (near..=far).contains(&f64::from(surface.range)));
            let range = hit.map_or(range_at(echo.position), |surface| surface.range.into());
            let of_surface = || [hit.map_or(f32::NAN, |surface| surface.velocity), f32::NAN];
            let [velocity, deviation] = self.velocity_of(number, waveform, echo).unwrap_or_else(of_surface);
            Point {
                shot: number,
                position: place + range * direction,
                range,
                extent: [near, far],
                intensity: (echo.light - self.background / self.shots.white * (echo.end - echo.begin) as f64).max(0.0),
                echo: k as u8 + 1,
                echoes: found.len() as u8,
                time: self.shots.times[number],
                channel: self.shots.channels[number],
                object: hit.map_or(0, |surface| surface.object),
                velocity,
                deviation,
            }
        };
        found.iter().enumerate().map(point).collect()
    }

    /// Mean and standard deviation of the radial velocity of the light of an echo. `None` if the scan did not record them.
    fn velocity_of(&self, number: usize, waveform: &[f64], echo: &echoes::Echo) -> Option<[f32; 2]> {
        let velocities = self.velocities?;
        let [mut light, mut sum, mut squares] = [0.0; 3];
        for (bin, &weight) in waveform.iter().enumerate().take(echo.end).skip(echo.begin) {
            let at = 2 * (bin * self.shots.count() + number);
            let [mean, deviation] = [velocities[at], velocities[at + 1]].map(f64::from);
            // Bins with counts of noise alone have no velocity.
            if mean.is_finite() {
                light += weight;
                sum += weight * mean;
                squares += weight * (mean * mean + deviation * deviation);
            }
        }
        let mean = sum / light;
        let deviation = (squares / light - mean * mean).max(0.0).sqrt();
        Some([mean as f32, deviation as f32])
    }
}

#[cfg(test)]
mod tests {
    use super::echoes::{Detection, MAX_ECHOES};
    use super::*;

    const FINDER: Finder =
        Finder { detection: Detection::Peak, threshold: 0.1, floor: 0.0, separation: 1.0, max: MAX_ECHOES };

    /// Two echoes of one shot: the first is the surface on its axis, the second has no surface.
    #[test]
    fn echoes_become_points() {
        let place = DVec3::new(1.0, 2.0, 3.0);
        let shots = Shots {
            places: vec![place; 2],
            directions: vec![DVec3::NEG_Z, DVec3::X],
            times: vec![0.25, 0.25],
            channels: vec![3, 4],
            white: 8.0,
        };
        // The second shot was not measured.
        let mut values = vec![0.0; 40];
        values.iter_mut().skip(1).step_by(2).for_each(|x| *x = f32::NAN);
        let white = shots.white as f32;
        (values[2 * 4], values[2 * 12]) = (0.5 * white, 0.25 * white);
        let surface = |range, object| Surface { range, object, velocity: 2.5 };
        let surfaces = [surface(5.4567, 9), surface(0.0, 0)];
        let (surfaces, velocities) = (Some(&surfaces[..]), None);
        let waveforms =
            Waveforms { background: 0.0, shots: &shots, values: &values, begin: 2.0, width: 2.0, surfaces, velocities };
        let cloud = waveforms.cloud(&FINDER);
        assert_eq!(cloud.len(), 2);
        assert!((cloud[0].range - 5.4567).abs() < 1e-6 && cloud[0].object == 9);
        assert!(cloud[0].velocity == 2.5 && cloud[1].velocity.is_nan());
        assert!((cloud[0].position - DVec3::new(1.0, 2.0, 3.0 - 5.4567)).length() < 1e-6);
        // The centre of bin 12, there and back.
        assert!((cloud[1].range - 13.5).abs() < 1e-9 && cloud[1].object == 0);
        assert!((cloud[0].intensity - 0.5).abs() < 1e-6 && (cloud[1].intensity - 0.25).abs() < 1e-6);
        assert_eq!(cloud.iter().map(|p| (p.echo, p.echoes, p.channel)).collect::<Vec<_>>(), [(1, 2, 3), (2, 2, 3)]);

        let without = Waveforms { surfaces: None, ..waveforms }.cloud(&FINDER);
        assert!((without[0].range - 5.5).abs() < 1e-9 && without[0].object == 0);
    }

    /// Two bins of one echo with the light 3 and 1, which moves at 4 and at -2 m/s.
    #[test]
    fn an_echo_has_the_velocity_of_its_light() {
        let shots = Shots {
            places: vec![DVec3::ZERO],
            directions: vec![DVec3::X],
            times: vec![0.0],
            channels: vec![0],
            white: 1.0,
        };
        let values = [0.0, 3.0, 1.0, 0.0];
        let velocities = [f32::NAN, f32::NAN, 4.0, 1.0, -2.0, 0.0, f32::NAN, f32::NAN];
        let (surfaces, velocities) = (None, Some(&velocities[..]));
        let cloud =
            Waveforms { background: 0.1, shots: &shots, values: &values, begin: 2.0, width: 2.0, surfaces, velocities }
                .cloud(&FINDER);
        let [point] = cloud[..] else { panic!("{cloud:?}") };
        // Two bins have twice the background.
        assert!((point.intensity - 3.8).abs() < 1e-6);
        // The mean square is (3 (16 + 1) + 4) / 4.
        assert!(
            (point.velocity - 2.5).abs() < 1e-6 && (point.deviation - (13.75f32 - 6.25).sqrt()).abs() < 1e-6,
            "{point:?}"
        );
    }
}
