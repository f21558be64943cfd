//! Error of an image against a reference.

pub mod flip;

use serde::Serialize;

use crate::error::{Error, Result};

/// The pinned definition of relMSE, printed with every number.
pub const RELMSE_FORMULA: &str =
    "mean over pixels and channels of (x - r)^2 / (r^2 + eps), eps = (1 % of the mean of r)^2";

/// An image's error against a reference r, over all pixels and channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    pub relmse: f64,
    /// (0.01 mean of r)^2, relative to the reference because gated images are dark.
    pub eps: f64,
    pub mse: f64,
    pub mean: f64,
    pub reference_mean: f64,
    /// mean / reference_mean: 1 for an unbiased image, whatever its noise.
    pub ratio_of_means: f64,
}

/// Compares interleaved images of equal, non-zero length with finite values.
pub fn compare(image: &[f32], reference: &[f32]) -> Result<Comparison> {
    assert_eq!(image.len(), reference.len(), "images are compared at the same size");
    let n = reference.len() as f64;
    let mean_of = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let (mean, reference_mean) = (mean_of(image), mean_of(reference));
    if reference_mean == 0.0 {
        return Err(Error::Settings(
            "the reference is black on average, so a relative error means nothing; choose a gate that light can meet"
                .into(),
        ));
    }

    let eps = (0.01 * reference_mean).powi(2);
    let (mut relative, mut absolute) = (0.0, 0.0);
    for (&x, &r) in image.iter().zip(reference) {
        let (x, r) = (f64::from(x), f64::from(r));
        let square = (x - r) * (x - r);
        relative += square / (r * r + eps);
        absolute += square;
    }
    let ratio_of_means = mean / reference_mean;
    Ok(Comparison { relmse: relative / n, eps, mse: absolute / n, mean, reference_mean, ratio_of_means })
}

/// Pixel index and channel (0 to 2) of the first value that is NaN or infinite.
pub fn first_non_finite(rgb: &[f32]) -> Option<(usize, usize)> {
    rgb.iter().position(|v| !v.is_finite()).map(|at| (at / 3, at % 3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        // r = (1, 3), mean 2, eps = 4e-4; x = (2, 3): 1 / (1 + 4e-4) / 2 and 1 / 2.
        let c = compare(&[2.0, 3.0], &[1.0, 3.0]).unwrap();
        assert!((c.eps - 4e-4).abs() < 1e-18);
        assert!((c.relmse - 0.5 / 1.0004).abs() < 1e-15);
        assert!((c.mse - 0.5).abs() < 1e-15);
        assert!((c.ratio_of_means - 1.25).abs() < 1e-15);
    }

    #[test]
    fn relmse_does_not_depend_on_brightness() {
        let (image, reference) = ([1.0, 0.0, 2.0, 0.5_f32], [1.5, 0.0, 1.0, 0.25_f32]);
        let bright = compare(&image, &reference).unwrap().relmse;
        let dark = compare(&image.map(|v| v * 1e-6), &reference.map(|v| v * 1e-6)).unwrap().relmse;
        assert!((bright / dark - 1.0).abs() < 1e-6, "{bright} {dark}");
    }

    #[test]
    fn a_black_reference_is_refused_and_odd_values_are_found() {
        assert!(compare(&[1.0], &[0.0]).is_err());
        assert_eq!(first_non_finite(&[0.0, 1.0, 2.0, 3.0, f32::NAN, 0.0]), Some((1, 1)));
        assert_eq!(first_non_finite(&[0.0; 6]), None);
    }
}
