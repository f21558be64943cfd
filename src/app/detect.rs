//! `taugate detect`: photon counts of a detector from the radiance of a render.

use std::path::Path;
use std::process::ExitCode;

use rayon::prelude::*;
use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::detector::{Bins, Blind, Detector};
use taugate::internals::files::{check_writable, write_atomically};
use taugate::internals::image::accumulation::file::read_about;
use taugate::internals::image::exr_file::read_picture;
use taugate::internals::image::exr_header::read_corner;
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_file::{COUNTS, description_path, paths_beside, write_new_array};
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray, described, is_counts, read};
use taugate::internals::settings::units::Gate;

use super::{accumulated, memory};
use crate::app::cli::DetectArgs;

/// The radiance that the detector sees.
struct Input {
    array: ImageArray,
    bins: Bins,
    /// Column and row of the first pixel in the whole image, if they are known.
    corner: Option<[i64; 2]>,
    /// The description of the radiance: the JSON file beside an array, or the gates of an image or of sums.
    description: Value,
}

pub fn run(args: &DetectArgs) -> anyhow::Result<ExitCode> {
    if !has_extension(&args.output, "npy") {
        return Err(Error::settings(format!("the output {} must end in .npy", args.output.display())).into());
    }
    let detector = detector(args)?;
    let description = description_path(&args.output);
    let [variances, depths] = paths_beside(&args.output);
    check_writable(&args.output)?;
    check_writable(&description)?;
    let same =
        |a: &Path, b: &Path| std::fs::canonicalize(a).is_ok_and(|a| std::fs::canonicalize(b).is_ok_and(|b| a == b));
    if [&args.output, &description, &variances, &depths]
        .into_iter()
        .any(|file| same(file, &args.input) || same(file, &description_path(&args.input)))
    {
        return Err(
            Error::settings(format!("{} would replace the light; choose another name", args.output.display())).into()
        );
    }
    let free = memory::free();
    check_readable_in(free, &args.input)?;
    let input = input(&args.input)?;
    let background = background(args.background.as_deref(), &input)?;
    let values = input.array.width * input.array.height * input.array.images() * channels(args);
    memory::check_bytes(
        bytes_of(values) + bytes_of(input.array.values.len()),
        free,
        "the light with its counts",
        REMEDY,
    )?;
    let counts = counts(args, &detector, &input, &background)?;
    if counts.iter().any(|count| !count.is_finite()) {
        return Err(Error::settings(
            "counts exceed the largest number of the output, 3e38; lower --photons or --pulses",
        )
        .into());
    }

    let mut shape = vec![input.array.height, input.array.width];
    shape.extend(input.array.responses);
    shape.push(channels(args));
    let text = serde_json::to_string_pretty(&describe(args, &input, &shape))?;
    write_new_array(&args.output, &shape, counts.iter().copied())?;
    write_atomically(&description, |writer| std::io::Write::write_all(writer, text.as_bytes()))?;
    let total: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    let pixels = (input.array.width * input.array.height * channels(args)) as f64;
    super::say(&format!(
        "{}, {}: {total:.0} counts, {:.3} per pixel{} and pulse",
        args.output.display(),
        description.display(),
        total / pixels / detector.pulses as f64,
        if args.mono { "" } else { ", channel" }
    ));
    Ok(ExitCode::SUCCESS)
}

/// Fails if a number is out of range.
fn detector(args: &DetectArgs) -> Result<Detector, Error> {
    let check = |name: &str, x: f64, max: f64| match (0.0..=max).contains(&x) {
        true => Ok(x),
        false if max.is_finite() && max < 1e9 => {
            Err(Error::settings(format!("--{name} is {x}; it must be from 0 to {max}")))
        }
        false => Err(Error::settings(format!("--{name} is {x}; it must be a finite number, 0 or more"))),
    };
    let blind = match args.dead_time {
        Some(time) => Blind::For(time.0),
        None if args.first_photon => Blind::UntilNextPulse,
        None => Blind::Never,
    };
    Ok(Detector {
        photons: check("photons", args.photons, f64::MAX)?,
        pulses: args.pulses,
        efficiency: check("efficiency", args.efficiency, 1.0)?,
        dark_rate: check("dark-counts", args.dark_counts, f64::MAX)?,
        jitter: args.jitter.map_or(0.0, |jitter| jitter.0),
        blind,
    })
}

/// How the user can need less memory.
const REMEDY: &str = "render fewer gates, or a --crop";

/// Bytes of `values` numbers of 32 bits.
fn bytes_of(values: usize) -> u64 {
    4 * values as u64
}

