//! Density grids on the device: the cells of `shared/grid.wgsl`, and blocks of them.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::space::RenderSpace;
use crate::scene::{DensityGrid, GridFilter, Scene};
use crate::wgsl::layout::Grid;
use crate::wgsl::layout::constants::BLOCK;

/// One texel: the densities at the eight corners of a cell, or the density of a block.
pub type Texel = [u32; 4];

/// Marks a block whose density varies.
const VARIES: f32 = -1.0;
/// Number of steps from density 0 to the largest density of a grid.
const STEPS: f64 = 65535.0;
/// Share of the mass of a grid that rounding may move without a warning.
const ROUNDED_SHARE: f64 = 0.01;

/// Number of cells and blocks of a grid.
pub fn texel_count(grid: &DensityGrid) -> u64 {
    let cells = Cells::new(grid).count;
    let product = |counts: [u32; 3]| counts.into_iter().map(u64::from).product::<u64>();
    product(cells) + product(cells.map(|n| n.div_ceil(BLOCK)))
}

/// The record of a grid. Its cells and blocks are appended to `densities`.
pub fn convert(grid: &DensityGrid, space: &RenderSpace, densities: &mut Vec<Texel>) -> Grid {
    let cells = Cells::new(grid);
    let scale = largest(grid);
    let mean = grid.density.iter().map(|&d| f64::from(d)).sum::<f64>() / grid.density.len() as f64;
    let first = densities.len() as u32;
    let [nx, ny, nz] = cells.count.map(|n| n as usize);
    densities
        .par_extend((0..nx * ny * nz).into_par_iter().map(|i| cells.texel([i % nx, i / nx % ny, i / nx / ny], scale)));
    let first_block = densities.len() as u32;
    let [bx, by, bz] = [nx, ny, nz].map(|n| n.div_ceil(BLOCK as usize));
    let blocks = (0..bx * by * bz).into_par_iter().map(|i| cells.constant([i % bx, i / bx % by, i / bx / by]));
    densities.par_extend(blocks.map(|density| [density.unwrap_or(VARIES).to_bits(), 0, 0, 0]));

    let [x, y, z] = rows(grid, space, cells.margin);
    let is_linear = u32::from(grid.filter == GridFilter::Linear);
    Grid { x, y, z, cells: cells.count, first, first_block, scale, mean: mean as f32, is_linear }
}

fn largest(grid: &DensityGrid) -> f32 {
    grid.density.iter().copied().fold(0.0, f32::max)
}

/// A density in steps of `scale` / [`STEPS`].
fn steps(density: f32, scale: f32) -> u32 {
    (f64::from(density) / f64::from(scale).max(f64::MIN_POSITIVE) * STEPS).round() as u32
}

/// One text per grid whose thin parts are lost or changed, because the device stores its densities in [`STEPS`].
pub fn warnings(scene: &Scene) -> Vec<String> {
    let grids = scene.media.iter().enumerate().filter_map(|(i, medium)| Some((i + 1, medium.grid.as_ref()?)));
    let rounded = grids.map(|(number, grid)| (number, rounded_share(grid))).filter(|(_, share)| *share > ROUNDED_SHARE);
    let text = |(number, share): (usize, f64)| {
        format!(
            "the density grid of medium {number} has parts far thinner than its densest voxel. Densities are rounded to 1/65535 of \
             the largest one, which adds or removes {:.0} % of the mass: lower the largest densities, or give the densest part a \
             grid of its own in a further table [[medium]]",
            100.0 * share
        )
    };
    rounded.map(text).collect()
}

/// Share of the mass of a grid that rounding adds or removes.
fn rounded_share(grid: &DensityGrid) -> f64 {
    let scale = largest(grid);
    let moved_and_mass = |density: f32| {
        let stored = f64::from(steps(density, scale)) / STEPS * f64::from(scale);
        [(stored - f64::from(density)).abs(), f64::from(density)]
    };
    let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
    let [moved, mass] = grid.density.par_iter().map(|&density| moved_and_mass(density)).reduce(|| [0.0; 2], add);
    if mass > 0.0 { moved / mass } else { 0.0 }
}

