//! `taugate detect`: photon counts of a detector from the radiance of a render or a scan.

mod light;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::{Value, json};
use taugate::Error;
use taugate::internals::detector::light::counts;
use taugate::internals::detector::{Blind, Detector};
use taugate::internals::files::{check_writable, has_extension, is_same};
use taugate::internals::image::array_set::{ArraySet, Role, forget_arrays, names};
use taugate::internals::image::exr_file::read_picture;
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_file::{COUNTS, description_path};
use taugate::internals::image::png_file;
use taugate::internals::job::memory;
use taugate::internals::settings::exposure::Exposure;
use taugate::internals::settings::units::Gate;

use super::rescue::Rescue;
use crate::app::cli::{DetectArgs, DetectorArgs};
use light::{Input, bytes_of};

pub fn run(args: &DetectArgs) -> anyhow::Result<ExitCode> {
    if !has_extension(&args.output, "npy") {
        return Err(Error::settings(format!("the output {} must end in .npy", args.output.display())).into());
    }
    let detector = detector(args.photons, &args.detector)?;
    let png = picture_path(args)?;
    let description = description_path(&args.output);
    check_writable(&args.output)?;
    check_writable(&description)?;
    let of_light = names(&args.input);
    if names(&args.output).iter().chain(&png).any(|file| of_light.iter().any(|of_light| is_same(file, of_light))) {
        return Err(
            Error::settings(format!("{} would replace the light; choose another name", args.output.display())).into()
        );
    }
    let free = memory::free();
    light::check_readable_in(free, &args.input)?;
    let input = Input::read(&args.input)?;
    let light = &input.light;
    if png.is_some() && light.size().is_none() {
        return Err(Error::advice("--png needs images, but the light is a scan; ", "leave out --png").into());
    }
    detector.check_gates(light.bins(), args.background.is_some())?;
    let background = background(args.background.as_deref(), &input)?;
    let shape = light.shape(args.mono);
    memory::check_bytes(
        bytes_of(shape.iter().product()) + bytes_of(light.numbers()),
        free,
        "the light with its counts",
        light::REMEDY,
    )?;
    let counts = counts(&detector, light, &background, args.mono, args.detector.seed)?;

    let about = describe(args, &input, &shape);
    let write = |path: &Path| {
        let mut set = ArraySet::new(path);
        set.add(Role::Array, &shape, counts.iter().copied())?;
        set.publish(&about)
    };
    let mut rescue = Rescue::default();
    rescue.write(&args.output, write);
    if let (Some(path), Some([width, height])) = (&png, light.size()) {
        let picture = sums_over_gates(&counts, light.gates(), light.channels(args.mono));
        let exposure = match args.exposure.unwrap_or_default() {
            Exposure::Auto => png_file::exposure(&picture),
            Exposure::Stops(stops) => stops.exp2() as f32,
        };
        rescue.write(path, |path| png_file::write(path, width as u32, height as u32, &picture, exposure));
    }
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

/// The detector that the user describes. `photons`: see [`Detector::photons`]. Fails if a number is out of range.
pub fn detector(photons: f64, args: &DetectorArgs) -> Result<Detector, Error> {
    let blind = match args.dead_time {
        Some(time) => Blind::For(time.0),
        None if args.first_photon => Blind::UntilNextPulse,
        None => Blind::Never,
    };
    let detector = Detector {
        photons,
        pulses: args.pulses,
        efficiency: args.efficiency,
        dark_rate: args.dark_counts,
        jitter: args.jitter.map_or(0.0, |jitter| jitter.0),
        blind,
    };
    detector.check_numbers()?;
    Ok(detector)
}

/// The file of --png. Fails if it has another extension or cannot be written.
fn picture_path(args: &DetectArgs) -> Result<Option<PathBuf>, Error> {
    let path = match &args.png {
        None if args.exposure.is_some() => return Err(Error::advice("--exposure is for the picture: ", "add --png")),
        None => return Ok(None),
        Some(None) => args.output.with_extension("png"),
        Some(Some(path)) if has_extension(path, "png") => path.clone(),
        Some(Some(path)) => {
            return Err(Error::settings(format!("the picture {} must end in .png", path.display())));
        }
    };
    check_writable(&path)?;
    Ok(Some(path))
}

/// The sum of the counts over all gates: R, G, B per pixel. A detector without colours gives grey.
fn sums_over_gates(counts: &[f32], gates: usize, channels: usize) -> Vec<f32> {
    let of_pixel = |counts: &[f32]| {
        let sum = |channel: usize| counts.iter().skip(channel).step_by(channels).sum::<f32>();
        [0, 1, 2].map(|k| sum(k.min(channels - 1)))
    };
    counts.chunks_exact(gates * channels).flat_map(of_pixel).collect()
}

/// R, G, B of the background per pixel: a number, or an image of a render without a gate.
fn background(text: Option<&str>, input: &Input) -> Result<Vec<[f32; 3]>, Error> {
    let light = &input.light;
    let pixels = light.pixels();
    let Some(text) = text else { return Ok(vec![[0.0; 3]; pixels]) };
    let path = Path::new(text);
    if !has_extension(path, "exr") {
        let radiance = text.parse().ok().filter(|x: &f32| x.is_finite() && *x >= 0.0);
        let radiance = radiance.ok_or_else(|| {
            Error::advice(
                format!("'{text}' is no background; "),
                "give a radiance in W/(m^2 sr), 0 or more, or an image (.exr)",
            )
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
    if let (Some(_), Some([x, y])) = (&picture.renderer, input.corner)
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

/// The description of the counts: the description of the radiance, with the detector added.
fn describe(args: &DetectArgs, input: &Input, shape: &[usize]) -> Value {
    let mut description = input.description.clone();
    // The arrays beside the light are not beside the counts.
    forget_arrays(description.as_object_mut().expect("a description is an object"));
    description["unit"] = COUNTS.into();
    description["shape"] = shape.into();
    description["detector"] = json!({
        "light": args.input.display().to_string(),
        "photons_per_pulse_and_radiance": args.photons,
        "pulses": args.detector.pulses,
        "efficiency": args.detector.efficiency,
        "background": args.background,
        "dark_counts_per_second": args.detector.dark_counts,
        "jitter_m": args.detector.jitter.map(|jitter| jitter.0),
        "dead_time_m": args.detector.dead_time.map(|time| time.0),
        "first_photon": args.detector.first_photon,
        "mono": args.mono,
        "seed": args.detector.seed,
    });
    description
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_counts_is_the_sum_over_the_gates() {
        let counts: Vec<f32> = (1..=12).map(|x| x as f32).collect();
        assert_eq!(sums_over_gates(&counts, 2, 3), [5.0, 7.0, 9.0, 17.0, 19.0, 21.0]);
        assert_eq!(sums_over_gates(&counts[..4], 2, 1), [3.0, 3.0, 3.0, 7.0, 7.0, 7.0]);
    }
}
