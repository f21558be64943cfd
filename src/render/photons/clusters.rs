//! Groups of neighbouring smooth triangles. Where there are too many triangles to aim at each, photons are aimed at groups.

use glam::Vec3;

use crate::wgsl::layout::Triangle;

/// Maximum number of triangles of a group that is not divided into two others.
const LEAF: usize = 4;

/// A tree of groups. The root is group 0.
pub struct Clusters {
    /// Indices and corners of the triangles. Those of a group are neighbours in the list.
    triangles: Vec<(u32, [Vec3; 3])>,
    /// Area of all triangles up to each.
    areas: Vec<f64>,
    groups: Vec<Group>,
}

struct Group {
    first: usize,
    end: usize,
    lo: Vec3,
    hi: Vec3,
    /// The second half; the first half is the next group. `None`: single triangles.
    second: Option<u32>,
}

/// A half of a group, or one triangle of a small group.
pub enum Part {
    Group(u32),
    Triangle(u32, [Vec3; 3]),
}

impl Clusters {
    /// Groups of these triangles, of which there is at least one.
    pub fn new(triangles: &[(u32, &Triangle)]) -> Clusters {
        let corners = |&(number, t): &(u32, &Triangle)| (number, [t.v0, t.v1, t.v2].map(Vec3::from));
        let mut clusters =
            Clusters { triangles: triangles.iter().map(corners).collect(), areas: vec![], groups: vec![] };
        clusters.add(0, triangles.len());
        let mut sum = 0.0;
        let areas = clusters.triangles.iter().map(|(_, [a, b, c])| {
            sum += 0.5 * (*b - *a).as_dvec3().cross((*c - *a).as_dvec3()).length();
            sum
        });
        clusters.areas = areas.collect();
        clusters
    }

    /// Adds the group of the triangles from `first` to `end`, and the groups inside of it. Sorts the triangles. Returns its number.
    fn add(&mut self, first: usize, end: usize) -> u32 {
        let triangles = &mut self.triangles[first..end];
        let corners = || triangles.iter().flat_map(|(_, corners)| *corners);
        let lo = corners().fold(Vec3::INFINITY, Vec3::min);
        let hi = corners().fold(Vec3::NEG_INFINITY, Vec3::max);
        let number = self.groups.len();
        self.groups.push(Group { first, end, lo, hi, second: None });
        if triangles.len() > LEAF {
            let axis = (hi - lo).max_position();
            let along = |(_, [a, b, c]): &(u32, [Vec3; 3])| a[axis] + b[axis] + c[axis];
            let middle = triangles.len() / 2;
            triangles.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)));
            self.add(first, first + middle);
            self.groups[number].second = Some(self.add(first + middle, end));
        }
        number as u32
    }

    /// The two groups or the triangles inside of a group.
    pub fn parts(&self, group: u32) -> Vec<Part> {
        let Group { first, end, second, .. } = self.groups[group as usize];
        let triangle = |&(number, corners): &(u32, [Vec3; 3])| Part::Triangle(number, corners);
        match second {
            Some(second) => vec![Part::Group(group + 1), Part::Group(second)],
            None => self.triangles[first..end].iter().map(triangle).collect(),
        }
    }

    /// Centre and diagonal of the bounds.
    pub fn bounds(&self, group: u32) -> (Vec3, f64) {
        let Group { lo, hi, .. } = self.groups[group as usize];
        (0.5 * (lo + hi), f64::from(lo.distance(hi)))
    }

    /// Area of all triangles.
    pub fn area(&self, group: u32) -> f64 {
        let Group { first, end, .. } = self.groups[group as usize];
        self.areas[end - 1] - self.area_before(first)
    }

    fn area_before(&self, triangle: usize) -> f64 {
        if triangle > 0 { self.areas[triangle - 1] } else { 0.0 }
    }

    /// A triangle of the group, chosen by `u` from 0 to 1 in proportion to its area, and a number from 0 to 1 that is uniform for all
    /// `u` that choose this triangle.
    pub fn choose(&self, group: u32, u: f64) -> (u32, [Vec3; 3], f64) {
        let Group { first, end, .. } = self.groups[group as usize];
        let wanted = self.area_before(first) + u * self.area(group);
        let place = first + self.areas[first..end].partition_point(|&sum| sum <= wanted).min(end - first - 1);
        let before = self.area_before(place);
        let rest = (wanted - before) / (self.areas[place] - before).max(f64::MIN_POSITIVE);
        let (triangle, corners) = self.triangles[place];
        (triangle, corners, rest.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups contain each triangle once, and choose them in proportion to their areas.
    #[test]
    fn groups_divide_the_triangles() {
        let triangle = |k: u32| {
            let (x, height) = ((k * 37 % 101) as f32, 1.0 + (k % 3) as f32);
            Triangle {
                v0: [x, 0.0, 0.0],
                v1: [x + 1.0, 0.0, 0.0],
                v2: [x, height, 0.0],
                ..bytemuck::Zeroable::zeroed()
            }
        };
        let all: Vec<Triangle> = (0..101).map(triangle).collect();
        let clusters = Clusters::new(&(0..).zip(&all).collect::<Vec<_>>());
        let (mut open, mut seen) = (vec![(0, clusters.area(0))], vec![]);
        while let Some((group, area)) = open.pop() {
            assert!((clusters.area(group) - area).abs() < 1e-9);
            let (centre, diagonal) = clusters.bounds(group);
            let mut rest = area;
            for part in clusters.parts(group) {
                match part {
                    Part::Group(inner) => {
                        rest -= clusters.area(inner);
                        open.push((inner, clusters.area(inner)));
                    }
                    Part::Triangle(number, corners) => {
                        assert_eq!(corners[0].to_array(), all[number as usize].v0);
                        assert!(corners.iter().all(|c| f64::from(c.distance(centre)) <= 0.5 * diagonal + 1e-5));
                        rest -= f64::from(0.5 * corners[0].distance(corners[2]));
                        seen.push(number);
                    }
                }
            }
            assert!(rest.abs() < 1e-9, "{rest}");
        }
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..101));
        let mut counts = [0.0; 101];
        let draws = 100_000;
        for draw in 0..draws {
            let (number, _, rest) = clusters.choose(0, (f64::from(draw) + 0.5) / f64::from(draws));
            assert!((0.0..=1.0).contains(&rest));
            counts[number as usize] += 1.0 / f64::from(draws);
        }
        let wanted = |k: usize| 0.5 * (1.0 + (k % 3) as f64) / clusters.area(0);
        assert!((0..101).all(|k| (counts[k] - wanted(k)).abs() < 3e-5));
    }
}
