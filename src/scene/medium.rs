//! Participating media (fog, smoke, water): coefficients, phase functions and density grids, and the range of each number.

use std::ops::RangeInclusive;

use glam::{DAffine3, DVec3};

use super::check::{Checked, MAX_COORDINATE, is_singular};
use super::corners;

/// Upper bound on scattering and absorption coefficients, per metre.
pub const MAX_COEFFICIENT: f64 = 1e15;
/// Upper bound on |g|, the mean cosine of a lobe: the cosines of narrower lobes exceed the precision of the device.
pub const MAX_MEAN_COSINE: f64 = 0.999;
/// Upper bound on the index of refraction and on the group index.
pub const MAX_INDEX: f32 = 5.0;
/// Smallest step between the cosines of a table. The device stores cosines as 32-bit floats.
const MIN_STEP: f64 = 1e-6;
/// Upper bound on the number of voxels of a grid: 2 GiB of densities.
pub const MAX_VOXELS: u64 = 1 << 29;

/// A medium that scatters and absorbs light. Lengths are in metres and world space.
///
/// Media of [`Scene::media`](super::Scene::media) fill the space outside of transmissive solids. Where several overlap, only
/// the last one in the list counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Medium {
    /// Scattering coefficient per metre for red, green and blue, in [0, 1e15].
    pub sigma_s: [f64; 3],
    /// Absorption coefficient per metre for red, green and blue, in [0, 1e15].
    pub sigma_a: [f64; 3],
    /// Distribution of the directions after scattering.
    pub phase: PhaseFunction,
    /// Index of refraction, from 1 to 5. A value other than 1 needs an unbounded medium, because bounds do not refract light. The
    /// relative index at the surface of a solid in the medium is then the solid's index over `ior`.
    pub ior: f32,
    /// Group index, from 1 to 5: it multiplies distances in the travel time. Like `ior`, it is 1 unless the medium is unbounded.
    pub group_ior: f32,
    /// Lower and upper corner of an axis-aligned box in world space. Outside the box the medium is absent. `None`: no limit.
    pub bounds: Option<[DVec3; 2]>,
    /// Density that multiplies both coefficients. Outside the grid the medium is absent.
    pub grid: Option<DensityGrid>,
}

/// Clear air: no scattering, no absorption, everywhere.
impl Default for Medium {
    fn default() -> Medium {
        Medium {
            sigma_s: [0.0; 3],
            sigma_a: [0.0; 3],
            phase: PhaseFunction::Isotropic,
            ior: 1.0,
            group_ior: 1.0,
            bounds: None,
            grid: None,
        }
    }
}

/// Index of refraction and group index outside of transmissive solids: those of the last medium that fills all space.
pub fn surrounding_indices(media: &[Medium]) -> [f32; 2] {
    let water = media.iter().rev().find(|medium| medium.is_unbounded());
    water.map_or([1.0; 2], |medium| [medium.ior, medium.group_ior])
}

/// Density of scattered light per steradian, as a function of the cosine between the directions of travel before and after
/// scattering. The cosine is 1 for light that goes straight on. All phase functions integrate to 1 over the sphere.
#[derive(Debug, Clone, PartialEq)]
pub enum PhaseFunction {
    /// The same in all directions.
    Isotropic,
    /// Henyey and Greenstein 1941.
    HenyeyGreenstein {
        /// Mean cosine, from -0.999 to 0.999; positive values scatter forwards.
        g: f64,
    },
    /// A mixture of two Henyey-Greenstein lobes.
    DoubleHenyeyGreenstein {
        /// Mean cosines of the lobes, each from -0.999 to 0.999.
        g: [f64; 2],
        /// Weight of the first lobe, in [0, 1].
        weight: f64,
    },
    /// A mixture of a Henyey-Greenstein lobe and a lobe of Draine 2003, which fits water droplets (Jendersie and d'Eon 2023).
    HenyeyGreensteinDraine {
        /// Mean cosine of the Henyey-Greenstein lobe, from -0.999 to 0.999.
        g: f64,
        /// Parameter g of the Draine lobe, from -0.999 to 0.999.
        g_draine: f64,
        /// Parameter alpha of the Draine lobe, >= 0.
        alpha: f64,
        /// Weight of the Draine lobe, in [0, 1].
        weight_draine: f64,
    },
    /// Particles much smaller than the wavelength: 3 / (16 pi) (1 + cos^2).
    Rayleigh,
    /// Values at some cosines, linear in the cosine between them.
    Table {
        /// Strictly increasing from -1 to 1, at least two.
        cosines: Vec<f64>,
        /// One per cosine, >= 0 and not all 0. Their scale has no effect.
        values: Vec<f64>,
    },
}

