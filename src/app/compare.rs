//! `taugate compare`: relMSE, MSE, FLIP and ratio of means against a reference.

mod arrays;

use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::internals::compare::agreement::{Agreement, SIGNIFICANCE, Verdict, agreement, colours};
use taugate::internals::compare::flip;
use taugate::internals::compare::metrics::{self, RELMSE_FORMULA, TRIMMED};
use taugate::internals::files::is_same;
use taugate::internals::image::accumulation::file::read_about;
use taugate::internals::image::batches::CellBatches;
use taugate::internals::image::exr_file::{Merged, Picture, read_picture, write_plain};
use taugate::internals::image::exr_header::read_size;
use taugate::internals::image::png_file;

use super::accumulated;
use crate::app::cli::CompareArgs;

pub fn run(args: &CompareArgs) -> anyhow::Result<ExitCode> {
    if let Some(max) = args.max_relmse
        && (max.is_nan() || max < 0.0)
    {
        return Err(Error::advice(format!("--max-relmse is {max}; "), "it must be 0 or more, such as 0.05").into());
    }
    let mut is_array = false;
    for path in [&args.image, &args.reference] {
        is_array |= arrays::is_array(path)?;
    }
    if is_array {
        return arrays::run(args);
    }
    // A small file may hold a huge image, so compare the sizes before decoding.
    let [[width, height], [reference_width, reference_height]] = [size(&args.image)?, size(&args.reference)?];
    if [width, height] != [reference_width, reference_height] {
        return Err(Error::settings(format!(
            "the images differ in size: {} is {width}x{height}, {} is {reference_width}x{reference_height}; render both with \
             the same --resolution and --crop",
            args.image.display(),
            args.reference.display(),
        ))
        .into());
    }
    let image = read_finite(&args.image)?;
    let reference = read_finite(&args.reference)?;

    let result = metrics::compare(&image.rgb, &reference.rgb)?;
    let flip = flip::hdr(&image.rgb, &reference.rgb, image.width as usize).mean();
    let within = args.max_relmse.is_none_or(|max| result.relmse <= max);
    let verdict = args.z.as_ref().map(|out| z_map(args, out, &image, &reference)).transpose()?;
    let damped = verdict.as_ref().and_then(|_| damped(&image, &reference));
    let blurred = verdict.as_ref().and_then(|_| blur(&image, &reference));
    let notes = content_difference(&image, &reference).into_iter().chain(blurred).chain(damped.map(String::from));
    for note in notes {
        super::say(&format!("note: {note}"));
    }
    if args.json {
        let mut json = serde_json::to_value(result)?;
        json["flip"] = flip.into();
        json["formula"] = RELMSE_FORMULA.into();
        json["max_relmse"] = args.max_relmse.into();
        json["within"] = within.into();
        json["z"] = serde_json::to_value(&verdict)?;
        super::print(&format!("{json:#}\n"))?;
    } else {
        let mut text = format!(
            "relMSE          {:.6e}\n                {RELMSE_FORMULA}; eps = {:.6e}\n  trimmed       {:.6e}  (without the worst {:.0} % of the pixels)\nMSE             {:.6e}\n\
             FLIP            {flip:.6}  (HDR-FLIP, mean; 67 pixels per degree, ACES)\n\
             ratio of means  {:.6}  ({:.6e} / {:.6e})\n",
            result.relmse,
            result.eps,
            result.trimmed_relmse,
            100.0 * TRIMMED,
            result.mse,
            result.ratio_of_means,
            result.mean,
            result.reference_mean
        );
        if let Some(max) = args.max_relmse {
            text += &format!("threshold       {} {max:e}\n", if within { "met:" } else { "exceeded:" });
        }
        super::print(&(text + &verdict.as_ref().map(describe).unwrap_or_default()))?;
    }
    Ok(ExitCode::from(match verdict.map(|verdict| verdict.verdict) {
        _ if !within => 1,
        Some(Verdict::Differ) => 1,
        Some(Verdict::TooFewSamples) => 2,
        Some(Verdict::Agree) | None => 0,
    }))
}

/// A sentence about damped fireflies, which the noise of an image does not tell.
fn damped(image: &Picture, reference: &Picture) -> Option<&'static str> {
    let is_damped = image.undamped.is_some() || reference.undamped.is_some();
    is_damped.then_some("the test uses the images without damped fireflies (undamped.R, .G, .B); all other figures are those of the damped ones")
}

/// A sentence about light that merging has blurred, which the noise of an image does not tell.
fn blur(image: &Picture, reference: &Picture) -> Option<String> {
    let merged = image.merged.into_iter().chain(reference.merged).filter(|merged| merged.share > 0.0);
    let Merged { share, radius } = merged.max_by(|a, b| a.share.total_cmp(&b.share))?;
    Some(format!(
        "{:.1} % of the light was merged within {radius:.2} pixels or less, which blurs edges; a large z there may be this bias; render \
         longer, or with a smaller --merge-radius",
        100.0 * share
    ))
}

