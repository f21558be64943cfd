//! `taugate compare`: relMSE, MSE, FLIP and ratio of means against a reference.

use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::exr_file::{Picture, read_picture};
use taugate::metrics::{self, RELMSE_FORMULA};

use crate::cli::CompareArgs;

pub fn run(args: &CompareArgs) -> anyhow::Result<ExitCode> {
    if let Some(most) = args.max_relmse
        && (most.is_nan() || most < 0.0)
    {
        return Err(Error::Settings(format!("--max-relmse is {most}; it must be a number from 0 up, like 0.05")).into());
    }
    let image = read_finite(&args.image)?;
    let reference = read_finite(&args.reference)?;
    let size = |p: &Picture| (p.width, p.height);
    if size(&image) != size(&reference) {
        return Err(Error::Settings(format!(
            "the images differ in size: {} is {}x{}, {} is {}x{}; render both with the same --resolution and --crop",
            args.image.display(),
            image.width,
            image.height,
            args.reference.display(),
            reference.width,
            reference.height
        ))
        .into());
    }

    let result = metrics::compare(&image.rgb, &reference.rgb)?;
    let flip = metrics::flip::hdr(&image.rgb, &reference.rgb, image.width as usize).mean();
    let within = args.max_relmse.is_none_or(|most| result.relmse <= most);
    if args.json {
        let mut json = serde_json::to_value(result)?;
        json["flip"] = flip.into();
        json["formula"] = RELMSE_FORMULA.into();
        json["max_relmse"] = args.max_relmse.into();
        json["within"] = within.into();
        super::print(&format!("{json:#}\n"));
    } else {
        let mut text = format!(
            "relMSE          {:.6e}\n                {RELMSE_FORMULA}; eps = {:.6e}\nMSE             {:.6e}\n\
             FLIP            {flip:.6}  (HDR-FLIP, mean; 67 pixels a degree, ACES)\n\
             ratio of means  {:.6}  ({:.6e} / {:.6e})\n",
            result.relmse, result.eps, result.mse, result.ratio_of_means, result.mean, result.reference_mean
        );
        if let Some(most) = args.max_relmse {
            text += &format!("threshold       {} {most:e}\n", if within { "met:" } else { "exceeded:" });
        }
        super::print(&text);
    }
    Ok(ExitCode::from(if within { 0 } else { 1 }))
}

fn read_finite(path: &Path) -> Result<Picture, Error> {
    let picture = read_picture(path)?;
    if let Some((pixel, channel)) = metrics::first_non_finite(&picture.rgb) {
        let (x, y) = (pixel % picture.width as usize, pixel / picture.width as usize);
        let value = picture.rgb[3 * pixel + channel];
        let message =
            format!("pixel {x},{y} is {value} in {}; only finite images are compared", ["R", "G", "B"][channel]);
        return Err(Error::File { path: path.into(), message });
    }
    Ok(picture)
}
