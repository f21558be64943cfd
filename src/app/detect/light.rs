//! The light that `taugate detect` reads: the images of gates, or a scan.

use std::path::Path;

use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::detector::Bins;
use taugate::internals::image::accumulation::file::read_about;
use taugate::internals::image::exr_header::read_corner;
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_file::description_path;
use taugate::internals::image::npy_read::{
    DescribedResponse, ImageArray, ScanArray, described, is_counts, is_scan, read, read_scan,
};

use crate::app::{accumulated, memory};

/// How the user can need less memory.
pub const REMEDY: &str = "render fewer gates, or fewer pixels or points";

/// The radiance that the detector sees. The pixels of a scan are its pairs of points; they have one channel.
pub struct Light {
    values: Values,
    pub bins: Bins,
    /// Column and row of the first pixel in the whole image, if they are known.
    pub corner: Option<[i64; 2]>,
    /// The description of the radiance: the JSON file beside an array, or the gates of an image or of sums.
    pub description: Value,
}

enum Values {
    Images(ImageArray),
    Scan(ScanArray),
}

impl Values {
    fn gates(&self) -> usize {
        match self {
            Values::Images(array) => array.images(),
            Values::Scan(scan) => scan.responses(),
        }
    }

    fn numbers(&self) -> &[f32] {
        match self {
            Values::Images(array) => &array.values,
            Values::Scan(scan) => &scan.values,
        }
    }
}

impl Light {
    /// Reads an array (.npy), an image (.exr) or sums (.acc).
    pub fn read(path: &Path) -> Result<Light, Error> {
        let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
        let (values, gates) = if has_extension(path, "exr") {
            let (array, gates) = exr_responses::read(path)?;
            let gates = gates.ok_or_else(|| fail("names no gate; give an image that taugate rendered with --gate"))?;
            (Values::Images(array), gates)
        } else if has_extension(path, "npy") {
            if is_counts(path) {
                return Err(fail("holds counts of a detector, not light; give the light"));
            }
            let values = match is_scan(path) {
                true => Values::Scan(read_scan(path)?),
                false => Values::Images(read(path)?),
            };
            let gates = described(path, values.gates()).ok_or_else(|| {
                fail("comes without the JSON file that names its gates; keep that file beside the array")
            })?;
            (values, gates)
        } else if accumulated::is_sums(path) {
            let (array, gates) = accumulated::array(path)?;
            (Values::Images(array), gates)
        } else {
            return Err(Error::settings(format!(
                "{} must be an array (.npy), an image (.exr) or sums (.acc) of taugate render",
                path.display()
            )));
        };
        if values.numbers().iter().any(|value| !value.is_finite()) {
            return Err(fail(match values {
                Values::Images(_) => "has values that are not finite; render an image without such pixels",
                Values::Scan(_) => "lacks pairs of points, because its scan was interrupted; measure it again",
            }));
        }
        let bins = Bins::new(gates.iter().map(DescribedResponse::gate).collect())?
            .weighted(gates.iter().map(DescribedResponse::integral).collect())?
            .repeated(gates[0].repeat_m);
        let beside = || serde_json::from_slice(&std::fs::read(description_path(path)).ok()?).ok();
        let of_file = if has_extension(path, "npy") { beside().filter(Value::is_object) } else { None };
        let description = of_file.unwrap_or_else(|| description(values.gates(), &gates));
        let corner = corner(path, &description)?;
        Ok(Light { values, bins, corner, description })
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        match &self.values {
            Values::Images(array) => array.width * array.height,
            Values::Scan(scan) => scan.pairs(),
        }
    }

    /// Width and height of the images; `None` for a scan.
    pub fn size(&self) -> Option<[usize; 2]> {
        match &self.values {
            Values::Images(array) => Some([array.width, array.height]),
            Values::Scan(_) => None,
        }
    }

    pub fn gates(&self) -> usize {
        self.values.gates()
    }

    /// Number of values in memory.
    pub fn numbers(&self) -> usize {
        self.values.numbers().len()
    }

