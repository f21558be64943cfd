//! Writes the film as an EXR file, and reads EXR files as images to compare.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;
use std::time::Duration;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    MetaData, ReadChannels, ReadLayers, Text, Vec2, WritableImage, read,
};

use crate::error::{Error, Result};
use crate::files::{check_readable, read_error, write_atomically};
use crate::image::film::Film;
use crate::image::fingerprint;
use crate::settings::units::METRES_PER_NS;
use crate::settings::{Crop, MAX_PIXELS, Responses, Settings};

/// Maximum number of values (pixels times channels) that taugate decodes: that of our own largest image. A header of a few bytes
/// may claim any size, so this limit is checked before memory is allocated.
const MAX_SAMPLES: u64 = 6 * MAX_PIXELS;

const SPEED_OF_LIGHT_M_PER_S: f64 = METRES_PER_NS * 1e9;

/// How a film file was rendered.
#[derive(Debug, Clone)]
pub struct Provenance {
    /// Resolution of the whole image.
    pub resolution: [u32; 2],
    /// Region of the image that the film covers.
    pub crop: Crop,
    pub responses: Responses,
    pub seed: u32,
    pub seconds: f64,
    /// The resolved experiment as TOML, which reproduces the render.
    pub settings: String,
}

impl Provenance {
    /// Provenance of a render with `settings` that took `seconds`; `experiment` is its TOML.
    pub fn new(settings: &Settings, seconds: f64, experiment: String) -> Provenance {
        Provenance {
            resolution: settings.resolution(),
            crop: settings.crop(),
            responses: settings.responses().clone(),
            seed: settings.seed(),
            seconds,
            settings: experiment,
        }
    }
}

/// Name and version of this program, with the commit if the build set `TAUGATE_COMMIT`.
pub fn version() -> String {
    let commit = option_env!("TAUGATE_COMMIT").map(|c| format!(" ({c})")).unwrap_or_default();
    format!("taugate {}{commit}", env!("CARGO_PKG_VERSION"))
}

/// Writes the film of a render with these settings that took `elapsed`: mean and variance of every pixel, gate, seed and version.
/// The attribute `tof:settings` holds the settings as an experiment file. It lacks the path of the scene and the name of the
/// camera, which the settings do not contain. After [`crate::Renderer::restart`], `settings` must have the seed and the gate
/// passed to it.
pub fn write_film(path: &Path, film: &Film, settings: &Settings, elapsed: Duration) -> Result<()> {
    write(path, film, &Provenance::new(settings, elapsed.as_secs_f64(), settings.to_tables().to_toml()))
}

/// Writes mean and variance as one single-part EXR of 32-bit scan lines (ZIP): R, G, B and Variance.R, .G, .B. With fewer than
/// two iterations the variance is 0; readers can check `tof:varianceBatches` for this case.
pub fn write(path: &Path, film: &Film, provenance: &Provenance) -> Result<()> {
    let mut channels = channels_of(&film.mean(), "");
    channels.extend(channels_of(&film.variance_of_mean(), "Variance."));

    let Provenance { resolution, crop, responses, .. } = provenance;
    let gate = responses.support();
    let mut attributes = LayerAttributes {
        layer_position: Vec2(crop.x0 as i32, crop.y0 as i32),
        software_name: Some(text(&version())),
        ..LayerAttributes::default()
    };
    attributes.other.extend(
        [
            ("renderTimeSeconds", AttributeValue::F32(provenance.seconds as f32)),
            ("samplesPerPixel", AttributeValue::I32(film.samples().try_into().unwrap_or(i32::MAX))),
            ("tof:gateMin_m", AttributeValue::F64(gate.lo)),
            ("tof:gateMax_m", AttributeValue::F64(gate.hi)),
            ("tof:gateMin_ns", AttributeValue::F64(gate.lo / METRES_PER_NS)),
            ("tof:gateMax_ns", AttributeValue::F64(gate.hi / METRES_PER_NS)),
            ("tof:convention", AttributeValue::Text(text("optical_path_length"))),
            ("tof:c_m_per_s", AttributeValue::F64(SPEED_OF_LIGHT_M_PER_S)),
            ("tof:seed", AttributeValue::Text(text(&provenance.seed.to_string()))),
            ("tof:varianceBatches", AttributeValue::I32(film.iterations().try_into().unwrap_or(i32::MAX))),
            ("tof:cellBatches", floats(&film.cells().to_floats())),
            ("tof:version", AttributeValue::Text(text(&version()))),
            ("tof:renderer", AttributeValue::Text(text(fingerprint::RENDERER))),
            ("tof:settings", AttributeValue::Text(text(&provenance.settings))),
        ]
        .map(|(name, value)| (text(name), value)),
    );

    let layer = Layer::new(
        (film.width() as usize, film.height() as usize),
        attributes,
        Encoding { compression: exr::prelude::Compression::ZIP16, ..Encoding::UNCOMPRESSED },
        AnyChannels::sort(channels.into_iter().collect()),
    );
    let mut image = Image::from_layer(layer);
    image.attributes.display_window = IntegerBounds::new((0, 0), Vec2(resolution[0] as usize, resolution[1] as usize));
    write_atomically(path, |writer| image.write().to_buffered(writer).map_err(into_io))
}

/// Writes R, G, B (interleaved, row 0 at the top) without variance or metadata.
pub fn write_plain(path: &Path, width: u32, height: u32, rgb: &[f32]) -> Result<()> {
    let channels = AnyChannels::sort(channels_of(rgb, "").into_iter().collect());
    let attributes = LayerAttributes { software_name: Some(text(&version())), ..LayerAttributes::default() };
    let encoding = Encoding { compression: exr::prelude::Compression::ZIP16, ..Encoding::UNCOMPRESSED };
    let image = Image::from_layer(Layer::new((width as usize, height as usize), attributes, encoding, channels));
    write_atomically(path, |writer| image.write().to_buffered(writer).map_err(into_io))
}

