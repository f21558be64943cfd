//! The Gaussian error of measured times.

/// Standard deviations after which the error is cut off; 2e-9 of the photons have a larger one.
const CUT: f64 = 6.0;

/// Moves the photons of each gate, which are spread evenly over it, by a Gaussian error with standard deviation `sigma`. Photons
/// that leave all gates are lost.
pub fn spread(means: &[f64], gates: &[[f64; 2]], sigma: f64) -> Vec<f64> {
    if sigma == 0.0 {
        return means.to_vec();
    }
    let mut spread = vec![0.0; means.len()];
    for (&[lo, hi], &mean) in gates.iter().zip(means).filter(|(_, mean)| **mean > 0.0) {
        // The fraction of the gate's photons that are measured before `time`.
        let before =
            |time: f64| sigma * (integrated((time - lo) / sigma) - integrated((time - hi) / sigma)) / (hi - lo);
        let first = gates.partition_point(|gate| gate[1] < lo - CUT * sigma);
        for (gate, sum) in gates.iter().zip(&mut spread).skip(first).take_while(|(gate, _)| gate[0] < hi + CUT * sigma)
        {
            *sum += mean * (before(gate[1]) - before(gate[0])).max(0.0);
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
