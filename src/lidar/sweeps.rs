//! Two sweeps of an FMCW LiDAR together: the range and the velocity of each echo.

use super::Point;
use super::shots::Shots;
use crate::image::scan_layers::Surface;

/// Echoes of one object have nearly the same light in both sweeps: at most this many times that of the other.
const MAX_RATIO: f64 = 2.0;
/// If motion shifts a beat by more than this share of its length, it may have been folded.
const MAX_SHIFT: f64 = 0.5;

/// Two scans with the same shots and different sweeps.
pub struct Sweeps<'a> {
    /// The couplings of the sweeps in seconds, see [`crate::settings::chirp::Chirp::coupling`]. They differ.
    pub couplings: [f64; 2],
    /// The shots of both.
    pub shots: &'a Shots,
    /// The first surface on the axis of each shot (range 0: none); `None` if they are not known.
    pub surfaces: Option<&'a [Surface]>,
}

/// The points of two sweeps.
pub struct Paired {
    /// In the order of [`super::Waveforms::cloud`].
    pub cloud: Vec<Point>,
    /// Number of shots that are left out, because their echoes do not fit each other.
    pub unlike: usize,
    /// Number of points whose beats may have been folded: then range and shift have changed places.
    pub may_fold: usize,
}

impl Sweeps<'_> {
    /// The points with ranges and velocities, from the points of each sweep in the order of [`super::Waveforms::cloud`]. Echoes of a shot belong
    /// together by their order if their light fits, otherwise by the order of their light. Intensities are means.
    pub fn pair(&self, sweeps: [Vec<Point>; 2]) -> Paired {
        let [first, second] = sweeps.each_ref().map(|points| by_shot(points, self.shots.count()));
        let mut paired = Paired { cloud: vec![], unlike: 0, may_fold: 0 };
        for (shot, (a, b)) in first.iter().zip(&second).enumerate() {
            let Some(pairs) = pairs(a, b) else {
                paired.unlike += 1;
                continue;
            };
            let mut points: Vec<Point> = pairs.iter().map(|(a, b)| self.joined(shot, a, b)).collect();
            points.sort_by(|a, b| a.range.total_cmp(&b.range));
            points.iter_mut().zip(1..).for_each(|(point, echo)| point.echo = echo);
            let coupling = self.couplings[0].abs().max(self.couplings[1].abs());
            let is_near = |point: &&Point| f64::from(point.velocity.abs()) * coupling > MAX_SHIFT * point.range;
            paired.may_fold += points.iter().filter(is_near).count();
            paired.cloud.extend(points);
        }
        paired
    }

    /// A light path of the length L that grows at the rate v seems to have the length L + k v in a sweep with the coupling k. With the lamp beside the
    /// sensor, the range is half of L, and the radial velocity half of v.
    fn joined(&self, shot: usize, a: &Point, b: &Point) -> Point {
        let velocity = (a.range - b.range) / (self.couplings[0] - self.couplings[1]);
        let shift = self.couplings[0] * velocity;
        let extent = a.extent.map(|end| end - shift);
        let surface = self.surfaces.map(|surfaces| surfaces[shot]).filter(|surface| surface.range > 0.0);
        let hit = surface.filter(|surface| (extent[0]..=extent[1]).contains(&f64::from(surface.range)));
        let range = hit.map_or(a.range - shift, |surface| surface.range.into());
        Point {
            position: self.shots.places[shot] + range * self.shots.directions[shot],
            range,
            extent,
            intensity: 0.5 * (a.intensity + b.intensity),
            object: hit.map_or(0, |surface| surface.object),
            velocity: velocity as f32,
            ..*a
        }
    }
}

