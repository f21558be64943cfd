//! The waveforms that `taugate lidar` reads: a scan, or the counts of a detector.

use std::path::{Path, PathBuf};

use serde_json::Value;
use taugate::Error;
use taugate::internals::detector::light::{Light, Values, counts};
use taugate::internals::files::{check_readable, has_extension};
use taugate::internals::image::array_set::{Role, beside, description};
use taugate::internals::image::npy_read::{DescribedResponse, ScanArray, described, is_counts, is_scan, read_scan};
use taugate::internals::image::scan_layers::{Surface, read_surfaces};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::job::memory;
use taugate::internals::lidar::echoes::Finder;
use taugate::internals::lidar::shots::Shots;
use taugate::internals::lidar::{Point, Waveforms};
use taugate::internals::settings::chirp::Chirp;
use taugate::internals::settings::units::METRES_PER_NS;

use crate::app::cli::LidarArgs;
use crate::app::detect;

/// A scan of a LiDAR.
pub struct Input {
    pub shots: Shots,
    /// The sweep of an FMCW sensor, whose waveforms are beat spectra.
    pub chirp: Option<Chirp>,
    /// What two sweeps have in common: the experiment without the sweep, the seed and the number of samples, as TOML.
    pub setting: Option<String>,
    /// Number of shots that were not measured, because the scan was interrupted.
    pub unmeasured: usize,
    /// The first surface on the axis of each shot, if the scan has these layers.
    pub surfaces: Option<Vec<Surface>>,
    /// Light per bin and shot, the shot the fastest.
    values: Vec<f32>,
    /// See [`Waveforms::begin`].
    begin: f64,
    width: f64,
    /// See [`Waveforms::background`].
    background: f64,
    /// See [`Waveforms::velocities`].
    velocities: Option<Vec<f32>>,
}

impl Input {
    /// Reads a scan or counts, and draws the counts of the detector that `args` describe, if they do.
    pub fn read(args: &LidarArgs, path: &Path) -> Result<Input, Error> {
        let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
        check_readable(path)?;
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
        let velocities = named(path, &about, Role::Velocity)?;
        let copies = if args.photons.is_some() { 4 } else { 2 } + if velocities.is_some() { 4 } else { 0 };
        memory::check_bytes(copies * length, memory::free(), "the waveforms", "use fewer gates or points")?;
        let array = read_scan(path)?;
        let gates = described(path, array.responses())
            .ok_or_else(|| fail("comes without the JSON file that names its gates; keep that file beside the array"))?;
        let [begin, width] = bins(&about, &gates).map_err(fail)?;
        let measured = about["measured_laser_points"].as_u64().map_or(shots.count(), |count| count as usize);
        let is_finite = |(at, value): (usize, &f32)| at % shots.count() >= measured || value.is_finite();
        let velocities = velocities.map(|velocities| read_scan(&velocities)).transpose()?.map(|array| array.values);
        let has_velocities = velocities.as_ref().is_none_or(|velocities| velocities.len() == 2 * array.values.len());
        if array.pairs() != shots.count() || !has_velocities || !array.values.iter().enumerate().all(is_finite) {
            return Err(fail("does not fit its JSON file, or has values that are not finite; measure it again"));
        }
        let experiment = about["settings"].as_str().and_then(|settings| Experiment::parse(settings).ok());
        let chirp = experiment.as_ref().and_then(|experiment| experiment.gate.fmcw);
        if chirp.is_none() && about["beat_hz_per_m"].is_number() {
            return Err(fail("has a JSON file that was changed; measure it again"));
        }
        if chirp.is_some() && args.photons.is_some() {
            return Err(fail(
                "holds beat spectra, but a detector counts photons by their travel times; leave out --photons",
            ));
        }
        let (values, noise) = light(args, path, &about, array, &gates)?;
        let fields: Vec<&str> = about["aov"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let layers = named(path, &about, Role::Layers)?.filter(|_| fields.contains(&"range"));
        let surfaces = layers.map(|layers| read_surfaces(&layers, &fields, shots.count())).transpose()?;
        let index = about["group_index"].as_f64().unwrap_or(1.0);
        Ok(Input {
            unmeasured: shots.count().saturating_sub(measured),
            shots,
            chirp,
            setting: experiment.map(setting),
            surfaces,
            values,
            begin: begin / index,
            width: width / index,
            background: noise * width / METRES_PER_NS * 1e-9,
            velocities,
        })
    }

    /// The points of all shots. With `surfaces`, echoes of the first surfaces have their exact ranges and their objects.
    pub fn cloud(&self, args: &LidarArgs, surfaces: Option<&[Surface]>) -> Vec<Point> {
        let &Input { ref shots, ref values, begin, width, background, ref velocities, .. } = self;
        let finder = Finder {
            detection: args.detection,
            threshold: args.threshold,
            floor: args.min_intensity,
            separation: 2.0 * args.separation / width,
            max: args.max_echoes,
        };
        let velocities = velocities.as_deref();
        Waveforms { shots, values, begin, width, background, surfaces, velocities }.cloud(&finder)
    }
}

/// The file of this role beside the scan `path`. Fails if the description `about` names it, but it is missing.
fn named(path: &Path, about: &Value, role: Role) -> Result<Option<PathBuf>, Error> {
    let found = beside(path, role);
    match found.is_none() && about["files"].get(role.key()).is_some() {
        false => Ok(found),
        true => Err(Error::File {
            path: role.path(path),
            message: format!("is missing, but belongs to {}; put it there, or measure the scan again", path.display()),
        }),
    }
}

/// Begin and width of the bins in metres of optical path. Fails if they are no bins of a waveform.
fn bins(about: &Value, gates: &[DescribedResponse]) -> Result<[f64; 2], &'static str> {
    let (Some(begin), Some(width)) = (about["start_opl"].as_f64(), about["bin_width_opl"].as_f64()) else {
        return Err("has no waveforms; measure it with --gates A..B/N");
    };
    if gates.iter().any(|gate| gate.repeat_m.is_some()) {
        return Err("counts the light of many pulses; measure it again without --repeat");
    }
    let step = match gates {
        [.., before, last] => last.gate_begin_m - before.gate_begin_m,
        _ => width,
    };
    match width > 0.0 && begin >= 0.0 && (step - width).abs() <= 1e-3 * width {
        true => Ok([begin, width]),
        false => Err("has a JSON file that was changed; measure it again"),
    }
}

