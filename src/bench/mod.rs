//! Measures error against time: estimators, or variants of their settings, render the same scenes in turns and are compared
//! with references.
//!
//! A [`suite`] lists scenes and variants. A [`case`] is one scene, ready to render. A [`race`] renders a case once per
//! repetition. A [`table`] holds the measurements, and a [`summary`] their medians and ratios. [`growth`] fits how costs
//! depend on a quantity. A [`report`] presents everything.

pub mod case;
pub mod growth;
mod pilot;
mod plot;
pub mod power_law;
pub mod quality;
pub mod race;
pub mod reference;
pub mod report;
mod strip;
pub mod suite;
pub mod summary;
pub mod sweep;
pub mod table;
mod timed_renderer;
