//! Writes the film as an EXR file, and reads EXR files as images to compare.

use std::io;
use std::path::Path;
use std::time::Duration;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    ReadChannels, ReadLayers, ReadSpecificChannel, Text, Vec2, WritableImage, read,
};

use crate::error::{Error, Result};
use crate::files::write_atomically;
use crate::image::channels::{self, ChannelGroup};
use crate::image::exr_header::{COLOR_CHANNELS, header, unreadable, window};
use crate::image::film::Film;
use crate::image::fingerprint;
use crate::image::layers::{Layers, Plane};
use crate::image::response_film::ResponseFilm;
use crate::settings::doppler::Doppler;
use crate::settings::units::{Gate, METRES_PER_NS};
use crate::settings::{Crop, Response, Responses, Settings};

/// Names of the channels of the variance, which may be missing.
const VARIANCE_CHANNELS: [&str; 3] = ["Variance.R", "Variance.G", "Variance.B"];

/// Names of the channels of the image without damped fireflies, which may be missing.
const UNDAMPED_CHANNELS: [&str; 3] = ["undamped.R", "undamped.G", "undamped.B"];

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
    /// `None` if the render does not merge.
    pub merged: Option<Merged>,
}

/// Light of an image that merging found, which is blurred.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Merged {
    /// Its share of the luminance of the image.
    pub share: f64,
    /// Radius in pixels of the last iteration.
    pub radius: f64,
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
            merged: None,
        }
    }

    /// The radial velocity in m/s that saturates the colours; `None` if the image records no velocities.
    fn doppler(&self) -> Option<f64> {
        let settings: toml::Table = self.settings.parse().ok()?;
        settings.get("render")?.get("doppler")?.as_str()?.parse::<Doppler>().ok()?.speed()
    }
}

/// Name and version of this program, with the commit if the build set `TAUGATE_COMMIT`.
pub fn version() -> String {
    let commit = option_env!("TAUGATE_COMMIT").map(|c| format!(" ({c})")).unwrap_or_default();
    format!("taugate {}{commit}", env!("CARGO_PKG_VERSION"))
}

/// Writes the images of a render with these settings: mean and variance of every pixel, gate, seed and version. The render took
/// `elapsed`. With several responses, R, G and B are the image of the first one; a further response NAME has the channels NAME.R,
/// NAME.G and NAME.B, and its variance if the film estimates it. `images` holds them, as [`crate::Renderer::responses`] returns them;
/// it is `None` if the settings have a single response. Fails if the number or the size of the images is not that of the settings.
/// The attribute `tof:settings` holds the settings as an experiment file. It lacks the path of the scene and the name of the
/// camera, which the settings do not contain. After [`crate::Renderer::restart`], `settings` must have the seed and the gate
/// passed to it.
pub fn write_film(
    path: &Path,
    film: &Film,
    images: Option<&ResponseFilm>,
    settings: &Settings,
    elapsed: Duration,
) -> Result<()> {
    let [width, height] = [settings.crop().width(), settings.crop().height()];
    let (expected, count) = (settings.responses().len(), images.map_or(1, ResponseFilm::responses));
    if expected != count {
        return Err(Error::advice(
            format!("the number of responses is {expected} in the settings, but {count} in the images; "),
            "pass Renderer::responses of this render",
        ));
    }
    let has_size = |images: &ResponseFilm| images.pixels() as u64 == u64::from(width) * u64::from(height);
    if (film.width(), film.height()) != (width, height) || !images.is_none_or(has_size) {
        return Err(Error::advice(
            format!("the images do not have the size of the crop, {width}x{height}; "),
            "give the settings of their render",
        ));
    }
    let provenance = Provenance::new(settings, elapsed.as_secs_f64(), settings.to_tables().to_toml());
    write_responses(path, film, images, &provenance, &Layers::default())
}

