//! How accurate a reference is, and how accurate it must be.

use crate::compare::metrics::Means;
use crate::settings::Estimator;

/// The relMSE of a reference itself must be this many times smaller than the best result that is compared with it.
pub const MARGIN: f64 = 20.0;
/// About the relMSE of a black image. Ratios between larger errors say nothing, because both images are worse than a black one.
pub const BLACK_RELMSE: f64 = 1.0;
/// Maximum relMSE of a reference itself. Larger values cannot be trusted: if a dark pixel is bright by chance, relMSE divides its
/// error by this false brightness.
pub const MAX_REFERENCE_RELMSE: f64 = 0.02;

/// If the relMSE of a reference is at least this many times smaller than a result, the result is an upper bound of the error.
pub const MARGIN_OF_BOUNDS: f64 = 5.0;

/// What a relMSE says that was measured with a reference. It contains the error of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trust {
    /// Nothing: the reference is too noisy.
    Nothing,
    /// An upper bound: up to a fifth of it is the error of the reference.
    Bound,
    /// The error.
    Full,
}

/// How far a result with this `relmse` can be trusted, with a reference whose own relMSE is `own`. Call it for each of [`Means`]
/// separately.
pub fn trust(own: f64, relmse: f64) -> Trust {
    match own <= MAX_REFERENCE_RELMSE {
        true if own * MARGIN <= relmse => Trust::Full,
        true if own * MARGIN_OF_BOUNDS <= relmse => Trust::Bound,
        _ => Trust::Nothing,
    }
}

/// The results for which a reference must be accurate enough, and the time limit of its render.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceTarget {
    /// Time of each variant in the suite, in seconds.
    pub seconds: f64,
    /// The estimator that renders the reference. `None`: the one with the smallest error per second.
    pub estimator: Option<Estimator>,
    /// Time limit of the reference, in seconds.
    pub limit: f64,
    /// The smallest relMSE measured so far; `None` without results.
    pub best: Option<Means>,
}

/// relMSE from squared errors: means of `squared` / (r^2 + eps), with eps as in [`crate::compare::metrics`]. Infinite if the
/// reference is black.
pub fn relative(squared: &[f32], reference: &[f32]) -> Means {
    let mean = reference.iter().map(|&r| f64::from(r)).sum::<f64>() / reference.len() as f64;
    if mean <= 0.0 {
        return Means::INFINITE;
    }
    let eps = (0.01 * mean).powi(2);
    let error = |(&s, &r): (&f32, &f32)| f64::from(s) / (f64::from(r).powi(2) + eps);
    Means::of(&squared.iter().zip(reference).map(error).collect::<Vec<f64>>())
}