/// Densities on a regular grid of voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityGrid {
    /// Number of voxels along x, y and z; each at least 1.
    pub resolution: [u32; 3],
    /// One density per voxel, >= 0. Voxel (x, y, z) has index x + nx (y + ny z).
    pub density: Vec<f32>,
    /// Lower and upper corner of the grid in its own space, in metres.
    pub bounds: [DVec3; 2],
    /// World from grid space.
    pub transform: DAffine3,
    /// Density between the centres of voxels.
    pub filter: GridFilter,
}

/// How a grid continues between the centres of its voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GridFilter {
    /// Trilinear between centres; constant from the outermost centres to the edge of the grid.
    #[default]
    Linear,
    /// Constant in each voxel.
    Nearest,
}

impl Medium {
    /// Whether the medium has neither bounds nor a grid.
    pub fn is_unbounded(&self) -> bool {
        self.bounds.is_none() && self.grid.is_none()
    }

    /// Lower and upper corner of a box in world space that contains the medium. `None`: no limit.
    pub fn extent(&self) -> Option<[DVec3; 2]> {
        let grid = self.grid.as_ref().map(DensityGrid::extent);
        match (self.bounds, grid) {
            (Some([lo, hi]), Some([grid_lo, grid_hi])) => {
                let lo = lo.max(grid_lo);
                // If the bounds and the grid do not overlap, the box is empty.
                Some([lo, hi.min(grid_hi).max(lo)])
            }
            (bounds, grid) => bounds.or(grid),
        }
    }

    /// Fails with one sentence if a number is out of range. `name` names the medium in the message.
    #[doc(hidden)]
    pub fn check(&self, name: &str) -> Checked {
        for (what, sigma) in [("sigma_s", self.sigma_s), ("sigma_a", self.sigma_a)] {
            sigma.iter().try_for_each(|&x| within(x, 0.0..=MAX_COEFFICIENT, &format!("{name} has a {what}")))?;
        }
        self.phase.check(name)?;
        for (what, index) in [("an ior", self.ior), ("a group_ior", self.group_ior)] {
            if !(1.0..=MAX_INDEX).contains(&index) {
                return Err(format!("{name} has {what} of {index}; it must be from 1 to {MAX_INDEX}"));
            }
            if index != 1.0 && !self.is_unbounded() {
                return Err(format!(
                    "{name} has {what} of {index} and a limited extent; remove its bounds and its grid, or set the index to 1"
                ));
            }
        }
        if let Some(bounds) = &self.bounds {
            check_bounds(bounds, name, "bounds")?;
        }
        self.grid.as_ref().map_or(Ok(()), |grid| grid.check(name))
    }

    /// As [`Medium::check`], for the medium inside a closed mesh. The mesh determines the extent, and the material of the mesh
    /// the index of refraction.
    pub(super) fn check_interior(&self, name: &str) -> Checked {
        self.check(name)?;
        if self.bounds.is_some() {
            return Err(format!("{name} has bounds, but the mesh bounds it already; remove them"));
        }
        if self.ior != 1.0 || self.group_ior != 1.0 {
            return Err(format!("{name} has an ior or a group_ior; set the ior of the material instead"));
        }
        Ok(())
    }
}

impl PhaseFunction {
    fn check(&self, name: &str) -> Checked {
        let part = |what: &str| format!("{name} has a phase function with {what}");
        let mean_cosine = |g: f64| match g.abs() <= MAX_MEAN_COSINE {
            true => Ok(()),
            false => Err(format!(
                "{}; it must be from -{MAX_MEAN_COSINE} to {MAX_MEAN_COSINE}",
                part(&format!("a g of {g}"))
            )),
        };
        match self {
            PhaseFunction::Isotropic | PhaseFunction::Rayleigh => Ok(()),
            PhaseFunction::HenyeyGreenstein { g } => mean_cosine(*g),
            PhaseFunction::DoubleHenyeyGreenstein { g, weight } => {
                g.iter().try_for_each(|&g| mean_cosine(g))?;
                within(*weight, 0.0..=1.0, &part("a weight"))
            }
            PhaseFunction::HenyeyGreensteinDraine { g, g_draine, alpha, weight_draine } => {
                [*g, *g_draine].into_iter().try_for_each(mean_cosine)?;
                within(*alpha, 0.0..=MAX_COEFFICIENT, &part("an alpha"))?;
                within(*weight_draine, 0.0..=1.0, &part("a weight"))
            }
            PhaseFunction::Table { cosines, values } => check_table(cosines, values, name),
        }
    }
}

impl DensityGrid {
    /// Lower and upper corner of the smallest box in world space that contains the grid.
    fn extent(&self) -> [DVec3; 2] {
        let corners = corners(self.bounds, &self.transform);
        corners.iter().fold([corners[0]; 2], |[lo, hi], &p| [lo.min(p), hi.max(p)])
    }

