//! Entries of the zip: arrays of 64-bit floats in NumPy's format, and texts.

use std::io::{self, Read, Seek, Write};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::file::Problem;
use crate::image::npy_file::header;
use crate::image::npy_read::{read_header, shape};

/// Maximum size of a text in bytes.
const MAX_TEXT: u64 = 64 << 20;
/// Number of values that are converted at a time.
const CHUNK: usize = 1 << 13;
/// Entries of this size in bytes, or larger, need the 64-bit extension of the zip format.
const LARGE: u64 = u32::MAX as u64;

pub type Archive<'a, R> = ZipArchive<&'a mut R>;

/// Begins an entry of `bytes` bytes. All entries have the same date, so that equal sums give equal files.
pub fn start(zip: &mut ZipWriter<impl Write + Seek>, name: &str, bytes: u64) -> io::Result<()> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .large_file(bytes >= LARGE);
    Ok(zip.start_file(name, options)?)
}

/// Writes an array of this shape.
pub fn array(
    zip: &mut ZipWriter<impl Write + Seek>,
    name: &str,
    shape: &[usize],
    values: impl IntoIterator<Item = f64>,
) -> io::Result<()> {
    let header = header("<f8", shape);
    let bytes = header.len() as u64 + 8 * shape.iter().product::<usize>() as u64;
    start(zip, &format!("{name}.npy"), bytes)?;
    zip.write_all(&header)?;
    let mut values = values.into_iter();
    let mut chunk: Vec<u8> = Vec::with_capacity(8 * CHUNK);
    loop {
        chunk.clear();
        chunk.extend(values.by_ref().take(CHUNK).flat_map(f64::to_le_bytes));
        if chunk.is_empty() {
            return Ok(());
        }
        zip.write_all(&chunk)?;
    }
}

/// The bytes of a small entry.
pub fn text<R: Read + Seek>(zip: &mut Archive<R>, name: &str) -> Result<Vec<u8>, Problem> {
    let entry = zip.by_name(name).map_err(|_| Problem::Contents(format!("it has no {name}")))?;
    let mut text = vec![];
    entry.take(MAX_TEXT).read_to_end(&mut text)?;
    Ok(text)
}

/// Reads an array. Fails unless it has this shape and finite values.
pub fn values<R: Read + Seek>(zip: &mut Archive<R>, name: &str, wanted: &[usize]) -> Result<Vec<f64>, Problem> {
    let (found, values) = any_values(zip, name, |found| found == wanted)?;
    debug_assert_eq!(found, wanted);
    finite(name, values)
}

/// Fails if a value is not finite.
pub fn finite(name: &str, values: Vec<f64>) -> Result<Vec<f64>, Problem> {
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(values),
        false => Err(not_finite(name)),
    }
}

pub fn not_finite(name: &str) -> Problem {
    Problem::Contents(format!("its array {name} has values that are not finite"))
}

/// Reads an array with a shape that `is_wanted`.
pub fn any_values<R: Read + Seek>(
    zip: &mut Archive<R>,
    name: &str,
    is_wanted: impl Fn(&[usize]) -> bool,
) -> Result<(Vec<usize>, Vec<f64>), Problem> {
    let mut all = vec![];
    let shape = visit_values(zip, name, is_wanted, |values| all.extend_from_slice(values))?;
    Ok((shape, all))
}

/// Reads an array with a shape that `is_wanted`, and returns the shape. `visit` receives the values part by part, in order.
pub fn visit_values<R: Read + Seek>(
    zip: &mut Archive<R>,
    name: &str,
    is_wanted: impl Fn(&[usize]) -> bool,
    mut visit: impl FnMut(&[f64]),
) -> Result<Vec<usize>, Problem> {
    let wrong = |what: &str| Problem::Contents(format!("its array {name} {what}"));
    let mut entry = zip.by_name(&format!("{name}.npy")).map_err(|_| wrong("is missing or cannot be unpacked"))?;
    if entry.compression() != CompressionMethod::Stored {
        return Err(wrong("is compressed"));
    }
    let (length, stored) = (entry.size(), entry.compressed_size());
    let (text, data_at) = read_header(&mut entry)?.ok_or_else(|| wrong("is not a NumPy array"))?;
    let shape = shape(&text, "<f8").map_err(|problem| wrong(&format!("cannot be used: {problem}")))?;
    // Compare the sizes before memory is allocated: a header could claim more than the file holds.
    let bytes = shape.iter().try_fold(8u64, |product, &side| product.checked_mul(side as u64));
    let fits = bytes.and_then(|bytes| bytes.checked_add(data_at)) == Some(length) && length == stored;
    if !fits || !is_wanted(&shape) {
        return Err(wrong(&format!("has the shape {shape:?}, which does not fit the image")));
    }
    let mut values = Vec::with_capacity(CHUNK);
    let mut chunk = vec![0; 8 * CHUNK];
    let mut left = (length - data_at) as usize;
    while left > 0 {
        let part = &mut chunk[..left.min(8 * CHUNK)];
        entry.read_exact(part)?;
        values.clear();
        values.extend(part.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes)));
        visit(&values);
        left -= part.len();
    }
    // Reads to the end, where the check sum is compared.
    if entry.read(&mut [0])? != 0 {
        return Err(wrong("is longer than its header says"));
    }
    Ok(shape)
}
