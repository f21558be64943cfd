//! `taugate lidar`: a point cloud from the waveforms of a LiDAR scan.

use std::path::Path;
use std::process::ExitCode;

use serde_json::Value;
use taugate::Error;
use taugate::internals::files::{check_writable, has_extension};
use taugate::internals::image::array_set::{Role, beside, description, names, read_whole};
use taugate::internals::image::npy_read::{described, is_counts, is_scan, read_scan};
use taugate::internals::image::scan_layers::read_surfaces;
use taugate::internals::job::memory;
use taugate::internals::lidar::echoes::{Finder, MAX_ECHOES};
use taugate::internals::lidar::shots::Shots;
use taugate::internals::lidar::{Point, Waveforms, cloud_file};

use crate::app::cli::LidarArgs;

pub fn run(args: &LidarArgs) -> anyhow::Result<ExitCode> {
    cloud_file::check_extension(&args.output)?;
    check_numbers(args)?;
    check_writable(&args.output)?;
    let same =
        |a: &Path, b: &Path| std::fs::canonicalize(a).is_ok_and(|a| std::fs::canonicalize(b).is_ok_and(|b| a == b));
    if names(&args.input).iter().any(|file| same(file, &args.output)) {
        return Err(
            Error::settings(format!("{} would replace the scan; choose another name", args.output.display())).into()
        );
    }
    let cloud = read_whole(&args.input, || cloud(args))?;
    cloud_file::write(&args.output, &cloud)?;
    let shots = cloud.iter().filter(|point| point.echo == 1).count();
    let points = cloud.len();
    super::say(&format!("{}: {points} points of {shots} shots with an echo", args.output.display()));
    Ok(ExitCode::SUCCESS)
}

/// Fails if a number is out of range.
fn check_numbers(args: &LidarArgs) -> Result<(), Error> {
    let fail = |problem: String, remedy: String| Err(Error::advice(problem, remedy));
    if !(1..=MAX_ECHOES).contains(&args.max_echoes) {
        return fail(format!("--max-echoes is {}; ", args.max_echoes), format!("it must be from 1 to {MAX_ECHOES}"));
    }
    if !(args.threshold > 0.0 && args.threshold < 1.0) {
        return fail(format!("--threshold is {}; ", args.threshold), "it must be above 0 and below 1".into());
    }
    for (flag, x) in [("--min-intensity", args.min_intensity), ("--separation", args.separation)] {
        if !(x >= 0.0 && x.is_finite()) {
            return fail(format!("{flag} is {x}; "), "it must be a finite number, 0 or more".into());
        }
    }
    Ok(())
}

/// Reads the scan and finds its points.
fn cloud(args: &LidarArgs) -> Result<Vec<Point>, Error> {
    let path = &args.input;
    let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
    if !has_extension(path, "npy") || !is_scan(path) {
        return Err(fail(
            "is no scan; give the array (.npy) of an experiment with [scan], and keep its JSON file beside it",
        ));
    }
    let about = description(path);
    let shots = Shots::of(&about).ok_or_else(|| {
        fail("is no scan of a LiDAR whose laser lights what it sees; give its laser a divergence and directions, and measure it again")
    })?;
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    memory::check_bytes(2 * length, memory::free(), "the waveforms", "use fewer gates or points")?;
    if about["beat_hz_per_m"].is_number() {
        super::say(
            "warning: the ranges are those of an FMCW sensor: an object that moves seems nearer or farther; a rising and a falling sweep \
             together tell its range and its velocity",
        );
    }
    let mut array = read_scan(path)?;
    let gates = described(path, array.responses())
        .ok_or_else(|| fail("comes without the JSON file that names its gates; keep that file beside the array"))?;
    let (Some(begin), Some(width)) = (about["start_opl"].as_f64(), about["bin_width_opl"].as_f64()) else {
        return Err(fail("has no waveforms; measure it with --gates A..B/N"));
    };
    if array.pairs() != shots.count() || gates.iter().any(|gate| gate.repeat_m.is_some()) {
        return Err(fail("has waveforms of a pulsed laser or of other points; measure it again with --gates A..B/N"));
    }
    if is_counts(path) {
        let factor = light_per_count(&about["detector"]).ok_or_else(|| fail("has no counts that tell the light"))?;
        array.values.iter_mut().for_each(|count| *count = (f64::from(*count) * factor) as f32);
    }
    let fields: Vec<&str> = about["aov"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let layers = beside(path, Role::Layers).filter(|_| fields.contains(&"range"));
    let surfaces = layers.map(|layers| read_surfaces(&layers, &fields, shots.count())).transpose()?;
    let finder = Finder {
        detection: args.detection,
        threshold: args.threshold,
        floor: args.min_intensity,
        separation: 2.0 * args.separation / width,
        max: args.max_echoes,
    };
    let surfaces = surfaces.as_deref();
    Ok(Waveforms { shots: &shots, values: &array.values, begin, width, surfaces }.cloud(&finder))
}

/// The light in W/(m^2 sr) that gives a count on average. `None` if no light is counted.
fn light_per_count(detector: &Value) -> Option<f64> {
    let number = |key: &str| detector[key].as_f64();
    let counts = number("photons_per_pulse_and_radiance")? * number("pulses")? * number("efficiency")?;
    (counts > 0.0).then_some(1.0 / counts)
}