/// Fails if the light in the file needs more memory than is `free`.
fn check_readable_in(free: Option<u64>, path: &Path) -> Result<(), Error> {
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

fn input(path: &Path) -> Result<Input, Error> {
    let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
    let (array, gates) = if has_extension(path, "exr") {
        let (array, gates) = exr_responses::read(path)?;
        (array, gates.ok_or_else(|| fail("names no gate; give an image that taugate rendered with --gate"))?)
    } else if has_extension(path, "npy") {
        if is_counts(path) {
            return Err(fail("holds counts of a detector, not light; give the light"));
        }
        let array = read(path)?;
        let gates = described(path, &array)
            .ok_or_else(|| fail("comes without the JSON file that names its gates; keep that file beside the array"))?;
        (array, gates)
    } else if accumulated::is_sums(path) {
        accumulated::array(path)?
    } else {
        return Err(Error::settings(format!(
            "{} must be an array (.npy), an image (.exr) or sums (.acc) of taugate render",
            path.display()
        )));
    };
    if array.values.iter().any(|value| !value.is_finite()) {
        return Err(fail("has values that are not finite; render an image without such pixels"));
    }
    let bins = Bins::new(gates.iter().map(DescribedResponse::gate).collect())?
        .weighted(gates.iter().map(DescribedResponse::integral).collect())?
        .repeated(gates[0].repeat_m);
    let beside = || serde_json::from_slice(&std::fs::read(description_path(path)).ok()?).ok();
    let of_file = if has_extension(path, "npy") { beside().filter(Value::is_object) } else { None };
    let description = of_file.unwrap_or_else(|| description(&array, &gates));
    let corner = corner(path, &description)?;
    Ok(Input { array, bins, corner, description })
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

/// Describes the gates with the names that the JSON file beside an array has.
fn description(array: &ImageArray, gates: &[DescribedResponse]) -> Value {
    let axes = if array.responses.is_some() { "height, width, response, channel" } else { "height, width, channel" };
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

/// R, G, B of the background per pixel: a number, or an image of a render without a gate.
fn background(text: Option<&str>, Input { array, corner, .. }: &Input) -> Result<Vec<[f32; 3]>, Error> {
    let pixels = array.width * array.height;
    let Some(text) = text else { return Ok(vec![[0.0; 3]; pixels]) };
    let path = Path::new(text);
    if !has_extension(path, "exr") {
        let radiance = text.parse().ok().filter(|x: &f32| x.is_finite() && *x >= 0.0);
        let radiance = radiance.ok_or_else(|| {
            Error::settings(format!(
                "'{text}' is no background; give a radiance in W/(m^2 sr), 0 or more, or an image (.exr)"
            ))
        })?;
        return Ok(vec![[radiance; 3]; pixels]);
    }
    let fail = |message: String| Error::File { path: path.into(), message };
    if exr_responses::has_many(path)? {
        return Err(fail("has several gates, but daylight has none; render the background without a gate".into()));
    }
    let picture = read_picture(path)?;
    if (picture.width as usize, picture.height as usize) != (array.width, array.height) {
        return Err(fail(format!(
            "is {}x{}, but the light is {}x{}; render the background with the same --resolution and --crop",
            picture.width, picture.height, array.width, array.height
        )));
    }
    // An image of another program may show the same part of the scene without saying so.
    if let (Some(_), Some([x, y])) = (&picture.renderer, *corner)
        && picture.corner.map(i64::from) != [x, y]
    {
        let [column, row] = picture.corner;
        return Err(fail(format!(
            "begins at column {column}, row {row} of the whole image, but the light at column {x}, row {y}; render the background with \
             the same --crop"
        )));
    }
    if let Some([lo, hi]) = picture.gate
        && !(Gate { lo, hi }).is_open()
    {
        return Err(fail("has a gate, but daylight has none; render the background without a gate".into()));
    }
    if picture.rgb.iter().any(|value| !value.is_finite()) {
        return Err(fail("has values that are not finite; render an image without such pixels".into()));
    }
    Ok(picture.rgb.as_chunks().0.to_vec())
}

fn channels(args: &DetectArgs) -> usize {
    if args.mono { 1 } else { 3 }
}

/// The counts of all pixels, in the order of the array. Fails if they cannot be drawn.
fn counts(args: &DetectArgs, detector: &Detector, input: &Input, background: &[[f32; 3]]) -> Result<Vec<f32>, Error> {
    let Input { array, bins, .. } = input;
    let channels = channels(args);
    let of_channel = |rgb: &[f32; 3], channel: usize| match args.mono {
        true => rgb.iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0,
        false => f64::from(rgb[channel]),
    };
    let means_of = |pixel: usize, channel: usize| {
        let light = array.pixel([pixel % array.width, pixel / array.width]);
        let radiance = light.iter().map(|rgb| of_channel(rgb, channel));
        detector.means(radiance, of_channel(&background[pixel], channel), bins)
    };
    let pixels = 0..array.width * array.height;
    let draws_of = |pixel: usize| {
        let of_channel = |channel| {
            let means = means_of(pixel, channel);
            detector.check(&means, bins)?;
            Ok(detector.draws(&means, bins))
        };
        (0..channels).map(of_channel).sum::<Result<f64, Error>>()
    };
    Detector::check_draws(pixels.clone().into_par_iter().map(draws_of).sum::<Result<f64, Error>>()?)?;
    let count_pixel = |(pixel, counts_of_pixel): (usize, &mut [f32])| {
        for channel in 0..channels {
            let means = means_of(pixel, channel);
            // A seed per pixel and channel: counts do not depend on the order of the work.
            let seed = (u64::from(args.seed) << 32) ^ (3 * pixel + channel) as u64;
            let steady = detector.steady_means(of_channel(&background[pixel], channel), bins);
            for (k, count) in detector.counts(&means, &steady, bins, seed).into_iter().enumerate() {
                counts_of_pixel[k * channels + channel] = count as f32;
            }
        }
    };
    let per_pixel = array.images() * channels;
    let mut counts = vec![0.0; pixels.len() * per_pixel];
    counts.par_chunks_mut(per_pixel).enumerate().for_each(count_pixel);
    Ok(counts)
}

/// The description of the counts: the description of the radiance, with the detector added.
fn describe(args: &DetectArgs, input: &Input, shape: &[usize]) -> Value {
    let mut description = input.description.clone();
    description["unit"] = COUNTS.into();
    description["shape"] = shape.into();
    description["detector"] = json!({
        "light": args.input.display().to_string(),
        "photons_per_pulse_and_radiance": args.photons,
        "pulses": args.pulses,
        "efficiency": args.efficiency,
        "background": args.background,
        "dark_counts_per_second": args.dark_counts,
        "jitter_m": args.jitter.map(|jitter| jitter.0),
        "dead_time_m": args.dead_time.map(|time| time.0),
        "first_photon": args.first_photon,
        "mono": args.mono,
        "seed": args.seed,
    });
    description
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}
