//! `shared/grid.wgsl`: densities and their integrals along rays, compared with the oracle's densities.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::grid::convert;
use taugate::internals::render::space::RenderSpace;
use taugate::internals::scene::{DensityGrid, GridFilter};
use taugate_oracle::media::PreparedGrid;

use crate::shader_function::{Contents, ShaderFunction, contents};
use crate::values::{direction, dvec, vec3};

pub const KERNELS: &[&ShaderFunction] = &[&PASSAGE];

/// Passes through the whole grid, then only up to the point where the integral reaches the fraction `share` of the whole.
const PASSAGE: ShaderFunction = ShaderFunction {
    imports: &["medium"],
    input: "o: vec3<f32>, share: f32, d: vec3<f32>, pad: u32",
    result: "first: f32, last: f32, integral: f32, length: f32, density: f32, reached: f32, found: f32, pad: f32",
    body: "let g = load_grid(0u);
        let span = grid_span(g, input.o, input.d);
        let whole = pass_medium(0u, input.o, input.d, span.x, span.y, 3e38);
        let part = pass_grid(g, input.o, input.d, span.x, span.y, input.share * whole.integral);
        result.first = span.x;
        result.last = span.y;
        result.integral = select(whole.integral, 0.0, span.x > span.y);
        result.length = part.length;
        result.density = medium_density(0u, input.o);
        result.reached = part.integral;
        result.found = f32(has_grid(g));",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Ray {
    o: [f32; 3],
    share: f32,
    d: [f32; 3],
    pad: u32,
}

/// A turned and stretched grid of 21 x 3 x 14 voxels. Along x there is first air, then random densities, then a constant one.
fn grid(filter: GridFilter) -> DensityGrid {
    let mut pcg = Pcg::new(4);
    let resolution = [21, 3, 14];
    let density = (0..21 * 3 * 14).map(|i| match i % 21 {
        0..9 => 0.0,
        9..12 => 3.0 * pcg.uniform() as f32,
        _ => 1.7,
    });
    let turn = DAffine3::from_rotation_y(0.4) * DAffine3::from_rotation_x(-0.9);
    let transform = DAffine3::from_translation(DVec3::new(0.3, 0.1, -0.2)) * turn;
    let bounds = [DVec3::new(-1.0, -0.4, -0.8), DVec3::new(1.1, 0.5, 0.6)];
    DensityGrid { resolution, density: density.collect(), bounds, transform, filter }
}

fn buffers(grid: &DensityGrid, origin: DVec3) -> [Contents; 3] {
    let mut densities = vec![];
    let record = convert(grid, &RenderSpace::metres(origin), &mut densities);
    [contents("grids", &[record]), contents("densities", &densities), contents("media", &[0u32; 20])]
}

/// The integral of the density over the line, and over the first `length` metres after the line enters the grid.
fn march(grid: &DensityGrid, o: DVec3, d: DVec3, length: f64) -> [f64; 2] {
    const STEPS: u32 = 40_000;
    let prepared = PreparedGrid::new(grid);
    let to_grid = grid.transform.inverse();
    let inside = |p: DVec3| p.cmpge(grid.bounds[0]).all() && p.cmplt(grid.bounds[1]).all();
    let (width, mut entry, mut sums) = (8.0 / f64::from(STEPS), None, [0.0; 2]);
    for i in 0..STEPS {
        let t = (f64::from(i) + 0.5) * width - 4.0;
        let p = o + t * d;
        if inside(to_grid.transform_point3(p)) {
            let behind = t - *entry.get_or_insert(t - 0.5 * width);
            let amount = width * prepared.density(p);
            sums[0] += amount;
            sums[1] += if behind < length { amount } else { 0.0 };
        }
    }
    sums
}

#[test]
fn passages_have_the_integral_of_the_oracles_densities() {
    let origin = DVec3::new(0.2, -0.1, 0.4);
    for filter in [GridFilter::Linear, GridFilter::Nearest] {
        let grid = grid(filter);
        let mut pcg = Pcg::new(9);
        let mut rays: Vec<Ray> = (0..300)
            .map(|_| {
                let o = DVec3::from_array([0, 1, 2].map(|_| 1.4 * pcg.uniform() - 0.7));
                Ray { o: vec3(o), share: pcg.uniform() as f32, d: vec3(direction(&mut pcg)), pad: 0 }
            })
            .collect();
        // Along the axes of the grid.
        let axes = DVec3::AXES.map(|axis| grid.transform.transform_vector3(axis));
        rays.extend(axes.map(|d| Ray { d: vec3(d), ..rays[0] }));
        rays.extend(axes.map(|d| Ray { d: vec3(-d), ..rays[1] }));
        let found: Vec<[f32; 8]> = PASSAGE.run(&rays, &buffers(&grid, origin));
        let (mut crossed, mut wrong_factor) = (0, 0);
        for (ray, [first, last, integral, length, density, reached, has_grid, _]) in rays.iter().zip(found) {
            let o = dvec(&ray.o) + origin;
            let [whole, part] = march(&grid, o, dvec(&ray.d), length.into());
            let off = |truth: f64| (f64::from(integral) - truth).abs() > 1e-3;
            assert!(has_grid == 1.0 && !off(whole), "{filter:?} {ray:?}: {integral}, {whole}");
            wrong_factor += u32::from(off(1.01 * whole));
            if first < last {
                crossed += 1;
                let wanted = f64::from(ray.share) * whole;
                assert!((part - wanted).abs() < 2e-3, "{filter:?} {ray:?}: {part} after {length}, {wanted}");
                assert!((f64::from(reached) - wanted).abs() < 1e-3, "{filter:?} {ray:?}: {reached}, {wanted}");
            }
            // A point at the face of a voxel may be rounded to either side.
            let expected = [-1e-5, 0.0, 1e-5].map(|shift| PreparedGrid::new(&grid).density(o + shift * dvec(&ray.d)));
            assert!(
                expected.iter().any(|e| (e - f64::from(density)).abs() < 1e-3),
                "{filter:?} {ray:?}: {density}, {expected:?}"
            );
        }
        assert!(
            crossed > 150 && wrong_factor > 50,
            "{crossed} rays in the grid; {wrong_factor} reject a wrong density"
        );
    }
}
