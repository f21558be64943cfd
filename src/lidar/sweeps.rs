//! Two sweeps of an FMCW LiDAR together: the range and the velocity of each echo.

use super::Point;
use super::shots::Shots;
use crate::image::scan_layers::Surface;

/// Two scans with the same shots and different sweeps.
pub struct Sweeps<'a> {
    /// The couplings of the sweeps in seconds, see [`crate::settings::chirp::Chirp::coupling`]. They differ.
    pub couplings: [f64; 2],
    /// The shots of both.
    pub shots: &'a Shots,
    /// The first surface on the axis of each shot (range 0: none); `None` if they are not known.
    pub surfaces: Option<&'a [Surface]>,
    /// An echo is that of the surface if their ranges differ by less than this, in metres.
    pub reach: f64,
}

impl Sweeps<'_> {
    /// The points with ranges and velocities, from the points of each sweep in the order of [`super::Waveforms::cloud`]. Echoes with the same
    /// number belong together, because objects rarely move fast enough to overtake each other in the spectrum. Also returns the number of shots that are
    /// left out, because they have unlike numbers of echoes. Intensities are means.
    pub fn pair(&self, sweeps: [Vec<Point>; 2]) -> (Vec<Point>, usize) {
        let [first, second] = sweeps.each_ref().map(|points| by_shot(points, self.shots.count()));
        let (mut cloud, mut unlike) = (vec![], 0);
        for (shot, (a, b)) in first.iter().zip(&second).enumerate() {
            match a.len() == b.len() {
                true => cloud.extend(a.iter().zip(*b).map(|(a, b)| self.joined(shot, a, b))),
                false => unlike += 1,
            }
        }
        (cloud, unlike)
    }

    /// A light path of the length L that grows at the rate v seems to have the length L + k v in a sweep with the coupling k. With the lamp beside the
    /// sensor, the range is half of L, and the radial velocity half of v.
    fn joined(&self, shot: usize, a: &Point, b: &Point) -> Point {
        let velocity = (a.range - b.range) / (self.couplings[0] - self.couplings[1]);
        let range = a.range - self.couplings[0] * velocity;
        let surface = self.surfaces.map(|surfaces| surfaces[shot]).filter(|surface| surface.range > 0.0);
        let hit = surface.filter(|surface| (f64::from(surface.range) - range).abs() < self.reach);
        Point {
            position: self.shots.places[shot] + range * self.shots.directions[shot],
            range,
            intensity: 0.5 * (a.intensity + b.intensity),
            object: hit.map_or(0, |surface| surface.object),
            velocity: velocity as f32,
            ..*a
        }
    }
}

/// The points of each shot.
fn by_shot(points: &[Point], shots: usize) -> Vec<&[Point]> {
    let mut rest = points;
    let of_shot = |shot: usize| {
        let count = rest.iter().take_while(|point| point.shot == shot).count();
        let (these, after) = rest.split_at(count);
        rest = after;
        these
    };
    (0..shots).map(of_shot).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn two_sweeps_tell_range_and_velocity() {
        let shots = Shots {
            places: vec![DVec3::ZERO; 3],
            directions: vec![DVec3::X; 3],
            times: vec![0.0; 3],
            channels: vec![0; 3],
            white: 1.0,
        };
        let couplings = [0.01, -0.02];
        // Shot 0 has two echoes, shot 1 one in one of the sweeps, and shot 2 none.
        let truth = [(0, 1, 5.0, -8.0), (0, 2, 9.0, 0.5), (1, 1, 7.0, 3.0)];
        let seen = |coupling: f64| {
            let point = |(shot, echo, range, velocity): (usize, u8, f64, f64)| Point {
                shot,
                position: DVec3::ZERO,
                range: range + coupling * velocity,
                intensity: 2.0 + coupling,
                echo,
                echoes: 2,
                time: 0.0,
                channel: 0,
                object: 0,
                velocity: f32::NAN,
                deviation: f32::NAN,
            };
            truth.map(point).to_vec()
        };
        let surface = Surface { range: 5.0, object: 4, velocity: 0.0 };
        let surfaces = [surface; 3];
        let sweeps = Sweeps { couplings, shots: &shots, surfaces: Some(&surfaces), reach: 0.1 };
        let [rising, mut falling] = couplings.map(seen);
        falling.pop();
        let (cloud, unlike) = sweeps.pair([rising, falling]);
        assert_eq!((cloud.len(), unlike), (2, 1));
        for (point, (_, echo, range, velocity)) in cloud.iter().zip(truth) {
            assert!(
                (point.range - range).abs() < 1e-12 && (f64::from(point.velocity) - velocity).abs() < 1e-6,
                "{point:?}"
            );
            assert!((point.position - range * DVec3::X).length() < 1e-12 && (point.intensity - 1.995).abs() < 1e-12);
            assert_eq!((point.echo, point.object), (echo, if echo == 1 { 4 } else { 0 }));
        }
    }
}
