//! Reads NumPy arrays (`.npy`) of the images of a render, with the JSON file beside them if there is one.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error};
use crate::image::array_set::{self, description};
use crate::image::npy_file::COUNTS;
use crate::settings::Response;

/// Maximum length of a header in bytes. NumPy writes 118 bytes for four sides.
const MAX_HEADER: usize = 4096;

/// The images of all responses of a render.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageArray {
    pub width: usize,
    pub height: usize,
    /// Number of responses; `None` for the array of a single image, which lacks this axis.
    pub responses: Option<usize>,
    /// Indexed by row, column, response and channel, the channel fastest. Row 0 is at the top.
    pub values: Vec<f32>,
}

impl ImageArray {
    /// Number of images: one per response.
    pub fn images(&self) -> usize {
        self.responses.unwrap_or(1)
    }

    /// R, G and B of each response in a pixel.
    pub fn pixel(&self, [x, y]: [usize; 2]) -> &[[f32; 3]] {
        let length = 3 * self.images();
        self.values[(y * self.width + x) * length..][..length].as_chunks().0
    }

    /// The image of a response: R, G, B interleaved, row 0 at the top.
    pub fn image(&self, response: usize) -> Vec<f32> {
        self.values.chunks_exact(3 * self.images()).flat_map(|pixel| pixel[3 * response..][..3].to_vec()).collect()
    }
}

/// The result of a scan, see [`crate::image::scan_file::ScanFilm`].
#[derive(Debug, Clone, PartialEq)]
pub struct ScanArray {
    /// Number of responses, then number of points, or number of points of the laser and of the sensor.
    pub shape: Vec<usize>,
    /// Indexed by response and pair of points, the pair the fastest. Pairs that were not measured are NaN.
    pub values: Vec<f32>,
}

impl ScanArray {
    /// Number of responses.
    pub fn responses(&self) -> usize {
        self.shape[0]
    }

    /// Number of pairs of points of laser and sensor.
    pub fn pairs(&self) -> usize {
        self.shape[1..].iter().product()
    }
}

/// A response as the JSON file beside an array describes it, with the names of the fields in that file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DescribedResponse {
    pub name: String,
    /// Begin and end of the gate in metres of optical path. The end is `None` for a gate without an end.
    pub gate_begin_m: f64,
    pub gate_end_m: Option<f64>,
    /// The integral of the weights over travel time in metres. `None` if it is infinite (a wave, or a gate without an end), or if an
    /// earlier version wrote the file.
    pub weight_integral_m: Option<f64>,
    /// The period of a pulsed laser, if the gate counts light of all its pulses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat_m: Option<f64>,
}

impl DescribedResponse {
    pub fn of(response: &Response) -> DescribedResponse {
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        DescribedResponse {
            name: response.name().into(),
            gate_begin_m: response.gate().lo,
            gate_end_m: finite(response.gate().hi),
            weight_integral_m: finite(response.integral()),
            repeat_m: response.period(),
        }
    }

    /// Begin and end of the gate in metres.
    pub fn gate(&self) -> [f64; 2] {
        [self.gate_begin_m, self.gate_end_m.unwrap_or(f64::INFINITY)]
    }

    /// The integral of the weights over travel time in metres. If the file does not say it, the gate is taken for a box.
    pub fn integral(&self) -> f64 {
        let [begin, end] = self.gate();
        self.weight_integral_m.unwrap_or(end - begin)
    }
}

#[derive(Deserialize)]
struct Described {
    responses: Vec<DescribedResponse>,
}

/// The responses of the array `path`, from the JSON file beside it; `None` if there is no such file or if it describes another
/// number of responses than `count`.
pub fn described(path: &Path, count: usize) -> Option<Vec<DescribedResponse>> {
    let responses = serde_json::from_value::<Described>(description(path)).ok()?.responses;
    (responses.len() == count).then_some(responses)
}

/// Whether the JSON file beside the array `path` says that the array holds counts of a detector.
pub fn is_counts(path: &Path) -> bool {
    description(path)["unit"] == COUNTS
}

/// Whether the JSON file beside the array `path` says that the array is a scan, or the counts of one.
pub fn is_scan(path: &Path) -> bool {
    description(path)["axes"].as_str().is_some_and(|axes| axes.starts_with("response"))
}

/// Reads an array of 32-bit floats of shape (height, width, 3) or (height, width, responses, 3). Fails if the file holds something
/// else, or fewer or more values than its shape says, or another array than the JSON file beside it describes.
pub fn read(path: &Path) -> Result<ImageArray> {
    Ok(read_channels(path, &[3])?.0)
}