/// Writes mean and variance as one single-part EXR of 32-bit scan lines (ZIP): R, G, B and Variance.R, .G, .B. With fewer than
/// two iterations the variance is 0; readers can check `tof:varianceBatches` for this case.
pub fn write(path: &Path, film: &Film, provenance: &Provenance) -> Result<()> {
    write_with_layers(path, film, provenance, &Layers::default())
}

/// As [`write`], with further channels. The attribute `tof:objects` names the objects: a JSON object from the ids in `object.ID`
/// to names.
pub fn write_with_layers(path: &Path, film: &Film, provenance: &Provenance, layers: &Layers) -> Result<()> {
    write_responses(path, film, None, provenance, layers)
}

/// As [`write_with_layers`], with the images of several responses, see [`channels::of_render`]. The attribute `tof:responses` lists
/// the responses in order: a JSON array of names and gates.
pub fn write_responses(
    path: &Path,
    film: &Film,
    images: Option<&ResponseFilm>,
    provenance: &Provenance,
    layers: &Layers,
) -> Result<()> {
    let Provenance { resolution, crop, responses, .. } = provenance;
    let groups = channels::of_render(film, images, responses, usize::MAX, provenance.doppler());
    let mut channels: Vec<_> = groups.into_iter().flat_map(channels_of).collect();
    channels.extend(planes_of(layers));

    let first = responses.iter().next();
    let (gate, integral) = (first.map_or(Gate::OPEN, Response::gate), first.map_or(f64::INFINITY, Response::integral));
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
            ("tof:weightIntegral_m", AttributeValue::F64(integral)),
            ("tof:convention", AttributeValue::Text(text("optical_path_length"))),
            ("tof:c_m_per_s", AttributeValue::F64(SPEED_OF_LIGHT_M_PER_S)),
            ("tof:seed", AttributeValue::Text(text(&provenance.seed.to_string()))),
            ("tof:varianceBatches", AttributeValue::I32(film.iterations().try_into().unwrap_or(i32::MAX))),
            ("tof:version", AttributeValue::Text(text(&version()))),
            ("tof:renderer", AttributeValue::Text(text(fingerprint::RENDERER))),
            ("tof:settings", AttributeValue::Text(text(&provenance.settings))),
        ]
        .map(|(name, value)| (text(name), value)),
    );
    if let Some(Merged { share, radius }) = provenance.merged {
        attributes.other.insert(text("tof:mergedShare"), AttributeValue::F64(share));
        attributes.other.insert(text("tof:mergeRadius_px"), AttributeValue::F64(radius));
    }
    if let Some(damped) = film.damped() {
        attributes.other.insert(text("tof:dampedShare"), AttributeValue::F64(damped.share));
    }
    if let Some(speed) = provenance.doppler() {
        attributes.other.insert(text("tof:doppler_m_per_s"), AttributeValue::F64(speed));
    }
    if let Some(period) = first.and_then(Response::period) {
        attributes.other.insert(text("tof:repeat_m"), AttributeValue::F64(period));
    }
    if images.is_some() {
        let gates = |r: &Response| {
            let gate = [r.gate().lo, r.gate().hi];
            let mut entry = serde_json::json!({"name": r.name(), "gate_m": gate, "weight_integral_m": r.integral()});
            if let Some(period) = r.period() {
                entry["repeat_m"] = period.into();
            }
            entry
        };
        let list = serde_json::Value::from_iter(responses.iter().map(gates)).to_string();
        attributes.other.insert(text("tof:responses"), AttributeValue::Text(text(&list)));
    } else {
        // The cells belong to the film. With several responses, the file has no channels of the film.
        attributes.other.insert(text("tof:cellBatches"), floats(&film.cells().to_floats()));
    }
    if !layers.objects.is_empty() {
        let names = serde_json::to_string(&layers.objects).expect("a map of numbers and names is valid JSON");
        attributes.other.insert(text("tof:objects"), AttributeValue::Text(text(&names)));
    }
    write_image(path, *resolution, [film.width(), film.height()], attributes, channels)
}

