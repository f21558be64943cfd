//! The file of an accumulation, `.acc`: a zip of NumPy arrays of 64-bit floats, not compressed, and the text `about.json`, see
//! [`About`]. `numpy.load` opens it.
//!
//! | array | shape | contents |
//! |---|---|---|
//! | `sums` | height, width, T, 3 | sums over the iterations of w x: x is the mean over the w samples per pixel of an iteration |
//! | `squares` | height, width, T, 3 | sums of w x^2; missing without variances |
//! | `sums_low`, `squares_low` | height, width, 1, 3 | rounding errors of the sums of a single response |
//! | `total_sums`, ..., `total_squares_low` | height, width, 1, 3 | the same four sums, for the total of several responses |
//! | `image` | 4 | the same four sums, for the mean over all pixels and channels |
//! | `cells` | batches, cells, 3 | per batch of iterations and cell of 16 x 16 pixels: sum over the pixels, times samples |
//! | `cell_samples` | batches | samples per pixel of each batch |
//! | `cell_lengths` | 2 | number of iterations of a full batch, and of the last one |
//! | `adaptive` | height, width, 4 | what adaptive sampling has measured, see [`AdaptiveState`]; missing if the sampling is uniform |
//! | `adaptive_counts` | 2 | samples per pixel and iterations of `adaptive` |
//! | `adaptive_errors` | height, width | the errors that the next samples follow; missing in merged sums |
//! | `brightness` | height, width, 7, 4 | iterations by brightness, see [`BrightnessLayers`]; missing if fireflies are kept |
//! | `brightness_lowest` | 1 | binary logarithm of the luminance of the lowest of these layers; empty if all iterations are black |
//! | `depth.Z`, `object.ID`, ... | height, width | auxiliary layers, see [`CHANNELS`]; only those that were rendered |
//!
//! `objects.json` gives the name for each number in `object.ID`.
//!
//! The mean image is `sums[:, :, t] / samples_per_pixel`.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use zip::{ZipArchive, ZipWriter};

use super::arrays::{Archive, any_values, array, finite, not_finite, start, text, values, visit_values};
use super::{About, Accumulation, AdaptiveState, FORMAT, layer_arrays};
use crate::error::{Error, Result};
use crate::files::{check_readable, read_error, write_atomically};
use crate::image::batches::CellBatches;
use crate::image::brightness_layers::{BrightnessLayers, LAYERS};
use crate::image::film::Film;
#[cfg(doc)]
use crate::image::layers::CHANNELS;
use crate::image::layers::Layers;
use crate::image::moments::Moments;
use crate::image::response_film::ResponseFilm;
use crate::settings::MAX_PIXELS;

/// Name of the text in the zip.
const ABOUT: &str = "about.json";
/// Maximum number of seconds that a file may state, about 30,000 years.
const MAX_SECONDS: f64 = 1e12;
/// Names of the four sums of [`Moments`], for a single response and for the total of several.
const SINGLE: [&str; 4] = ["sums", "sums_low", "squares", "squares_low"];
const TOTAL: [&str; 4] = ["total_sums", "total_sums_low", "total_squares", "total_squares_low"];

/// The parts of an [`Accumulation`], borrowed from a render.
#[derive(Clone, Copy)]
pub struct Parts<'a> {
    pub about: &'a About,
    pub film: &'a Film,
    pub responses: Option<&'a ResponseFilm>,
    pub adaptive: Option<&'a AdaptiveState>,
    pub layers: &'a Layers,
}

impl Accumulation {
    pub fn parts(&self) -> Parts<'_> {
        let Accumulation { about, film, responses, adaptive, layers } = self;
        Parts { about, film, responses: responses.as_ref(), adaptive: adaptive.as_ref(), layers }
    }
}

/// Writes the file, whole or not at all.
pub fn write(path: &Path, parts: Parts) -> Result<()> {
    write_atomically(path, |writer| write_to(writer, parts))
}

/// Writes the contents of the file.
pub fn write_to(writer: &mut (impl Write + Seek), parts: Parts) -> io::Result<()> {
    let mut writer = Silent { writer, error: None, position: 0, end: 0 };
    write_entries(&mut writer, parts)?;
    writer.error.map_or(Ok(()), Err)
}