/// See [`Input::setting`].
fn setting(experiment: Experiment) -> String {
    let mut common = experiment;
    common.gate.fmcw = None;
    let render = &mut common.render;
    (render.seed, render.spp, render.time, render.device) = (None, None, None, None);
    common.to_toml()
}

/// The light of a scan, or the light that counts tell, and what a detector adds to it per second. `array`: the contents of the file.
fn light(
    args: &LidarArgs,
    path: &Path,
    about: &Value,
    mut array: ScanArray,
    gates: &[DescribedResponse],
) -> Result<(Vec<f32>, f64), Error> {
    let fail = |message: &str| Error::File { path: path.into(), message: message.into() };
    match args.photons {
        Some(_) if is_counts(path) => {
            Err(fail("holds the counts of a detector already; leave out --photons, or give the scan itself"))
        }
        Some(photons) => counted(args, photons, path, array, gates),
        None if is_counts(path) => {
            let number = |key: &str| about["detector"][key].as_f64();
            let factors = ["photons_per_pulse_and_radiance", "pulses", "efficiency"].map(number);
            let per_light = factors.into_iter().product::<Option<f64>>().filter(|counts| *counts > 0.0);
            let per_light = per_light.ok_or_else(|| fail("has no counts that tell the light"))?;
            divide(&mut array.values, per_light);
            let dark = number("dark_counts_per_second").unwrap_or(0.0) * number("pulses").unwrap_or(0.0);
            let daylight: Option<f64> = about["detector"]["background"].as_str().and_then(|text| text.parse().ok());
            Ok((array.values, daylight.unwrap_or(0.0) + dark / per_light))
        }
        None => Ok((array.values, 0.0)),
    }
}

/// The light that the counts of the detector of `args` tell, on average that of `scan` and the second value per second.
fn counted(
    args: &LidarArgs,
    photons: f64,
    path: &Path,
    scan: ScanArray,
    gates: &[DescribedResponse],
) -> Result<(Vec<f32>, f64), Error> {
    let detector = detect::detector(photons, &args.detector)?;
    let background = args.background.unwrap_or(0.0);
    if !(background >= 0.0 && background.is_finite()) {
        return Err(Error::advice(format!("--background is {background}; "), "it must be a finite number, 0 or more"));
    }
    let pulses = args.detector.pulses as f64;
    let per_light = photons * pulses * args.detector.efficiency;
    if per_light == 0.0 {
        return Err(Error::advice("a detector that counts no light sees no echo; ", "raise --photons or --efficiency"));
    }
    let light = Light::new(Values::Scan(scan), gates)
        .map_err(|error| Error::File { path: path.into(), message: error.to_string() })?;
    let daylight = vec![[background; 3]; light.pixels()];
    let mut counts = counts(&detector, &light, &daylight, true, args.detector.seed)?;
    divide(&mut counts, per_light);
    Ok((counts, f64::from(background) + args.detector.dark_counts * pulses / per_light))
}

/// Divides counts by the counts of light of 1.
fn divide(counts: &mut [f32], per_light: f64) {
    counts.iter_mut().for_each(|count| *count = (f64::from(*count) / per_light) as f32);
}