    /// As [`Medium::check`], for a grid alone.
    pub(super) fn check(&self, name: &str) -> Checked {
        let [nx, ny, nz] = self.resolution;
        let voxels = voxel_count(self.resolution).map_err(|why| format!("{name} has a grid that {why}"))?;
        if self.density.len() as u64 != voxels {
            let found = self.density.len();
            return Err(format!("{name} has a grid of {nx} x {ny} x {nz} voxels, but {found} densities"));
        }
        if let Some(wrong) = self.density.iter().find(|d| !(d.is_finite() && **d >= 0.0)) {
            return Err(format!("{name} has a grid with a density of {wrong}; densities must be 0 or more"));
        }
        if is_singular(&self.transform) || !self.transform.is_finite() {
            return Err(format!(
                "{name} has a grid whose transform is not finite or flattens it; give an invertible matrix"
            ));
        }
        check_bounds(&self.bounds, name, "bounds of its grid")?;
        check_distance(&corners(self.bounds, &self.transform), name, "a grid that reaches")
    }
}

/// Number of voxels of a grid with this resolution. The error completes the sentence "the grid ...".
pub fn voxel_count(resolution: [u32; 3]) -> Result<u64, String> {
    let [nx, ny, nz] = resolution;
    let voxels = resolution.into_iter().try_fold(1u64, |product, n| product.checked_mul(n.into()));
    match voxels {
        Some(0) => Err(format!("is empty ({nx} x {ny} x {nz} voxels); give at least one voxel")),
        Some(voxels) if voxels <= MAX_VOXELS => Ok(voxels),
        _ => Err(format!("has {nx} x {ny} x {nz} voxels, more than {} million; use fewer voxels", MAX_VOXELS >> 20)),
    }
}

/// An error if `x` is not in `range`. `what` is the beginning of the sentence.
fn within(x: f64, range: RangeInclusive<f64>, what: &str) -> Checked {
    if range.contains(&x) {
        return Ok(());
    }
    Err(format!("{what} of {x}; it must be from {} to {:e}", range.start(), range.end()))
}

fn check_table(cosines: &[f64], values: &[f64], name: &str) -> Checked {
    let wrong = |what: String| Err(format!("{name} has a table as phase function that {what}"));
    if cosines.len() != values.len() {
        return wrong(format!("has {} cosines and {} values; give one value per cosine", cosines.len(), values.len()));
    }
    let increases = cosines.is_sorted_by(|a, b| b - a >= MIN_STEP);
    if !increases || cosines.len() < 2 || cosines[0] != -1.0 || cosines[cosines.len() - 1] != 1.0 {
        return wrong(format!(
            "lacks cosines that increase from -1 to 1 in steps of at least {MIN_STEP}; sort them and add both ends"
        ));
    }
    if let Some(value) = values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
        return wrong(format!("has a value of {value}; values must be 0 or more"));
    }
    if values.iter().all(|&v| v == 0.0) {
        return wrong("is 0 everywhere; give at least one positive value".into());
    }
    Ok(())
}

/// An error if a corner has a coordinate above [`MAX_COORDINATE`].
fn check_distance(corners: &[DVec3], name: &str, what: &str) -> Checked {
    match corners.iter().flat_map(DVec3::to_array).all(|x| x.abs() <= MAX_COORDINATE) {
        true => Ok(()),
        false => Err(format!("{name} has {what} farther than {MAX_COORDINATE:e} m from the origin")),
    }
}

