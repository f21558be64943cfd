//! The waveforms that `taugate lidar` reads: a scan, or the counts of a detector.

use std::path::Path;

use serde_json::Value;
use taugate::internals::detector::light::{Light, Values, counts};
use taugate::internals::files::has_extension;
use taugate::internals::image::array_set::{Role, beside, description};
use taugate::internals::image::npy_read::{DescribedResponse, ScanArray, described, is_counts, is_scan, read_scan};
use taugate::internals::image::scan_layers::{Surface, read_surfaces};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::job::memory;
use taugate::internals::lidar::echoes::Finder;
use taugate::internals::lidar::shots::Shots;
use taugate::internals::lidar::{Point, Waveforms};
use taugate::internals::settings::chirp::Chirp;
use taugate::{Error, ErrorKind};

use crate::app::cli::LidarArgs;
use crate::app::detect;

/// A scan of a LiDAR.
pub struct Input {
    pub shots: Shots,
    /// The sweep of an FMCW sensor, whose waveforms are beat spectra.
    pub chirp: Option<Chirp>,
    /// The first surface on the axis of each shot, if the scan has these layers.
    pub surfaces: Option<Vec<Surface>>,
    /// Light per bin and shot, the shot the fastest.
    values: Vec<f32>,
    /// Begin of the first bin, and width of the bins, in metres of optical path.
    begin: f64,
    pub width: f64,
    /// See [`Waveforms::velocities`].
    velocities: Option<Vec<f32>>,
}

impl Input {
    /// Reads a scan or counts, and draws the counts of the detector that `args` describe, if they do.
    pub fn read(args: &LidarArgs, path: &Path) -> Result<Input, Error> {
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
        let velocities = beside(path, Role::Velocity);
        let copies = if args.photons.is_some() { 4 } else { 2 } + if velocities.is_some() { 4 } else { 0 };
        memory::check_bytes(copies * length, memory::free(), "the waveforms", "use fewer gates or points")?;
        let mut array = read_scan(path)?;
        let gates = described(path, array.responses())
            .ok_or_else(|| fail("comes without the JSON file that names its gates; keep that file beside the array"))?;
        let (Some(begin), Some(width)) = (about["start_opl"].as_f64(), about["bin_width_opl"].as_f64()) else {
            return Err(fail("has no waveforms; measure it with --gates A..B/N"));
        };
        if array.pairs() != shots.count() || gates.iter().any(|gate| gate.repeat_m.is_some()) {
            return Err(fail(
                "has waveforms of a pulsed laser or of other points; measure it again with --gates A..B/N",
            ));
        }
        let velocities = velocities.map(|velocities| read_scan(&velocities)).transpose()?.map(|array| array.values);
        if velocities.as_ref().is_some_and(|velocities| velocities.len() != 2 * array.values.len()) {
            return Err(fail("does not fit its velocities; measure it again"));
        }
        let chirp = chirp(&about);
        if is_counts(path) {
            if args.photons.is_some() {
                return Err(fail(
                    "holds the counts of a detector already; leave out --photons, or give the scan itself",
                ));
            }
            let per_light = counts_per_light(&about["detector"]);
            divide(&mut array.values, per_light.ok_or_else(|| fail("has no counts that tell the light"))?);
        }
        let values = match args.photons {
            None => array.values,
            Some(_) if chirp.is_some() => {
                return Err(fail(
                    "holds beat spectra, but a detector counts photons by their travel times; leave out --photons",
                ));
            }
            Some(photons) => counted(args, photons, array, &gates).map_err(|error| match error.kind() {
                ErrorKind::Settings => fail(&error.to_string()),
                _ => error,
            })?,
        };
        let fields: Vec<&str> = about["aov"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let layers = beside(path, Role::Layers).filter(|_| fields.contains(&"range"));
        let surfaces = layers.map(|layers| read_surfaces(&layers, &fields, shots.count())).transpose()?;
        Ok(Input { shots, chirp, surfaces, values, begin, width, velocities })
    }

    /// The points of all shots. With `surfaces`, echoes of the first surfaces have their exact ranges and their objects.
    pub fn cloud(&self, args: &LidarArgs, surfaces: Option<&[Surface]>) -> Vec<Point> {
        let finder = Finder {
            detection: args.detection,
            threshold: args.threshold,
            floor: args.min_intensity,
            separation: 2.0 * args.separation / self.width,
            max: args.max_echoes,
        };
        let Input { shots, values, begin, width, velocities, .. } = self;
        let velocities = velocities.as_deref();
        Waveforms { shots, values, begin: *begin, width: *width, surfaces, velocities }.cloud(&finder)
    }
}

/// The sweep in the settings of a scan with this description.
fn chirp(about: &Value) -> Option<Chirp> {
    Experiment::parse(about["settings"].as_str()?).ok()?.gate.fmcw
}

/// The counts of a described detector that light of 1 W/(m^2 sr) gives on average. `None` if it counts no light.
fn counts_per_light(detector: &Value) -> Option<f64> {
    let number = |key: &str| detector[key].as_f64();
    let counts = number("photons_per_pulse_and_radiance")? * number("pulses")? * number("efficiency")?;
    (counts > 0.0).then_some(counts)
}

/// The light that the counts of a detector tell, on average that of `scan`.
fn counted(args: &LidarArgs, photons: f64, scan: ScanArray, gates: &[DescribedResponse]) -> Result<Vec<f32>, Error> {
    let detector = detect::detector(photons, &args.detector)?;
    let background = args.background.unwrap_or(0.0);
    if !(background >= 0.0 && background.is_finite()) {
        return Err(Error::advice(format!("--background is {background}; "), "it must be a finite number, 0 or more"));
    }
    let per_light = photons * args.detector.pulses as f64 * args.detector.efficiency;
    if per_light == 0.0 {
        return Err(Error::advice("a detector that counts no light sees no echo; ", "raise --photons or --efficiency"));
    }
    let light = Light::new(Values::Scan(scan), gates)?;
    let background = vec![[background; 3]; light.pixels()];
    let mut counts = counts(&detector, &light, &background, true, args.detector.seed)?;
    divide(&mut counts, per_light);
    Ok(counts)
}

/// Divides counts by the counts of light of 1.
fn divide(counts: &mut [f32], per_light: f64) {
    counts.iter_mut().for_each(|count| *count = (f64::from(*count) / per_light) as f32);
}
