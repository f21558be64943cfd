//! Error of the images of many gates against the images of a reference.

#![warn(missing_docs)]

use serde::Serialize;

use super::metrics::{Comparison, compare};
use crate::error::{Error, Result};

/// Gates whose reference has less than this fraction of the light of the brightest gate are not compared.
pub const MIN_LIGHT: f64 = 1e-3;

/// The errors of all gates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HistogramComparison {
    /// relMSE of each gate, with eps from the gate's own mean, averaged over the gates that are compared.
    pub relmse: f64,
    /// The same without the worst pixels of each gate.
    pub trimmed_relmse: f64,
    /// Mean of the image, summed over all gates, divided by that of the reference.
    pub ratio_of_means: f64,
    /// Number of gates that are compared, at least 1.
    pub compared: usize,
    /// Number of gates that are too dark in the reference to be compared, but in which the image has excess light: it exceeds the
    /// light of the reference by at least [`MIN_LIGHT`] of the light of the brightest gate.
    pub lit_dark_gates: usize,
    /// The comparison of each gate; `None` for gates that are too dark in the reference ([`MIN_LIGHT`]).
    pub gates: Vec<Option<Comparison>>,
}

impl HistogramComparison {
    /// Compares the images of gate k for every k < `gates`. The images, `image(k)` and `reference(k)`, are interleaved, of equal,
    /// non-zero length, with finite values. Fails if all images of the reference are black.
    pub fn of(
        gates: usize,
        image: impl Fn(usize) -> Vec<f32>,
        reference: impl Fn(usize) -> Vec<f32>,
    ) -> Result<HistogramComparison> {
        let sum = |image: &[f32]| image.iter().map(|&x| f64::from(x)).sum::<f64>();
        let light: Vec<f64> = (0..gates).map(|k| sum(&reference(k))).collect();
        let brightest = light.iter().copied().fold(0.0, f64::max);
        if brightest == 0.0 {
            return Err(Error::advice(
                "all gates of the reference are black, so a relative error is undefined; ",
                "choose gates in which light arrives",
            ));
        }
        let is_compared = |k: &usize| light[*k] >= MIN_LIGHT * brightest;
        let found: Vec<f64> = (0..gates).map(|k| sum(&image(k))).collect();
        let is_lit = |k: &usize| !is_compared(k) && found[*k] - light[*k] >= MIN_LIGHT * brightest;
        let lit_dark_gates = (0..gates).filter(is_lit).count();
        let gates: Vec<Option<Comparison>> = (0..gates)
            .map(|k| Some(k).filter(is_compared).map(|k| compare(&image(k), &reference(k))).transpose())
            .collect::<Result<_>>()?;
        let compared: Vec<&Comparison> = gates.iter().flatten().collect();
        let mean = |of: fn(&Comparison) -> f64| compared.iter().map(|c| of(c)).sum::<f64>() / compared.len() as f64;
        Ok(HistogramComparison {
            relmse: mean(|c| c.relmse),
            trimmed_relmse: mean(|c| c.trimmed_relmse),
            ratio_of_means: found.iter().sum::<f64>() / light.iter().sum::<f64>(),
            compared: compared.len(),
            lit_dark_gates,
            gates,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dim_gates_count_as_much_as_bright_ones() {
        let reference = [[1000.0, 3000.0], [1.0, 3.0], [0.5, 0.0]];
        let image = [[1000.0, 3000.0], [2.0, 3.0], [9.0, 9.0]];
        let c = HistogramComparison::of(3, |k| image[k].to_vec(), |k| reference[k].to_vec()).unwrap();
        // The last gate has 1 / 8000 of the light of the first one. The second gate is that of the test `by_hand` of `metrics`.
        assert_eq!((c.compared, c.gates[2], c.lit_dark_gates), (2, None, 1));
        // In the last gate, this image has an excess of only 1.5, less than 1 / 1000 of the light of the first gate.
        let right = [image[0], image[1], [1.0, 1.0]];
        let of_right = HistogramComparison::of(3, |k| right[k].to_vec(), |k| reference[k].to_vec()).unwrap();
        assert_eq!((of_right.compared, of_right.lit_dark_gates), (2, 0));
        assert!((c.relmse - 0.5 * (0.5 / 1.0004)).abs() < 1e-12, "{c:?}");
        assert!((c.ratio_of_means - 4023.0 / 4004.5).abs() < 1e-12, "{c:?}");
        let black = HistogramComparison::of(1, |_| vec![1.0; 3], |_| vec![0.0; 3]).unwrap_err().to_string();
        assert!(black.contains("all gates of the reference are black"), "{black}");
    }
}
