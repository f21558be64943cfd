//! From what a user asked for to [`crate::settings::Settings`]: experiment files, defaults, checks.

pub mod experiment;
pub mod resolve;
