//! Error against time: estimators and variants of their settings on the same scenes, in turns, compared with references.
//!
//! A [`suite`] says what to compare, a [`job`] is one of its scenes made ready, a [`race`] renders it once, a [`table`]
//! holds what was measured, a [`summary`] is what it amounts to, [`growth`] how costs
//! follow the size of things, and a [`report`] shows it.

pub mod growth;
pub mod job;
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
