//! Mitsuba's `.vol` files: "VOL", u8 version 3, i32 encoding (1: f32), i32 nx, ny, nz and channels, six f32 bounds, then the
//! densities with x fastest. All numbers are little-endian.

use glam::{DVec3, Vec3};

use super::{Checked, Contents, ONE_DENSITY, check_length};

/// Length of the header in bytes.
const HEADER: usize = 48;

pub fn read(bytes: &[u8]) -> Checked<Contents> {
    let Some((header, data)) = bytes.split_at_checked(HEADER).filter(|(header, _)| header.starts_with(b"VOL")) else {
        return Err("is not a Mitsuba volume, or is truncated; export it again".into());
    };
    if header[3] != 3 {
        return Err(format!("is a Mitsuba volume of version {}; export it as version 3", header[3]));
    }
    let word = |i: usize| <[u8; 4]>::try_from(&header[4 + 4 * i..8 + 4 * i]).expect("4 bytes");
    let [encoding, nx, ny, nz, channels] = [0, 1, 2, 3, 4].map(|i| i32::from_le_bytes(word(i)));
    if encoding != 1 {
        return Err(format!("has densities of encoding {encoding}; export them as 32-bit floats (encoding 1)"));
    }
    if channels != 1 {
        return Err(format!("has {channels} channels; {ONE_DENSITY}"));
    }
    // A negative number of voxels counts as 0, which is refused.
    let resolution = [nx, ny, nz].map(|n| u32::try_from(n).unwrap_or(0));
    check_length(data, resolution, 4)?;
    let corner = |i: usize| -> DVec3 { Vec3::from([i, i + 1, i + 2].map(|k| f32::from_le_bytes(word(k)))).as_dvec3() };
    let density = data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    Ok(Contents { resolution, density, bounds: Some([corner(5), corner(8)]) })
}
