//! The film: per-pixel mean and variance over iterations, in f64.