/// The echoes of a shot in both sweeps that belong together. `None` if their numbers or their light differ.
fn pairs(a: &[Point], b: &[Point]) -> Option<Vec<(Point, Point)>> {
    let fits = |pairs: &[(Point, Point)]| {
        let ratio = |(a, b): &(Point, Point)| a.intensity.max(b.intensity) / a.intensity.min(b.intensity);
        pairs.iter().all(|pair| ratio(pair) <= MAX_RATIO)
    };
    let zipped = |a: &[Point], b: &[Point]| a.iter().copied().zip(b.iter().copied()).collect::<Vec<_>>();
    if a.len() != b.len() {
        return None;
    }
    let by_range = zipped(a, b);
    if fits(&by_range) {
        return Some(by_range);
    }
    let by_light = |points: &[Point]| {
        let mut points = points.to_vec();
        points.sort_by(|a, b| b.intensity.total_cmp(&a.intensity));
        points
    };
    Some(zipped(&by_light(a), &by_light(b))).filter(|pairs| fits(pairs))
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

    const COUPLINGS: [f64; 2] = [0.1, -0.2];

    /// An echo of a shot: range, velocity and light. `coupling`: that of the sweep.
    fn seen(coupling: f64, shot: usize, echoes: &[[f64; 3]]) -> Vec<Point> {
        let point = |&[range, velocity, light]: &[f64; 3]| Point {
            shot,
            position: DVec3::ZERO,
            range: range + coupling * velocity,
            extent: [-0.3, 0.3].map(|x| range + coupling * velocity + x),
            intensity: light + coupling,
            echo: 0,
            echoes: echoes.len() as u8,
            time: 0.0,
            channel: 0,
            object: 0,
            velocity: f32::NAN,
            deviation: f32::NAN,
        };
        let mut points: Vec<Point> = echoes.iter().map(point).collect();
        points.sort_by(|a, b| a.range.total_cmp(&b.range));
        points
    }

    #[test]
    fn two_sweeps_tell_range_and_velocity() {
        let shots = Shots {
            places: vec![DVec3::ZERO; 4],
            directions: vec![DVec3::X; 4],
            times: vec![0.0; 4],
            channels: vec![0; 4],
            white: 1.0,
        };
        // The echoes of shot 2 change places in the falling sweep. Shot 1 lacks an echo there.
        let truth: [&[[f64; 3]]; 4] = [
            &[[5.0, -8.0, 3.0], [9.0, 0.5, 1.0]],
            &[[7.0, 3.0, 2.0], [8.0, 3.0, 2.0]],
            &[[10.0, -6.0, 5.0], [11.0, 2.0, 1.0]],
            &[[3.0, 9.0, 1.0]],
        ];
        let all = |coupling: f64| -> Vec<Point> {
            truth.iter().enumerate().flat_map(|(shot, echoes)| seen(coupling, shot, echoes)).collect()
        };
        let [rising, mut falling] = COUPLINGS.map(all);
        falling.remove(3);
        let surface = |range| Surface { range, object: 4, velocity: 0.0 };
        let surfaces = [surface(5.2), surface(0.0), surface(10.5), surface(0.0)];
        let sweeps = Sweeps { couplings: COUPLINGS, shots: &shots, surfaces: Some(&surfaces) };
        let Paired { cloud, unlike, may_fold } = sweeps.pair([rising, falling]);
        assert_eq!((cloud.len(), unlike, may_fold), (5, 1, 1));
        let expected = [truth[0], truth[2], truth[3]].concat();
        for (point, [range, velocity, light]) in cloud.iter().zip(expected) {
            // The first echo of shot 0 is that of the surface, and has its range.
            let range = if range == 5.0 { 5.2f32.into() } else { range };
            assert!((point.range - range).abs() < 1e-12, "{point:?}");
            assert!((f64::from(point.velocity) - velocity).abs() < 1e-6, "{point:?}");
            assert!(
                (point.position - range * DVec3::X).length() < 1e-12 && (point.intensity - light + 0.05).abs() < 1e-12
            );
            assert_eq!(point.object, if range < 5.5 && range > 5.0 { 4 } else { 0 });
        }
        assert_eq!(cloud.iter().map(|point| point.echo).collect::<Vec<_>>(), [1, 2, 1, 2, 1]);
    }
}