/// Splits interleaved R, G, B into three channels.
fn channels_of(rgb: &[f32], prefix: &str) -> Vec<AnyChannel<FlatSamples>> {
    let plane = |c| FlatSamples::F32(rgb.iter().skip(c).step_by(3).copied().collect());
    ["R", "G", "B"]
        .iter()
        .enumerate()
        .map(|(c, name)| AnyChannel::new(text(&format!("{prefix}{name}")), plane(c)))
        .collect()
}

/// An attribute of the standard type `floatvector`.
fn floats(values: &[f32]) -> AttributeValue {
    AttributeValue::Custom { kind: text("floatvector"), bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
}

/// An EXR text, which consists of bytes; readers expect UTF-8.
fn text(string: &str) -> Text {
    Text::from_bytes_unchecked(string.bytes().collect())
}

fn into_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(error) => error,
        other => io::Error::other(other),
    }
}

/// An image to compare: R, G, B interleaved, row 0 at the top.
#[derive(Debug, Clone)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<f32>,
    /// Variance of `rgb`, if the file has it.
    pub variance: Option<Vec<f32>>,
    /// `tof:cellBatches` if the file has it, see [`crate::image::batches::CellBatches::to_floats`].
    pub cell_batches: Option<Vec<f32>>,
    /// `tof:seed`, if the file has it.
    pub seed: Option<String>,
    /// `tof:renderer`, the [`fingerprint::RENDERER`] of the program that rendered it, if the file has it.
    pub renderer: Option<String>,
    /// Render time in seconds (`renderTimeSeconds`), if the file has it.
    pub seconds: Option<f64>,
    /// Ends of the gate in metres of optical path, if the file has them.
    pub gate: Option<[f64; 2]>,
    /// Column and row of the first pixel in the whole image.
    pub corner: [i32; 2],
}

/// Reads a single-part EXR of any program: the channels R, G, B, and Variance.R, .G, .B if there.
pub fn read_picture(path: &Path) -> Result<Picture> {
    check_header(path)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| unreadable(path, e))?;
    let layer = image.layer_data;
    let (width, height) = (layer.size.width(), layer.size.height());

    let interleave = |prefix: &str| -> Option<Vec<f32>> {
        let mut rgb = vec![0.0; 3 * width * height];
        for (c, name) in ["R", "G", "B"].iter().enumerate() {
            let wanted = format!("{prefix}{name}");
            let channel = layer.channel_data.list.iter().find(|channel| channel.name.bytes() == wanted.as_bytes())?;
            for (pixel, value) in rgb.chunks_exact_mut(3).zip(channel.sample_data.values_as_f32()) {
                pixel[c] = value;
            }
        }
        Some(rgb)
    };
    let rgb = interleave("").ok_or_else(|| {
        let names: Vec<_> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
        let message =
            format!("has no channels R, G, B to compare, only {}; write it with these names", names.join(", "));
        Error::File { path: path.into(), message }
    })?;
    let attribute = |name: &str| layer.attributes.other.get(&text(name));
    let cell_batches = attribute("tof:cellBatches").and_then(|value| match value {
        AttributeValue::Custom { kind, bytes } if kind.bytes() == b"floatvector" => {
            Some(bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
        }
        _ => None,
    });
    let words = |name: &str| match attribute(name) {
        Some(AttributeValue::Text(words)) => Some(words.to_string()),
        _ => None,
    };
    let (seed, renderer) = (words("tof:seed"), words("tof:renderer"));
    let seconds = attribute("renderTimeSeconds").and_then(|value| match value {
        AttributeValue::F32(seconds) => Some(f64::from(*seconds)),
        _ => None,
    });
    let number = |name: &str| match attribute(name) {
        Some(AttributeValue::F64(number)) => Some(*number),
        _ => None,
    };
    let gate = number("tof:gateMin_m").zip(number("tof:gateMax_m")).map(<[f64; 2]>::from);
    let corner = layer.attributes.layer_position;
    Ok(Picture {
        width: width as u32,
        height: height as u32,
        variance: interleave("Variance."),
        rgb,
        cell_batches,
        seed,
        renderer,
        seconds,
        gate,
        corner: [corner.x(), corner.y()],
    })
}

/// Fails if the decoder would allocate too much memory, or if the file is not one flat image.
fn check_header(path: &Path) -> Result<()> {
    let fail = |message: String| Err(Error::File { path: path.into(), message });
    check_readable(path)?;
    let file = File::open(path).map_err(|e| read_error(path, e))?;
    let meta = MetaData::read_from_buffered(BufReader::new(file), false).map_err(|e| unreadable(path, e))?;
    let [header] = &meta.headers[..] else {
        return fail(format!("has {} parts; extract one into a file of its own", meta.headers.len()));
    };
    if header.deep {
        return fail("is a deep image, which cannot be compared; flatten it".into());
    }
    let (width, height) = (header.layer_size.width() as u64, header.layer_size.height() as u64);
    let channels = header.channels.list.len() as u64;
    if width.saturating_mul(height).saturating_mul(channels) > MAX_SAMPLES {
        return fail(format!(
            "has a header of {width} x {height} pixels with {channels} channels, more than taugate reads; crop the image"
        ));
    }
    if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return fail("has subsampled channels; write it with R, G, B at full resolution".into());
    }
    Ok(())
}

fn unreadable(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => read_error(path, error),
        other => {
            Error::File { path: path.into(), message: format!("is not an EXR file that taugate can read: {other}") }
        }
    }
}
