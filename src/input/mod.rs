//! Turns the user's input into [`crate::settings::Settings`]: experiment files, defaults, checks. Adds
//! cameras and lights to the scene.

pub mod experiment;
pub mod light_table;
pub mod medium_tables;
pub mod named;
pub mod plain;
pub mod resolve;
pub mod response_table;
pub mod responses;
mod rows;
pub mod scan_table;
pub mod scenery;
pub mod sequence;
