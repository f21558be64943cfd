//! The density grid of `[medium]`.

use glam::{DAffine3, DMat3, DVec3};

use crate::scene::{DensityGrid, GridFilter, grid};
use crate::settings::Filter;
use crate::settings::numbers::Numbers;
use crate::settings::table::MediumTable;

/// The grid of `table`, if the user gave one. `bounds` are its corners before the transform; they replace the corners in the file.
/// Fails with one sentence if the file is no grid, or if a setting has no effect.
pub(super) fn grid(table: &MediumTable, bounds: Option<[DVec3; 2]>) -> Result<Option<DensityGrid>, String> {
    let Some(path) = &table.density_grid else {
        let settings =
            [("--grid-filter", table.grid_filter.is_some()), ("--grid-transform", table.grid_transform.is_some())];
        return match settings.iter().find(|(_, given)| *given) {
            Some((flag, _)) => Err(format!("{flag} needs --density-grid: give the file, or remove {flag}")),
            None => Ok(None),
        };
    };
    let loaded = grid::load(path, bounds).map_err(|e| e.to_string())?;
    let filter = match table.grid_filter.unwrap_or(Filter::Linear) {
        Filter::Linear => GridFilter::Linear,
        Filter::Nearest => GridFilter::Nearest,
    };
    let transform = table.grid_transform.map_or(DAffine3::IDENTITY, |Numbers(rows)| affine(rows));
    Ok(Some(DensityGrid { filter, transform, ..loaded }))
}

/// The map with these rows of a 3 x 4 matrix.
fn affine(rows: [f64; 12]) -> DAffine3 {
    let column = |i: usize| DVec3::new(rows[i], rows[4 + i], rows[8 + i]);
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::experiment::Experiment;

    /// The grid of `[medium]` with these keys. `DIR` stands for a folder with a grid of two voxels in both formats.
    fn read(keys: &str) -> Result<Option<DensityGrid>, String> {
        let folder = tempfile::tempdir().unwrap();
        let mut vol = b"VOL\x03".to_vec();
        vol.extend([1, 2, 1, 1, 1].into_iter().flat_map(i32::to_le_bytes));
        vol.extend([0.0f32, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 0.25].into_iter().flat_map(f32::to_le_bytes));
        std::fs::write(folder.path().join("a.vol"), &vol).unwrap();
        std::fs::write(folder.path().join("short.vol"), &vol[..50]).unwrap();
        let mut npy = b"\x93NUMPY\x01\x00\x40\x00".to_vec();
        npy.extend(format!("{:63}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 2), }").bytes());
        npy.extend([0.5f32, 0.25].into_iter().flat_map(f32::to_le_bytes));
        std::fs::write(folder.path().join("a.npy"), npy).unwrap();
        let keys = keys.replace("DIR", folder.path().to_str().unwrap());
        let experiment = Experiment::parse(&format!("[medium]\n{keys}")).map_err(|e| e.to_string())?;
        assert_eq!(Experiment::parse(&experiment.to_toml()).unwrap(), experiment, "{}", experiment.to_toml());
        let table = &experiment.medium.one;
        grid(table, table.medium_bounds.map(|bounds| bounds.0.map(DVec3::from)))
    }

    #[test]
    fn a_grid_has_the_bounds_the_filter_and_the_transform_of_the_user() {
        let plain = read("density-grid = 'DIR/a.vol'").unwrap().unwrap();
        assert_eq!(
            (plain.resolution, plain.density.as_slice(), plain.filter),
            ([2, 1, 1], &[0.5, 0.25][..], GridFilter::Linear)
        );
        let keys = "density-grid = 'DIR/a.npy'\ngrid-filter = 'nearest'\nmedium-bounds = [[0, 0, 0], [1, 2, 3]]\n\
                    grid-transform = [2, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7]";
        let placed = read(keys).unwrap().unwrap();
        assert_eq!((placed.density, placed.filter), (plain.density, GridFilter::Nearest));
        assert_eq!(placed.transform.transform_point3(placed.bounds[1]), DVec3::new(7.0, 8.0, 10.0));
        assert_eq!(read("sigma_s = 1").unwrap(), None);
    }

    #[test]
    fn mistakes_name_the_remedy() {
        for (keys, part) in [
            ("density-grid = 'DIR/a.npy'", "give the box of the grid"),
            ("density-grid = 'DIR/short.vol'", "should have 8 bytes of densities, but has 2"),
            ("density-grid = 'DIR/absent.vol'", "check the name"),
            ("density-grid = 'DIR/a.vdb'", "use a .vol or .npy file"),
            ("grid-filter = 'cubic'\ndensity-grid = 'DIR/a.vol'", "choose linear or nearest"),
            ("grid-filter = 'nearest'", "--grid-filter needs --density-grid"),
            ("grid-transform = [1, 2]", "not a list of 12 numbers"),
        ] {
            let message = read(keys).expect_err(keys);
            assert!(message.contains(part), "{keys}: {message}");
        }
    }
}
