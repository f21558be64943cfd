//! Comparison of images: errors (relMSE, FLIP), and whether two images differ by more than their noise.

pub mod agreement;
pub mod flip;
pub mod histogram;
pub mod metrics;
pub mod statistics;
