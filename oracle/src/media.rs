//! Where the media of a scene are. This module finds the medium of each part of a ray and its density. It also tracks on which
//! side of a closed mesh a path is.

use glam::{DAffine3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::{DensityGrid, GridFilter, Material, Medium, Mesh, Scene};

use super::geometry::{Geometry, Ray, Surface};
use super::phase::Phase;

/// All media of a scene.
pub struct Media<'a> {
    /// Media outside of solids. Where several overlap, only the last one counts.
    outside: Vec<PreparedMedium<'a>>,
    /// The medium inside, per material.
    interiors: Vec<Option<PreparedMedium<'a>>>,
    /// The region outside of all solids.
    surrounding: Region,
    /// Per instance.
    is_null_boundary: Vec<bool>,
    /// Whether a material transmits light.
    has_solids: bool,
    /// Whether all coefficients are the same in the three channels.
    is_grey: bool,
}

/// A medium with values that are computed once.
pub struct PreparedMedium<'a> {
    medium: &'a Medium,
    pub phase: Phase<'a>,
    grid: Option<PreparedGrid<'a>>,
}

/// A grid with values that are computed once.
pub struct PreparedGrid<'a> {
    grid: &'a DensityGrid,
    /// From world space to coordinates in which each voxel is a unit cube, and the grid starts at the origin.
    to_voxels: DAffine3,
    max_density: f64,
}

/// Where a ray travels: in a solid, or outside of all solids.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Material of the solid.
    pub solid: Option<u32>,
    /// Index of refraction.
    pub eta: f64,
    /// Travel time per distance.
    pub group_index: f64,
}

/// The colour channel whose coefficients the flights of one sample use.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    pub index: usize,
    /// Factor on the contributions of the sample: 3 for this channel and 0 for the others; 1 if all media are grey.
    pub weight: DVec3,
}

/// A part of a ray in one medium, from one distance to another; the second may be infinite.
pub struct Stretch<'m, 'a> {
    pub medium: &'m PreparedMedium<'a>,
    pub from: f64,
    pub to: f64,
}

impl<'a> Media<'a> {
    pub fn new(scene: &'a Scene) -> Media<'a> {
        let water = scene.media.iter().rev().find(|medium| medium.is_unbounded());
        let [ior, group_ior] = water.map_or([1.0; 2], |medium| [medium.ior, medium.group_ior]);
        let interiors: Vec<Option<&Medium>> = scene.materials.iter().map(|m| m.interior.as_ref()).collect();
        let is_null = |mesh: &Mesh| scene.materials[mesh.material as usize].is_null_boundary(mesh, ior);
        let is_grey = |sigma: [f64; 3]| sigma[0] == sigma[1] && sigma[0] == sigma[2];
        let mut all = scene.media.iter().chain(interiors.iter().copied().flatten());
        Media {
            is_grey: all.all(|medium| is_grey(medium.sigma_s) && is_grey(medium.sigma_a)),
            outside: scene.media.iter().map(PreparedMedium::new).collect(),
            interiors: interiors.into_iter().map(|medium| medium.map(PreparedMedium::new)).collect(),
            surrounding: Region { solid: None, eta: ior.into(), group_index: group_ior.into() },
            has_solids: scene.materials.iter().any(Material::transmits),
            is_null_boundary: scene.instances.iter().map(|i| is_null(&scene.meshes[i.mesh as usize])).collect(),
        }
    }

    /// Whether the scene has no medium at all.
    pub fn is_empty(&self) -> bool {
        self.outside.is_empty() && !self.has_interiors()
    }

    fn has_interiors(&self) -> bool {
        self.interiors.iter().any(Option::is_some)
    }

    pub fn is_null_boundary(&self, instance: u32) -> bool {
        self.is_null_boundary[instance as usize]
    }

    /// Index of refraction outside of all solids.
    pub fn ior(&self) -> f64 {
        self.surrounding.eta
    }

    /// Draws the channel of a sample. Without coloured media it draws no random number.
    pub fn channel(&self, pcg: &mut Pcg) -> Channel {
        if self.is_grey {
            return Channel { index: 0, weight: DVec3::ONE };
        }
        let index = pcg.below(3);
        let mut weight = DVec3::ZERO;
        weight[index] = 3.0;
        Channel { index, weight }
    }

    /// The region inside a solid with this surface, for a ray that enters it from `outside`. `indices`: index of refraction and group index of the solid.
    pub fn inside(&self, surface: &Surface, indices: [f64; 2], outside: Region) -> Region {
        let solid = Some(surface.material);
        match self.is_null_boundary(surface.instance) {
            true => Region { solid, ..outside },
            false => Region { solid, eta: indices[0], group_index: indices[1] },
        }
    }

    /// The region where a ray starts. Solids must be closed and nested properly. `indices`: see [`Media::inside`].
    pub fn region(&self, geometry: &Geometry, ray: Ray, indices: impl Fn(u32) -> [f64; 2]) -> Region {
        if !self.has_solids {
            return self.surrounding;
        }
        let (mut passed, mut depth) = (vec![], 0);
        // The first solid that the ray leaves without having entered it before contains the start of the ray.
        while let Some(hit) = geometry.closest_but(&ray, &passed) {
            let surface = geometry.surface(&hit);
            passed.push(hit.triangle);
            if !geometry.scene.materials[surface.material as usize].transmits() {
                continue;
            }
            match surface.geometric.dot(ray.direction) > 0.0 {
                false => depth += 1,
                true if depth > 0 => depth -= 1,
                true => return self.inside(&surface, indices(surface.material), self.surrounding),
            }
        }
        self.surrounding
    }

    /// The media along the first `length` metres of a ray in a region, in order. Gaps between them contain no medium.
    pub fn stretches<'m>(&'m self, ray: &Ray, length: f64, region: Region) -> Vec<Stretch<'m, 'a>> {
        let clipped = |medium: &PreparedMedium| {
            let (from, to) = medium.span(ray)?;
            let (from, to) = (from.max(0.0), to.min(length));
            (from < to).then_some((from, to))
        };
        if let Some(material) = region.solid {
            let interior = self.interiors[material as usize].as_ref();
            let stretch = interior.and_then(|medium| clipped(medium).map(|(from, to)| Stretch { medium, from, to }));
            return stretch.into_iter().collect();
        }
        let spans: Vec<_> = self.outside.iter().map(clipped).collect();
        let mut cuts: Vec<f64> = spans.iter().flatten().flat_map(|&(from, to)| [from, to]).collect();
        cuts.sort_by(f64::total_cmp);
        let parts = cuts.windows(2).filter(|cut| cut[0] < cut[1]);
        parts
            .filter_map(|cut| {
                let fills = |span: &Option<(f64, f64)>| span.is_some_and(|(from, to)| from <= cut[0] && cut[1] <= to);
                let medium = &self.outside[spans.iter().rposition(fills)?];
                Some(Stretch { medium, from: cut[0], to: cut[1] })
            })
            .collect()
    }
}

