//! A length in pixels.

use std::fmt;
use std::str::FromStr;

use super::units::number;
use crate::error::{Error, Result};

/// A radius in pixels, 0.01 to 100.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Pixels(f64);

impl Pixels {
    /// The radius within which merging gathers light in the first iteration.
    pub const DEFAULT_MERGE_RADIUS: Pixels = Pixels(1.5);

    /// The radius in pixels.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Pixels {
    type Error = Error;

    fn try_from(pixels: f64) -> Result<Pixels> {
        match (0.01..=100.0).contains(&pixels) {
            true => Ok(Pixels(pixels)),
            false => Err(Error::settings(format!("{pixels} is not a radius: choose 0.01 to 100 pixels"))),
        }
    }
}

impl From<Pixels> for f64 {
    fn from(pixels: Pixels) -> f64 {
        pixels.0
    }
}

impl FromStr for Pixels {
    type Err = Error;

    fn from_str(text: &str) -> Result<Pixels> {
        let wrong = |_| Error::settings(format!("'{text}' is not a radius in pixels: write a number such as 1.5"));
        Pixels::try_from(text.trim().parse::<f64>().map_err(wrong)?)
    }
}

impl fmt::Display for Pixels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&number(self.0))
    }
}