/// Rows of the map from render space to the space of cells.
fn rows(grid: &DensityGrid, space: &RenderSpace, margin: f64) -> [[f32; 4]; 3] {
    let [lo, hi] = grid.bounds;
    let voxel = (hi - lo) / DVec3::from(grid.resolution.map(f64::from));
    let world_from_voxels = grid.transform * DAffine3::from_translation(lo) * DAffine3::from_scale(voxel);
    let world_from_render = DAffine3::from_translation(space.origin) * DAffine3::from_scale(DVec3::splat(space.unit));
    let map = DAffine3::from_translation(DVec3::splat(margin)) * world_from_voxels.inverse() * world_from_render;
    let linear = map.matrix3.transpose();
    let row = |axis: DVec3, offset: f64| axis.extend(offset).as_vec4().to_array();
    let offset = map.translation;
    [row(linear.x_axis, offset.x), row(linear.y_axis, offset.y), row(linear.z_axis, offset.z)]
}

/// The cells of a grid: its voxels, or the boxes between the centres of neighbouring voxels.
struct Cells<'a> {
    grid: &'a DensityGrid,
    count: [u32; 3],
    /// Distance from the edge of the outermost cells to the edge of the grid, in cells.
    margin: f64,
}

impl<'a> Cells<'a> {
    fn new(grid: &'a DensityGrid) -> Cells<'a> {
        match grid.filter {
            GridFilter::Nearest => Cells { grid, count: grid.resolution, margin: 0.0 },
            GridFilter::Linear => Cells { grid, count: grid.resolution.map(|n| n + 1), margin: 0.5 },
        }
    }

    /// The voxels at the two ends of cell `i` of an axis with `n` voxels. Beyond the outermost centres the density is constant.
    fn ends(&self, i: usize, n: u32) -> [usize; 2] {
        match self.grid.filter {
            GridFilter::Nearest => [i, i],
            GridFilter::Linear => [i.saturating_sub(1), i.min(n as usize - 1)],
        }
    }

    fn density(&self, [x, y, z]: [usize; 3]) -> f32 {
        let [nx, ny, _] = self.grid.resolution.map(|n| n as usize);
        self.grid.density[x + nx * (y + ny * z)]
    }

    /// The densities at the corners of a cell in units of `scale`.
    fn texel(&self, at: [usize; 3], scale: f32) -> Texel {
        let [x, y, z] = [0, 1, 2].map(|axis| self.ends(at[axis], self.grid.resolution[axis]));
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[j, k]| {
            let [low, high] = x.map(|x| steps(self.density([x, y[j], z[k]]), scale));
            low | high << 16
        })
    }

    /// The density of a block of cells, if it is constant.
    fn constant(&self, block: [usize; 3]) -> Option<f32> {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let n = self.grid.resolution[axis];
            let first = block[axis] * BLOCK as usize;
            let last = (first + BLOCK as usize).min(self.count[axis] as usize) - 1;
            self.ends(first, n)[0]..=self.ends(last, n)[1]
        });
        let density = self.density([*x.start(), *y.start(), *z.start()]);
        let row = |y, z| x.clone().all(|x| self.density([x, y, z]) == density);
        z.clone().all(|z| y.clone().all(|y| row(y, z))).then_some(density)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Medium;

    #[test]
    fn thin_parts_beside_a_dense_voxel_are_warned_about() {
        let warnings = |density: Vec<f32>| {
            let resolution = [density.len() as u32, 1, 1];
            let bounds = [DVec3::ZERO, DVec3::ONE];
            let transform = DAffine3::IDENTITY;
            let grid = DensityGrid { resolution, density, bounds, transform, filter: GridFilter::Linear };
            warnings(&Scene { media: vec![Medium { grid: Some(grid), ..Medium::default() }], ..Scene::default() })
        };
        // A plume in clear air, and smoke a hundred times thinner than the densest voxel.
        let plume = (0..1000).map(|i| (-1e-3 * f64::from(i * i)).exp() as f32).collect();
        let smoke = (0..1000).map(|i| if i == 0 { 1.0 } else { 0.01 }).collect();
        assert_eq!(
            [warnings(vec![0.0; 9]), warnings(vec![0.7; 9]), warnings(plume), warnings(smoke)].concat(),
            [""; 0]
        );
        // Smoke below half a step vanishes: 20,000 voxels have a tenth of the mass.
        let lost = warnings((0..20_000).map(|i| if i == 0 { 1.0 } else { 1.0 / 180_000.0 }).collect());
        assert!(lost.len() == 1 && lost[0].contains("medium 1") && lost[0].contains(" 10 % of the mass"), "{lost:?}");
    }
}
