//! Error of an image against a reference.

#![warn(missing_docs)]

use serde::Serialize;

use crate::error::{Error, Result};

/// The definition of relMSE in this project, printed with every number.
pub const RELMSE_FORMULA: &str =
    "mean over pixels and channels of (x - r)^2 / (r^2 + eps), eps = (1 % of the mean of r)^2";

/// Fraction of the pixels, those with the largest errors, that trimmed means leave out. Published comparisons leave out 0.1 % of
/// images with a million pixels; the images of our suites have about ten thousand pixels.
pub const TRIMMED: f64 = 0.01;

/// A mean over all pixels and channels, and a trimmed mean. Rare bright samples ("fireflies") can dominate the mean over all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Means {
    /// Mean over all pixels.
    pub all: f64,
    /// Mean without the worst pixels ([`TRIMMED`]).
    pub trimmed: f64,
}

impl Means {
    /// Stands for an error that is not known.
    pub const NAN: Means = Means { all: f64::NAN, trimmed: f64::NAN };
    /// Larger than any error.
    pub const INFINITE: Means = Means { all: f64::INFINITY, trimmed: f64::INFINITY };

    /// Means of errors >= 0, R, G, B interleaved. With fewer than a hundred pixels nothing is trimmed.
    pub fn of(errors: &[f64]) -> Means {
        let mut pixels: Vec<f64> = errors.chunks(3).map(|pixel| pixel.iter().sum()).collect();
        let all = pixels.iter().sum::<f64>() / errors.len() as f64;
        let left_out = (TRIMMED * pixels.len() as f64) as usize;
        if left_out == 0 {
            return Means { all, trimmed: all };
        }
        let kept = pixels.len() - left_out;
        pixels.select_nth_unstable_by(kept, f64::total_cmp);
        let trimmed = pixels[..kept].iter().sum::<f64>() / (errors.len() - 3 * left_out) as f64;
        Means { all, trimmed }
    }

    /// Both means times `by`.
    pub fn scaled(self, by: f64) -> Means {
        Means { all: by * self.all, trimmed: by * self.trimmed }
    }

    /// The smaller value of each mean.
    pub fn min(self, other: Means) -> Means {
        Means { all: self.all.min(other.all), trimmed: self.trimmed.min(other.trimmed) }
    }
}

/// An image's error against a reference r, over all pixels and channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Relative mean squared error, by [`RELMSE_FORMULA`].
    pub relmse: f64,
    /// relMSE without the worst pixels ([`TRIMMED`]).
    pub trimmed_relmse: f64,
    /// (0.01 mean of r)^2. It is relative to the reference because gated images are dark.
    pub eps: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean of the image.
    pub mean: f64,
    /// Mean of the reference.
    pub reference_mean: f64,
    /// mean / reference_mean; its expected value is 1 for an unbiased image, whatever its noise.
    pub ratio_of_means: f64,
}

/// Compares interleaved images with finite values. Fails if they differ in length or have no values, or if the mean of the reference is
/// 0.
pub fn compare(image: &[f32], reference: &[f32]) -> Result<Comparison> {
    if image.len() != reference.len() || image.is_empty() {
        return Err(Error::settings(format!(
            "an image of {} values cannot be compared with a reference of {}; give images of the same size",
            image.len(),
            reference.len()
        )));
    }
    let n = reference.len() as f64;
    let mean_of = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let (mean, reference_mean) = (mean_of(image), mean_of(reference));
    if reference_mean == 0.0 {
        return Err(Error::advice(
            "the reference is black (its mean is 0), so a relative error is undefined; ",
            "choose a gate in which light arrives",
        ));
    }

    let eps = (0.01 * reference_mean).powi(2);
    let (mut relative, mut absolute) = (Vec::with_capacity(reference.len()), 0.0);
    for (&x, &r) in image.iter().zip(reference) {
        let (x, r) = (f64::from(x), f64::from(r));
        let square = (x - r) * (x - r);
        relative.push(square / (r * r + eps));
        absolute += square;
    }
    let Means { all: relmse, trimmed: trimmed_relmse } = Means::of(&relative);
    let ratio_of_means = mean / reference_mean;
    Ok(Comparison { relmse, trimmed_relmse, eps, mse: absolute / n, mean, reference_mean, ratio_of_means })
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
    fn the_worst_pixels_are_left_out() {
        // 250 pixels with error 3 (1 per channel), of which 2 are left out: the firefly and one other pixel.
        let mut errors = vec![1.0; 750];
        errors[301] = 1e9;
        let means = Means::of(&errors);
        assert!((means.all - (749.0 + 1e9) / 750.0).abs() < 1e-3, "{means:?}");
        assert_eq!(means.trimmed, 1.0);
        // Only two of the three bright pixels are left out.
        (errors[0], errors[749]) = (100.0, 1e9);
        assert!((Means::of(&errors).trimmed - (743.0 + 100.0) / 744.0).abs() < 1e-12, "{:?}", Means::of(&errors));
        assert_eq!(Means::of(&[1.0, 2.0, 9.0]), Means { all: 4.0, trimmed: 4.0 });
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
        for (image, reference) in [(&[1.0, 2.0][..], &[1.0][..]), (&[], &[])] {
            assert!(compare(image, reference).unwrap_err().to_string().contains("give images of the same size"));
        }
        assert_eq!(first_non_finite(&[0.0, 1.0, 2.0, 3.0, f32::NAN, 0.0]), Some((1, 1)));
        assert_eq!(first_non_finite(&[0.0; 6]), None);
    }
}
