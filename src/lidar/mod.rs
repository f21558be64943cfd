//! Point clouds from the waveforms of a LiDAR scan: `taugate lidar`.

#![warn(missing_docs)]

pub mod cloud_file;
pub mod echoes;
mod las;
pub mod shots;

use glam::DVec3;
use rayon::prelude::*;

use echoes::Finder;
use shots::Shots;

use crate::image::scan_layers::Surface;

/// An echo as a point of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position in world space, in metres.
    pub position: DVec3,
    /// Distance from the sensor in metres.
    pub range: f64,
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
    /// Radial velocity of that object in m/s, receding positive; NaN if it is not known, and for other echoes.
    pub velocity: f32,
}

/// The waveforms of the shots of a LiDAR.
pub struct Waveforms<'a> {
    /// The shots.
    pub shots: &'a Shots,
    /// Mean radiance per bin and shot, the shot the fastest. Shots that were not measured are NaN.
    pub values: &'a [f32],
    /// Begin of the first bin, and width of the bins, in metres of optical path.
    pub begin: f64,
    /// See `begin`.
    pub width: f64,
    /// The first surface on the axis of each shot (range 0: none); `None` if they are not known.
    pub surfaces: Option<&'a [Surface]>,
}

impl Waveforms<'_> {
    /// The points of all shots in order, and within a shot the earliest echo first. The finder's lengths are in bins, and its floor is an
    /// intensity. An echo has the range of the first surface on the axis of the shot, if that surface is in its bins or at most
    /// one bin away. Otherwise its range is its position in the waveform, in a medium of index 1.
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
            let bins = range_at(echo.begin as f64 - 1.0)..=range_at(echo.end as f64 + 1.0);
            let hit = surface.filter(|surface| bins.contains(&f64::from(surface.range)));
            let range = hit.map_or(range_at(echo.position), |surface| surface.range.into());
            Point {
                position: place + range * direction,
                range,
                intensity: echo.light,
                echo: k as u8 + 1,
                echoes: found.len() as u8,
                time: self.shots.times[number],
                channel: self.shots.channels[number],
                object: hit.map_or(0, |surface| surface.object),
                velocity: hit.map_or(f32::NAN, |surface| surface.velocity),
            }
        };
        found.iter().enumerate().map(point).collect()
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
        let waveforms = Waveforms { shots: &shots, values: &values, begin: 2.0, width: 2.0, surfaces: Some(&surfaces) };
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
}