/// Keeps the first error of a writer, and after it only counts bytes. A [`ZipWriter`] prints an error of its writer when it is dropped.
struct Silent<W> {
    writer: W,
    error: Option<io::Error>,
    position: u64,
    end: u64,
}

impl<W> Silent<W> {
    fn try_to<T>(&mut self, work: impl FnOnce(&mut W) -> io::Result<T>) -> Option<T> {
        if self.error.is_some() {
            return None;
        }
        work(&mut self.writer).map_err(|error| self.error = Some(error)).ok()
    }
}

impl<W: Write> Write for Silent<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.try_to(|writer| writer.write(bytes)).unwrap_or(bytes.len());
        self.position += written as u64;
        self.end = self.end.max(self.position);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.try_to(W::flush);
        Ok(())
    }
}

impl<W: Seek> Seek for Silent<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let counted = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
            SeekFrom::End(offset) => self.end.checked_add_signed(offset),
        };
        self.position = counted.ok_or(io::ErrorKind::InvalidInput)?;
        self.try_to(|writer| writer.seek(to));
        Ok(self.position)
    }
}

fn write_entries(writer: &mut (impl Write + Seek), parts: Parts) -> io::Result<()> {
    let mut zip = ZipWriter::new(writer);
    start(&mut zip, ABOUT, 0)?;
    zip.write_all(&serde_json::to_vec_pretty(parts.about)?)?;

    let Parts { film, responses, adaptive, layers, .. } = parts;
    let [height, width] = [film.height(), film.width()].map(|side| side as usize);
    if let Some(all) = responses {
        let shape = [height, width, all.responses(), 3];
        for (name, values) in ["sums", "squares"].iter().zip(all.sums()) {
            if !values.is_empty() {
                array(&mut zip, name, &shape, values.iter().copied())?;
            }
        }
    }
    let (moments, image) = film.moments();
    let names = if responses.is_some() { TOTAL } else { SINGLE };
    for (k, name) in names.iter().enumerate() {
        array(&mut zip, name, &[height, width, 1, 3], moments.iter().map(|moments| moments.to_array()[k]))?;
    }
    array(&mut zip, "image", &[4], image.to_array())?;

    let cells = film.cells();
    let (batches, [columns, rows]) = (cells.batches(), cells.grid());
    let sums = batches.iter().flat_map(|(_, sums)| sums).copied();
    array(&mut zip, "cells", &[batches.len(), columns * rows, 3], sums)?;
    array(&mut zip, "cell_samples", &[batches.len()], batches.iter().map(|batch| batch.0))?;
    array(&mut zip, "cell_lengths", &[2], cells.lengths().map(f64::from))?;

    if let Some(layers) = film.layers() {
        array(&mut zip, "brightness", &[height, width, LAYERS, 4], layers.values().map(f64::from))?;
        let lowest = layers.lowest().map(f64::from);
        array(&mut zip, "brightness_lowest", &[lowest.iter().len()], lowest)?;
    }
    if let Some(state) = adaptive {
        array(&mut zip, "adaptive", &[height, width, 4], state.pixels.iter().flatten().copied())?;
        array(&mut zip, "adaptive_counts", &[2], [state.samples, f64::from(state.iterations)])?;
        if let Some(errors) = &state.errors {
            array(&mut zip, "adaptive_errors", &[height, width], errors.iter().copied())?;
        }
    }
    layer_arrays::write(&mut zip, [height, width], layers)?;
    zip.finish()?;
    Ok(())
}

/// Reads a file. Fails if it is no accumulation, if it is damaged, or if its numbers contradict each other.
pub fn read(path: &Path) -> Result<Accumulation> {
    let mut source = open(path)?;
    read_from(&mut source).map_err(|problem| wrong(path, problem))
}

/// Reads only `about.json`.
pub fn read_about(path: &Path) -> Result<About> {
    let mut source = open(path)?;
    let mut zip = ZipArchive::new(&mut source).map_err(|e| wrong(path, Problem::from(e)))?;
    about(&mut zip).map_err(|problem| wrong(path, problem))
}

fn open(path: &Path) -> Result<BufReader<File>> {
    check_readable(path)?;
    let file = File::open(path).map_err(|e| read_error(path, e))?;
    Ok(BufReader::with_capacity(1 << 16, file))
}

/// Why a file cannot be read.
#[derive(Debug)]
pub enum Problem {
    /// The operating system cannot read it.
    Io(io::Error),
    /// The contents are wrong.
    Contents(String),
}

