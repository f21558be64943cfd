//! `taugate histogram`: the light of a pixel in every gate of a render, as a table or as a plot.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use taugate::Error;
use taugate::internals::files::{check_writable, write_atomically};
use taugate::internals::image::npy_file::variance_path;
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray, described, read};
use taugate::internals::image::time_plot::{Bar, steps};
use taugate::internals::settings::values::Pixel;

use crate::app::cli::HistogramArgs;

/// The light of one gate. With --json, the keys are the names of these fields.
#[derive(Debug, Serialize)]
struct Row {
    name: String,
    /// Begin and end of the gate in metres of optical path. None if the array has no description beside it; `end_m` is also none if
    /// the gate has no end.
    begin_m: Option<f64>,
    end_m: Option<f64>,
    /// R, G and B.
    radiance: [f32; 3],
    /// Standard deviations of the radiance. None without an array of variances. Also none for the mean over pixels, because the
    /// errors of pixels may be correlated.
    deviation: Option<[f32; 3]>,
}

pub fn run(args: &HistogramArgs) -> anyhow::Result<ExitCode> {
    if let Some(plot) = &args.plot {
        if !plot.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("svg")) {
            return Err(Error::Settings(format!("the plot {} must end in .svg", plot.display())).into());
        }
        check_writable(plot)?;
    }
    let array = read(&args.array)?;
    let variances = variances(&args.array, &array)?;
    let rows = rows(args.pixel, &array, variances.as_ref(), described(&args.array, &array))?;
    let title = match args.pixel {
        Some(Pixel([x, y])) => format!("pixel {x},{y} of {}", args.array.display()),
        None => format!("mean over all pixels of {}", args.array.display()),
    };
    if let Some(plot) = &args.plot {
        let svg = steps(&title, "radiance in each gate, mean of R, G, B (W/m^2/sr)", &bars(&args.array, &rows)?)?;
        write_atomically(plot, |writer| writer.write_all(svg.as_bytes()))?;
    }
    crate::app::print(&match args.json {
        true => format!("{}\n", serde_json::to_string_pretty(&rows)?),
        false => table(&title, &rows),
    })?;
    Ok(ExitCode::SUCCESS)
}

/// The variances beside an array, if there are any. Fails if their shape differs from that of the array.
fn variances(path: &Path, array: &ImageArray) -> Result<Option<ImageArray>, Error> {
    let path = variance_path(path);
    if !path.exists() {
        return Ok(None);
    }
    let variances = read(&path)?;
    let shape = |array: &ImageArray| (array.height, array.width, array.responses);
    match shape(&variances) == shape(array) {
        true => Ok(Some(variances)),
        false => Err(Error::File {
            path,
            message: "has another shape than the array beside it; render both again, or remove this file".into(),
        }),
    }
}

fn rows(
    pixel: Option<Pixel>,
    array: &ImageArray,
    variances: Option<&ImageArray>,
    described: Option<Vec<DescribedResponse>>,
) -> Result<Vec<Row>, Error> {
    let pixels: Vec<[usize; 2]> = match pixel {
        Some(Pixel([x, y])) if (x as usize) < array.width && (y as usize) < array.height => {
            vec![[x as usize, y as usize]]
        }
        Some(Pixel([x, y])) => {
            return Err(Error::Settings(format!(
                "the pixel {x},{y} is outside of the array, which has {} columns and {} rows from 0",
                array.width, array.height
            )));
        }
        None => (0..array.height).flat_map(|y| (0..array.width).map(move |x| [x, y])).collect(),
    };
    let count = pixels.len() as f64;
    let sum = |array: &ImageArray| {
        let mut sums = vec![[0.0f64; 3]; array.images()];
        for &pixel in &pixels {
            for (sum, rgb) in sums.iter_mut().zip(array.pixel(pixel)) {
                (0..3).for_each(|k| sum[k] += f64::from(rgb[k]));
            }
        }
        sums
    };
    let deviations = variances.filter(|_| pixel.is_some()).map(sum);
    let row = |(k, light): (usize, [f64; 3])| {
        let described = described.as_ref().map(|all| &all[k]);
        Row {
            name: described.map_or(format!("gate {k}"), |one| one.name.clone()),
            begin_m: described.map(|one| one.gate_begin_m),
            end_m: described.and_then(|one| one.gate_end_m),
            radiance: light.map(|x| (x / count) as f32),
            deviation: deviations.as_ref().map(|all| all[k].map(|variance| variance.sqrt() as f32)),
        }
    };
    Ok(sum(array).into_iter().enumerate().map(row).collect())
}

/// The bars of the plot. Fails if the begin or the end of a gate is not known.
fn bars(path: &Path, rows: &[Row]) -> Result<Vec<Bar>, Error> {
    let bar = |row: &Row| {
        let deviations = row.deviation.unwrap_or_default().map(f64::from);
        Some(Bar {
            gate: [row.begin_m?, row.end_m?],
            light: row.radiance.iter().map(|&x| f64::from(x)).sum::<f64>() / 3.0,
            // The channels share their paths, so their errors are correlated: the standard deviations add up.
            deviation: deviations.iter().sum::<f64>() / 3.0,
        })
    };
    rows.iter().map(bar).collect::<Option<_>>().ok_or_else(|| Error::File {
        path: path.into(),
        message: "the ends of its gates are not known, so they cannot be drawn; keep the JSON file beside the array, and use \
                  gates that end"
            .into(),
    })
}

fn table(title: &str, rows: &[Row]) -> String {
    let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0).max(4);
    let mut text = format!("{title}\n{:width$}  {:>10}  {:>10}  R, G, B in W/m^2/sr\n", "gate", "from m", "to m");
    for row in rows {
        let metres = |x: Option<f64>| x.map_or("".into(), |x| format!("{x:.4}"));
        text += &format!("{:width$}  {:>10}  {:>10}", row.name, metres(row.begin_m), metres(row.end_m));
        for k in 0..3 {
            text += &format!("  {:.4e}", row.radiance[k]);
            if let Some(deviation) = row.deviation {
                text += &format!(" +- {:.1e}", deviation[k]);
            }
        }
        text.push('\n');
    }
    text
}
