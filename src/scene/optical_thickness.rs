//! Optical thickness of media along a ray.

use std::cmp::Ordering;

use glam::DVec3;

use super::medium::{DensityGrid, Medium};

/// Number of points at which the density of a grid is read, per part of a ray in one medium.
const POINTS: u32 = 256;

/// Optical thickness per channel of the media along the first `length` metres of a ray. The fraction exp(-thickness) of the light goes
/// straight on. `direction` is a unit vector; `length` may be infinite. Where media overlap, only the last one counts. The density of
/// a grid is that of the nearest voxel. Media inside of meshes do not count.
pub fn optical_thickness(media: &[Medium], origin: DVec3, direction: DVec3, length: f64) -> [f64; 3] {
    let spans: Vec<Option<[f64; 2]>> = media.iter().map(|medium| medium.span(origin, direction)).collect();
    let ends = spans.iter().flatten().flatten().copied();
    let mut ends: Vec<f64> = ends.chain([0.0, length]).filter(|end| (0.0..=length).contains(end)).collect();
    ends.sort_by(f64::total_cmp);
    let part = |ends: &[f64]| {
        let [from, to] = [ends[0], ends[1]];
        let middle = if to.is_finite() { 0.5 * (from + to) } else { from + 1.0 };
        let contains = |span: &Option<[f64; 2]>| span.is_some_and(|[enter, leave]| enter <= middle && middle < leave);
        let medium = spans.iter().rposition(contains).map(|index| &media[index]);
        medium.filter(|_| to > from).map_or([0.0; 3], |medium| {
            let density = medium.mean_density(origin, direction, [from, to]);
            // A clear channel has no thickness, however far the medium reaches.
            let thickness = |sigma: f64| if sigma == 0.0 { 0.0 } else { sigma * density * (to - from) };
            [0, 1, 2].map(|channel| thickness(medium.sigma_s[channel] + medium.sigma_a[channel]))
        })
    };
    ends.windows(2).map(part).fold([0.0; 3], |sum, part| [0, 1, 2].map(|channel| sum[channel] + part[channel]))
}

impl Medium {
    /// Scattering and absorption per metre, as a mean over the channels, where the density is 1.
    pub fn extinction(&self) -> f64 {
        self.sigma_s.iter().chain(&self.sigma_a).sum::<f64>() / 3.0
    }

    /// Distances at which a line enters and leaves the medium; `None` if it misses the medium.
    fn span(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let mut span = [f64::NEG_INFINITY, f64::INFINITY];
        let mut clip = |[lo, hi]: [DVec3; 2], origin: DVec3, direction: DVec3| {
            for axis in 0..3 {
                let (lo, hi, o, d) = (lo[axis], hi[axis], origin[axis], direction[axis]);
                let (enter, leave) = match d.total_cmp(&0.0) {
                    _ if d == 0.0 && lo <= o && o < hi => (f64::NEG_INFINITY, f64::INFINITY),
                    _ if d == 0.0 => (f64::INFINITY, f64::NEG_INFINITY),
                    Ordering::Less => ((hi - o) / d, (lo - o) / d),
                    _ => ((lo - o) / d, (hi - o) / d),
                };
                span = [span[0].max(enter), span[1].min(leave)];
            }
        };
        if let Some(bounds) = self.bounds {
            clip(bounds, origin, direction);
        }
        if let Some(grid) = &self.grid {
            let to_grid = grid.transform.inverse();
            clip(grid.bounds, to_grid.transform_point3(origin), to_grid.transform_vector3(direction));
        }
        (span[0] < span[1]).then_some(span)
    }

    /// Mean density along the part of a ray from distance `from` to `to`, which must be inside the medium.
    fn mean_density(&self, origin: DVec3, direction: DVec3, [from, to]: [f64; 2]) -> f64 {
        let Some(grid) = &self.grid else { return 1.0 };
        let to_grid = grid.transform.inverse();
        let place = |i: u32| origin + (from + (to - from) * (f64::from(i) + 0.5) / f64::from(POINTS)) * direction;
        (0..POINTS).map(|i| grid.nearest_density(to_grid.transform_point3(place(i)))).sum::<f64>() / f64::from(POINTS)
    }
}