impl From<String> for Problem {
    fn from(message: String) -> Problem {
        Problem::Contents(message)
    }
}

impl From<zip::result::ZipError> for Problem {
    fn from(error: zip::result::ZipError) -> Problem {
        match error {
            zip::result::ZipError::Io(error) => error.into(),
            other => Problem::Contents(format!("it is not a zip archive of arrays ({other})")),
        }
    }
}

impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Problem {
        match error.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
                Problem::Contents(format!("it is damaged ({error})"))
            }
            _ => Problem::Io(error),
        }
    }
}

/// The error for a file that cannot be read.
fn wrong(path: &Path, problem: Problem) -> Error {
    match problem {
        Problem::Io(error) => read_error(path, error),
        Problem::Contents(message) => Error::File {
            path: path.into(),
            message: format!(
                "this is not an accumulation of taugate (.acc): {message}; name a file that --checkpoint, -o OUT.acc or merge wrote"
            ),
        },
    }
}

/// Reads the contents of a file. All numbers are checked.
pub fn read_from(source: &mut (impl Read + Seek)) -> Result<Accumulation, Problem> {
    let bytes = source.seek(SeekFrom::End(0))?;
    let mut zip = ZipArchive::new(source)?;
    let about = about(&mut zip)?;
    let [width, height] = about.size();
    let (columns, rows) = (width as usize, height as usize);
    let pixels = columns * rows;
    let count = about.responses.len();
    let (samples, iterations) = (about.samples_per_pixel, about.iterations.len());

    let responses = match count {
        1 => None,
        _ => {
            let shape = [rows, columns, count, 3];
            let sums = values(&mut zip, "sums", &shape)?;
            let squares = match zip.index_for_name("squares.npy") {
                Some(_) => values(&mut zip, "squares", &shape)?,
                None => vec![],
            };
            Some(ResponseFilm::from_sums([sums, squares], pixels, samples, iterations))
        }
    };

    let names = if count == 1 { SINGLE } else { TOTAL };
    // At most as many as the file can hold, whatever it says.
    let mut moments = Vec::with_capacity((3 * pixels).min(bytes as usize / size_of::<f64>()));
    for (k, name) in names.iter().enumerate() {
        read_sums(&mut zip, name, &[rows, columns, 1, 3], k, &mut moments)?;
    }
    let moments = moments.into_iter().map(Moments::from_array).collect();
    let image = values(&mut zip, "image", &[4])?;
    let image = Moments::from_array([image[0], image[1], image[2], image[3]]);
    let cells = cells(&mut zip, [width, height])?;
    let layers = match zip.index_for_name("brightness.npy") {
        Some(_) => Some(brightness(&mut zip, [width, height])?),
        None => None,
    };
    let film = Film::from_moments(moments, image, cells, [width, height], samples, iterations, layers);

    let adaptive = match zip.index_for_name("adaptive.npy") {
        Some(_) => Some(adaptive(&mut zip, [rows, columns])?),
        None => None,
    };
    let layers = layer_arrays::read(&mut zip, [rows, columns])?;
    Ok(Accumulation { about, film, responses, adaptive, layers })
}

/// Reads and checks `about.json`.
fn about<R: Read + Seek>(zip: &mut Archive<R>) -> Result<About, Problem> {
    let wrong = |what: String| Problem::Contents(what);
    let text = text(zip, ABOUT)?;
    let format: serde_json::Value =
        serde_json::from_slice(&text).map_err(|e| wrong(format!("{ABOUT} is not valid JSON ({e})")))?;
    if format["format"] != FORMAT {
        return Err(wrong(format!(
            "its format is {}, and this version of taugate reads format {FORMAT}",
            format["format"]
        )));
    }
    let about: About = serde_json::from_value(format).map_err(|e| wrong(format!("{ABOUT} cannot be used ({e})")))?;
    let [width, height] = about.size();
    let [x0, x1, y0, y1] = about.crop;
    let pixels = u64::from(width) * u64::from(height);
    if x0 >= x1 || y0 >= y1 || x1 > about.resolution[0] || y1 > about.resolution[1] || pixels > MAX_PIXELS {
        return Err(wrong("its crop does not lie in its image".into()));
    }
    if about.responses.is_empty() || about.shards.is_empty() {
        return Err(wrong("it has no responses or no shards".into()));
    }
    let is_empty = about.samples_per_pixel == 0;
    if is_empty != about.iterations.is_empty() || about.samples_per_pixel < u64::from(about.iterations.len()) {
        return Err(wrong("its number of samples contradicts its iterations".into()));
    }
    if !(0.0..=MAX_SECONDS).contains(&about.seconds) {
        return Err(wrong(format!("its seconds of render time are not from 0 to {MAX_SECONDS:e}")));
    }
    Ok(about)
}

