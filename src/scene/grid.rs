//! Reads density grids from files: Mitsuba's `.vol` and NumPy's `.npy`.
//!
//! Both readers compare the header with the length of the file before they allocate memory.

mod npy;
mod vol;

use std::path::Path;

use glam::{DAffine3, DVec3};

use super::medium::{DensityGrid, GridFilter, MAX_VOXELS, voxel_count};
use crate::error::{Error, Result};

/// Largest header of a grid's file in bytes. Headers of `.npy` files are about 128 bytes long.
const MAX_HEADER: u64 = 1 << 16;

/// The remedy for a file with several values per voxel.
const ONE_DENSITY: &str = "save one density per voxel, such as the mean of the channels, and give the colour as three numbers in \
                           sigma_s and sigma_a";

/// The contents of a file, before it is placed in the scene.
#[derive(Debug, PartialEq)]
struct Contents {
    resolution: [u32; 3],
    /// x is fastest, as in [`DensityGrid::density`].
    density: Vec<f32>,
    /// Lower and upper corner in metres, if the file has them.
    bounds: Option<[DVec3; 2]>,
}

/// The error is one sentence that says why the file cannot be read; [`load`] adds the path.
type Checked<T> = std::result::Result<T, String>;

/// Reads a grid with one density per voxel from a `.vol` or `.npy` file; the extension selects the format. `bounds` are the
/// corners of the grid in metres: `.npy` files need them, and they replace the corners in a `.vol` file. The grid has no
/// transform, and a linear filter.
pub fn load(path: &Path, bounds: Option<[DVec3; 2]>) -> Result<DensityGrid> {
    let wrong = |message: String| Error::File { path: path.into(), message };
    let read = match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("vol") => vol::read,
        Some("npy") => npy::read,
        _ => return Err(wrong("is not a density grid; use a .vol or .npy file".into())),
    };
    let length = std::fs::metadata(path).map_err(|e| Error::io(path, "cannot be read; check the name", e))?.len();
    if length > 8 * MAX_VOXELS + MAX_HEADER {
        return Err(wrong(format!("is larger than {} GiB; use fewer voxels", MAX_VOXELS >> 27)));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "cannot be read; check the name", e))?;
    let contents = read(&bytes).map_err(wrong)?;
    let Some(bounds) = bounds.or(contents.bounds) else {
        return Err(wrong(
            "has no bounds of its own; give the box of the grid, with --medium-bounds, or with bounds in Python".into(),
        ));
    };
    let Contents { resolution, density, .. } = contents;
    let grid = DensityGrid { resolution, density, bounds, transform: DAffine3::IDENTITY, filter: GridFilter::Linear };
    grid.check("the file").map_err(wrong)?;
    Ok(grid)
}

/// An error unless `data` has exactly one value of `size` bytes per voxel. The message gives both numbers of bytes.
fn check_length(data: &[u8], resolution: [u32; 3], size: u64) -> Checked<()> {
    let voxels = voxel_count(resolution)?;
    match data.len() as u64 {
        found if found == voxels * size => Ok(()),
        found => Err(format!(
            "should have {} bytes of densities, but has {found}; copy or export the file again",
            voxels * size
        )),
    }
}

#[cfg(test)]
mod tests;
