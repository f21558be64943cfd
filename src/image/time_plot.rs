//! Light as a function of travel time, drawn as SVG.

#![warn(missing_docs)]

use std::error::Error as StdError;

use plotters::prelude::*;

use crate::error::{Error, Result};

const SIZE: (u32, u32) = (720, 440);
/// Blue and orange of Okabe and Ito, which colour-blind readers can distinguish.
const LIGHT: RGBColor = RGBColor(0, 114, 178);
const ERROR: RGBColor = RGBColor(213, 94, 0);

/// The light of one gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bar {
    /// Begin and end of the gate in metres of optical path, both finite.
    pub gate: [f64; 2],
    /// The light in the gate, in the unit of the axis.
    pub light: f64,
    /// Standard deviation of `light`; 0 if it is not known.
    pub deviation: f64,
}

/// An SVG plot of steps, with a vertical line of one standard deviation up and down at each gate. `light` names the vertical axis.
/// Fails if there is no gate, or if a number is not finite.
pub fn steps(title: &str, light: &str, bars: &[Bar]) -> Result<String> {
    let numbers = || bars.iter().flat_map(|bar| [bar.gate[0], bar.gate[1], bar.light, bar.deviation]);
    if bars.is_empty() || numbers().any(|x| !x.is_finite()) {
        return Err(Error::settings(format!(
            "{title} cannot be drawn: it has no gates, or numbers that are not finite"
        )));
    }
    let mut svg = String::new();
    draw(&mut svg, title, light, bars).map_err(|e| Error::settings(format!("the plot of {title}: {e}")))?;
    Ok(svg)
}

fn draw(svg: &mut String, title: &str, light: &str, bars: &[Bar]) -> std::result::Result<(), Box<dyn StdError>> {
    let begin = bars.iter().map(|bar| bar.gate[0]).fold(f64::INFINITY, f64::min);
    let end = bars.iter().map(|bar| bar.gate[1]).fold(begin, f64::max);
    let top = bars.iter().map(|bar| bar.light + bar.deviation).fold(0.0, f64::max);
    let top = if top > 0.0 { 1.05 * top } else { 1.0 };
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(80)
        .build_cartesian_2d(begin..end, 0.0..top)?;
    chart
        .configure_mesh()
        .x_desc("travel time as optical path (m)")
        .y_desc(light)
        .y_label_formatter(&|y| format!("{y:.2e}"))
        .light_line_style(WHITE)
        .draw()?;
    let step = |bar: &Bar| [(bar.gate[0], bar.light), (bar.gate[1], bar.light)];
    chart.draw_series(bars.iter().map(|bar| {
        let [(lo, _), (hi, light)] = step(bar);
        Rectangle::new([(lo, 0.0), (hi, light)], LIGHT.mix(0.15).filled())
    }))?;
    chart.draw_series(bars.iter().map(|bar| PathElement::new(step(bar), LIGHT.stroke_width(2))))?;
    chart.draw_series(bars.iter().filter(|bar| bar.deviation > 0.0).map(|bar| {
        let middle = 0.5 * (bar.gate[0] + bar.gate[1]);
        let low = (bar.light - bar.deviation).max(0.0);
        PathElement::new([(middle, low), (middle, bar.light + bar.deviation)], ERROR)
    }))?;
    area.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_has_axes_and_bars() {
        let bars = [0.0, 2.0, 1.0].into_iter().enumerate().map(|(k, light)| Bar {
            gate: [4.0 + k as f64, 5.0 + k as f64],
            light,
            deviation: 0.1 * light,
        });
        let bars: Vec<Bar> = bars.collect();
        let svg = steps("pixel 3,4", "radiance", &bars).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("pixel 3,4") && svg.contains("optical path (m)"), "{svg}");
        assert!(steps("black", "radiance", &bars[..1]).is_ok());
        assert!(steps("empty", "radiance", &[]).is_err());
        assert!(steps("odd", "radiance", &[Bar { light: f64::NAN, ..bars[0] }]).is_err());
    }
}
