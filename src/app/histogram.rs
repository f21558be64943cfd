//! `taugate histogram`: the light of a pixel in every gate of a render, as a table or as a plot.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use taugate::Error;
use taugate::internals::files::{check_writable, has_extension, write_atomically};
use taugate::internals::image::array_set::{self, Role};
use taugate::internals::image::npy_file::COUNTS;
use taugate::internals::image::npy_read::{DescribedResponse, ImageArray, described, is_counts, read_with_mono};
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
    /// R, G and B. None if the array holds counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    radiance: Option<Vec<f32>>,
    /// Counts of a detector: R, G and B, or one channel. None if the array holds radiances.
    #[serde(skip_serializing_if = "Option::is_none")]
    counts: Option<Vec<f32>>,
    /// Standard deviations of the values. None without an array of variances. Also none for the mean over pixels, because the errors of
    /// pixels may be correlated.
    deviation: Option<Vec<f32>>,
}

impl Row {
    /// The radiance or the counts of each channel.
    fn values(&self) -> &[f32] {
        self.radiance.as_ref().or(self.counts.as_ref()).expect("a row has one of the two")
    }
}

/// The quantity in an array.
#[derive(Clone, Copy)]
struct Quantity {
    /// Whether the values are counts of a detector, and not radiances.
    is_counts: bool,
    /// 1 or 3.
    channels: usize,
}

impl Quantity {
    /// The title of the columns with values.
    fn columns(self) -> &'static str {
        match (self.is_counts, self.channels) {
            (false, _) => "R, G, B in W/m^2/sr",
            (true, 1) => COUNTS,
            (true, _) => "R, G, B in counts over all pulses",
        }
    }

    /// The label of the axis in the plot.
    fn label(self) -> &'static str {
        match (self.is_counts, self.channels) {
            (false, _) => "radiance in each gate, mean of R, G, B (W/m^2/sr)",
            (true, 1) => "counts over all pulses in each gate",
            (true, _) => "counts over all pulses in each gate, mean of R, G, B",
        }
    }
}

pub fn run(args: &HistogramArgs) -> anyhow::Result<ExitCode> {
    if let Some(plot) = &args.plot {
        if !has_extension(plot, "svg") {
            return Err(Error::settings(format!("the plot {} must end in .svg", plot.display())).into());
        }
        check_writable(plot)?;
    }
    let (quantity, rows) = array_set::read_whole(&args.array, || {
        let (array, channels) = read_with_mono(&args.array)?;
        // Only a detector has a single channel.
        let quantity = Quantity { is_counts: channels == 1 || is_counts(&args.array), channels };
        let variances = variances(&args.array, &array)?;
        Ok((quantity, rows(args.pixel, &array, variances.as_ref(), described(&args.array, array.images()), quantity)?))
    })?;
    let title = match args.pixel {
        Some(Pixel([x, y])) => format!("pixel {x},{y} of {}", args.array.display()),
        None => format!("mean over all pixels of {}", args.array.display()),
    };
    if let Some(plot) = &args.plot {
        let svg = steps(&title, quantity.label(), &bars(&args.array, &rows)?)?;
        write_atomically(plot, |writer| writer.write_all(svg.as_bytes()))?;
    }
    crate::app::print(&match args.json {
        true => format!("{}\n", serde_json::to_string_pretty(&rows)?),
        false => table(&title, &rows, quantity),
    })?;
    Ok(ExitCode::SUCCESS)
}

/// The variances beside an array, if there are any. Fails if their shape differs from that of the array.
fn variances(path: &Path, array: &ImageArray) -> Result<Option<ImageArray>, Error> {
    let Some(path) = array_set::beside(path, Role::Variance) else { return Ok(None) };
    let (variances, _) = read_with_mono(&path)?;
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
    quantity: Quantity,
) -> Result<Vec<Row>, Error> {
    let pixels: Vec<[usize; 2]> = match pixel {
        Some(Pixel([x, y])) if (x as usize) < array.width && (y as usize) < array.height => {
            vec![[x as usize, y as usize]]
        }
        Some(Pixel([x, y])) => {
            return Err(Error::settings(format!(
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
        let values: Vec<f32> = light[..quantity.channels].iter().map(|x| (x / count) as f32).collect();
        let (radiance, counts) = if quantity.is_counts { (None, Some(values)) } else { (Some(values), None) };
        let deviation = |variances: &[f64; 3]| variances[..quantity.channels].iter().map(|x| x.sqrt() as f32).collect();
        Row {
            name: described.map_or(format!("gate {k}"), |one| one.name.clone()),
            begin_m: described.map(|one| one.gate_begin_m),
            end_m: described.and_then(|one| one.gate_end_m),
            radiance,
            counts,
            deviation: deviations.as_ref().map(|all| deviation(&all[k])),
        }
    };
    Ok(sum(array).into_iter().enumerate().map(row).collect())
}

/// The bars of the plot. Fails if the begin or the end of a gate is not known.
fn bars(path: &Path, rows: &[Row]) -> Result<Vec<Bar>, Error> {
    let bar = |row: &Row| {
        let mean = |values: &[f32]| values.iter().map(|&x| f64::from(x)).sum::<f64>() / values.len() as f64;
        Some(Bar {
            gate: [row.begin_m?, row.end_m?],
            light: mean(row.values()),
            // The channels share their paths, so their errors are correlated: the standard deviations add up.
            deviation: row.deviation.as_deref().map_or(0.0, mean),
        })
    };
    rows.iter().map(bar).collect::<Option<_>>().ok_or_else(|| Error::File {
        path: path.into(),
        message: "the ends of its gates are not known, so they cannot be drawn; keep the JSON file beside the array, and use \
                  gates that end"
            .into(),
    })
}

fn table(title: &str, rows: &[Row], quantity: Quantity) -> String {
    let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0).max(4);
    let columns = quantity.columns();
    let mut text = format!("{title}\n{:width$}  {:>10}  {:>10}  {columns}\n", "gate", "from m", "to m");
    for row in rows {
        let metres = |x: Option<f64>| x.map_or("".into(), |x| format!("{x:.4}"));
        text += &format!("{:width$}  {:>10}  {:>10}", row.name, metres(row.begin_m), metres(row.end_m));
        for (k, value) in row.values().iter().enumerate() {
            text += &format!("  {value:.4e}");
            if let Some(deviation) = &row.deviation {
                text += &format!(" +- {:.1e}", deviation[k]);
            }
        }
        text.push('\n');
    }
    text
}