/// Fails if `bounds` are not two opposite corners of a box, first the smaller coordinates. `name` and `what` name them in the message.
pub(crate) fn check_bounds(bounds: &[DVec3; 2], name: &str, what: &str) -> Checked {
    check_distance(bounds, name, what)?;
    let [lo, hi] = bounds;
    match lo.cmplt(*hi).all() {
        true => Ok(()),
        false => Err(format!("{name} has {what} whose first corner is not below the second; swap the coordinates")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> DensityGrid {
        let (bounds, transform) = ([DVec3::ZERO, DVec3::ONE], DAffine3::IDENTITY);
        DensityGrid { resolution: [2, 1, 1], density: vec![0.5; 2], bounds, transform, filter: GridFilter::Linear }
    }

    fn draine(alpha: f64, weight_draine: f64) -> PhaseFunction {
        PhaseFunction::HenyeyGreensteinDraine { g: 0.9, g_draine: 0.5, alpha, weight_draine }
    }

    fn table(cosines: &[f64], values: &[f64]) -> PhaseFunction {
        PhaseFunction::Table { cosines: cosines.to_vec(), values: values.to_vec() }
    }

    #[test]
    fn good_media_pass() {
        let phases = [
            PhaseFunction::Isotropic,
            PhaseFunction::Rayleigh,
            PhaseFunction::HenyeyGreenstein { g: -0.999 },
            PhaseFunction::DoubleHenyeyGreenstein { g: [0.9, -0.4], weight: 1.0 },
            draine(0.0, 0.0),
            table(&[-1.0, 0.0, 1.0], &[1.0, 0.0, 3.0]),
        ];
        for phase in phases {
            let medium = Medium { sigma_s: [0.0, 0.1, 1e15], phase, grid: Some(grid()), ..Medium::default() };
            assert_eq!(medium.check("fog"), Ok(()));
        }
        let water = Medium { ior: 1.33, group_ior: 1.35, ..Medium::default() };
        assert_eq!(water.check("water"), Ok(()));
        assert!(water.check_interior("water").unwrap_err().contains("set the ior of the material"));
    }

    type Change = fn(&mut Medium);

    #[test]
    fn a_medium_that_breaks_a_rule_is_refused() {
        let changes: [(&str, Change); 29] = [
            ("fog has a sigma_s of -1; it must be from 0", |m| m.sigma_s[1] = -1.0),
            ("fog has a sigma_a of NaN", |m| m.sigma_a[0] = f64::NAN),
            ("fog has a sigma_a of inf", |m| m.sigma_a[2] = f64::INFINITY),
            ("a g of 1; it must be from", |m| m.phase = PhaseFunction::HenyeyGreenstein { g: 1.0 }),
            ("a g of 0.9999;", |m| m.phase = PhaseFunction::HenyeyGreenstein { g: 0.9999 }),
            ("a g of NaN", |m| m.phase = PhaseFunction::HenyeyGreenstein { g: f64::NAN }),
            ("a g of -2", |m| m.phase = PhaseFunction::DoubleHenyeyGreenstein { g: [0.0, -2.0], weight: 0.5 }),
            ("a weight of 1.5", |m| m.phase = PhaseFunction::DoubleHenyeyGreenstein { g: [0.0; 2], weight: 1.5 }),
            ("an alpha of -1", |m| m.phase = draine(-1.0, 0.5)),
            ("a weight of -0.5", |m| m.phase = draine(1.0, -0.5)),
            ("2 cosines and 1 values", |m| m.phase = table(&[-1.0, 1.0], &[1.0])),
            ("increase from -1 to 1", |m| m.phase = table(&[-1.0, 0.5, 0.5, 1.0], &[1.0; 4])),
            ("increase from -1 to 1", |m| m.phase = table(&[-0.5, 1.0], &[1.0; 2])),
            ("increase from -1 to 1", |m| m.phase = table(&[], &[])),
            ("a value of -1", |m| m.phase = table(&[-1.0, 1.0], &[1.0, -1.0])),
            ("is 0 everywhere", |m| m.phase = table(&[-1.0, 1.0], &[0.0; 2])),
            ("an ior of 0.9; it must be from 1 to 5", |m| m.ior = 0.9),
            ("an ior of inf", |m| m.ior = f32::INFINITY),
            ("a group_ior of NaN", |m| m.group_ior = f32::NAN),
            ("an ior of 1.33 and a limited extent", |m| m.ior = 1.33),
            ("bounds whose first corner", |m| m.bounds = Some([DVec3::ONE, DVec3::new(2.0, 0.0, 2.0)])),
            ("bounds farther than", |m| m.bounds = Some([DVec3::ZERO, DVec3::new(1.0, f64::NAN, 1.0)])),
            ("a grid that is empty (2 x 0 x 1", |m| m.grid = Some(DensityGrid { resolution: [2, 0, 1], ..grid() })),
            ("more than 512 million", |m| m.grid = Some(DensityGrid { resolution: [u32::MAX; 3], ..grid() })),
            ("but 2 densities", |m| m.grid = Some(DensityGrid { resolution: [2, 2, 1], ..grid() })),
            ("a density of NaN", |m| m.grid = Some(DensityGrid { density: vec![1.0, f32::NAN], ..grid() })),
            ("a density of -1", |m| m.grid = Some(DensityGrid { density: vec![-1.0, 1.0], ..grid() })),
            ("transform is not finite or flattens", |m| {
                m.grid = Some(DensityGrid { transform: DAffine3::from_scale(DVec3::X), ..grid() });
            }),
            ("a grid that reaches farther than", |m| {
                m.grid = Some(DensityGrid { transform: DAffine3::from_scale(DVec3::splat(1e16)), ..grid() });
            }),
        ];
        for (part, change) in changes {
            let mut medium = Medium { bounds: Some([DVec3::ZERO, DVec3::ONE]), ..Medium::default() };
            change(&mut medium);
            let message = medium.check("fog").expect_err(part);
            assert!(message.starts_with("fog has") && message.contains(part), "{part}: {message}");
        }
        let boxed = Medium { bounds: Some([DVec3::ZERO, DVec3::ONE]), ..Medium::default() };
        assert!(boxed.check_interior("fog").unwrap_err().contains("the mesh bounds it already"));
    }
}
