//! Turns the user's input into [`crate::settings::Settings`]: experiment files, defaults, checks.

pub mod experiment;
pub mod resolve;
