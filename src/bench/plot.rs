//! Convergence curves as SVG.

use std::error::Error as StdError;

use plotters::prelude::*;

use super::summary::Point;
use crate::error::{Error, Result};

const SIZE: (u32, u32) = (720, 440);
/// Colour-blind readers can distinguish the colours of Okabe and Ito, also in print. A grey replaces their yellow.
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(140, 140, 140),
];

/// An SVG plot of the error against seconds, both logarithmic, with bars from minimum to maximum. `measure`: name of the error measure.
/// `None` if there is nothing to draw.
pub fn convergence(title: &str, measure: &str, curves: &[(String, Vec<Point>)]) -> Result<Option<String>> {
    let points = || curves.iter().flat_map(|(_, points)| points).filter(|p| p.relmse.min > 0.0);
    let span = |of: &dyn Fn(&Point) -> [f64; 2]| {
        let all: Vec<f64> = points().flat_map(of).collect();
        let (low, high) = all.iter().fold((f64::INFINITY, 0.0f64), |(low, high), &x| (low.min(x), high.max(x)));
        low / 1.3..high * 1.3
    };
    if points().next().is_none() {
        return Ok(None);
    }
    let (times, errors) = (span(&|p| [p.seconds; 2]), span(&|p| [p.relmse.min, p.relmse.max]));
    let mut svg = String::new();
    draw(&mut svg, [title, measure], curves, times, errors)
        .map_err(|e| Error::settings(format!("the plot of {title}: {e}")))?;
    Ok(Some(svg))
}

fn draw(
    svg: &mut String,
    [title, measure]: [&str; 2],
    curves: &[(String, Vec<Point>)],
    times: std::ops::Range<f64>,
    errors: std::ops::Range<f64>,
) -> std::result::Result<(), Box<dyn StdError>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(times.log_scale(), errors.log_scale())?;
    chart
        .configure_mesh()
        .x_desc("seconds of rendering")
        .y_desc(measure)
        .x_label_formatter(&label)
        .y_label_formatter(&label)
        .light_line_style(WHITE)
        .draw()?;
    for (i, (name, points)) in curves.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let drawn: Vec<&Point> = points.iter().filter(|p| p.relmse.min > 0.0).collect();
        let line = drawn.iter().map(|p| (p.seconds, p.relmse.median));
        chart
            .draw_series(LineSeries::new(line.clone(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(line.map(|at| Circle::new(at, 3, colour.filled())))?;
        let bar = |p: &&Point| PathElement::new([(p.seconds, p.relmse.min), (p.seconds, p.relmse.max)], colour);
        chart.draw_series(drawn.iter().map(bar))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    area.present()?;
    Ok(())
}

/// A label such as 0.02, 5 or 1e-5. Only ticks with the first digit 1, 2 or 5 have labels; more labels would overlap.
fn label(value: &f64) -> String {
    let text = format!("{value:.0e}");
    match text.as_bytes().first() {
        Some(b'1' | b'2' | b'5') if (0.01..1000.0).contains(value) => format!("{}", (value * 1e3).round() / 1e3),
        Some(b'1' | b'2' | b'5') => text,
        _ => String::new(),
    }
}