impl DensityGrid {
    /// Density of the voxel that is nearest to a point in the space of `bounds`.
    fn nearest_density(&self, point: DVec3) -> f64 {
        let [lo, hi] = self.bounds;
        let relative = (point - lo) / (hi - lo);
        let voxel = |axis: usize| {
            let count = self.resolution[axis];
            ((relative[axis] * f64::from(count)).max(0.0) as usize).min(count as usize - 1)
        };
        let [x, y, z] = [0, 1, 2].map(voxel);
        let index = x + self.resolution[0] as usize * (y + self.resolution[1] as usize * z);
        self.density[index].into()
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::scene::{GridFilter, Scene};

    fn boxed(sigma_s: f64, lo: DVec3, hi: DVec3) -> Medium {
        Medium { sigma_s: [sigma_s; 3], sigma_a: [0.3, 0.0, 0.0], bounds: Some([lo, hi]), ..Medium::default() }
    }

    fn mean(thickness: [f64; 3]) -> f64 {
        thickness.iter().sum::<f64>() / 3.0
    }

    #[test]
    fn clear_channels_have_no_thickness() {
        let water = Medium { sigma_a: [2.0, 0.5, 0.0], ..Medium::default() };
        let along = |length: f64| optical_thickness(std::slice::from_ref(&water), DVec3::ZERO, DVec3::X, length);
        assert_eq!(along(4.0), [8.0, 2.0, 0.0]);
        assert_eq!(along(f64::INFINITY), [f64::INFINITY, f64::INFINITY, 0.0]);
    }

    #[test]
    fn the_last_medium_counts_along_a_ray() {
        let everywhere = Medium { sigma_s: [0.2; 3], ..Medium::default() };
        let media = [everywhere, boxed(0.9, DVec3::new(1.0, -1.0, -1.0), DVec3::new(3.0, 1.0, 1.0))];
        let along = |y: f64, length: f64| mean(optical_thickness(&media, DVec3::new(0.0, y, 0.0), DVec3::X, length));
        for (y, length, expected) in [
            (0.0, 10.0, 8.0 * 0.2 + 2.0 * 1.0),
            (0.0, 2.0, 0.2 + 1.0),
            (0.0, 0.5, 0.1),
            (2.0, 10.0, 2.0),
            (0.0, f64::INFINITY, f64::INFINITY),
            (0.0, 0.0, 0.0),
        ] {
            let found = along(y, length);
            assert!(found == expected || (found - expected).abs() < 1e-12, "{y} {length}: {found}");
        }
        let only_box = |direction: DVec3| mean(optical_thickness(&media[1..], DVec3::ZERO, direction, f64::INFINITY));
        assert!((only_box(DVec3::X) - 2.0).abs() < 1e-12);
        assert_eq!([only_box(DVec3::NEG_X), only_box(DVec3::Y)], [0.0, 0.0]);
    }

    #[test]
    fn a_grid_counts_by_its_density_and_has_bounds() {
        let (bounds, transform) = ([DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0)], DAffine3::from_scale(DVec3::splat(2.0)));
        let grid = DensityGrid {
            resolution: [2, 1, 1],
            density: vec![0.5, 3.0],
            bounds,
            transform,
            filter: GridFilter::Nearest,
        };
        let cloud = Medium { sigma_s: [0.1; 3], grid: Some(grid), ..Medium::default() };
        let scene = Scene { media: vec![cloud.clone()], ..Scene::default() };
        assert_eq!(scene.bounds(), Some([DVec3::ZERO, DVec3::new(4.0, 2.0, 2.0)]), "a scene of a grid alone");
        let found = mean(optical_thickness(&[cloud], DVec3::new(-5.0, 0.5, 0.5), DVec3::X, 100.0));
        assert!((found - 0.1 * (2.0 * 0.5 + 2.0 * 3.0)).abs() < 1e-9, "{found}");
    }
}