    /// Number of channels of the counts. `mono`: whether the detector has no colours.
    pub fn channels(&self, mono: bool) -> usize {
        match self.values {
            Values::Images(_) if !mono => 3,
            _ => 1,
        }
    }

    /// The shape of the counts. For a scan, it is the shape of the light.
    pub fn shape(&self, mono: bool) -> Vec<usize> {
        match &self.values {
            Values::Images(array) => {
                let mut shape = vec![array.height, array.width];
                shape.extend(array.responses);
                shape.push(self.channels(mono));
                shape
            }
            Values::Scan(scan) => scan.shape.clone(),
        }
    }

    /// Index by pixel, gate and channel of the count that is the number `i` of the array of counts.
    pub fn index(&self, i: usize) -> usize {
        match &self.values {
            Values::Images(_) => i,
            Values::Scan(scan) => i % scan.pairs() * scan.responses() + i / scan.pairs(),
        }
    }

    /// The radiance of each gate in a pixel, for one of `channels` channels.
    pub fn radiance(&self, pixel: usize, channels: usize, channel: usize) -> Vec<f64> {
        match &self.values {
            Values::Images(array) => {
                let light = array.pixel([pixel % array.width, pixel / array.width]);
                light.iter().map(|rgb| of_channel(rgb, channels, channel)).collect()
            }
            Values::Scan(scan) => scan.values.iter().skip(pixel).step_by(scan.pairs()).map(|&x| x.into()).collect(),
        }
    }
}

/// The value of one of `channels` channels, 1 or 3. The only channel is the mean of red, green and blue.
pub fn of_channel(rgb: &[f32; 3], channels: usize, channel: usize) -> f64 {
    match channels {
        1 => rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0,
        _ => f64::from(rgb[channel]),
    }
}

/// Bytes of `values` numbers of 32 bits.
pub fn bytes_of(values: usize) -> u64 {
    4 * values as u64
}

/// Fails if the light in the file needs more memory than is `free`.
pub fn check_readable_in(free: Option<u64>, path: &Path) -> Result<(), Error> {
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let needed = if has_extension(path, "npy") {
        // The bytes of the file, and the numbers in them.
        2 * length
    } else if accumulated::is_sums(path) {
        // The sums, and the means of 32 bits.
        length + length / 2
    } else {
        return Ok(());
    };
    memory::check_bytes(needed, free, &format!("the light in {}", path.display()), REMEDY)
}

/// Column and row of the first pixel in the whole image, if they are known. `description` is that of the file.
fn corner(path: &Path, description: &Value) -> Result<Option<[i64; 2]>, Error> {
    if has_extension(path, "exr") {
        return Ok(read_corner(path).map(|corner| corner.map(i64::from)));
    }
    if accumulated::is_sums(path) {
        let [x0, _, y0, _] = read_about(path)?.crop;
        return Ok(Some([x0, y0].map(i64::from)));
    }
    Ok(description["crop"][0].as_i64().zip(description["crop"][2].as_i64()).map(<[i64; 2]>::from))
}

/// Describes the gates of `images` with the names that the JSON file beside an array has.
fn description(images: usize, gates: &[DescribedResponse]) -> Value {
    let axes = if images > 1 { "height, width, response, channel" } else { "height, width, channel" };
    let mut description = json!({ "responses": gates, "axes": axes });
    let (first, last, count) = (&gates[0], &gates[gates.len() - 1], gates.len() as f64);
    let width = (last.gate_end_m.unwrap_or(f64::INFINITY) - first.gate_begin_m) / count;
    let begins = |k: usize| first.gate_begin_m + k as f64 * width;
    let are_near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * width;
    let is_bin = |(k, gate): (usize, &DescribedResponse)| {
        are_near(gate.gate_begin_m, begins(k)) && gate.gate_end_m.is_some_and(|end| are_near(end, begins(k + 1)))
    };
    if gates.iter().enumerate().all(is_bin) {
        description["start_opl"] = first.gate_begin_m.into();
        description["bin_width_opl"] = width.into();
        description["temporal_bins"] = gates.len().into();
    }
    description
}

pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}