impl<'a> PreparedMedium<'a> {
    fn new(medium: &'a Medium) -> PreparedMedium<'a> {
        PreparedMedium { medium, phase: Phase::new(&medium.phase), grid: medium.grid.as_ref().map(PreparedGrid::new) }
    }

    /// Scattering and absorption coefficients per metre where the density is 1.
    pub fn coefficients(&self, channel: Channel) -> [f64; 2] {
        [self.medium.sigma_s[channel.index], self.medium.sigma_a[channel.index]]
    }

    /// The greatest density of the grid; `None` for a homogeneous medium, whose density is 1.
    pub fn max_density(&self) -> Option<f64> {
        self.grid.as_ref().map(|grid| grid.max_density)
    }

    /// Density at a point of the medium.
    pub fn density(&self, point: DVec3) -> f64 {
        self.grid.as_ref().map_or(1.0, |grid| grid.density(point))
    }

    /// Distances at which the line of the ray enters and leaves the medium; `None` if it misses the medium.
    fn span(&self, ray: &Ray) -> Option<(f64, f64)> {
        let mut span = (f64::NEG_INFINITY, f64::INFINITY);
        if let Some(bounds) = self.medium.bounds {
            span = clip(span, ray.origin, ray.direction, bounds);
        }
        if let Some(PreparedGrid { grid, to_voxels, .. }) = &self.grid {
            let voxels = [DVec3::ZERO, DVec3::from(grid.resolution.map(f64::from))];
            let origin = to_voxels.transform_point3(ray.origin);
            span = clip(span, origin, to_voxels.transform_vector3(ray.direction), voxels);
        }
        (span.0 < span.1).then_some(span)
    }
}

/// The part of the span in which origin + t direction is in a box; empty (from >= to) if the line misses the box.
fn clip(span: (f64, f64), origin: DVec3, direction: DVec3, [lo, hi]: [DVec3; 2]) -> (f64, f64) {
    let (mut from, mut to) = span;
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if origin[axis] < lo[axis] || origin[axis] >= hi[axis] {
                return (0.0, 0.0);
            }
            continue;
        }
        let a = (lo[axis] - origin[axis]) / direction[axis];
        let b = (hi[axis] - origin[axis]) / direction[axis];
        (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
    }
    (from, to)
}

