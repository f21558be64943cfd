//! `taugate lidar`: a point cloud from the waveforms of a LiDAR scan.

mod input;

use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::internals::files::{check_writable, is_same};
use taugate::internals::image::array_set::{names, read_whole};
use taugate::internals::lidar::echoes::MAX_ECHOES;
use taugate::internals::lidar::sweeps::{Paired, Sweeps};
use taugate::internals::lidar::{Point, cloud_file};

use crate::app::cli::LidarArgs;
use input::Input;

pub fn run(args: &LidarArgs) -> anyhow::Result<ExitCode> {
    cloud_file::check_extension(&args.output)?;
    check_numbers(args)?;
    check_writable(&args.output)?;
    let read = args.falling.iter().chain([&args.input]).flat_map(|path| names(path));
    if read.into_iter().any(|file| is_same(&file, &args.output)) {
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

/// Reads the scan, or two sweeps, and finds the points.
fn cloud(args: &LidarArgs) -> Result<Vec<Point>, Error> {
    let input = Input::read(args, &args.input)?;
    if input.unmeasured > 0 {
        super::say(&format!(
            "warning: the scan was interrupted: the last {} of {} shots have no points",
            input.unmeasured,
            input.shots.count()
        ));
    }
    match &args.falling {
        Some(other) => two_sweeps(args, &input, other),
        None if input.chirp.is_some() => {
            super::say(
                "warning: the ranges are those of an FMCW sensor: an object that moves seems nearer or farther; with a second sweep, such \
                 as --falling SCAN.npy, they are right, and each echo has an object and a velocity",
            );
            // The surfaces have other ranges than their beats.
            Ok(input.cloud(args, None))
        }
        None => Ok(input.cloud(args, input.surfaces.as_deref())),
    }
}

/// The points of two sweeps of an FMCW sensor.
fn two_sweeps(args: &LidarArgs, input: &Input, path: &Path) -> Result<Vec<Point>, Error> {
    let fail = |path: &Path, message: &str| Error::File { path: path.into(), message: message.into() };
    let other = read_whole(path, || Input::read(args, path))?;
    let [Some(coupling), Some(of_other)] = [input, &other].map(|input| input.chirp.map(|chirp| chirp.coupling()))
    else {
        return Err(fail(
            if input.chirp.is_some() { path } else { &args.input },
            "is no scan of an FMCW sensor, as --falling needs; measure it with --fmcw",
        ));
    };
    if coupling == of_other {
        return Err(fail(
            path,
            "has the same sweep as the first scan; measure it with another, such as one that falls",
        ));
    }
    if input.shots != other.shots || input.setting != other.setting {
        return Err(fail(
            path,
            "is a scan with other shots, another scene or other settings than the first one; measure both alike, only with another --fmcw",
        ));
    }
    let (couplings, shots) = ([coupling, of_other], &input.shots);
    let sweeps = Sweeps { couplings, shots, surfaces: input.surfaces.as_deref() };
    let Paired { cloud, unlike, may_fold } = sweeps.pair([input, &other].map(|input| input.cloud(args, None)));
    if unlike > 0 {
        super::say(&format!(
            "warning: {unlike} of {} shots are left out, because their echoes in the two sweeps do not fit each other",
            shots.count()
        ));
    }
    if may_fold > 0 {
        super::say(&format!(
            "warning: motion shifts {may_fold} of {} echoes by more than half of their range; if it shifts a beat by more than the range, \
             range and velocity are wrong: use a shorter sweep, or a larger bandwidth",
            cloud.len()
        ));
    }
    Ok(cloud)
}