/// As [`read`], also for an array with a single channel, as `detect --mono` writes it. This channel becomes R, G and B. Returns the
/// number of channels too, 1 or 3.
pub fn read_with_mono(path: &Path) -> Result<(ImageArray, usize)> {
    read_channels(path, &[1, 3])
}

/// Reads the array of a scan: 32-bit floats of shape (response, point) or (response, laser point, sensor point).
pub fn read_scan(path: &Path) -> Result<ScanArray> {
    let check = |shape: &[usize]| match shape.len() {
        2 | 3 => Ok(()),
        _ => Err(format!("its shape is {shape:?}, but a scan has two or three axes; measure it again")),
    };
    let (shape, values) = read_values(path, check)?;
    Ok(ScanArray { shape, values })
}

/// Reads an array whose number of channels is one of `allowed`, 1 or 3.
fn read_channels(path: &Path, allowed: &[usize]) -> Result<(ImageArray, usize)> {
    let sides = |shape: &[usize]| match *shape {
        [height, width, channels] if allowed.contains(&channels) => Some((height, width, None, channels)),
        [height, width, responses, channels] if allowed.contains(&channels) => {
            Some((height, width, Some(responses), channels))
        }
        _ => None,
    };
    let check = |shape: &[usize]| {
        // With three points of the sensor, a scan has the shape of an image.
        if is_scan(path) {
            let remedy = if is_counts(path) { "" } else { "give it to taugate detect, or " };
            return Err(format!("it is a scan, and no array of images; {remedy}read it in Python with numpy.load"));
        }
        sides(shape).map(drop).ok_or_else(|| {
            format!(
                "its shape is {shape:?}; an array of images has the shape (height, width, 3) or (height, width, responses, 3)"
            )
        })
    };
    let (shape, values) = read_values(path, check)?;
    let (height, width, responses, channels) = sides(&shape).expect("the shape was checked");
    let values = if channels == 1 { values.into_iter().flat_map(|x| [x; 3]).collect() } else { values };
    Ok((ImageArray { width, height, responses, values }, channels))
}

/// Reads the shape and the values of an array of 32-bit floats. Fails with the message of `check` if it refuses the shape.
fn read_values(
    path: &Path,
    check: impl Fn(&[usize]) -> std::result::Result<(), String>,
) -> Result<(Vec<usize>, Vec<f32>)> {
    let fail = |message: String| Error::File { path: path.into(), message };
    let length = check_readable(path)?;
    let mut file = File::open(path).map_err(|e| read_error(path, e))?;
    let (text, data_at) = read_header(&mut file).map_err(|e| read_error(path, e))?.ok_or_else(|| {
        fail("this is not a NumPy array; give a file that taugate render -o OUT.npy or numpy.save wrote".into())
    })?;
    let shape = shape(&text, "<f4").map_err(fail)?;
    check(&shape).map_err(fail)?;
    // Compare the sizes before memory is allocated: a header could claim more than the file holds.
    let needed_bytes = shape.iter().try_fold(4u64, |product, &side| product.checked_mul(side as u64));
    if needed_bytes.is_none_or(|bytes| bytes == 0 || bytes.checked_add(data_at) != Some(length)) {
        return Err(fail(format!("its shape {shape:?} does not fit its {length} bytes; write the file again")));
    }
    // The header belongs to the record of the file, too.
    let mut bytes = vec![];
    file.seek(SeekFrom::Start(0)).and_then(|_| file.read_to_end(&mut bytes)).map_err(|e| read_error(path, e))?;
    array_set::check(path, &bytes)?;
    let bytes = &bytes[(data_at as usize).min(bytes.len())..];
    let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    if values.len() != shape.iter().product::<usize>() {
        return Err(fail("it changed while it was read; read it again".into()));
    }
    Ok((shape, values))
}

/// The text of the header, and the position of the first value; `None` if the file is no `.npy` file.
pub(super) fn read_header(file: &mut impl Read) -> std::io::Result<Option<(String, u64)>> {
    let mut start = [0; 10];
    let is_whole = read_exactly(file, &mut start)?;
    if !is_whole || start[..6] != *b"\x93NUMPY" {
        return Ok(None);
    }
    // Version 1 stores the length of the header in two bytes, later versions in four.
    let (length, before) = match start[6] {
        1 => (usize::from(u16::from_le_bytes([start[8], start[9]])), 10),
        _ => {
            let mut high = [0; 2];
            if !read_exactly(file, &mut high)? {
                return Ok(None);
            }
            (u32::from_le_bytes([start[8], start[9], high[0], high[1]]) as usize, 12)
        }
    };
    let mut text = vec![0; length.min(MAX_HEADER)];
    let is_whole = length <= MAX_HEADER && read_exactly(file, &mut text)?;
    Ok(is_whole.then(|| (String::from_utf8_lossy(&text).into_owned(), (before + length) as u64)))
}