/// Writes layers alone, of the pixels of a crop of an image of this resolution.
pub fn write_layers(path: &Path, resolution: [u32; 2], crop: Crop, layers: &Layers) -> Result<()> {
    let attributes = LayerAttributes {
        layer_position: Vec2(crop.x0 as i32, crop.y0 as i32),
        software_name: Some(text(&version())),
        ..LayerAttributes::default()
    };
    write_image(path, resolution, [crop.width(), crop.height()], attributes, planes_of(layers).collect())
}

/// Writes one single-part EXR of scan lines (ZIP) with a data window of `size` in a display window of `resolution`.
fn write_image(
    path: &Path,
    resolution: [u32; 2],
    size: [u32; 2],
    attributes: LayerAttributes,
    channels: Vec<AnyChannel<FlatSamples>>,
) -> Result<()> {
    let encoding = Encoding { compression: exr::prelude::Compression::ZIP16, ..Encoding::UNCOMPRESSED };
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let size = (size[0] as usize, size[1] as usize);
    let mut image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
    image.attributes.display_window = IntegerBounds::new((0, 0), Vec2(resolution[0] as usize, resolution[1] as usize));
    write_atomically(path, |writer| image.write().to_buffered(writer).map_err(into_io))
}

/// Writes R, G, B (interleaved, row 0 at the top) without variance or metadata.
pub fn write_plain(path: &Path, width: u32, height: u32, rgb: &[f32]) -> Result<()> {
    let attributes = LayerAttributes { software_name: Some(text(&version())), ..LayerAttributes::default() };
    let channels = channels_of(ChannelGroup::rgb("", rgb.to_vec())).collect();
    write_image(path, [width, height], [width, height], attributes, channels)
}

fn channels_of(group: ChannelGroup) -> impl Iterator<Item = AnyChannel<FlatSamples>> {
    group.into_channels().map(|(name, values)| AnyChannel::new(text(&name), FlatSamples::F32(values)))
}

fn planes_of(layers: &Layers) -> impl Iterator<Item = AnyChannel<FlatSamples>> {
    layers.channels.iter().map(|(name, plane)| match plane {
        Plane::Floats(values) => AnyChannel::new(text(name), FlatSamples::F32(values.clone())),
        Plane::Ids(ids) => AnyChannel::new(text(name), FlatSamples::U32(ids.clone())),
    })
}

/// An attribute of the standard type `floatvector`.
fn floats(values: &[f32]) -> AttributeValue {
    AttributeValue::Custom { kind: text("floatvector"), bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect() }
}

/// An EXR text, which consists of bytes; readers expect UTF-8.
pub(super) fn text(string: &str) -> Text {
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
    /// The image without damped fireflies, if the file has it.
    pub undamped: Option<Vec<f32>>,
    /// Variance of `undamped` or else `rgb`, if the file has it.
    pub variance: Option<Vec<f32>>,
    /// `tof:cellBatches` if the file has it, see [`crate::image::batches::CellBatches::to_floats`].
    pub cell_batches: Option<Vec<f32>>,
    /// `tof:seed`, if the file has it.
    pub seed: Option<String>,
    /// `tof:renderer`, the [`fingerprint::RENDERER`] of the program that rendered it, if the file has it.
    pub renderer: Option<String>,
    /// Render time in seconds (`renderTimeSeconds`), if the file has it.
    pub seconds: Option<f64>,
    /// Light that merging found, if the file says so.
    pub merged: Option<Merged>,
    /// Ends of the gate in metres of optical path, if the file has them.
    pub gate: Option<[f64; 2]>,
    /// Column and row of the first pixel in the whole image.
    pub corner: [i32; 2],
}

