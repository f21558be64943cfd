//! `taugate info --plot`: when the light arrives, as a plot.

use std::io::Write;
use std::path::Path;

use taugate::internals::files::{check_writable, has_extension, write_atomically};
use taugate::internals::image::time_plot::{Bar, steps};
use taugate::internals::render::TravelTimes;
use taugate::{Error, Result};

/// Number of bins of the histogram in the plot.
const PARTS: usize = 100;
/// The plot ends when this percentage of the light has arrived.
const END_PERCENT: f64 = 99.0;

/// Fails if the plot has the wrong extension or cannot be written. Call it first, because the measurement takes a while.
pub fn check(path: &Path) -> Result<()> {
    match has_extension(path, "svg") {
        true => check_writable(path),
        false => Err(Error::settings(format!("the plot {} must end in .svg", path.display()))),
    }
}

/// Writes the plot. Fails if no light arrives that has a travel time. `missing`: the reason, if a render misses the light.
pub fn write(path: &Path, times: Option<&TravelTimes>, missing: Option<&str>) -> Result<()> {
    let parts =
        times.and_then(|times| Some(times.histogram(times.percentile(END_PERCENT)?, PARTS))).unwrap_or_default();
    if parts.is_empty() {
        let reason = missing.unwrap_or("no light with a travel time reaches the sensor");
        return Err(Error::settings(format!("there is nothing to plot: {reason}")));
    }
    let bar = |(gate, light): ([f64; 2], f64)| Bar { gate, light: 100.0 * light, deviation: 0.0 };
    let bars: Vec<Bar> = parts.into_iter().map(bar).collect();
    let svg = steps("Light that reaches the sensor", "% of all light", &bars)?;
    write_atomically(path, |writer| writer.write_all(svg.as_bytes()))
}
