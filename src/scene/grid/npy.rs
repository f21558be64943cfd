//! NumPy's `.npy` files, versions 1 to 3: an array of shape (nz, ny, nx) or (nz, ny, nx, 1) of 32-bit or 64-bit floats.
//!
//! The crates for this format (`npyz`, `ndarray-npy`) parse the header as Python. That needs a parser generator, and a C
//! compiler at build time. NumPy itself writes the header in one form only, and the few lines here read this form.

use super::{Checked, Contents, MAX_HEADER, ONE_DENSITY, check_length};

pub fn read(bytes: &[u8]) -> Checked<Contents> {
    let truncated = || "is not a NumPy array, or is truncated; save it again".to_string();
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(truncated)?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(truncated)?;
    let (length, rest) = match version[0] {
        1 => rest.split_first_chunk().map(|(n, rest)| (u64::from(u16::from_le_bytes(*n)), rest)),
        2 | 3 => rest.split_first_chunk().map(|(n, rest)| (u64::from(u32::from_le_bytes(*n)), rest)),
        other => return Err(format!("is a NumPy file of version {other}; save it with numpy.save")),
    }
    .ok_or_else(truncated)?;
    if length > MAX_HEADER {
        return Err(format!("has a header of {length} bytes; save it with numpy.save"));
    }
    let (header, data) = rest.split_at_checked(length as usize).ok_or_else(truncated)?;
    let header = std::str::from_utf8(header).map_err(|_| truncated())?;

    if value(header, "fortran_order").is_none_or(|order| !order.starts_with("False")) {
        return Err("is not in C order; save numpy.ascontiguousarray(grid)".into());
    }
    let resolution = shape(header)?;
    let kind = value(header, "descr").and_then(|text| text.strip_prefix('\'')?.split('\'').next());
    let density = match kind {
        Some("<f4") => {
            check_length(data, resolution, 4)?;
            data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
        }
        Some("<f8") => {
            check_length(data, resolution, 8)?;
            data.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes) as f32).collect()
        }
        _ => return Err("is not an array of little-endian floats; save grid.astype('<f4')".into()),
    };
    Ok(Contents { resolution, density, bounds: None })
}

/// The text after `'key':` in the header.
fn value<'h>(header: &'h str, key: &str) -> Option<&'h str> {
    let (_, after) = header.split_once(&format!("'{key}'"))?;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

/// The number of voxels along x, y and z.
fn shape(header: &str) -> Checked<[u32; 3]> {
    let tuple = value(header, "shape").and_then(|text| Some(text.strip_prefix('(')?.split_once(')')?.0));
    let numbers = tuple.map(|tuple| {
        let numbers = tuple.split(',').map(str::trim).filter(|number| !number.is_empty());
        numbers.map(str::parse).collect::<Result<Vec<u32>, _>>()
    });
    match numbers.as_ref().map(|numbers| numbers.as_deref()) {
        Some(Ok(&[z, y, x] | &[z, y, x, 1])) => Ok([x, y, z]),
        Some(Ok(&[_, _, _, channels])) => Err(format!("has {channels} values per voxel; {ONE_DENSITY}")),
        _ => Err("has another shape than (nz, ny, nx); save one density per voxel".into()),
    }
}