/// Reads the `k`-th sum of each of the `moments`, an array of this shape. They go straight to their place: with an array of its
/// own for each sum, `merge` is 15 to 20 % slower (docs/notebook/merge-speed.md).
fn read_sums<R: Read + Seek>(
    zip: &mut Archive<R>,
    name: &str,
    shape: &[usize],
    k: usize,
    moments: &mut Vec<[f64; 4]>,
) -> Result<(), Problem> {
    let (mut at, mut all_finite) = (0, true);
    let next = |values: &[f64]| {
        let end = at + values.len();
        moments.resize(moments.len().max(end), [0.0; 4]);
        for (moments, value) in moments[at..end].iter_mut().zip(values) {
            moments[k] = *value;
            all_finite &= value.is_finite();
        }
        at = end;
    };
    visit_values(zip, name, |found| found == shape, next)?;
    if all_finite { Ok(()) } else { Err(not_finite(name)) }
}

fn cells<R: Read + Seek>(zip: &mut Archive<R>, size: [u32; 2]) -> Result<CellBatches, Problem> {
    let wrong = || Problem::Contents("its batches of cells contradict each other".into());
    let [columns, rows] = CellBatches::new(size[0], size[1]).grid();
    let (shape, sums) = any_values(zip, "cells", |shape| matches!(shape, [_, n, 3] if *n == columns * rows))?;
    let sums = finite("cells", sums)?;
    let samples = values(zip, "cell_samples", &shape[..1])?;
    let lengths = values(zip, "cell_lengths", &[2])?;
    let is_count = |x: &f64| x.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(x);
    if !lengths.iter().all(is_count) || samples.iter().any(|&samples| samples <= 0.0) {
        return Err(wrong());
    }
    let batches = samples.into_iter().zip(sums.chunks(3 * columns * rows).map(<[f64]>::to_vec)).collect();
    CellBatches::from_batches(size, batches, [lengths[0] as u32, lengths[1] as u32]).ok_or_else(wrong)
}

fn brightness<R: Read + Seek>(zip: &mut Archive<R>, [width, height]: [u32; 2]) -> Result<BrightnessLayers, Problem> {
    let shape = [height as usize, width as usize, LAYERS, 4];
    let values = values(zip, "brightness", &shape)?.into_iter().map(|x| x as f32).collect();
    let (_, lowest) = any_values(zip, "brightness_lowest", |shape| matches!(shape, [0 | 1]))?;
    BrightnessLayers::from_values(width, lowest.first().map(|&x| x as f32), values)
        .ok_or_else(|| not_finite("brightness"))
}

fn adaptive<R: Read + Seek>(zip: &mut Archive<R>, [rows, columns]: [usize; 2]) -> Result<AdaptiveState, Problem> {
    let (_, pixels) = any_values(zip, "adaptive", |shape| *shape == [rows, columns, 4])?;
    let counts = values(zip, "adaptive_counts", &[2])?;
    let (pixels, _) = pixels.as_chunks();
    let errors = match zip.index_for_name("adaptive_errors.npy") {
        Some(_) => Some(values(zip, "adaptive_errors", &[rows, columns])?),
        None => None,
    };
    // The device adds the squares as f32, so their sum may be infinite.
    let is_right = |&[samples, sum, squares, light]: &[f64; 4]| {
        [samples, sum, light].iter().all(|x| x.is_finite()) && samples >= 0.0 && squares >= 0.0
    };
    let mut not_negative = counts.iter().chain(errors.iter().flatten());
    if !pixels.iter().all(is_right) || not_negative.any(|&value| value < 0.0) {
        return Err(Problem::Contents(
            "its state of adaptive sampling, adaptive, has a negative count or a value that is not finite".into(),
        ));
    }
    Ok(AdaptiveState { pixels: pixels.to_vec(), samples: counts[0], iterations: counts[1] as u32, errors })
}