impl<'a> PreparedGrid<'a> {
    pub fn new(grid: &'a DensityGrid) -> PreparedGrid<'a> {
        let [lo, hi] = grid.bounds;
        let voxel = (hi - lo) / DVec3::from(grid.resolution.map(f64::from));
        let world_from_voxels = grid.transform * DAffine3::from_translation(lo) * DAffine3::from_scale(voxel);
        let max_density = grid.density.iter().copied().fold(0.0, f32::max).into();
        PreparedGrid { grid, to_voxels: world_from_voxels.inverse(), max_density }
    }

    fn voxel(&self, at: [i64; 3]) -> f64 {
        let [nx, ny, nz] = self.grid.resolution.map(i64::from);
        let [x, y, z] = [at[0].clamp(0, nx - 1), at[1].clamp(0, ny - 1), at[2].clamp(0, nz - 1)];
        self.grid.density[(x + nx * (y + ny * z)) as usize].into()
    }

    /// Density at a point of the grid in world space.
    pub fn density(&self, point: DVec3) -> f64 {
        let p = self.to_voxels.transform_point3(point);
        if self.grid.filter == GridFilter::Nearest {
            return self.voxel(p.floor().to_array().map(|x| x as i64));
        }
        let low = (p - 0.5).floor();
        let [x, y, z] = low.to_array().map(|x| x as i64);
        let f = p - 0.5 - low;
        let mut sum = 0.0;
        for corner in 0..8i64 {
            let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let part = |bit: i64, f: f64| if bit == 1 { f } else { 1.0 - f };
            sum += part(i, f.x) * part(j, f.y) * part(k, f.z) * self.voxel([x + i, y + j, z + k]);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> DVec3 {
        DVec3::new(x, 0.5, 0.5)
    }

    fn boxed(lo: f64, hi: f64) -> Medium {
        let bounds = Some([DVec3::new(lo, -1.0, -1.0), DVec3::new(hi, 1.0, 1.0)]);
        Medium { sigma_s: [hi; 3], bounds, ..Medium::default() }
    }

    #[test]
    fn the_last_medium_of_the_list_counts() {
        let fog = Medium { sigma_s: [0.5; 3], ..Medium::default() };
        let scene = Scene { media: vec![fog, boxed(1.0, 4.0), boxed(3.0, 6.0)], ..Scene::default() };
        let media = Media::new(&scene);
        let channel = media.channel(&mut Pcg::new(1));
        let parts = |ray: &Ray, length: f64| -> Vec<(f64, f64, f64)> {
            let stretches = media.stretches(ray, length, media.surrounding);
            stretches.iter().map(|s| (s.medium.coefficients(channel)[0], s.from, s.to)).collect()
        };
        let along = Ray::new(at(0.0), DVec3::X);
        let infinity = f64::INFINITY;
        assert_eq!(
            parts(&along, infinity),
            [(0.5, 0.0, 1.0), (4.0, 1.0, 3.0), (6.0, 3.0, 4.0), (6.0, 4.0, 6.0), (0.5, 6.0, infinity)]
        );
        assert_eq!(parts(&along, 2.0), [(0.5, 0.0, 1.0), (4.0, 1.0, 2.0)]);
        // From inside of a box, and beside all boxes.
        assert_eq!(parts(&Ray::new(at(3.5), DVec3::NEG_X), 1.0), [(6.0, 0.0, 0.5), (4.0, 0.5, 1.0)]);
        assert_eq!(parts(&Ray::new(at(0.0) + DVec3::Y, DVec3::X), 9.0), [(0.5, 0.0, 9.0)]);
    }

    #[test]
    fn densities_between_and_in_voxels() {
        let grid = |filter| DensityGrid {
            resolution: [2, 1, 1],
            density: vec![1.0, 3.0],
            bounds: [DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0)],
            transform: DAffine3::from_translation(DVec3::new(10.0, 0.0, 0.0)),
            filter,
        };
        let density = |filter, x: f64| PreparedGrid::new(&grid(filter)).density(at(10.0 + x));
        for (x, linear, nearest) in
            [(0.5, 1.0, 1.0), (1.0, 1.0, 1.0), (1.5, 1.5, 1.0), (2.5, 2.5, 3.0), (3.9, 3.0, 3.0)]
        {
            assert!((density(GridFilter::Linear, x) - linear).abs() < 1e-12, "x {x}");
            assert_eq!(density(GridFilter::Nearest, x), nearest, "x {x}");
        }
        // Axes keep their order: x is fastest.
        let whole = DensityGrid { resolution: [1, 2, 1], ..grid(GridFilter::Nearest) };
        assert_eq!(PreparedGrid::new(&whole).density(DVec3::new(12.0, 0.75, 0.5)), 3.0);
        let scene = Scene {
            media: vec![Medium { grid: Some(grid(GridFilter::Linear)), ..Medium::default() }],
            ..Scene::default()
        };
        let media = Media::new(&scene);
        let span = media.outside[0].span(&Ray::new(at(0.0), DVec3::X)).expect("a hit");
        assert!((span.0 - 10.0).abs() < 1e-12 && (span.1 - 14.0).abs() < 1e-12, "{span:?}");
        assert!(media.outside[0].span(&Ray::new(at(0.0), DVec3::Y)).is_none());
        assert_eq!(media.outside[0].max_density(), Some(3.0));
    }
}
