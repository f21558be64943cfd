//! `taugate detect`: photon counts of a detector from the radiance of a render or a scan.

mod light;

use std::path::Path;
use std::process::ExitCode;

use rayon::prelude::*;
use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::detector::{Blind, Detector};
use taugate::internals::files::{check_writable, write_atomically};
use taugate::internals::image::exr_file::read_picture;
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_file::{COUNTS, description_path, paths_beside, write_new_array};
use taugate::internals::settings::units::Gate;

use super::memory;
use super::rescue::Rescue;
use crate::app::cli::DetectArgs;
use light::{Light, bytes_of, has_extension};

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
    light::check_readable_in(free, &args.input)?;
    let light = Light::read(&args.input)?;
    detector.check_gates(&light.bins, args.background.is_some())?;
    let background = background(args.background.as_deref(), &light)?;
    let shape = light.shape(args.mono);
    memory::check_bytes(
        bytes_of(shape.iter().product()) + bytes_of(light.numbers()),
        free,
        "the light with its counts",
        light::REMEDY,
    )?;
    let counts = counts(args, &detector, &light, &background)?;
    if counts.iter().any(|count| !count.is_finite()) {
        return Err(Error::settings(
            "counts exceed the largest number of the output, 3e38; lower --photons or --pulses",
        )
        .into());
    }

    let text = serde_json::to_string_pretty(&describe(args, &light, &shape))?;
    let in_order = || (0..counts.len()).map(|i| counts[light.index(i)]);
    let mut rescue = Rescue::default();
    let is_in_place = rescue.write(&args.output, |path| write_new_array(path, &shape, in_order()));
    rescue.write(&description, |path| match path == description && !is_in_place {
        // Another array may still lie beside it. The description goes where the counts are.
        true => Err(Error::settings("the counts could not be written")),
        false => write_atomically(path, |writer| std::io::Write::write_all(writer, text.as_bytes())),
    });
    rescue.finish()?;
    let total: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    let measurements = (light.pixels() * light.channels(args.mono)) as f64;
    let unit = match (light.size(), light.channels(args.mono)) {
        (None, _) => "pair of points",
        (Some(_), 1) => "pixel",
        _ => "pixel, channel",
    };
    super::say(&format!(
        "{}, {}: {total:.0} counts, {:.3} per {unit} and pulse",
        args.output.display(),
        description.display(),
        total / measurements / detector.pulses as f64,
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

/// R, G, B of the background per pixel: a number, or an image of a render without a gate.
fn background(text: Option<&str>, light: &Light) -> Result<Vec<[f32; 3]>, Error> {
    let pixels = light.pixels();
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
    let Some([width, height]) = light.size() else {
        return Err(fail(
            "is an image, but the light is a scan; give the radiance of the background as a number".into(),
        ));
    };
    if exr_responses::has_many(path)? {
        return Err(fail("has several gates, but daylight has none; render the background without a gate".into()));
    }
    let picture = read_picture(path)?;
    if [picture.width as usize, picture.height as usize] != [width, height] {
        return Err(fail(format!(
            "is {}x{}, but the light is {width}x{height}; render the background with the same --resolution and --crop",
            picture.width, picture.height
        )));
    }
    // An image of another program may show the same part of the scene without saying so.
    if let (Some(_), Some([x, y])) = (&picture.renderer, light.corner)
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

/// The counts of all pixels, indexed by pixel, gate and channel. Fails if they cannot be drawn.
fn counts(args: &DetectArgs, detector: &Detector, light: &Light, background: &[[f32; 3]]) -> Result<Vec<f32>, Error> {
    let bins = &light.bins;
    let channels = light.channels(args.mono);
    let of_background = |pixel: usize, channel: usize| light::of_channel(&background[pixel], channels, channel);
    let means_of = |pixel: usize, channel: usize| {
        detector.means(light.radiance(pixel, channels, channel).into_iter(), of_background(pixel, channel), bins)
    };
    let pixels = 0..light.pixels();
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
            let steady = detector.steady_means(of_background(pixel, channel), bins);
            for (k, count) in detector.counts(&means, &steady, bins, seed).into_iter().enumerate() {
                counts_of_pixel[k * channels + channel] = count as f32;
            }
        }
    };
    let per_pixel = light.gates() * channels;
    let mut counts = vec![0.0; pixels.len() * per_pixel];
    counts.par_chunks_mut(per_pixel).enumerate().for_each(count_pixel);
    Ok(counts)
}

/// The description of the counts: the description of the radiance, with the detector added.
fn describe(args: &DetectArgs, light: &Light, shape: &[usize]) -> Value {
    let mut description = light.description.clone();
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
