//! How good a reference is, and how good it must be.

use crate::compare::metrics::Means;

/// A reference's own relMSE must be this many times below the best result it is compared with.
pub const MARGIN: f64 = 20.0;
/// Above this, a reference's own relMSE says nothing: the error of a dark pixel that is bright by chance is measured against
/// that very brightness.
pub const MAX_REFERENCE_RELMSE: f64 = 0.02;

/// Whether a result of this relMSE may be compared with a reference of that own relMSE; asked of each of [`Means`] for itself.
pub fn is_good(own: f64, relmse: f64) -> bool {
    own <= MAX_REFERENCE_RELMSE && own * MARGIN <= relmse
}

/// What a reference is to be good enough for.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceTarget {
    /// Time of each variant in the suite.
    pub seconds: f64,
    /// Rendering stops after so many seconds in any case.
    pub limit: f64,
    /// The best relMSE that was measured so far, if any was.
    pub best: Option<Means>,
}

/// Means of squared errors over r^2 + eps, as relMSE has it; infinite for a black reference.
pub fn relative(squared: &[f32], reference: &[f32]) -> Means {
    let mean = reference.iter().map(|&r| f64::from(r)).sum::<f64>() / reference.len() as f64;
    if mean <= 0.0 {
        return Means::INFINITE;
    }
    let eps = (0.01 * mean).powi(2);
    let error = |(&s, &r): (&f32, &f32)| f64::from(s) / (f64::from(r).powi(2) + eps);
    Means::of(&squared.iter().zip(reference).map(error).collect::<Vec<f64>>())
}