/// Fills `bytes`; false if the file ends before.
fn read_exactly(file: &mut impl Read, bytes: &mut [u8]) -> std::io::Result<bool> {
    match file.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        Err(e) => Err(e),
    }
}

/// The shape in a header such as `{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }`. Fails if the values are not of the
/// type `wanted`, `<f4` or `<f8`, in C order.
pub(super) fn shape(header: &str, wanted: &str) -> std::result::Result<Vec<usize>, String> {
    let convert = format!("convert it in Python with numpy.save(FILE, numpy.ascontiguousarray(ARRAY, '{wanted}'))");
    let bits = if wanted == "<f4" { 32 } else { 64 };
    let after = |key: &str| header.split_once(key).map(|(_, rest)| rest.trim_start());
    let kind = after("'descr':").and_then(|rest| rest.strip_prefix('\'')?.split_once('\'')).map(|(kind, _)| kind);
    match kind {
        Some(kind) if kind == wanted => {}
        Some(kind) => {
            return Err(format!("its values have the type '{kind}', not {bits}-bit floats '{wanted}'; {convert}"));
        }
        None => return Err(format!("its values are not plain numbers; {convert}")),
    }
    if !after("'fortran_order':").is_some_and(|rest| rest.starts_with("False")) {
        return Err(format!("its values are in Fortran order (column by column); {convert}"));
    }
    let sides = after("'shape':").and_then(|rest| rest.strip_prefix('(')?.split_once(')')).map(|(sides, _)| sides);
    let sides = sides.unwrap_or_default().split(',').map(str::trim).filter(|side| !side.is_empty());
    sides.map(|side| side.parse().map_err(|_| format!("its shape contains '{side}'; write the file again"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(bytes: &[u8]) -> Result<ImageArray> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    }

    fn file(version: u8, header: &str, values: &[f32]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.as_bytes());
        values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes
    }

    #[test]
    fn arrays_of_all_versions_are_read() {
        let values: Vec<f32> = (0..12).map(|i| i as f32).collect();
        for version in [1, 2, 3] {
            let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2, 2, 3), }\n";
            let array = written(&file(version, header, &values)).unwrap();
            assert_eq!((array.height, array.width, array.responses, array.images()), (1, 2, Some(2), 2));
            assert_eq!(array.pixel([1, 0]), [[6.0, 7.0, 8.0], [9.0, 10.0, 11.0]]);
            assert_eq!(array.image(1), [3.0, 4.0, 5.0, 9.0, 10.0, 11.0]);
        }
        let one = written(&file(1, "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2, 3)}", &values)).unwrap();
        assert_eq!((one.responses, one.image(0)), (None, values));
    }

    #[test]
    fn other_files_are_refused_with_the_remedy() {
        let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 3), }\n";
        let with = |from: &str, to: &str| file(1, &good.replace(from, to), &[1.0; 3]);
        assert!(written(&with("", "")).is_ok());
        for (bytes, part) in [
            (vec![], "not a NumPy array"),
            (b"PK\x03\x04 a zip of arrays".to_vec(), "not a NumPy array"),
            (file(1, good, &[1.0; 3])[..40].to_vec(), "not a NumPy array"),
            (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(), "not a NumPy array"),
            (with("<f4", "<f8"), "numpy.save"),
            (with("'<f4'", "[('a', '<f4')]"), "not plain numbers"),
            (with("False", "True"), "Fortran order"),
            (with("(1, 1, 3)", "(3,)"), "shape is [3]"),
            (with("(1, 1, 3)", "(1, x, 3)"), "contains 'x'"),
            (with("(1, 1, 3)", "(2, 1, 3)"), "does not fit"),
            (with("(1, 1, 3)", "(0, 1, 3)"), "does not fit"),
            (with("(1, 1, 3)", "(18446744073709551615, 2, 3)"), "does not fit"),
        ] {
            let error = written(&bytes).unwrap_err().to_string();
            assert!(error.contains(part), "{part}: {error}");
        }
    }
}
