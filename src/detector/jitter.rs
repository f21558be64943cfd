//! The Gaussian error of measured times.

use super::Bins;

/// Standard deviations after which the error is cut off; 2e-9 of the photons have a larger one.
const CUT: f64 = 6.0;
/// Standard deviations in periods at which the error modulo the period is even, to 1e-33.
const EVEN: f64 = 2.0;

/// Moves photons by a Gaussian error with standard deviation `sigma` > 0. Each of the `sources` is an interval, and the number of
/// photons that are spread evenly over it. Returns the photons per gate. Photons that leave all gates are lost, unless they reach the
/// gates of another pulse.
pub fn spread(sources: impl IntoIterator<Item = ([f64; 2], f64)>, bins: &Bins, sigma: f64) -> Vec<f64> {
    let Bins { gates, period, .. } = bins;
    let (begin, end) = (gates[0][0], gates[gates.len() - 1][1]);
    let sigma = period.map_or(sigma, |period| sigma.min(EVEN * period));
    let mut spread = vec![0.0; gates.len()];
    for ([lo, hi], photons) in sources.into_iter().filter(|(_, photons)| *photons != 0.0) {
        // The fraction of the photons that are measured before `time`.
        let before =
            |time: f64| sigma * (integrated((time - lo) / sigma) - integrated((time - hi) / sigma)) / (hi - lo);
        let [first, last] = [lo - CUT * sigma, hi + CUT * sigma];
        let pulses = match period {
            None => 0..=0,
            Some(period) => ((first - end) / period).ceil() as i64..=((last - begin) / period).floor() as i64,
        };
        for pulse in pulses {
            let shift = period.map_or(0.0, |period| pulse as f64 * period);
            let skipped = gates.partition_point(|gate| gate[1] + shift < first);
            let reached = gates.iter().zip(&mut spread).skip(skipped).take_while(|(gate, _)| gate[0] + shift < last);
            for (gate, sum) in reached {
                *sum += photons * (before(gate[1] + shift) - before(gate[0] + shift)).max(0.0);
            }
        }
    }
    spread
}

/// The integral of the normal distribution function from minus infinity to `x`.
fn integrated(x: f64) -> f64 {
    let below = 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    let density = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    x * below + density
}
