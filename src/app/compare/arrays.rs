//! Compares two renders of several gates: the error of every gate.

use std::path::Path;
use std::process::ExitCode;

use taugate::Error;
use taugate::internals::compare::histogram::{HistogramComparison, MIN_LIGHT};
use taugate::internals::compare::metrics::{RELMSE_FORMULA, TRIMMED, first_non_finite};
use taugate::internals::files::has_extension;
use taugate::internals::image::exr_responses;
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray, described, read};

use crate::app::accumulated;
use crate::app::cli::CompareArgs;

/// Number of gates with the largest errors that the report names.
const WORST: usize = 5;

/// Whether `path` names an array, or an image or sums of several gates.
pub fn is_array(path: &Path) -> Result<bool, Error> {
    match accumulated::is_sums(path) {
        true => accumulated::has_many(path),
        false => Ok(has_extension(path, "npy") || exr_responses::has_many(path)?),
    }
}

pub fn run(args: &CompareArgs) -> anyhow::Result<ExitCode> {
    if !is_array(&args.image)? || !is_array(&args.reference)? {
        return Err(Error::advice(
            "an array, or a file of several gates, is only compared with another of them; ",
            "render both with the same gates and -o OUT.npy",
        )
        .into());
    }
    if args.z.is_some() {
        return Err(Error::advice("--z needs two images of a single gate, because arrays and files of several gates do not hold batches of samples; ", "render each gate alone with -o OUT.exr")
        .into());
    }
    let ((image, gates), (reference, reference_gates)) = (read_finite(&args.image)?, read_finite(&args.reference)?);
    let shape = |array: &ImageArray| [array.height, array.width, array.images()];
    if shape(&image) != shape(&reference) {
        let describe = |array: &ImageArray| format!("{}x{} with {} gates", array.width, array.height, array.images());
        return Err(Error::settings(format!(
            "the arrays differ in size: {} is {}, {} is {}; render both with the same --gates and --resolution",
            args.image.display(),
            describe(&image),
            args.reference.display(),
            describe(&reference),
        ))
        .into());
    }
    let of = |gate: &DescribedResponse| (gate.name.clone(), gate.gate(), gate.integral());
    if let (Some(gates), Some(reference_gates)) = (&gates, &reference_gates)
        && !gates.iter().map(of).eq(reference_gates.iter().map(of))
    {
        crate::app::say("note: the two files have different gates");
    }
    let result = HistogramComparison::of(image.images(), |k| image.image(k), |k| reference.image(k))?;
    let within = args.max_relmse.is_none_or(|max| result.relmse <= max && result.lit_dark_gates == 0);
    if args.json {
        let mut json = serde_json::to_value(&result)?;
        json["formula"] = RELMSE_FORMULA.into();
        json["max_relmse"] = args.max_relmse.into();
        json["within"] = within.into();
        crate::app::print(&format!("{json:#}\n"))?;
    } else {
        let names = gates.map(|gates| gates.into_iter().map(|gate| gate.name).collect::<Vec<_>>());
        let mut text = describe(&result, names.as_deref());
        if let Some(max) = args.max_relmse {
            let outcome = match result.relmse <= max {
                true if within => "met:",
                true => "met, but for the false light:",
                false => "exceeded:",
            };
            text += &format!("threshold       {outcome} {max:e}\n");
        }
        crate::app::print(&text)?;
    }
    Ok(ExitCode::from(if within { 0 } else { 1 }))
}

fn describe(result: &HistogramComparison, names: Option<&[String]>) -> String {
    let mut text = format!(
        "relMSE          {:.6e}  (averaged over {} of {} gates, those with at least {MIN_LIGHT} of the light of the brightest)\n\
        \u{20}               {RELMSE_FORMULA}, per gate\n\
        \u{20} trimmed       {:.6e}  (without the worst {:.0} % of the pixels)\n\
         ratio of means  {:.6}\n",
        result.relmse,
        result.compared,
        result.gates.len(),
        result.trimmed_relmse,
        100.0 * TRIMMED,
        result.ratio_of_means,
    );
    if result.lit_dark_gates > 0 {
        text += &format!(
            "false light     light in {} of the gates that are dark in the reference\n",
            result.lit_dark_gates
        );
    }
    let mut worst: Vec<(usize, f64)> =
        result.gates.iter().enumerate().filter_map(|(k, gate)| Some((k, gate.as_ref()?.relmse))).collect();
    worst.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (k, relmse) in worst.into_iter().take(WORST) {
        let name = names.map_or(format!("gate {k}"), |names| names[k].clone());
        text += &format!("  {relmse:.6e}  in {name}\n");
    }
    text
}

/// An array, and its gates if they are known. Fails if a value is not finite.
fn read_finite(path: &Path) -> Result<(ImageArray, Option<Vec<DescribedResponse>>), Error> {
    let (array, gates) = if accumulated::is_sums(path) {
        let (array, gates) = accumulated::array(path)?;
        (array, Some(gates))
    } else if has_extension(path, "npy") {
        let array = read(path)?;
        let gates = described(path, array.images());
        (array, gates)
    } else {
        exr_responses::read(path)?
    };
    if let Some((at, channel)) = first_non_finite(&array.values) {
        let (pixel, gate) = (at / array.images(), at % array.images());
        let (x, y) = (pixel % array.width, pixel / array.width);
        let message = format!(
            "pixel {x},{y} is {} in {} of gate {gate}; render an array without such pixels",
            array.values[3 * at + channel],
            ["R", "G", "B"][channel]
        );
        return Err(Error::File { path: path.into(), message });
    }
    Ok((array, gates))
}
