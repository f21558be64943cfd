//! Fits power laws to measured points.

/// A power law y = c x^exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerLaw {
    pub exponent: f64,
    /// Standard error of the exponent, from the residuals; `None` with two points.
    pub error: Option<f64>,
}

/// Least squares of the logarithms. Points that are not positive and finite are ignored. `None` with fewer than two different
/// values of x.
pub fn fit_power_law(points: impl IntoIterator<Item = (f64, f64)>) -> Option<PowerLaw> {
    let usable = |v: f64| v > 0.0 && v.is_finite();
    let logs: Vec<(f64, f64)> =
        points.into_iter().filter(|&(x, y)| usable(x) && usable(y)).map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (x, y) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (xy, xx) = logs.iter().fold((0.0, 0.0), |(a, b), (u, v)| (a + (u - x) * (v - y), b + (u - x).powi(2)));
    // If all x are equal, rounding of their mean can leave a small positive xx.
    if xx < 1e-12 {
        return None;
    }
    let exponent = xy / xx;
    let residuals: f64 = logs.iter().map(|(u, v)| (v - y - exponent * (u - x)).powi(2)).sum();
    let error = (logs.len() > 2).then(|| (residuals / (n - 2.0) / xx).sqrt());
    Some(PowerLaw { exponent, error })
}