/// A sentence about the difference if the metadata of the files name different crops or gates.
fn content_difference(image: &Picture, reference: &Picture) -> Option<String> {
    if image.corner != reference.corner {
        let [[x, y], [u, v]] = [image.corner, reference.corner];
        return Some(format!(
            "the images show different crops: one begins at column {x}, row {y}, the other at column {u}, row {v}"
        ));
    }
    let [[lo, hi], [from, to]] = [image.gate?, reference.gate?];
    let differ = [lo, hi] != [from, to];
    differ.then(|| format!("the images show different gates: {lo} m to {hi} m, and {from} m to {to} m"))
}

/// Tests whether the images differ by more than their noise, and writes the map of z.
fn z_map(args: &CompareArgs, out: &Path, image: &Picture, reference: &Picture) -> Result<Agreement, Error> {
    let extension = out.extension().unwrap_or_default().to_ascii_lowercase();
    if extension != "png" && extension != "exr" {
        return Err(Error::settings(format!("the map of --z, {}, must end in .png or .exr", out.display())));
    }
    if is_same(out, &args.image) || is_same(out, &args.reference) {
        return Err(Error::settings(format!("--z would overwrite {}; choose another name", out.display())));
    }
    if image.seed.is_some() && image.seed == reference.seed && unbiased(image) != unbiased(reference) {
        return Err(Error::settings(format!(
            "both images were rendered with seed {}, so their noise is not independent; render one with another --seed",
            image.seed.as_deref().unwrap_or_default()
        )));
    }
    let batches = |path: &Path, picture: &Picture| {
        let floats = picture.cell_batches.as_ref().ok_or_else(|| Error::File {
            path: path.into(),
            message: "has no estimate of its noise (the attribute tof:cellBatches is missing; variances of single pixels are not \
                      enough, because pixels share light paths); render it with this version of taugate"
                .into(),
        })?;
        let cells = CellBatches::from_floats(picture.width, picture.height, floats)
            .map_err(|e| Error::File { path: path.into(), message: e.to_string() })?;
        match cells.are_of(unbiased(picture)) {
            true => Ok(cells),
            false => Err(Error::File {
                path: path.into(),
                message:
                    "its pixels were changed after rendering, or an earlier version of taugate extended it as a reference, so their \
                     noise is not known; compare the file that taugate wrote, or render it again"
                        .into(),
            }),
        }
    };
    let (a, b) = (batches(&args.image, image)?, batches(&args.reference, reference)?);
    let verdict = agreement([image.width, image.height], &a, &b)?;
    if extension == "exr" {
        write_plain(out, image.width, image.height, &verdict.map)?;
    } else {
        png_file::write_bytes(out, image.width, image.height, &colours(&verdict.map, verdict.threshold))?;
    }
    Ok(verdict)
}

/// The image without damped fireflies.
fn unbiased(picture: &Picture) -> &[f32] {
    picture.undamped.as_ref().unwrap_or(&picture.rgb)
}

fn describe(verdict: &Agreement) -> String {
    let Agreement { cell, tests, threshold, max_z, judged, .. } = verdict;
    let mut text = format!(
        "z               {} max |z| = {max_z:.2}, threshold {threshold:.2} for {tests} means (Sidak, {SIGNIFICANCE:e})\n                \
         cells of {cell} x {cell} pixels, per channel; {:.1} % of the light lies in cells that are tested one by one\n",
        match verdict.verdict {
            Verdict::Agree => "the two agree:",
            Verdict::Differ => "the two differ:",
            Verdict::TooFewSamples => "too few samples to judge:",
        },
        100.0 * judged
    );
    if verdict.verdict == Verdict::TooFewSamples {
        text += &format!(
            "                the noise has heavy tails (skewness {:.1}), so its size is not known; render both with more \
             samples, or with another estimator\n",
            verdict.skewness
        );
    }
    for c in &verdict.worst {
        let place = match c.rest {
            true => "all noisier cells together".into(),
            false => format!("x {}..{}, y {}..{}", c.x[0], c.x[1], c.y[0], c.y[1]),
        };
        text += &format!("  z = {:6.2}    {place}, {}: {:.6e} against {:.6e}\n", c.z, c.channel, c.mean, c.reference);
    }
    text
}

/// Columns and rows of an image.
fn size(path: &Path) -> Result<[u32; 2], Error> {
    match accumulated::is_sums(path) {
        true => Ok(read_about(path)?.size()),
        false => read_size(path),
    }
}

fn read_finite(path: &Path) -> Result<Picture, Error> {
    let picture = if accumulated::is_sums(path) { accumulated::picture(path)? } else { read_picture(path)? };
    if let Some((pixel, channel)) = metrics::first_non_finite(&picture.rgb) {
        let (x, y) = (pixel % picture.width as usize, pixel / picture.width as usize);
        let value = picture.rgb[3 * pixel + channel];
        let message =
            format!("pixel {x},{y} is {value} in {}; render an image without such pixels", ["R", "G", "B"][channel]);
        return Err(Error::File { path: path.into(), message });
    }
    Ok(picture)
}