/// Reads a single-part EXR of any program: the channels R, G, B, and Variance.R, .G, .B if there. Other channels take no memory:
/// they are decoded block by block, and dropped. The picture of another program is its display window: pixels that the file lacks are
/// black, and pixels beyond the window are left out. An image of taugate is its data window.
pub fn read_picture(path: &Path) -> Result<Picture> {
    let header = header(path, COLOR_CHANNELS.len())?;
    let (window, display) = (window(&header), header.shared_attributes.display_window);
    // The positions in the header of a hostile file may be any 32-bit numbers.
    let difference =
        |a: Vec2<i32>, b: Vec2<i32>| [(a.x(), b.x()), (a.y(), b.y())].map(|(a, b)| i64::from(a) - i64::from(b));
    let offset = difference(header.own_attributes.layer_position, window.position);
    let [r, g, b] = COLOR_CHANNELS;
    let [variance_r, variance_g, variance_b] = VARIANCE_CHANNELS;
    let [undamped_r, undamped_g, undamped_b] = UNDAMPED_CHANNELS;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(r)
        .required(g)
        .required(b)
        .optional(variance_r, 0.0)
        .optional(variance_g, 0.0)
        .optional(variance_b, 0.0)
        .optional(undamped_r, 0.0)
        .optional(undamped_g, 0.0)
        .optional(undamped_b, 0.0)
        .collect_pixels(
            |_, (_, _, _, r, g, b, undamped_r, undamped_g, undamped_b)| {
                let all = |channels: [&Option<_>; 3]| channels.iter().all(|channel| channel.is_some());
                Values::new(window.size, offset, [all([r, g, b]), all([undamped_r, undamped_g, undamped_b])])
            },
            |values: &mut Values, at, (r, g, b, vr, vg, vb, ur, ug, ub): Pixel| {
                values.set(at, [r, g, b], [vr, vg, vb], [ur, ug, ub]);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| unreadable(path, e))?;
    let layer = image.layer_data;
    let Vec2(width, height) = window.size;
    let Values { rgb, variance, undamped, .. } = layer.channel_data.pixels;
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
    let merged = number("tof:mergedShare").zip(number("tof:mergeRadius_px"));
    let merged = merged.map(|(share, radius)| Merged { share, radius });
    let corner = difference(window.position, display.position).map(|x| x as i32);
    Ok(Picture {
        width: width as u32,
        height: height as u32,
        rgb,
        undamped,
        variance,
        cell_batches,
        seed,
        renderer,
        seconds,
        merged,
        gate,
        corner,
    })
}

/// The channels of a pixel.
type Pixel = (f32, f32, f32, f32, f32, f32, f32, f32, f32);

/// The values of a picture while its blocks are read: R, G, B interleaved, row by row.
struct Values {
    size: Vec2<usize>,
    /// Position in the picture of the first pixel of the file.
    offset: [i64; 2],
    rgb: Vec<f32>,
    variance: Option<Vec<f32>>,
    undamped: Option<Vec<f32>>,
}

impl Values {
    fn new(size: Vec2<usize>, offset: [i64; 2], [has_variance, has_undamped]: [bool; 2]) -> Values {
        let zeros = || vec![0.0; 3 * size.area()];
        Values { size, offset, rgb: zeros(), variance: has_variance.then(zeros), undamped: has_undamped.then(zeros) }
    }

    fn set(&mut self, at: Vec2<usize>, rgb: [f32; 3], variance: [f32; 3], undamped: [f32; 3]) {
        let [x, y] = [(at.x(), self.offset[0], self.size.width()), (at.y(), self.offset[1], self.size.height())]
            .map(|(at, offset, size)| usize::try_from(at as i64 + offset).ok().filter(|&place| place < size));
        let (Some(x), Some(y)) = (x, y) else { return };
        let first = 3 * (y * self.size.width() + x);
        self.rgb[first..first + 3].copy_from_slice(&rgb);
        for (values, pixel) in [(&mut self.variance, variance), (&mut self.undamped, undamped)] {
            if let Some(values) = values {
                values[first..first + 3].copy_from_slice(&pixel);
            }
        }
    }
}
